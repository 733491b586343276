#include "engine/light/studio.h"

#include "engine/core/parallel.h"
#include "engine/core/parameter_ranges.h"
#include "engine/light/cube_map.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>

namespace ars {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr std::size_t kMaxLamps = 64;
/// Samples of a pixel along an axis; edges of lamps get as many steps between dark and bright.
constexpr int kSamples = 4;

double radians(double degrees) { return degrees * kPi / 180.0; }

double smoothStep(double from, double to, double x) {
    const double t = std::clamp((x - from) / (to - from), 0.0, 1.0);
    return t * t * (3.0 - 2.0 * t);
}

/// A lamp as rays from the origin meet it.
struct LampPlane {
    glm::dvec3 towards, right, up;
    double halfWidth, halfHeight; ///< at distance 1
    double softness;
    bool round;
    double reach; ///< cosine of the angle beyond which nothing of it is seen

    explicit LampPlane(const StudioLamp& lamp)
        : halfWidth(0.5 * lamp.widthM / lamp.distanceM), halfHeight(0.5 * lamp.heightM / lamp.distanceM),
          softness(lamp.softness), round(lamp.shape == LampShape::Round) {
        const double azimuth = radians(lamp.azimuthDeg), elevation = radians(lamp.elevationDeg);
        towards = {std::cos(elevation) * std::sin(azimuth), std::sin(elevation),
                   std::cos(elevation) * std::cos(azimuth)};
        // Straight above or below, the azimuth alone says where the lamp's own up points.
        const glm::dvec3 level(std::cos(azimuth), 0.0, -std::sin(azimuth));
        const glm::dvec3 upright = glm::cross(towards, level);
        const double roll = radians(lamp.rollDeg);
        right = std::cos(roll) * level + std::sin(roll) * upright;
        up = glm::cross(towards, right);
        reach = 1.0 / std::sqrt(1.0 + halfWidth * halfWidth + halfHeight * halfHeight);
    }

