#include "engine/light/sky.h"

#include "engine/core/parallel.h"
#include "engine/core/parameter_ranges.h"
#include "engine/light/atmosphere.h"
#include "engine/light/cube_map.h"

#include <algorithm>
#include <cmath>

namespace ars {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kSunIlluminance = 128000.0; ///< above the air, lux
constexpr double kPlainUnit = 20000.0;       ///< cd/m^2 of the value 1 without normalise
constexpr double kMeanRadiance = 0.5;        ///< of a normalised sky, over all directions
constexpr double kDarkestUnit = 0.1;         ///< cd/m^2: deep night stays dark
constexpr double kEyeRadiusKm = kGroundRadiusKm + 0.002;
/// Light of a moonless night (air glow and stars), cd/m^2.
const glm::dvec3 kNightGlow(2.4e-4, 2.9e-4, 3.6e-4);

constexpr int kAzimuths = 33, kElevations = 97, kSteps = 40;

double luminance(const glm::dvec3& color) { return 0.2126 * color.x + 0.7152 * color.y + 0.0722 * color.z; }

/// Scattering over the sky without phase functions, which are sharp; what is left is smooth in both angles. The sky is
/// symmetrical about the sun's meridian.
class SkyTable {
public:
    SkyTable(const Atmosphere& air, double sunElevation, bool below) : below_(below) {
        nodes_.resize(static_cast<std::size_t>(kAzimuths * kElevations));
        const double sunCosine = std::sin(sunElevation), sunSine = std::cos(sunElevation);
        parallelFor(
            nodes_.size(),
            [&](std::size_t i) {
                const double azimuth = kPi * static_cast<double>(i % kAzimuths) / (kAzimuths - 1);
                const double place = static_cast<double>(i / kAzimuths) / (kElevations - 1);
                // The horizon itself belongs to both halves; each is a hair on its own side of it.
                const double elevation = (below ? -1.0 : 1.0) * std::max(0.5 * kPi * place * place, 1e-5) +
                                         (below ? horizonElevation() : 0.0);
                const double cosine = std::sin(elevation);
                const double viewSun = cosine * sunCosine + std::cos(elevation) * sunSine * std::cos(azimuth);
                nodes_[i] = air.march(kEyeRadiusKm, cosine, sunCosine, viewSun, kSteps);
            },
            16);
    }

    RayLight at(double azimuth, double elevation) const {
        const double height = below_ ? horizonElevation() - elevation : elevation;
        const double y = std::sqrt(std::clamp(height / (0.5 * kPi), 0.0, 1.0)) * (kElevations - 1);
        const double x = std::clamp(azimuth / kPi, 0.0, 1.0) * (kAzimuths - 1);
        const std::size_t y0 = std::min(static_cast<std::size_t>(y), static_cast<std::size_t>(kElevations - 2));
        const std::size_t x0 = std::min(static_cast<std::size_t>(x), static_cast<std::size_t>(kAzimuths - 2));
        const double fy = y - static_cast<double>(y0), fx = x - static_cast<double>(x0);
        const RayLight* row = &nodes_[y0 * kAzimuths + x0];
        RayLight sum;
        sum.transmittance = glm::dvec3(0.0);
        const auto add = [&sum](const RayLight& node, double weight) {
            sum.rayleigh += weight * node.rayleigh;
            sum.aerosol += weight * node.aerosol;
            sum.multiple += weight * node.multiple;
            sum.transmittance += weight * node.transmittance;
        };
        add(row[0], (1.0 - fx) * (1.0 - fy));
        add(row[1], fx * (1.0 - fy));
        add(row[kAzimuths], (1.0 - fx) * fy);
        add(row[kAzimuths + 1], fx * fy);
        return sum;
    }

private:
    /// Where the sea meets the sky for eyes two metres up: 0.045 degrees below level.
    static double horizonElevation() { return -std::acos(kGroundRadiusKm / kEyeRadiusKm); }

    std::vector<RayLight> nodes_;
    bool below_;
};

/// Everything that a pixel asks; radiance for a sun of irradiance 1.
struct SkyModel {
    Atmosphere air;
    double sunElevation;
    glm::dvec3 sun; ///< direction
    SkyTable upper, lower;
    glm::dvec3 ground{0.0}; ///< radiance of the ground

