#include "engine/rig/body_parts.h"

#include "engine/rig/joint_names.h"

namespace ars {
namespace {

struct PartInfo {
    std::string_view name;
    float initialRadiusM;
};

// Design section 4, rows "radii r_init" and "parts".
constexpr std::array<PartInfo, kBodyPartCount> kParts = {{
    {"torso", 0.25f},
    {"hip", 0.20f},
    {"knee", 0.12f},
    {"foot", 0.10f},
    {"head", 0.15f},
    {"shoulder", 0.15f},
    {"elbow", 0.10f},
    {"wrist", 0.06f},
    {"hand", 0.04f},
}};

constexpr int kFirstFingerJoint = 25;

// clang-format off
constexpr std::array<BodyPart, kFirstFingerJoint> kJointParts = {
    BodyPart::Torso, BodyPart::Hip, BodyPart::Hip, BodyPart::Torso, BodyPart::Knee, BodyPart::Knee, BodyPart::Torso,
    BodyPart::Foot, BodyPart::Foot, BodyPart::Torso, BodyPart::Foot, BodyPart::Foot, BodyPart::Head,
    BodyPart::Shoulder, BodyPart::Shoulder, BodyPart::Head, BodyPart::Shoulder, BodyPart::Shoulder,
    BodyPart::Elbow, BodyPart::Elbow, BodyPart::Wrist, BodyPart::Wrist, BodyPart::Head, BodyPart::Head, BodyPart::Head,
};
// clang-format on

} // namespace

std::string_view bodyPartName(BodyPart part) { return kParts[static_cast<std::size_t>(part)].name; }

float bodyPartInitialRadiusM(BodyPart part) { return kParts[static_cast<std::size_t>(part)].initialRadiusM; }

BodyPart smplxJointPart(int joint) {
    assert(joint >= 0 && joint < kSmplxJointCount);
    return joint >= kFirstFingerJoint ? BodyPart::Hand : kJointParts[static_cast<std::size_t>(joint)];
}

std::vector<BodyPart> jointParts(const Skeleton& skeleton) {
    const std::vector<int> named = smplxJointsForNames(skeleton.names);
    std::vector<BodyPart> parts(skeleton.parents.size(), BodyPart::Torso);
    for (std::size_t j = 0; j < parts.size(); ++j) {
        const int parent = skeleton.parents[j];
        if (j < named.size() && named[j] >= 0) {
            parts[j] = smplxJointPart(named[j]);
        } else if (parent >= 0 && static_cast<std::size_t>(parent) < j) {
            parts[j] = parts[static_cast<std::size_t>(parent)];
        }
    }
    return parts;
}

} // namespace ars
