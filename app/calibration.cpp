#include "app/calibration.h"

#include "app/text.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace ars::app {
namespace {

constexpr double kRotationTolerance = 1e-3; ///< of R^T R from the identity; files hold at least six digits

Error badCamera(const std::string& name, std::string message) {
    return makeError(ErrorCode::BadFile, fmt::format("camera \"{}\"", printable(name)), std::move(message));
}

/// All numbers of a flat or nested list, in order; nothing where something else stands in it.
bool collectNumbers(const Json& value, std::vector<double>& numbers, int depth = 0) {
    if (value.is_number()) {
        numbers.push_back(value.get<double>());
        return true;
    }
    if (!value.is_array() || depth > 2 || value.size() > 16) return false;
    return std::all_of(value.begin(), value.end(),
                       [&](const Json& entry) { return collectNumbers(entry, numbers, depth + 1); });
}

Result<std::vector<double>> numbersOf(const std::string& camera, const Json& json, const char* key, std::size_t count,
                                      const char* form) {
    if (!json.contains(key)) return badCamera(camera, fmt::format("{} is missing", key));
    std::vector<double> numbers;
    if (!collectNumbers(json[key], numbers)) return badCamera(camera, fmt::format("{} is no list of numbers", key));
    if (count > 0 && numbers.size() != count) {
        return badCamera(
            camera, fmt::format("{} has {}, expected {} ({})", key, counted(numbers.size(), "number"), count, form));
    }
    for (const double value : numbers) {
        if (!std::isfinite(value)) return badCamera(camera, fmt::format("{} holds a number that is not finite", key));
    }
    return numbers;
}

glm::dmat3 fromRows(const std::vector<double>& m) {
    return glm::transpose(glm::dmat3(m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7], m[8]));
}

Status checkIntrinsics(const CalibratedCamera& camera) {
    const glm::dmat3& k = camera.intrinsics;
    if (!(k[0][0] > 0.0) || !(k[1][1] > 0.0)) {
        return badCamera(camera.name,
                         fmt::format("focal lengths in K must be positive, found {:g} and {:g}", k[0][0], k[1][1]));
    }
    if (k[0][1] != 0.0 || k[0][2] != 0.0 || k[1][2] != 0.0 || k[2][2] != 1.0) {
        return badCamera(camera.name, "K must have the form [fx s cx; 0 fy cy; 0 0 1]");
    }
    return {};
}

Status checkRotation(const CalibratedCamera& camera) {
    const glm::dmat3 product = glm::transpose(camera.rotation) * camera.rotation;
    double worst = 0.0;
    for (int c = 0; c < 3; ++c) {
        for (int r = 0; r < 3; ++r) worst = std::max(worst, std::abs(product[c][r] - (c == r ? 1.0 : 0.0)));
    }
    if (worst > kRotationTolerance) {
        return badCamera(camera.name, fmt::format("R is no rotation: R^T R is off the identity by {:.2g}", worst));
    }
    if (glm::determinant(camera.rotation) < 0.0) return badCamera(camera.name, "R mirrors, expected a rotation");
    return {};
}

Result<CalibratedCamera> cameraFromJson(const std::string& name, const Json& json) {
    if (!json.is_object()) return badCamera(name, "expected an object with K, R, T and imgSize");
    CalibratedCamera camera;
    camera.name = name;
    ARS_TRY(const auto k, numbersOf(name, json, "K", 9, "row-major 3x3"));
    ARS_TRY(const auto r, numbersOf(name, json, "R", 9, "row-major 3x3"));
    ARS_TRY(const auto t, numbersOf(name, json, "T", 3, "x y z in metres"));
    ARS_TRY(const auto size, numbersOf(name, json, "imgSize", 2, "width and height in pixels"));
    if (json.contains("distCoeff")) {
        ARS_TRY(camera.distortion, numbersOf(name, json, "distCoeff", 0, ""));
    }
    for (const double side : size) {
        if (side < 1.0 || side > 1e6 || side != std::floor(side)) {
            return badCamera(
                name, fmt::format("imgSize must be positive whole numbers, found {:g} x {:g}", size[0], size[1]));
        }
    }
    camera.width = static_cast<int>(size[0]);
    camera.height = static_cast<int>(size[1]);
    camera.intrinsics = fromRows(k);
    camera.rotation = fromRows(r);
    camera.translation = {t[0], t[1], t[2]};
    ARS_TRY_STATUS(checkIntrinsics(camera));
    ARS_TRY_STATUS(checkRotation(camera));
    return camera;
}

} // namespace

double CalibratedCamera::verticalFieldDeg() const {
    const double f = intrinsics[1][1], c = intrinsics[2][1];
    return (std::atan(c / f) + std::atan((height - c) / f)) * 180.0 / 3.14159265358979323846;
}

bool CalibratedCamera::distorted() const {
    return std::any_of(distortion.begin(), distortion.end(), [](double d) { return d != 0.0; });
}

bool looksLikeCalibration(const Json& json) {
    if (!json.is_object()) return false;
    return std::any_of(json.begin(), json.end(), [](const Json& entry) {
        return entry.is_object() && (entry.contains("K") || entry.contains("R")) &&
               (entry.contains("T") || entry.contains("imgSize"));
    });
}

Result<std::vector<CalibratedCamera>> camerasFromJson(const Json& json) {
    std::vector<CalibratedCamera> cameras;
    for (const auto& [name, entry] : json.items()) {
        ARS_TRY(CalibratedCamera camera, cameraFromJson(name, entry));
        cameras.push_back(std::move(camera));
    }
    if (cameras.empty()) return makeError(ErrorCode::BadFile, "", "the calibration has no camera");
    return cameras;
}

} // namespace ars::app