    SkyModel(const SkyParams& params, double elevation, const glm::dvec3& direction)
        : air(params.turbidity, params.groundAlbedo), sunElevation(elevation), sun(direction),
          upper(air, elevation, false), lower(air, elevation, true) {
        const double sunCosine = std::sin(elevation);
        const glm::dvec3 direct = std::max(sunCosine, 0.0) * air.sunTransmittance(kEyeRadiusKm, sunCosine);
        ground = static_cast<double>(params.groundAlbedo) / kPi * (direct + skyIrradiance());
    }

    glm::dvec3 scattered(const RayLight& light, double cosine) const {
        return light.rayleigh * Atmosphere::rayleighPhase(cosine) + light.aerosol * Atmosphere::aerosolPhase(cosine) +
               light.multiple;
    }

    /// On level ground, without the sun itself.
    glm::dvec3 skyIrradiance() const {
        constexpr int kRows = 48, kColumns = 48;
        glm::dvec3 sum(0.0);
        for (int i = 0; i < kRows; ++i) {
            // Equal steps of sin^2: every sample counts alike under the cosine.
            const double elevation = std::asin(std::sqrt((i + 0.5) / kRows));
            for (int j = 0; j < kColumns; ++j) {
                const double azimuth = kPi * (j + 0.5) / kColumns;
                const double cosine = std::sin(elevation) * std::sin(sunElevation) +
                                      std::cos(elevation) * std::cos(sunElevation) * std::cos(azimuth);
                sum += scattered(upper.at(azimuth, elevation), cosine);
            }
        }
        return sum * kPi / static_cast<double>(kRows * kColumns);
    }

    glm::dvec3 radiance(const glm::dvec3& direction, double sunAzimuth) const {
        const double elevation = std::asin(std::clamp(direction.y, -1.0, 1.0));
        double azimuth = std::fabs(std::atan2(direction.x, direction.z) - sunAzimuth);
        azimuth = std::fmod(azimuth, 2.0 * kPi);
        if (azimuth > kPi) azimuth = 2.0 * kPi - azimuth;
        const RayLight light = elevation >= 0.0 ? upper.at(azimuth, elevation) : lower.at(azimuth, elevation);
        glm::dvec3 color = scattered(light, glm::dot(direction, sun));
        if (elevation < 0.0) color += light.transmittance * ground;
        return color;
    }
};

void fillSky(const SkyModel& model, double sunAzimuth, Image& picture) {
    parallelFor(
        static_cast<std::size_t>(picture.height),
        [&](std::size_t row) {
            for (int column = 0; column < picture.width; ++column) {
                const glm::dvec3 color =
                    kSunIlluminance *
                        model.radiance(latLongDirection((column + 0.5) / picture.width,
                                                        (static_cast<double>(row) + 0.5) / picture.height),
                                       sunAzimuth) +
                    kNightGlow;
                for (int c = 0; c < 3; ++c) picture.at(static_cast<int>(row), column, c) = static_cast<float>(color[c]);
            }
        },
        8);
}

/// Adds one bundle of sunlight (lux) to the pixels around its place; the sum over pixels of radiance times solid angle
/// is the bundle, however small a pixel is.
void addBundle(Image& picture, const glm::dvec3& direction, const glm::dvec3& flux) {
    const glm::dvec2 place = latLongPlace(direction);
    const double x = place.x * picture.width - 0.5, y = place.y * picture.height - 0.5;
    const int x0 = static_cast<int>(std::floor(x)), y0 = static_cast<int>(std::floor(y));
    for (int k = 0; k < 4; ++k) {
        const int column = x0 + (k & 1), row = std::clamp(y0 + (k >> 1), 0, picture.height - 1);
        const double weight = std::fabs(1.0 - (k & 1) - (x - x0)) * std::fabs(1.0 - (k >> 1) - (y - y0));
        const double top = kPi * row / picture.height;
        const double solidAngle = (std::cos(top) - std::cos(top + kPi / picture.height)) * 2.0 * kPi / picture.width;
        for (int c = 0; c < 3; ++c) {
            picture.at(row, (column + picture.width) % picture.width, c) +=
                static_cast<float>(flux[c] * weight / solidAngle);
        }
    }
}

/// The disc as bundles of equal share, each dimmed by the air on its own way and gone below the horizon.
void addSun(const SkyModel& model, const SkyParams& params, Image& picture) {
    constexpr int kRings = 24, kSpokes = 48;
    const double radius = 0.5 * static_cast<double>(params.sunDiameterDeg) * kPi / 180.0;
    const glm::dvec3 side = glm::normalize(
        glm::cross(std::fabs(model.sun.y) < 0.99 ? glm::dvec3(0, 1, 0) : glm::dvec3(1, 0, 0), model.sun));
    const glm::dvec3 above = glm::cross(model.sun, side);
    const double share = kSunIlluminance * static_cast<double>(params.sunScale) / (kRings * kSpokes);
    for (int i = 0; i < kRings; ++i) {
        const double reach = radius * std::sqrt((i + 0.5) / kRings);
        for (int j = 0; j < kSpokes; ++j) {
            const double angle = 2.0 * kPi * (j + 0.5 * (i % 2)) / kSpokes;
            const glm::dvec3 direction =
                std::cos(reach) * model.sun + std::sin(reach) * (std::cos(angle) * side + std::sin(angle) * above);
            if (direction.y <= 0.0) continue;
            addBundle(picture, direction, share * model.air.sunTransmittance(kEyeRadiusKm, direction.y));
        }
    }
}

} // namespace

