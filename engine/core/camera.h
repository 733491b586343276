#pragma once

#include "engine/core/error.h"
#include "engine/core/host_device.h"

#include <glm/glm.hpp>

#include <string_view>

namespace ars {

/// A pinhole camera without distortion (docs/conventions.md, Cameras and pixels): OpenCV axes, world to camera
/// x_cam = rotation x_world + translation, metres; focal lengths and principal point in pixels; pixel (row i, column j)
/// is centred at (j + 0.5, i + 0.5); the principal point may lie anywhere.
template <typename T>
struct PinholeCamera {
    int width = 0;
    int height = 0;
    T fx = 0, fy = 0; ///< pixels
    T cx = 0, cy = 0; ///< pixels from the left and top edge
    glm::mat<3, 3, T, glm::defaultp> rotation{T(1)};
    glm::vec<3, T, glm::defaultp> translation{T(0)};

    ARS_HD glm::vec<3, T, glm::defaultp> toCamera(const glm::vec<3, T, glm::defaultp>& world) const {
        return rotation * world + translation;
    }
    ARS_HD glm::vec<3, T, glm::defaultp> toWorld(const glm::vec<3, T, glm::defaultp>& camera) const {
        return glm::transpose(rotation) * (camera - translation);
    }
    ARS_HD glm::vec<3, T, glm::defaultp> centerWorld() const { return -(glm::transpose(rotation) * translation); }
    /// Image position (pixels from the left and top edge) of a point in camera space with z > 0.
    ARS_HD glm::vec<2, T, glm::defaultp> project(const glm::vec<3, T, glm::defaultp>& camera) const {
        return {fx * camera.x / camera.z + cx, fy * camera.y / camera.z + cy};
    }
    /// The ray through image position (u, v) in camera space, scaled to z = 1: depth times this is the point.
    ARS_HD glm::vec<3, T, glm::defaultp> ray(T u, T v) const { return {(u - cx) / fx, (v - cy) / fy, T(1)}; }

    bool operator==(const PinholeCamera&) const = default;

    template <typename U>
    PinholeCamera<U> as() const {
        return {width,
                height,
                static_cast<U>(fx),
                static_cast<U>(fy),
                static_cast<U>(cx),
                static_cast<U>(cy),
                glm::mat<3, 3, U, glm::defaultp>(rotation),
                glm::vec<3, U, glm::defaultp>(translation)};
    }
};

/// Cameras are kept in double and handed to kernels as PinholeCamera<float>.
using Camera = PinholeCamera<double>;

/// InvalidArgument for a side outside [1, 32768], numbers that are not finite, focal lengths that are not positive, and
/// a rotation that is none (R R^T differs from 1 by more than 1e-3, or mirrored). `place` begins the sentence.
Status validateCamera(const Camera& camera, std::string_view place = "camera");

/// The same view with a picture of another size: everything in pixels is scaled (each axis for itself).
Camera resizedCamera(const Camera& camera, int width, int height);

/// A camera at `eye` that looks at `target`; the world's +y points up in the picture. Looking straight up or down, +z
/// does. The principal point is the centre.
/// @param verticalFieldDeg full opening angle from top to bottom, (0, 180)
Camera lookAtCamera(const glm::dvec3& eye, const glm::dvec3& target, double verticalFieldDeg, int width, int height);

} // namespace ars
