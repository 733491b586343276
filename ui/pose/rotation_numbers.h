#pragma once

#include "engine/rig/inverse_kinematics.h"

#include <glm/glm.hpp>
#include <glm/gtc/quaternion.hpp>

#include <string_view>

namespace ars::ui {

/// Axis times angle, degrees; the angle is at most 180.
glm::vec3 rotationVectorDeg(const glm::quat& rotation);
glm::quat fromRotationVectorDeg(const glm::vec3& degrees);

/// Euler angles in degrees: turned about x first, then y, then z, all fixed axes (R = Rz Ry Rx). At y = +-90, where x
/// and z turn about the same line, z is 0.
glm::vec3 eulerDeg(const glm::quat& rotation);
glm::quat fromEulerDeg(const glm::vec3& degrees);

/// What separates two rotations, degrees in [0, 180].
float angleBetweenDeg(const glm::quat& a, const glm::quat& b);

/// Where a rotation stands within a joint's range.
struct LimitReading {
    glm::vec3 coordinateDeg{0.0f};
    glm::vec3 minimumDeg{0.0f};
    glm::vec3 maximumDeg{0.0f};

    /// Within half a degree of a bound, or beyond it.
    bool atLimit(int axis) const;
};
LimitReading readLimits(const JointLimit& limit, const glm::quat& rotation);
/// The rotation after one coordinate was set, degrees.
glm::quat withCoordinate(const JointLimit& limit, const glm::quat& rotation, int axis, float degrees);

/// Limits of a joint by its SMPL-X name; null for joints of other skeletons.
const JointLimit* limitOf(std::string_view joint);

} // namespace ars::ui