const ParameterTable<SkyParams>& skyParameters() {
    using S = SkyParams;
    using enum ParameterTier;
    static const ParameterTable<SkyParams> table{
        {"sun_elevation", &S::sunElevationDeg, {-90, 90}, "deg", Basic, "Height of the sun; below -18 it is night."},
        {"sun_azimuth", &S::sunAzimuthDeg, {-360, 360}, "deg", Basic, "0 in front of the body, 90 at its left."},
        {"turbidity", &S::turbidity, {1, 10}, "", Basic, "Haze: 1 clear mountain air, 10 thick haze."},
        {"ground_albedo", &S::groundAlbedo, {0, 1}, "", Basic, "Brightness of the ground."},
        {"sun", &S::sunScale, {0, 10}, "", Basic, "Brightness of the sun's disc; 0 hides it."},
        {"sun_diameter", &S::sunDiameterDeg, {0.1, 30}, "deg", Advanced, "Size of the disc; its light stays the same."},
        {"normalise", &S::normalise, {}, "", Advanced, "Same brightness at every hour."},
        {"width", &S::width, {16, 8192}, "px", Expert, "Width of the picture; its height is half of it."},
    };
    return table;
}

Result<Sky> generateSky(const SkyParams& params) {
    ARS_TRY_STATUS(checkRanges(skyParameters(), params, "sky"));
    const double elevation = static_cast<double>(params.sunElevationDeg) * kPi / 180.0;
    const double azimuth = static_cast<double>(params.sunAzimuthDeg) * kPi / 180.0;
    Sky sky;
    sky.sunDirection = {std::cos(elevation) * std::sin(azimuth), std::sin(elevation),
                        std::cos(elevation) * std::cos(azimuth)};
    sky.environment = uniformEnvironment(0.0f, params.width / 2 * 2);
    Image& picture = sky.environment.picture;
    const SkyModel model(params, elevation, sky.sunDirection);
    fillSky(model, azimuth, picture);
    if (params.sunScale > 0.0f) addSun(model, params, picture);
    sky.luminancePerUnit = kPlainUnit;
    if (params.normalise) {
        const double mean = luminance(totalFlux(picture)) / (4.0 * kPi);
        sky.luminancePerUnit = std::max(mean / kMeanRadiance, kDarkestUnit);
    }
    const float scale = static_cast<float>(1.0 / sky.luminancePerUnit);
    for (float& v : picture.pixels) v *= scale;
    return sky;
}

SunPosition sunPosition(double latitudeDeg, int dayOfYear, double solarTimeHours, double northAzimuthDeg) {
    const double degree = kPi / 180.0;
    // Cooper's declination; the hour angle grows 15 degrees an hour from noon.
    const double declination = 23.45 * degree * std::sin(2.0 * kPi * (284.0 + dayOfYear) / 365.0);
    const double hour = 15.0 * degree * (solarTimeHours - 12.0), latitude = latitudeDeg * degree;
    const double up =
        std::sin(latitude) * std::sin(declination) + std::cos(latitude) * std::cos(declination) * std::cos(hour);
    const double north =
        std::cos(latitude) * std::sin(declination) - std::sin(latitude) * std::cos(declination) * std::cos(hour);
    const double east = -std::cos(declination) * std::sin(hour);
    SunPosition position;
    position.elevationDeg = std::asin(std::clamp(up, -1.0, 1.0)) / degree;
    // Seen from above in this frame (x left, z front), east lies a quarter before north as azimuths count.
    position.azimuthDeg = northAzimuthDeg - std::atan2(east, north) / degree;
    return position;
}

} // namespace ars