    /// Brightness along a unit direction, 0 beside the lamp, 1 where it is brightest.
    double profile(const glm::dvec3& direction) const {
        const double along = glm::dot(direction, towards);
        if (along <= 0.0) return 0.0;
        const double x = glm::dot(direction, right) / (along * halfWidth);
        const double y = glm::dot(direction, up) / (along * halfHeight);
        const double start = 1.0 - softness;
        const auto edge = [&](double r) {
            if (r >= 1.0) return 0.0;
            return r <= start ? 1.0 : 1.0 - smoothStep(start, 1.0, r);
        };
        return round ? edge(std::sqrt(x * x + y * y)) : edge(std::fabs(x)) * edge(std::fabs(y));
    }
};

struct LitPixel {
    std::size_t index;
    double profile; ///< mean over the pixel
};

/// The pixels that a lamp lights, in row order, and its irradiance on a card that faces it for a profile of 1.
std::vector<LitPixel> rasterise(const LampPlane& lamp, int width, int height, double& irradiance) {
    std::vector<std::vector<LitPixel>> rows(static_cast<std::size_t>(height));
    std::vector<double> received(rows.size(), 0.0);
    const double margin = std::cos(std::min(std::acos(lamp.reach) + 2.0 * kPi / height, kPi));
    parallelFor(
        rows.size(),
        [&](std::size_t row) {
            for (int column = 0; column < width; ++column) {
                const double u = (column + 0.5) / width, v = (static_cast<double>(row) + 0.5) / height;
                if (glm::dot(latLongDirection(u, v), lamp.towards) < margin) continue;
                double sum = 0.0;
                for (int k = 0; k < kSamples * kSamples; ++k) {
                    const double su = (column + (k % kSamples + 0.5) / kSamples) / width;
                    const double sv = (static_cast<double>(row) + (k / kSamples + 0.5) / kSamples) / height;
                    sum += lamp.profile(latLongDirection(su, sv));
                }
                if (sum <= 0.0) continue;
                const double mean = sum / (kSamples * kSamples);
                const double top = kPi * static_cast<double>(row) / height, bottom = top + kPi / height;
                const double solidAngle = (std::cos(top) - std::cos(bottom)) * 2.0 * kPi / width;
                rows[row].push_back({row * static_cast<std::size_t>(width) + static_cast<std::size_t>(column), mean});
                received[row] += mean * solidAngle * std::max(glm::dot(latLongDirection(u, v), lamp.towards), 0.0);
            }
        },
        8);
    std::vector<LitPixel> lit;
    irradiance = 0.0;
    for (std::size_t row = 0; row < rows.size(); ++row) {
        lit.insert(lit.end(), rows[row].begin(), rows[row].end());
        irradiance += received[row];
    }
    return lit;
}

void addLamp(const StudioLamp& lamp, Image& picture) {
    const LampPlane plane(lamp);
    double irradiance = 0.0;
    std::vector<LitPixel> lit = rasterise(plane, picture.width, picture.height, irradiance);
    if (!(irradiance > 0.0)) {
        // Too small for any sample: the one pixel that it lies in.
        const glm::dvec2 place = latLongPlace(plane.towards);
        const int column = std::min(static_cast<int>(place.x * picture.width), picture.width - 1);
        const int row = std::min(static_cast<int>(place.y * picture.height), picture.height - 1);
        const double top = kPi * row / picture.height;
        irradiance = (std::cos(top) - std::cos(top + kPi / picture.height)) * 2.0 * kPi / picture.width;
        lit = {
            {static_cast<std::size_t>(row) * static_cast<std::size_t>(picture.width) + static_cast<std::size_t>(column),
             1.0}};
    }
    const glm::dvec3 tint(lamp.tintRed, lamp.tintGreen, lamp.tintBlue);
    const glm::dvec3 radiance = blackBodyColor(lamp.temperatureK) * tint * (lamp.intensity * kPi / irradiance);
    for (const LitPixel& pixel : lit) {
        for (std::size_t c = 0; c < 3; ++c) {
            picture.pixels[3 * pixel.index + c] += static_cast<float>(radiance[static_cast<int>(c)] * pixel.profile);
        }
    }
}

/// Grey room: the floor fades into the horizon as a studio's paper sweep does.
void fillRoom(const StudioParams& params, Image& picture) {
    for (int row = 0; row < picture.height; ++row) {
        const double y = std::cos(kPi * (row + 0.5) / picture.height);
        const double horizon = params.horizonRadiance;
        const double value = y < 0.0 ? horizon + (params.floorRadiance - horizon) * smoothStep(0.0, 0.8, -y)
                                     : horizon + (params.ceilingRadiance - horizon) * smoothStep(0.0, 1.0, y);
        for (int column = 0; column < picture.width; ++column) {
            for (int c = 0; c < 3; ++c) picture.at(row, column, c) = static_cast<float>(value);
        }
    }
}

std::string lampPlace(std::size_t index, const StudioLamp& lamp) {
    return fmt::format("lamp {} \"{}\"", index, lamp.name);
}

} // namespace

