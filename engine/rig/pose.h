#pragma once

#include "engine/rig/skeleton.h"

#include <glm/glm.hpp>
#include <glm/gtc/quaternion.hpp>

#include <vector>

namespace ars {

/// One pose of a skeleton: a rotation per joint, relative to the parent, on top of the rest pose.
///
/// For SMPL-X bodies `rotations` has 55 entries (root first) and equals Rodrigues of the 165 axis-angle numbers; hand
/// means are already added. `translation` is SMPL-X's transl: it moves the skinned body, the root turns about its own
/// rest position.
struct Pose {
    std::vector<glm::quat> rotations; ///< w,x,y,z; unit length
    glm::vec3 translation{0.0f};      ///< metres
    std::vector<float> expression;    ///< coefficients psi, may be empty
};

/// The rest pose of a skeleton.
Pose restPose(int jointCount);

/// Rotation vector (axis times angle, radians) to quaternion and back; the angle of the result is in [0, pi].
glm::quat quatFromAxisAngle(const glm::vec3& axisAngle);
glm::vec3 axisAngleFromQuat(const glm::quat& rotation);

/// Forward kinematics: world matrix of each joint, (J) 4x4, column vectors, metres (avatar reference 5.5).
/// G_j = G_parent [R_j | J_j - J_parent] with the rest orientation between: R_j turns in the joint's own rest axes,
/// which for SMPL-X are the model's. `translation` is part of it. Joints that `pose` has no rotation for stay at rest.
std::vector<glm::mat4> jointWorldMatrices(const Skeleton& skeleton, const Pose& pose);

/// A_j: takes rest-pose model space to posed world space, (J) 4x4; what linear blend skinning blends. `translation` is
/// part of it.
std::vector<glm::mat4> skinningMatrices(const Skeleton& skeleton, const Pose& pose);

/// The canonical pose of the maps: T-pose with the hips turned out 25 degrees about z (left +, right -).
Pose canonicalPose();

/// Left and right exchanged (mirror at x = 0) for SMPL-X poses.
Pose mirroredPose(const Pose& pose);

/// Spherical interpolation along the shorter way, joint by joint; translation and expression linear.
Pose interpolatePoses(const Pose& a, const Pose& b, float t);

} // namespace ars
