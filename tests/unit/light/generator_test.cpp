#include "engine/light/atmosphere.h"
#include "engine/light/sky.h"
#include "engine/light/studio.h"
#include "tests/unit/light/light_support.h"

#include <nlohmann/json.hpp>

#include <numbers>

namespace ars {
namespace {

using test::Direction;
constexpr double kPi = std::numbers::pi;

SkyParams smallSky(float elevation) {
    SkyParams params;
    params.sunElevationDeg = elevation;
    params.width = 128;
    return params;
}

glm::dvec3 pixelAt(const Image& image, const Direction& d) {
    const glm::dvec2 place = latLongPlace(glm::normalize(d));
    const int column = std::min(static_cast<int>(place.x * image.width), image.width - 1);
    const int row = std::min(static_cast<int>(place.y * image.height), image.height - 1);
    return {image.at(row, column, 0), image.at(row, column, 1), image.at(row, column, 2)};
}

Direction brightest(const Image& image) {
    int best = 0;
    for (int i = 0; i < image.width * image.height; ++i) {
        if (image.pixels[3 * static_cast<std::size_t>(i) + 1] > image.pixels[3 * static_cast<std::size_t>(best) + 1])
            best = i;
    }
    return latLongDirection((best % image.width + 0.5) / image.width, (best / image.width + 0.5) / image.height);
}

TEST(Sky, TheSunStandsWhereItWasPut) {
    for (const float azimuth : {0.0f, 90.0f, -130.0f}) {
        SkyParams params = smallSky(30.0f);
        params.sunAzimuthDeg = azimuth;
        const auto sky = generateSky(params);
        ASSERT_TRUE(sky.ok());
        const double a = azimuth * kPi / 180.0, e = kPi / 6.0;
        const Direction expected(std::cos(e) * std::sin(a), std::sin(e), std::cos(e) * std::cos(a));
        EXPECT_NEAR(glm::length(sky->sunDirection - expected), 0.0, 1e-6);
        // A pixel is 2.8 degrees wide.
        EXPECT_GT(glm::dot(brightest(sky->environment.picture), expected), std::cos(3.0 * kPi / 180.0));
    }
}

TEST(Sky, ZenithIsBlueAndTheHorizonBrighterThanTheZenithAwayFromTheSun) {
    SkyParams params = smallSky(30.0f);
    params.sunAzimuthDeg = 0.0f;
    const auto sky = generateSky(params);
    ASSERT_TRUE(sky.ok());
    const glm::dvec3 zenith = pixelAt(sky->environment.picture, {0.01, 1, 0});
    const glm::dvec3 horizon = pixelAt(sky->environment.picture, {0.0, 0.05, -1});
    EXPECT_GT(zenith.z, 1.8 * zenith.x);
    EXPECT_GT(horizon.y, 1.5 * zenith.y);
    EXPECT_LT(horizon.z / horizon.x, zenith.z / zenith.x) << "air far away is paler";
}

TEST(Sky, SunlightReddensAsItSets) {
    const Atmosphere air(2.5, 0.2);
    double before = 0.0;
    for (const double elevation : {60.0, 20.0, 8.0, 3.0, 0.5}) {
        const glm::dvec3 sun = air.sunTransmittance(kGroundRadiusKm + 0.002, std::sin(elevation * kPi / 180.0));
        EXPECT_GT(sun.x / sun.z, before) << elevation;
        before = sun.x / sun.z;
    }
    EXPECT_GT(before, 10.0);
    EXPECT_EQ(air.sunTransmittance(kGroundRadiusKm + 0.002, -0.05), glm::dvec3(0.0));
}

TEST(Sky, PureAirDimsTheZenithSunByItsOpticalDepth) {
    // Closed form: scattering at the ground times scale height, and ozone's tent of 15 km.
    const Atmosphere air(1.0, 0.0);
    const glm::dvec3 found = air.sunTransmittance(kGroundRadiusKm, 1.0);
    const glm::dvec3 rayleigh = air.air(0.0).rayleigh * 8.0, ozone = air.air(25.0).extinction - air.air(25.0).rayleigh;
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(found[c], std::exp(-rayleigh[c] - 15.0 * ozone[c]), 3e-3);
}

TEST(Sky, PhaseFunctionsHaveTheWholeSphere) {
    double rayleigh = 0.0, aerosol = 0.0;
    const int n = 20000;
    for (int i = 0; i < n; ++i) {
        const double cosine = -1.0 + (i + 0.5) * 2.0 / n;
        rayleigh += Atmosphere::rayleighPhase(cosine) * 4.0 * kPi / n;
        aerosol += Atmosphere::aerosolPhase(cosine) * 4.0 * kPi / n;
    }
    EXPECT_NEAR(rayleigh, 1.0, 1e-6);
    EXPECT_NEAR(aerosol, 1.0, 1e-5);
}

TEST(Sky, TheDiscHoldsTheSameLightWhateverItsSizeAndThePicture) {
    const auto discFlux = [](int width, float diameter) {
        SkyParams params;
        params.width = width;
        params.sunElevationDeg = 40.0f;
        params.sunDiameterDeg = diameter;
        params.normalise = false;
        const auto with = generateSky(params);
        params.sunScale = 0.0f;
        const auto without = generateSky(params);
        return (totalFlux(with->environment.picture) - totalFlux(without->environment.picture)) *
               with->luminancePerUnit;
    };
    const Atmosphere air(2.5, 0.25);
    const glm::dvec3 expected = 128000.0 * air.sunTransmittance(kGroundRadiusKm + 0.002, std::sin(40.0 * kPi / 180.0));
    for (const auto& [width, diameter] : {std::pair{64, 0.533f}, {256, 0.533f}, {256, 5.0f}}) {
        const glm::dvec3 flux = discFlux(width, diameter);
        EXPECT_LT(glm::length(flux - expected) / glm::length(expected), 3e-3) << width << " " << diameter;
    }
}

TEST(Sky, NormalisedSkiesAreEquallyBrightAndNightIsDark) {
    for (const float elevation : {80.0f, 20.0f, 1.0f, -4.0f}) {
        const auto sky = generateSky(smallSky(elevation));
        ASSERT_TRUE(sky.ok());
        const glm::dvec3 mean = totalFlux(sky->environment.picture) / (4.0 * kPi);
        EXPECT_NEAR(0.2126 * mean.x + 0.7152 * mean.y + 0.0722 * mean.z, 0.5, 1e-3) << elevation;
        EXPECT_GT(sky->luminancePerUnit, 0.0);
        for (const float v : sky->environment.picture.pixels) ASSERT_TRUE(std::isfinite(v) && v >= 0.0f);
    }
    const auto night = generateSky(smallSky(-40.0f));
    ASSERT_TRUE(night.ok());
    for (const float v : night->environment.picture.pixels) {
        EXPECT_GT(v, 0.0f);
        EXPECT_LT(v, 0.05f);
    }
}

TEST(Sky, NoonHasTheBrightnessOfTheDaylightThatPeopleMeasure) {
    SkyParams params = smallSky(60.0f);
    params.normalise = false;
    const auto sky = generateSky(params);
    ASSERT_TRUE(sky.ok());
    // Level illuminance of a clear day with the sun at 60 degrees: 80 to 110 klx (CIE standard clear sky).
    double lux = 0.0;
    const Image& picture = sky->environment.picture;
    for (int row = 0; row < picture.height / 2; ++row) {
        for (int column = 0; column < picture.width; ++column) {
            const double top = kPi * row / picture.height, bottom = top + kPi / picture.height;
            const double y = 0.2126 * double(picture.at(row, column, 0)) + 0.7152 * double(picture.at(row, column, 1)) +
                             0.0722 * double(picture.at(row, column, 2));
            lux += y * (std::pow(std::sin(bottom), 2.0) - std::pow(std::sin(top), 2.0)) * kPi / picture.width;
        }
    }
    EXPECT_GT(lux * sky->luminancePerUnit, 80000.0);
    EXPECT_LT(lux * sky->luminancePerUnit, 115000.0);
}

TEST(Sky, ParametersOutOfRangeAreNamed) {
    SkyParams params;
    params.turbidity = 0.2f;
    const auto bad = generateSky(params);
    ASSERT_FALSE(bad.ok());
    EXPECT_EQ(bad.error().code, ErrorCode::InvalidArgument);
    EXPECT_NE(bad.error().describe().find("turbidity"), std::string::npos) << bad.error().describe();
    params.turbidity = std::nanf("");
    EXPECT_FALSE(generateSky(params).ok());
}

TEST(SunPosition, FollowsTheYearAndTheDay) {
    // Solstice noon on the tropic: overhead. Equinox noon at 50 degrees north: 40 degrees high in the south.
    EXPECT_NEAR(sunPosition(23.45, 172, 12.0).elevationDeg, 90.0, 0.5);
    const SunPosition noon = sunPosition(50.0, 81, 12.0, 180.0);
    EXPECT_NEAR(noon.elevationDeg, 40.0, 0.5);
    EXPECT_NEAR(std::remainder(noon.azimuthDeg, 360.0), 0.0, 0.5) << "south is in front when north is behind";
    // In the morning the sun is in the east: to the right of somebody who looks north, so at their -90 degrees.
    const SunPosition morning = sunPosition(50.0, 81, 6.0, 0.0);
    EXPECT_NEAR(std::remainder(morning.azimuthDeg + 90.0, 360.0), 0.0, 1.0);
    EXPECT_NEAR(morning.elevationDeg, 0.0, 0.5);
    EXPECT_LT(sunPosition(50.0, 355, 0.0).elevationDeg, -60.0);
}

TEST(Studio, AWhiteCardBeforeALampHasItsIntensity) {
    for (const float elevation : {0.0f, 35.0f, 90.0f}) {
        for (const float side : {0.02f, 0.5f, 3.0f}) {
            for (const LampShape shape : {LampShape::Rectangle, LampShape::Round}) {
                StudioParams studio;
                studio.floorRadiance = studio.horizonRadiance = studio.ceilingRadiance = 0.0f;
                studio.width = 256;
                StudioLamp lamp;
                lamp.shape = shape;
                lamp.elevationDeg = elevation;
                lamp.widthM = lamp.heightM = side;
                lamp.intensity = 1.5f;
                lamp.temperatureK = 6504.0f;
                studio.lamps.push_back(lamp);
                const auto environment = generateStudio(studio);
                ASSERT_TRUE(environment.ok()) << environment.error().describe();
                const double a = lamp.azimuthDeg * kPi / 180.0, e = elevation * kPi / 180.0;
                const Direction n(std::cos(e) * std::sin(a), std::sin(e), std::cos(e) * std::cos(a));
                const Image& picture = environment->picture;
                double received = 0.0;
                for (int row = 0; row < picture.height; ++row) {
                    for (int column = 0; column < picture.width; ++column) {
                        const double top = kPi * row / picture.height, bottom = top + kPi / picture.height;
                        const Direction d =
                            latLongDirection((column + 0.5) / picture.width, (row + 0.5) / picture.height);
                        received += double(picture.at(row, column, 1)) * std::max(glm::dot(n, d), 0.0) *
                                    (std::cos(top) - std::cos(bottom)) * 2.0 * kPi / picture.width;
                    }
                }
                const double green = blackBodyColor(6504.0).y;
                EXPECT_NEAR(received / kPi, 1.5 * green, 2e-3) << elevation << " " << side;
            }
        }
    }
}

TEST(Studio, LampsStandWhereTheyWerePut) {
    StudioParams studio = studioPreset(StudioPreset::Rim);
    studio.lamps.resize(1);
    studio.lamps[0].azimuthDeg = 90.0f;
    studio.lamps[0].elevationDeg = 0.0f;
    studio.lamps[0].softness = 1.0f;
    studio.width = 256;
    const auto environment = generateStudio(studio);
    ASSERT_TRUE(environment.ok());
    EXPECT_GT(glm::dot(brightest(environment->picture), Direction(1, 0, 0)), 0.99);
}

TEST(Studio, PresetsAreSoundAndSurviveJson) {
    for (int k = 0; k < 4; ++k) {
        StudioParams studio = studioPreset(static_cast<StudioPreset>(k));
        studio.width = 64;
        EXPECT_FALSE(studio.lamps.empty());
        const auto again = studioFromJson(studioToJson(studio));
        ASSERT_TRUE(again.ok()) << again.error().describe();
        const auto a = generateStudio(studio), b = generateStudio(*again);
        ASSERT_TRUE(a.ok() && b.ok());
        EXPECT_EQ(a->picture.pixels, b->picture.pixels);
        for (const float v : a->picture.pixels) ASSERT_TRUE(std::isfinite(v) && v >= 0.0f);
    }
}

TEST(Studio, BadLampsAreNamed) {
    StudioParams studio = studioPreset(StudioPreset::ThreePoint);
    studio.lamps[1].distanceM = 0.0f;
    const auto bad = generateStudio(studio);
    ASSERT_FALSE(bad.ok());
    EXPECT_NE(bad.error().describe().find("\"fill\""), std::string::npos) << bad.error().describe();
    EXPECT_NE(bad.error().describe().find("distance"), std::string::npos) << bad.error().describe();
    studio.lamps.assign(1000, StudioLamp{});
    EXPECT_EQ(generateStudio(studio).error().code, ErrorCode::LimitExceeded);
    EXPECT_FALSE(studioFromJson(nlohmann::json{{"lamps", 3}}).ok());
    EXPECT_FALSE(studioFromJson(nlohmann::json{{"lamps", {{{"intensity", "bright"}}}}}).ok());
}

TEST(BlackBody, IsWhiteAtDaylightWarmBelowAndCoolAbove) {
    // Planckian 6504 K lies a little beside D65.
    EXPECT_LT(glm::length(blackBodyColor(6504.0) - glm::dvec3(1.0)), 0.06);
    const glm::dvec3 lamp = blackBodyColor(2856.0);
    // Illuminant A, chromaticity (0.44757, 0.40745), through the matrix of IEC 61966-2-1 by hand.
    EXPECT_NEAR(lamp.x, 1.845, 0.01);
    EXPECT_NEAR(lamp.y, 0.826, 0.01);
    EXPECT_NEAR(lamp.z, 0.233, 0.01);
    EXPECT_GT(blackBodyColor(12000.0).z, 1.2);
    for (const double t : {500.0, 1667.0, 2222.0, 4000.0, 25000.0, 1e6}) {
        const glm::dvec3 c = blackBodyColor(t);
        EXPECT_NEAR(0.2126 * c.x + 0.7152 * c.y + 0.0722 * c.z, 1.0, 0.05) << t;
    }
}

} // namespace
} // namespace ars
