#include "engine/capture/calibration.h"

#include "engine/core/file.h"
#include "engine/io/text_scanner.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace ars {
namespace fs = std::filesystem;
namespace {

using Json = nlohmann::ordered_json;

/// As a tree JSON takes some twenty times its bytes; calibrations are far below this.
constexpr std::uint64_t kMaxJsonBytes = 64ull << 20;
constexpr double kRotationTolerance = 1e-3; ///< of R^T R from the identity; files hold at least six digits
constexpr double kSkewTolerance = 1e-6;     ///< of K's skew, times fx
constexpr double kMaxSide = 32768;          ///< pixels, as validateCamera has it

/// Where a camera's errors lie: `camera "22010710"`, or nothing for a file of one camera.
std::string placeOf(const std::string& name) {
    return fmt::format("camera {}", name.empty() ? "\"\"" : quotedFound(name));
}

Error badCamera(const std::string& place, std::string message) {
    return makeError(ErrorCode::BadFile, place, std::move(message));
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

/// `count` numbers under a key; 0: any count.
Result<std::vector<double>> numbersOf(const std::string& place, const Json& json, const char* key, std::size_t count,
                                      const char* form) {
    if (!json.contains(key)) return badCamera(place, fmt::format("{} is missing", key));
    std::vector<double> numbers;
    if (!collectNumbers(json[key], numbers)) return badCamera(place, fmt::format("{} is no list of numbers", key));
    if (count > 0 && numbers.size() != count) {
        return badCamera(place, fmt::format("{} has {} number{}, expected {} ({})", key, numbers.size(),
                                            numbers.size() == 1 ? "" : "s", count, form));
    }
    for (const double value : numbers) {
        if (!std::isfinite(value)) return badCamera(place, fmt::format("{} holds a number that is not finite", key));
    }
    return numbers;
}

glm::dmat3 fromRows(const std::vector<double>& m) {
    return glm::transpose(glm::dmat3(m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7], m[8]));
}

Status setIntrinsics(const std::string& place, const std::vector<double>& k, Camera& camera) {
    if (!(k[0] > 0.0) || !(k[4] > 0.0)) {
        return badCamera(place, fmt::format("focal lengths in K must be positive, found {:g} and {:g}", k[0], k[4]));
    }
    if (k[3] != 0.0 || k[6] != 0.0 || k[7] != 0.0 || k[8] != 1.0) {
        return badCamera(place, "K must have the form [fx s cx; 0 fy cy; 0 0 1]");
    }
    if (std::abs(k[1]) > kSkewTolerance * k[0]) {
        return makeError(ErrorCode::Unsupported, place,
                         fmt::format("K has a skew of {:g} pixels; only cameras without skew are read", k[1]));
    }
    camera.fx = k[0];
    camera.fy = k[4];
    camera.cx = k[2];
    camera.cy = k[5];
    return {};
}

Status setRotation(const std::string& place, const std::vector<double>& r, Camera& camera) {
    camera.rotation = fromRows(r);
    const glm::dmat3 product = glm::transpose(camera.rotation) * camera.rotation;
    double worst = 0.0;
    for (int c = 0; c < 3; ++c) {
        for (int row = 0; row < 3; ++row) worst = std::max(worst, std::abs(product[c][row] - (c == row ? 1.0 : 0.0)));
    }
    if (worst > kRotationTolerance) {
        return badCamera(place, fmt::format("R is no rotation: R^T R is off the identity by {:.2g}", worst));
    }
    if (glm::determinant(camera.rotation) < 0.0) return badCamera(place, "R mirrors, expected a rotation");
    return {};
}

Status setSize(const std::string& place, const char* key, double width, double height, Camera& camera) {
    for (const double side : {width, height}) {
        if (side >= 1.0 && side <= kMaxSide && side == std::floor(side)) continue;
        return badCamera(place, fmt::format("{} must be positive whole numbers up to {:.0f}, found {:g} x {:g}", key,
                                            kMaxSide, width, height));
    }
    camera.width = static_cast<int>(width);
    camera.height = static_cast<int>(height);
    return {};
}

Result<CalibratedCamera> calibratedCamera(const std::string& name, const Json& json) {
    const std::string place = placeOf(name);
    if (!json.is_object()) return badCamera(place, "expected an object with K, R, T and imgSize");
    CalibratedCamera result;
    result.name = name;
    ARS_TRY(const auto k, numbersOf(place, json, "K", 9, "row-major 3x3"));
    ARS_TRY(const auto r, numbersOf(place, json, "R", 9, "row-major 3x3"));
    ARS_TRY(const auto t, numbersOf(place, json, "T", 3, "x y z in metres"));
    ARS_TRY(const auto size, numbersOf(place, json, "imgSize", 2, "width and height in pixels"));
    if (json.contains("distCoeff")) {
        ARS_TRY(result.distortion, numbersOf(place, json, "distCoeff", 0, ""));
    }
    ARS_TRY_STATUS(setSize(place, "imgSize", size[0], size[1], result.camera));
    ARS_TRY_STATUS(setIntrinsics(place, k, result.camera));
    ARS_TRY_STATUS(setRotation(place, r, result.camera));
    result.camera.translation = {t[0], t[1], t[2]};
    return result;
}

Result<Json> readJson(const fs::path& path, ReadLimits limits) {
    limits.maxFileBytes = std::min(limits.maxFileBytes, kMaxJsonBytes);
    ARS_TRY(const std::string text, readTextFile(path, limits));
    try {
        return Json::parse(text);
    } catch (const Json::exception& error) {
        // "[json.exception.parse_error.101] parse error at line 1, column 8: ..." without what only programmers know
        std::string_view what = error.what();
        if (const std::size_t bracket = what.find("] "); bracket != std::string_view::npos) {
            what.remove_prefix(bracket + 2);
        }
        return makeError(ErrorCode::BadFile, path.string(), fmt::format("is no sound JSON: {}", what));
    }
}

std::string namesOf(const std::vector<CalibratedCamera>& cameras) {
    constexpr std::size_t kMost = 16;
    std::string text;
    for (std::size_t i = 0; i < std::min(cameras.size(), kMost); ++i) {
        text += (i ? ", " : "") + (cameras[i].name.empty() ? std::string("\"\"") : quotedFound(cameras[i].name));
    }
    if (cameras.size() > kMost) text += fmt::format(" and {} more", cameras.size() - kMost);
    return text;
}

/// A file of either form; a single camera has no name.
Result<std::vector<CalibratedCamera>> readCameras(const fs::path& path, const ReadLimits& limits) {
    ARS_TRY(const Json json, readJson(path, limits));
    if (looksLikeCalibration(json)) {
        auto cameras = camerasFromJson(json);
        if (!cameras) return atPlace(std::move(cameras).error(), path.string());
        return cameras;
    }
    auto camera = cameraFromJson(json);
    if (!camera) return atPlace(std::move(camera).error(), path.string());
    return std::vector<CalibratedCamera>{{"", *camera, {}}};
}

} // namespace

