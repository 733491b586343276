#include "engine/frame/buffer_catalogue.h"
#include "engine/frame/display.h"
#include "engine/frame/framing.h"

#include <gtest/gtest.h>

#include <cmath>
#include <set>

namespace ars {
namespace {

TEST(BufferCatalogue, EveryRowStandsAtItsPlaceUnderAnOwnName) {
    std::set<std::string_view> names;
    int index = 0;
    for (const BufferInfo& info : bufferCatalogue()) {
        EXPECT_EQ(static_cast<int>(info.id), index++);
        EXPECT_TRUE(names.insert(info.name).second) << info.name;
        EXPECT_LT(info.minimum, info.maximum);
        if (info.channel) {
            EXPECT_EQ(info.name, channelName(*info.channel));
            EXPECT_EQ(info.channels(), channelWidth(*info.channel)) << info.name;
        }
    }
    EXPECT_EQ(index, kBufferCount);
}

TEST(BufferCatalogue, WordsChooseBuffers) {
    const auto some = parseBuffers("albedo,ao,albedo");
    ASSERT_TRUE(some.ok());
    EXPECT_EQ(*some, (std::vector<BufferId>{BufferId::Albedo, BufferId::AmbientOcclusion}));
    const auto all = parseBuffers("all");
    ASSERT_TRUE(all.ok());
    EXPECT_EQ(all->size(), static_cast<std::size_t>(kBufferCount - 2)) << "R+ and R- are training's";
    for (const char* bad : {"", "albedo,", "colour", "Albedo"}) {
        const auto result = parseBuffers(bad);
        ASSERT_FALSE(result.ok()) << bad;
        EXPECT_NE(result.error().message.find("there are all, beauty, radiance"), std::string::npos);
    }
}

TEST(ColorMap, FollowsThePublishedTables) {
    // Entries of matplotlib's listed colour maps at 0, 1/2 and 1.
    const struct {
        ColorMap map;
        float t;
        glm::vec3 expected;
        float tolerance;
    } rows[] = {{ColorMap::Viridis, 0.0f, {0.267f, 0.005f, 0.329f}, 0.02f},
                {ColorMap::Viridis, 0.5f, {0.128f, 0.567f, 0.551f}, 0.02f},
                {ColorMap::Viridis, 1.0f, {0.993f, 0.906f, 0.144f}, 0.02f},
                {ColorMap::Magma, 0.5f, {0.716f, 0.215f, 0.475f}, 0.02f},
                {ColorMap::Magma, 1.0f, {0.987f, 0.991f, 0.750f}, 0.02f},
                {ColorMap::Turbo, 0.0f, {0.190f, 0.072f, 0.232f}, 0.13f},
                {ColorMap::Turbo, 0.5f, {0.644f, 0.990f, 0.234f}, 0.085f},
                {ColorMap::Gray, 0.25f, {0.25f, 0.25f, 0.25f}, 1e-6f},
                {ColorMap::Signed, 0.5f, {0.96f, 0.96f, 0.96f}, 1e-6f}};
    for (const auto& row : rows) {
        const glm::vec3 color = mapColor(row.map, row.t);
        for (int c = 0; c < 3; ++c) {
            EXPECT_NEAR(color[c], row.expected[c], row.tolerance) << colorMapName(row.map) << " at " << row.t;
        }
    }
    EXPECT_EQ(mapColor(ColorMap::Viridis, NAN), glm::vec3(1, 0, 1));
    EXPECT_EQ(mapColor(ColorMap::Gray, -3.0f), glm::vec3(0.0f));
    EXPECT_EQ(mapColor(ColorMap::Gray, INFINITY), glm::vec3(1.0f));
}

Image onePixel(std::vector<float> values) {
    Image image;
    image.width = image.height = 1;
    image.channels = static_cast<int>(values.size());
    image.pixels = std::move(values);
    return image;
}

std::vector<float> shown(BufferId id, std::vector<float> value, float opacity, const DisplaySettings& settings = {}) {
    const auto result = displayPicture(id, onePixel(std::move(value)), onePixel({opacity}), settings);
    EXPECT_TRUE(result.ok()) << result.error().describe();
    return result.ok() ? result->pixels : std::vector<float>{};
}

TEST(Display, LightIsEncodedAndLiesOverTheBackground) {
    DisplaySettings settings;
    settings.tone.backgroundGreen = 0.5f;
    const std::vector<float> full = shown(BufferId::Beauty, {0.2f, 0.4f, 2.0f, 1.0f}, 1.0f, settings);
    EXPECT_NEAR(full[0], linearToSrgb(0.2f), 1e-5);
    EXPECT_NEAR(full[2], 1.0f, 1e-6);
    const std::vector<float> half = shown(BufferId::Beauty, {0.1f, 0.2f, 0.3f, 0.5f}, 0.5f, settings);
    EXPECT_NEAR(half[0], linearToSrgb(0.1f), 1e-5) << "premultiplied: nothing is multiplied again";
    EXPECT_NEAR(half[1], linearToSrgb(0.2f + 0.25f), 1e-5);
    settings.tone.exposureEv = 1.0f;
    EXPECT_NEAR(shown(BufferId::Diffuse, {0.2f, 0.2f, 0.2f}, 1.0f, settings)[0], linearToSrgb(0.4f), 1e-5);
}

TEST(Display, DataGoThroughTheirColoursWithoutExposure) {
    DisplaySettings settings;
    settings.tone.exposureEv = 5.0f;
    EXPECT_NEAR(shown(BufferId::Albedo, {0.2f, 0.5f, 1.0f}, 1.0f, settings)[0], linearToSrgb(0.2f), 1e-6);
    EXPECT_NEAR(shown(BufferId::Radiance, {0.2f, 0.5f, 1.0f}, 1.0f, settings)[0], 0.2f, 1e-6);
    const std::vector<float> facing = shown(BufferId::Normal, {0.0f, 0.0f, -1.0f}, 1.0f);
    EXPECT_NEAR(facing[0], 0.5f, 1e-6);
    EXPECT_NEAR(facing[2], 1.0f, 1e-6) << "what faces the camera is light blue, as in every normal map";
    EXPECT_NEAR(shown(BufferId::Normal, {0.0f, -1.0f, 0.0f}, 1.0f)[1], 1.0f, 1e-6) << "upwards is green";
    settings.range = std::pair{2.0f, 4.0f};
    settings.colorMap = ColorMap::Gray;
    EXPECT_NEAR(shown(BufferId::Depth, {2.5f}, 1.0f, settings)[0], 0.25f, 1e-6);
    EXPECT_EQ(shown(BufferId::Opacity, {0.25f}, 0.25f)[0], 0.25f) << "opacity has no background";
}

TEST(Display, TransparentPicturesHaveStraightAlpha) {
    DisplaySettings settings;
    settings.tone.transparent = true;
    const std::vector<float> light = shown(BufferId::Beauty, {0.1f, 0.1f, 0.1f, 0.5f}, 0.5f, settings);
    ASSERT_EQ(light.size(), 4u);
    EXPECT_NEAR(light[0], linearToSrgb(0.2f), 1e-5);
    EXPECT_NEAR(light[3], 0.5f, 1e-6);
    EXPECT_EQ(shown(BufferId::Roughness, {0.3f}, 0.5f, settings).size(), 4u);
}

TEST(Display, WhatDoesNotFitIsRefused) {
    EXPECT_FALSE(displayPicture(BufferId::Depth, onePixel({1, 2, 3}), onePixel({1}), {}).ok());
    DisplaySettings settings;
    settings.range = std::pair{1.0f, 1.0f};
    EXPECT_FALSE(displayPicture(BufferId::Depth, onePixel({1}), onePixel({1}), settings).ok());
}

TEST(Display, TheBackdropShowsTheLightWhereItHangs) {
    // One bright texel at +z, then the light turned by 90 degrees: it must appear at +x.
    Environment environment;
    environment.picture.width = 64;
    environment.picture.height = 32;
    environment.picture.channels = 3;
    environment.picture.pixels.assign(64 * 32 * 3, 0.0f);
    for (int row = 14; row < 18; ++row) {
        for (int column = 30; column < 34; ++column) environment.picture.at(row, column, 0) = 8.0f;
    }
    const auto seen = [&](glm::dvec3 direction, float rotationDeg) {
        const Camera camera = lookAtCamera({0, 0, 0}, direction, 10.0, 1, 1);
        Image beauty = onePixel({0.0f, 0.0f, 0.0f, 0.25f});
        EXPECT_TRUE(addBackdrop(beauty, camera, environment, {rotationDeg, 0.5f}).ok());
        EXPECT_EQ(beauty.pixels[3], 1.0f);
        return beauty.pixels[0];
    };
    EXPECT_NEAR(seen({0, 0, 1}, 0.0f), 0.75f * 0.5f * 8.0f, 1e-4);
    EXPECT_NEAR(seen({1, 0, 0}, 0.0f), 0.0f, 1e-6);
    EXPECT_NEAR(seen({1, 0, 0}, 90.0f), 3.0f, 1e-4);
    EXPECT_NEAR(seen({0, 0, 1}, 90.0f), 0.0f, 1e-6);
}

TEST(Display, BytesAreRoundedToNearest) {
    const Image image = onePixel({0.5f, -1.0f, 2.0f, 0.3f});
    EXPECT_EQ(displayBytes(image), (std::vector<std::uint8_t>{128, 0, 255}));
}

TEST(Framing, TheWholeBoxIsInEveryPictureOfATurn) {
    const Bounds bounds{{-0.9f, 0.0f, -0.3f}, {0.9f, 1.8f, 0.25f}};
    double fullest = 0;
    for (const auto& [width, height] : {std::pair{512, 512}, {320, 640}, {640, 320}}) {
        for (double azimuth = 0; azimuth < 360; azimuth += 15) {
            for (const double elevation : {-30.0, 8.0, 60.0}) {
                const Camera camera = orbitCamera(bounds, azimuth, elevation, 30.0, width, height);
                for (int corner = 0; corner < 8; ++corner) {
                    const glm::dvec3 p((corner & 1 ? bounds.high : bounds.low).x,
                                       (corner & 2 ? bounds.high : bounds.low).y,
                                       (corner & 4 ? bounds.high : bounds.low).z);
                    const glm::dvec3 seen = camera.toCamera(p);
                    ASSERT_GT(seen.z, 0.0);
                    const glm::dvec2 pixel = camera.project(seen);
                    EXPECT_GE(std::min(pixel.x, pixel.y), 0.0);
                    EXPECT_LE(pixel.x, width);
                    EXPECT_LE(pixel.y, height);
                    fullest = std::max({fullest, std::abs(pixel.x / width - 0.5), std::abs(pixel.y / height - 0.5)});
                }
            }
        }
    }
    EXPECT_GT(fullest, 0.42) << "the picture is not wasted";
}

TEST(Framing, AzimuthZeroSeesTheFrontAndNinetyTheLeft) {
    const Bounds bounds{{-1, 0, -1}, {1, 2, 1}};
    EXPECT_GT(orbitCamera(bounds, 0, 0, 30, 100, 100).centerWorld().z, 3.0);
    EXPECT_GT(orbitCamera(bounds, 90, 0, 30, 100, 100).centerWorld().x, 3.0);
}

} // namespace
} // namespace ars
