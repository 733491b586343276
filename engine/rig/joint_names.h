#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace ars {

/// Which half of the body a joint's name speaks of.
enum class JointSide { Middle, Left, Right };

/// A joint's name without what rigs add to it: namespace ("mixamorig:"), prefix ("DEF-"), case, separators, side
/// marker.
struct NormalisedJointName {
    std::string base; ///< lower-case letters and digits: "mixamorig:LeftUpLeg" -> "upleg", "finger2-1.R" -> "finger21"
    JointSide side = JointSide::Middle;
};

/// Side markers: Left/Right anywhere, l/r as a word of its own (".L", "_r", "L_", "lShldr", "LHipJoint"), and l/r grown
/// together with a known word ("rhand").
NormalisedJointName normaliseJointName(std::string_view anyRigJointName);

/// The SMPL-X joint (0..54) that a joint of another rig moves, or -1 when the name says nothing. Known: SMPL, SMPL-H
/// and SMPL-X, Mixamo, MakeHuman's default rig, CMU/cgspeed (DAZ), Blender's Rigify (metarig, DEF- and ORG- bones),
/// VRM, Unreal's mannequin and the Hips/Chest2/RightCollar naming of BVH files.
///
/// One name alone is ambiguous in places (Mixamo's "LeftShoulder" is a collar bone, elsewhere it is the upper arm):
/// prefer smplxJointsForNames when the whole rig is at hand. Several joints may give the same answer ("upperarm01.L"
/// and "upperarm02.L"): the one nearest to the root is the joint that turns.
int smplxJointForName(std::string_view anyRigJointName);

/// The same for all joints of one rig (result has as many entries), with its other names to settle what one name leaves
/// open: "Shoulder" beside "Arm" is the collar, "Foot" beside "Ankle" is the ball of the foot, a spine numbered from
/// nothing ("Spine", "Spine1", "Spine2") starts at spine1, Rigify's "spine" is the pelvis.
std::vector<int> smplxJointsForNames(std::span<const std::string> names);

} // namespace ars
