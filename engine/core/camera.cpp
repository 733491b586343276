#include "engine/core/camera.h"

#include <fmt/format.h>

#include <cmath>
#include <numbers>

namespace ars {

Status validateCamera(const Camera& camera, std::string_view place) {
    auto wrong = [&](std::string message) {
        return makeError(ErrorCode::InvalidArgument, std::string(place), std::move(message));
    };
    if (camera.width < 1 || camera.height < 1 || camera.width > 32768 || camera.height > 32768) {
        return wrong(fmt::format("the picture is {}x{} pixels, sides must be 1 to 32768", camera.width, camera.height));
    }
    for (const double number : {camera.fx, camera.fy, camera.cx, camera.cy}) {
        if (!std::isfinite(number)) return wrong("K holds a number that is not finite");
    }
    if (camera.fx <= 0 || camera.fy <= 0) {
        return wrong(fmt::format("focal lengths are {} and {} pixels, must be positive", camera.fx, camera.fy));
    }
    for (int c = 0; c < 3; ++c) {
        if (!std::isfinite(camera.translation[c])) return wrong("t holds a number that is not finite");
        for (int r = 0; r < 3; ++r) {
            if (!std::isfinite(camera.rotation[c][r])) return wrong("R holds a number that is not finite");
        }
    }
    const glm::dmat3 gram = camera.rotation * glm::transpose(camera.rotation);
    double worst = 0;
    for (int c = 0; c < 3; ++c) {
        for (int r = 0; r < 3; ++r) worst = std::max(worst, std::abs(gram[c][r] - (c == r ? 1.0 : 0.0)));
    }
    if (worst > 1e-3) return wrong(fmt::format("R is no rotation: R R^T differs from the identity by {:.3g}", worst));
    if (glm::determinant(camera.rotation) < 0) return wrong("R mirrors (determinant -1), expected a rotation");
    return {};
}

Camera resizedCamera(const Camera& camera, int width, int height) {
    Camera result = camera;
    const double sx = static_cast<double>(width) / camera.width;
    const double sy = static_cast<double>(height) / camera.height;
    result.width = width;
    result.height = height;
    result.fx *= sx;
    result.cx *= sx;
    result.fy *= sy;
    result.cy *= sy;
    return result;
}

Camera lookAtCamera(const glm::dvec3& eye, const glm::dvec3& target, double verticalFieldDeg, int width, int height) {
    Camera camera;
    camera.width = width;
    camera.height = height;
    camera.fy = 0.5 * height / std::tan(verticalFieldDeg * std::numbers::pi / 360.0);
    camera.fx = camera.fy;
    camera.cx = 0.5 * width;
    camera.cy = 0.5 * height;
    const glm::dvec3 towards = target - eye;
    const glm::dvec3 forward = glm::length(towards) > 1e-12 ? glm::normalize(towards) : glm::dvec3(0.0, 0.0, -1.0);
    const glm::dvec3 up = std::abs(forward.y) < 0.9999 ? glm::dvec3(0, 1, 0) : glm::dvec3(0, 0, 1);
    const glm::dvec3 right = glm::normalize(glm::cross(forward, up));
    const glm::dvec3 down = glm::cross(forward, right);
    camera.rotation = glm::transpose(glm::dmat3(right, down, forward)); // rows are the camera's axes
    camera.translation = -(camera.rotation * eye);
    return camera;
}

} // namespace ars