const ParameterTable<StudioLamp>& studioLampParameters() {
    using L = StudioLamp;
    using enum ParameterTier;
    static const ParameterTable<StudioLamp> table{
        {"name", &L::name, {}, "", Basic, "What the lamp is called."},
        {"shape", &L::shape, {}, "", Basic, "Soft box or beauty dish."},
        {"azimuth", &L::azimuthDeg, {-360, 360}, "deg", Basic, "Direction; 0 in front of the body, 90 at its left."},
        {"elevation", &L::elevationDeg, {-90, 90}, "deg", Basic, "Height above the horizon."},
        {"distance", &L::distanceM, {0.1, 100}, "m", Basic, "From the subject; farther lamps look smaller."},
        {"width", &L::widthM, {0.01, 20}, "m", Basic, "Width of the lamp."},
        {"height", &L::heightM, {0.01, 20}, "m", Basic, "Height of the lamp."},
        {"roll", &L::rollDeg, {-180, 180}, "deg", Advanced, "Turn about the lamp's own axis."},
        {"softness", &L::softness, {0, 1}, "", Basic, "0 hard edge, 1 bright only in the middle."},
        {"intensity", &L::intensity, {0, 1000}, "", Basic, "Radiance of a white card that faces the lamp."},
        {"temperature", &L::temperatureK, {1667, 25000}, "K", Basic, "Colour temperature; 6504 is about white."},
        {"tint_red", &L::tintRed, {0, 1}, "", Advanced, "Filter over the lamp, linear red."},
        {"tint_green", &L::tintGreen, {0, 1}, "", Advanced, "Filter over the lamp, linear green."},
        {"tint_blue", &L::tintBlue, {0, 1}, "", Advanced, "Filter over the lamp, linear blue."},
    };
    return table;
}

const ParameterTable<StudioParams>& studioParameters() {
    using S = StudioParams;
    using enum ParameterTier;
    static const ParameterTable<StudioParams> table{
        {"floor", &S::floorRadiance, {0, 100}, "", Basic, "Radiance of the floor."},
        {"horizon", &S::horizonRadiance, {0, 100}, "", Basic, "Radiance of the walls at eye level."},
        {"ceiling", &S::ceilingRadiance, {0, 100}, "", Basic, "Radiance of the ceiling."},
        {"width", &S::width, {16, 8192}, "px", Expert, "Width of the picture; its height is half of it."},
    };
    return table;
}

StudioParams studioPreset(StudioPreset preset) {
    StudioParams studio;
    const auto add = [&](const char* name, float azimuth, float elevation, float distance, float width, float height,
                         float softness, float intensity, float temperature, LampShape shape = LampShape::Rectangle) {
        StudioLamp lamp;
        lamp.name = name;
        lamp.shape = shape;
        lamp.azimuthDeg = azimuth;
        lamp.elevationDeg = elevation;
        lamp.distanceM = distance;
        lamp.widthM = width;
        lamp.heightM = height;
        lamp.softness = softness;
        lamp.intensity = intensity;
        lamp.temperatureK = temperature;
        studio.lamps.push_back(lamp);
    };
    switch (preset) {
    case StudioPreset::ThreePoint:
        add("key", 42, 38, 2.2f, 1.2f, 1.6f, 0.25f, 1.3f, 5400);
        add("fill", -55, 15, 3.0f, 2.0f, 2.0f, 0.5f, 0.35f, 6200);
        add("back", 160, 45, 2.5f, 0.5f, 1.4f, 0.2f, 1.5f, 6800);
        break;
    case StudioPreset::Rim:
        add("rim left", 125, 15, 2.2f, 0.4f, 2.0f, 0.2f, 2.2f, 7200);
        add("rim right", -125, 15, 2.2f, 0.4f, 2.0f, 0.2f, 2.2f, 5000);
        add("front", 20, 30, 3.0f, 1.5f, 1.5f, 0.6f, 0.25f, 6000);
        studio.floorRadiance = 0.01f;
        studio.horizonRadiance = 0.02f;
        studio.ceilingRadiance = 0.03f;
        break;
    case StudioPreset::Beauty:
        add("dish", 0, 45, 1.2f, 0.7f, 0.7f, 0.35f, 1.6f, 5600, LampShape::Round);
        add("reflector", 0, -40, 1.2f, 1.0f, 0.6f, 0.6f, 0.5f, 5600);
        add("side left", 100, 10, 2.5f, 0.6f, 1.8f, 0.3f, 0.7f, 6000);
        add("side right", -100, 10, 2.5f, 0.6f, 1.8f, 0.3f, 0.7f, 6000);
        studio.floorRadiance = 0.08f;
        studio.horizonRadiance = 0.15f;
        studio.ceilingRadiance = 0.2f;
        break;
    case StudioPreset::Overcast:
        add("silk", 0, 90, 2.0f, 9.0f, 9.0f, 1.0f, 0.8f, 7000, LampShape::Round);
        studio.floorRadiance = 0.12f;
        studio.horizonRadiance = 0.35f;
        studio.ceilingRadiance = 0.5f;
        break;
    }
    return studio;
}

