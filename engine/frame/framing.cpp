#include "engine/frame/framing.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace ars {

Bounds boundsOf(std::span<const glm::vec3> points) {
    Bounds bounds{glm::vec3(std::numeric_limits<float>::max()), glm::vec3(std::numeric_limits<float>::lowest())};
    bool any = false;
    for (const glm::vec3& point : points) {
        if (!std::isfinite(point.x) || !std::isfinite(point.y) || !std::isfinite(point.z)) continue;
        bounds.low = glm::min(bounds.low, point);
        bounds.high = glm::max(bounds.high, point);
        any = true;
    }
    return any ? bounds : Bounds{glm::vec3(-0.5f), glm::vec3(0.5f)};
}

Camera orbitCamera(const Bounds& bounds, double azimuthDeg, double elevationDeg, double verticalFieldDeg, int width,
                   int height) {
    const glm::dvec3 size(bounds.size());
    const glm::dvec3 center(bounds.center());
    // What the turning box sweeps is a cylinder; its outline as seen from the elevation must fit.
    const double radius = 0.5 * std::hypot(size.x, size.z);
    const double elevation = glm::radians(std::clamp(elevationDeg, -89.0, 89.0));
    const double halfHeight = 0.5 * size.y * std::cos(elevation) + radius * std::abs(std::sin(elevation));
    const double tanY = std::tan(glm::radians(0.5 * verticalFieldDeg));
    const double tanX = tanY * width / height;
    const double depth = radius * std::cos(elevation) + 0.5 * size.y * std::abs(std::sin(elevation));
    const double distance = 1.06 * std::max({halfHeight / tanY, radius / tanX, 0.1}) + depth;
    const double azimuth = glm::radians(azimuthDeg);
    const glm::dvec3 towards(std::sin(azimuth) * std::cos(elevation), std::sin(elevation),
                             std::cos(azimuth) * std::cos(elevation));
    return lookAtCamera(center + distance * towards, center, verticalFieldDeg, width, height);
}

} // namespace ars
