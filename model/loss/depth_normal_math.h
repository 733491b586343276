#pragma once

#include "engine/core/camera.h"

#include <glm/glm.hpp>

#include <cmath>
#include <cstdint>

/// Normals of a depth picture, forward and backward of one pixel side by side (docs/math/losses.md).
namespace ars::detail {

/// The four points around a pixel, P = depth x ray through the pixel's centre.
template <typename T>
struct DepthCross {
    glm::vec<3, T> rayUp, rayDown, rayLeft, rayRight; ///< z = 1
    glm::vec<3, T> vertical;                          ///< P_up - P_down
    glm::vec<3, T> horizontal;                        ///< P_left - P_right
    T length = 0;                                     ///< of their cross product
    glm::vec<3, T> normal{T(0)};
};

/// u x l + r x u + b x r + l x b of the differences to the middle is (P_up - P_down) x (P_left - P_right): the middle
/// itself cancels. Towards the camera along every ray, since n . ray = -(z_up + z_down)(z_left + z_right) / (fx fy).
template <typename T>
DepthCross<T> depthCross(const PinholeCamera<T>& camera, std::int64_t row, std::int64_t column, T up, T down, T left,
                         T right) {
    DepthCross<T> cross;
    const T u = static_cast<T>(column) + T(0.5), v = static_cast<T>(row) + T(0.5);
    cross.rayUp = camera.ray(u, v - T(1));
    cross.rayDown = camera.ray(u, v + T(1));
    cross.rayLeft = camera.ray(u - T(1), v);
    cross.rayRight = camera.ray(u + T(1), v);
    cross.vertical = up * cross.rayUp - down * cross.rayDown;
    cross.horizontal = left * cross.rayLeft - right * cross.rayRight;
    const glm::vec<3, T> sum = glm::cross(cross.vertical, cross.horizontal);
    cross.length = std::sqrt(glm::dot(sum, sum));
    if (cross.length > T(0)) cross.normal = sum / cross.length;
    return cross;
}

/// dL/d of the four depths (up, down, left, right) from dL/d normal.
template <typename T>
glm::vec<4, T> depthCrossBackward(const DepthCross<T>& cross, const glm::vec<3, T>& gradNormal) {
    if (!(cross.length > T(0))) return glm::vec<4, T>(T(0));
    const glm::vec<3, T> gradSum = (gradNormal - cross.normal * glm::dot(cross.normal, gradNormal)) / cross.length;
    const glm::vec<3, T> gradVertical = glm::cross(cross.horizontal, gradSum);
    const glm::vec<3, T> gradHorizontal = glm::cross(gradSum, cross.vertical);
    return {glm::dot(gradVertical, cross.rayUp), -glm::dot(gradVertical, cross.rayDown),
            glm::dot(gradHorizontal, cross.rayLeft), -glm::dot(gradHorizontal, cross.rayRight)};
}

} // namespace ars::detail
