#pragma once

#include "engine/core/camera.h"
#include "engine/core/error.h"
#include "engine/core/limits.h"

#include <nlohmann/json_fwd.hpp>

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace ars {

/// One camera of a calibration_full.json (AvatarReX layout).
struct CalibratedCamera {
    std::string name;
    Camera camera;
    std::vector<double> distortion; ///< OpenCV k1 k2 p1 p2 k3 ..., empty when the file has none

    /// Opening angle from top to bottom, degrees.
    double verticalFieldDeg() const;
    /// Whether pictures must be undistorted first.
    bool distorted() const;
};

/// A camera's name is the name of its folder in a capture, and of files that are made of it: InvalidArgument for one
/// that is empty, "." or "..", or holds a slash, a backslash or a control character.
Status checkCameraName(std::string_view name);

/// Whether a JSON value has the form of a calibration, sound or not: an object of objects with K or R.
bool looksLikeCalibration(const nlohmann::ordered_json& json);

/// The cameras in the file's order. BadFile ("camera "22010710": K has 8 numbers, expected 9 (row-major 3x3)") for
/// anything missing, numbers that are not finite, focal lengths or sizes that are not positive, and R that is no
/// rotation. Unsupported for K with skew beyond 1e-6 fx.
Result<std::vector<CalibratedCamera>> camerasFromJson(const nlohmann::ordered_json& json);

/// A calibration_full.json. Errors as above with the path; BadFile for what is no JSON.
Result<std::vector<CalibratedCamera>> readCalibration(const std::filesystem::path& path,
                                                      const ReadLimits& limits = defaultReadLimits());

/// The camera of this name; NotFound lists the names that there are.
Result<CalibratedCamera> findCamera(const std::vector<CalibratedCamera>& cameras, std::string_view name);

/// A single camera {"width","height","K":[[..]],"R":[[..]],"t":[..]}; flat lists are taken too. Errors as above.
Result<Camera> cameraFromJson(const nlohmann::ordered_json& json);
Result<Camera> readCameraJson(const std::filesystem::path& path, const ReadLimits& limits = defaultReadLimits());
/// Reads back exactly.
nlohmann::ordered_json cameraToJson(const Camera& camera);

/// "CAMERA.json", or "CALIBRATION.json:NAME" for one camera of several. A calibration without a name is InvalidArgument
/// unless it holds one camera, and lists the names.
Result<CalibratedCamera> readCameraArgument(const std::string& argument,
                                            const ReadLimits& limits = defaultReadLimits());

} // namespace ars