double CalibratedCamera::verticalFieldDeg() const {
    return (std::atan(camera.cy / camera.fy) + std::atan((camera.height - camera.cy) / camera.fy)) * 180.0 /
           std::numbers::pi;
}

bool CalibratedCamera::distorted() const {
    return std::any_of(distortion.begin(), distortion.end(), [](double d) { return d != 0.0; });
}

Status checkCameraName(std::string_view name) {
    const bool unfit = std::any_of(name.begin(), name.end(), [](char c) {
        const auto byte = static_cast<unsigned char>(c);
        return c == '/' || c == '\\' || byte < 0x20 || byte == 0x7f;
    });
    if (!unfit && !name.empty() && name != "." && name != "..") return {};
    return makeError(ErrorCode::InvalidArgument, "",
                     fmt::format("{} is no camera name, expected the name of a folder",
                                 name.empty() ? std::string("\"\"") : quotedFound(name)));
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
    if (json.is_object()) {
        for (const auto& [name, entry] : json.items()) {
            ARS_TRY(CalibratedCamera camera, calibratedCamera(name, entry));
            cameras.push_back(std::move(camera));
        }
    }
    if (cameras.empty()) return makeError(ErrorCode::BadFile, "", "the calibration has no camera");
    return cameras;
}

Result<std::vector<CalibratedCamera>> readCalibration(const fs::path& path, const ReadLimits& limits) {
    ARS_TRY(const Json json, readJson(path, limits));
    auto cameras = camerasFromJson(json);
    if (!cameras) return atPlace(std::move(cameras).error(), path.string());
    return cameras;
}

