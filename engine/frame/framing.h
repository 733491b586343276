#pragma once

#include "engine/core/camera.h"

#include <glm/glm.hpp>

#include <span>

namespace ars {

/// A box with axes along the world's.
struct Bounds {
    glm::vec3 low{0.0f};
    glm::vec3 high{0.0f};

    glm::vec3 center() const { return 0.5f * (low + high); }
    glm::vec3 size() const { return high - low; }
};

/// Of the points that are finite; a unit box around the origin where there is none.
Bounds boundsOf(std::span<const glm::vec3> points);

/// A camera on a circle around a box, looking at its centre, as near as the whole box stays inside the picture with a
/// margin of 6 % from every azimuth: a turntable does not pump.
/// @param azimuthDeg   0 sees the front (+z), 90 the body's left side (+x)
/// @param elevationDeg above the horizon
Camera orbitCamera(const Bounds& bounds, double azimuthDeg, double elevationDeg, double verticalFieldDeg, int width,
                   int height);

} // namespace ars
