#pragma once

#include "engine/rig/skeleton.h"

#include <array>
#include <string>
#include <string_view>
#include <vector>

namespace ars::ui {

/// How the joints are folded in the tree.
enum class JointGroup { Body, LeftHand, RightHand, Face };
inline constexpr int kJointGroupCount = 4;
/// "Body", "Left hand" ...
const char* jointGroupLabel(JointGroup group);

/// A stable name as people write it: "left_index1" -> "Left index 1", "left_eye_smplhf" -> "Left eye".
std::string friendlyName(std::string_view name);

/// Whether what was typed means this name. Spaces, underscores and case are not looked at. Every letter continues the
/// run before it or begins a later word, so that "lwri" and "wrist" find left_wrist and "hip" does not find
/// "left_shoulder_pad". Nothing typed means everything.
bool matchesSearch(std::string_view name, std::string_view typed);

/// A joint as a row of the tree.
struct JointNode {
    int joint = 0;
    std::string label;
    JointGroup group = JointGroup::Body;
    std::vector<int> children; ///< joints below it in the same group
};

/// The tree of a skeleton by groups: hands and face begin where the body's branch ends.
struct JointTree {
    std::vector<JointNode> nodes;                             ///< (J) by joint
    std::array<std::vector<int>, kJointGroupCount> beginners; ///< joints on the first level of each group
};
JointTree jointTree(const Skeleton& skeleton);

} // namespace ars::ui