Result<Environment> generateStudio(const StudioParams& params) {
    if (params.lamps.size() > kMaxLamps) {
        return makeError(ErrorCode::LimitExceeded, "studio",
                         fmt::format("{} lamps, at most {} are taken", params.lamps.size(), kMaxLamps));
    }
    ARS_TRY_STATUS(checkRanges(studioParameters(), params, "studio"));
    for (std::size_t i = 0; i < params.lamps.size(); ++i) {
        ARS_TRY_STATUS(checkRanges(studioLampParameters(), params.lamps[i], lampPlace(i, params.lamps[i])));
    }
    Environment environment = uniformEnvironment(0.0f, params.width / 2 * 2);
    fillRoom(params, environment.picture);
    for (const StudioLamp& lamp : params.lamps) addLamp(lamp, environment.picture);
    return environment;
}

nlohmann::json studioToJson(const StudioParams& params) {
    nlohmann::json json = studioParameters().toJson(params);
    json["lamps"] = nlohmann::json::array();
    for (const StudioLamp& lamp : params.lamps) json["lamps"].push_back(studioLampParameters().toJson(lamp));
    return json;
}

Result<StudioParams> studioFromJson(const nlohmann::json& json) {
    StudioParams params;
    std::vector<std::string> unknown;
    auto room = studioParameters().fromJson(params, json, &unknown);
    if (!room) return atPlace(std::move(room).error(), "studio");
    const auto lamps = json.find("lamps");
    if (lamps == json.end()) return params;
    if (!lamps->is_array() || lamps->size() > kMaxLamps) {
        return makeError(ErrorCode::BadFile, "studio: lamps",
                         fmt::format("expected a list of at most {} lamps", kMaxLamps));
    }
    for (std::size_t i = 0; i < lamps->size(); ++i) {
        StudioLamp lamp;
        auto read = studioLampParameters().fromJson(lamp, (*lamps)[i], &unknown);
        if (!read) return atPlace(std::move(read).error(), fmt::format("studio: lamp {}", i));
        params.lamps.push_back(std::move(lamp));
    }
    return params;
}

glm::dvec3 blackBodyColor(double temperatureK) {
    const double t = std::clamp(temperatureK, 1667.0, 25000.0), i = 1000.0 / t;
    const double x = t < 4000.0 ? ((-0.2661239 * i - 0.2343589) * i + 0.8776956) * i + 0.179910
                                : ((-3.0258469 * i + 2.1070379) * i + 0.2226347) * i + 0.240390;
    double y = 0.0;
    if (t < 2222.0) {
        y = ((-1.1063814 * x - 1.34811020) * x + 2.18555832) * x - 0.20219683;
    } else if (t < 4000.0) {
        y = ((-0.9549476 * x - 1.37418593) * x + 2.09137015) * x - 0.16748867;
    } else {
        y = ((3.0817580 * x - 5.87338670) * x + 3.75112997) * x - 0.37001483;
    }
    const double X = x / y, Z = (1.0 - x - y) / y;
    // XYZ with Y = 1 to linear Rec.709 (IEC 61966-2-1); red lamps lie outside of it.
    return glm::max(glm::dvec3(3.2406 * X - 1.5372 - 0.4986 * Z, -0.9689 * X + 1.8758 + 0.0415 * Z,
                               0.0557 * X - 0.2040 + 1.0570 * Z),
                    glm::dvec3(0.0));
}

} // namespace ars
