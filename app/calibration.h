#pragma once

#include "app/command.h"
#include "engine/core/error.h"

#include <glm/glm.hpp>

#include <string>
#include <vector>

namespace ars::app {

/// One camera of a calibration_full.json: x_cam = R x_world + T, OpenCV axes, metres; K in pixels.
struct CalibratedCamera {
    std::string name;
    int width = 0;
    int height = 0;
    glm::dmat3 intrinsics{1.0}; ///< K
    glm::dmat3 rotation{1.0};   ///< R
    glm::dvec3 translation{0.0};
    std::vector<double> distortion;

    glm::dvec3 centerWorld() const { return -(glm::transpose(rotation) * translation); }
    double verticalFieldDeg() const;
    bool distorted() const;
};

/// Whether a JSON value has the form of a calibration, sound or not: an object of objects with K or R.
bool looksLikeCalibration(const Json& json);

/// The cameras in the file's order. BadFile ("camera "22010710": K has 8 numbers, expected 9 (row-major 3x3)") for
/// anything missing, numbers that are not finite, focal lengths or sizes that are not positive, and R that is no
/// rotation.
Result<std::vector<CalibratedCamera>> camerasFromJson(const Json& json);

} // namespace ars::app
