#pragma once

#include "engine/core/error.h"

#include <glm/glm.hpp>
#include <glm/gtc/quaternion.hpp>

#include <string>
#include <string_view>
#include <vector>

namespace ars {

/// Joints of a SMPL-X body, in the model's order (reference: smplx joint_names, first 55).
inline constexpr int kSmplxJointCount = 55;
std::string_view smplxJointName(int joint);
/// -1 for the pelvis.
int smplxJointParent(int joint);
/// Index of a SMPL-X joint name, or -1.
int smplxJointIndex(std::string_view name);

/// A joint tree in its rest pose. Parents come before their children; exactly one root (parent -1) at index 0 for
/// SMPL-X bodies, any number elsewhere.
struct Skeleton {
    std::vector<std::string> names;
    std::vector<int> parents;
    std::vector<glm::vec3> restPositions; ///< joint positions in the rest pose, model space, metres
    /// Rest orientation of each joint in model space. Identity for SMPL-X (its joints all share the model's axes);
    /// glTF and BVH rigs have their own.
    std::vector<glm::quat> restOrientations;

    int jointCount() const { return static_cast<int>(parents.size()); }
    /// -1 when there is none of this name.
    int find(std::string_view name) const;
    std::vector<int> children(int joint) const;
};

/// BadFile when parents form a cycle, point forward or outside, or lists differ in length; names the joint.
Status validateSkeleton(const Skeleton& skeleton);

/// The SMPL-X tree with joints at `positions` (55 of them).
Skeleton smplxSkeleton(std::vector<glm::vec3> positions);

} // namespace ars
