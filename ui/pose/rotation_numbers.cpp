#include "ui/pose/rotation_numbers.h"

#include "engine/rig/pose.h"

#include <algorithm>
#include <cmath>

namespace ars::ui {

glm::vec3 rotationVectorDeg(const glm::quat& rotation) { return glm::degrees(axisAngleFromQuat(rotation)); }

glm::quat fromRotationVectorDeg(const glm::vec3& degrees) { return quatFromAxisAngle(glm::radians(degrees)); }

glm::vec3 eulerDeg(const glm::quat& rotation) {
    const glm::dmat3 r = glm::mat3_cast(glm::normalize(glm::dquat(rotation)));
    const double sineY = std::clamp(-r[0][2], -1.0, 1.0);
    const double y = std::asin(sineY);
    // Rows and columns of glm are exchanged: r[column][row].
    if (std::abs(sineY) > 1.0 - 1e-7) {
        const double x = std::atan2(sineY * r[1][0], r[1][1]);
        return glm::vec3(glm::degrees(glm::dvec3(x, y, 0.0)));
    }
    return glm::vec3(glm::degrees(glm::dvec3(std::atan2(r[1][2], r[2][2]), y, std::atan2(r[0][1], r[0][0]))));
}

glm::quat fromEulerDeg(const glm::vec3& degrees) {
    const glm::vec3 a = glm::radians(degrees);
    const glm::quat x = glm::angleAxis(a.x, glm::vec3(1, 0, 0));
    const glm::quat y = glm::angleAxis(a.y, glm::vec3(0, 1, 0));
    const glm::quat z = glm::angleAxis(a.z, glm::vec3(0, 0, 1));
    return z * y * x;
}

float angleBetweenDeg(const glm::quat& a, const glm::quat& b) {
    const glm::quat difference = glm::conjugate(a) * b;
    const float sine = glm::length(glm::vec3(difference.x, difference.y, difference.z));
    return glm::degrees(2.0f * std::atan2(sine, std::abs(difference.w)));
}

bool LimitReading::atLimit(int axis) const {
    constexpr float toleranceDeg = 0.5f;
    return coordinateDeg[axis] <= minimumDeg[axis] + toleranceDeg ||
           coordinateDeg[axis] >= maximumDeg[axis] - toleranceDeg;
}

LimitReading readLimits(const JointLimit& limit, const glm::quat& rotation) {
    return {glm::degrees(limitCoordinates(limit, rotation)), glm::degrees(limit.minimum), glm::degrees(limit.maximum)};
}

glm::quat withCoordinate(const JointLimit& limit, const glm::quat& rotation, int axis, float degrees) {
    glm::vec3 coordinates = limitCoordinates(limit, rotation);
    coordinates[axis] = glm::radians(degrees);
    return rotationFromCoordinates(limit, coordinates);
}

const JointLimit* limitOf(std::string_view joint) {
    const int index = smplxJointIndex(joint);
    const std::span<const JointLimit> limits = smplxJointLimits();
    return index >= 0 && index < static_cast<int>(limits.size()) ? &limits[static_cast<std::size_t>(index)] : nullptr;
}

} // namespace ars::ui