Result<CalibratedCamera> findCamera(const std::vector<CalibratedCamera>& cameras, std::string_view name) {
    for (const CalibratedCamera& camera : cameras) {
        if (camera.name == name) return camera;
    }
    return makeError(ErrorCode::NotFound, placeOf(std::string(name)),
                     fmt::format("there is no camera of this name; there are {}", namesOf(cameras)));
}

Result<Camera> cameraFromJson(const Json& json) {
    if (!json.is_object() || !json.contains("K")) {
        return badCamera("camera", "expected an object with width, height, K, R and t");
    }
    const std::string place = "camera";
    Camera camera;
    ARS_TRY(const auto width, numbersOf(place, json, "width", 1, "pixels"));
    ARS_TRY(const auto height, numbersOf(place, json, "height", 1, "pixels"));
    ARS_TRY(const auto k, numbersOf(place, json, "K", 9, "row-major 3x3"));
    ARS_TRY(const auto r, numbersOf(place, json, "R", 9, "row-major 3x3"));
    ARS_TRY(const auto t, numbersOf(place, json, "t", 3, "x y z in metres"));
    ARS_TRY_STATUS(setSize(place, "width and height", width[0], height[0], camera));
    ARS_TRY_STATUS(setIntrinsics(place, k, camera));
    ARS_TRY_STATUS(setRotation(place, r, camera));
    camera.translation = {t[0], t[1], t[2]};
    return camera;
}

Result<Camera> readCameraJson(const fs::path& path, const ReadLimits& limits) {
    ARS_TRY(const Json json, readJson(path, limits));
    auto camera = cameraFromJson(json);
    if (!camera) return atPlace(std::move(camera).error(), path.string());
    return camera;
}

Json cameraToJson(const Camera& camera) {
    const glm::dmat3& r = camera.rotation; // columns first
    Json json;
    json["width"] = camera.width;
    json["height"] = camera.height;
    json["K"] = {{camera.fx, 0.0, camera.cx}, {0.0, camera.fy, camera.cy}, {0.0, 0.0, 1.0}};
    json["R"] = {{r[0][0], r[1][0], r[2][0]}, {r[0][1], r[1][1], r[2][1]}, {r[0][2], r[1][2], r[2][2]}};
    json["t"] = {camera.translation.x, camera.translation.y, camera.translation.z};
    return json;
}

Result<CalibratedCamera> readCameraArgument(const std::string& argument, const ReadLimits& limits) {
    std::error_code ignored;
    const std::size_t colon = argument.rfind(':');
    const bool named = colon != std::string::npos && !fs::exists(argument, ignored);
    ARS_TRY(const auto cameras, readCameras(named ? argument.substr(0, colon) : argument, limits));
    if (!named) {
        if (cameras.size() == 1) return cameras.front();
        return makeError(
            ErrorCode::InvalidArgument, argument,
            fmt::format("holds {} cameras; add one's name after a colon: {}", cameras.size(), namesOf(cameras)));
    }
    auto camera = findCamera(cameras, argument.substr(colon + 1));
    if (!camera) return atPlace(std::move(camera).error(), argument.substr(0, colon));
    return camera;
}

} // namespace ars
