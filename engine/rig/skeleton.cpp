#include "engine/rig/skeleton.h"

#include "engine/core/limits.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace ars {
namespace {

constexpr std::array<std::string_view, kSmplxJointCount> kNames = {
    "pelvis",
    "left_hip",
    "right_hip",
    "spine1",
    "left_knee",
    "right_knee",
    "spine2",
    "left_ankle",
    "right_ankle",
    "spine3",
    "left_foot",
    "right_foot",
    "neck",
    "left_collar",
    "right_collar",
    "head",
    "left_shoulder",
    "right_shoulder",
    "left_elbow",
    "right_elbow",
    "left_wrist",
    "right_wrist",
    "jaw",
    "left_eye_smplhf",
    "right_eye_smplhf",
    "left_index1",
    "left_index2",
    "left_index3",
    "left_middle1",
    "left_middle2",
    "left_middle3",
    "left_pinky1",
    "left_pinky2",
    "left_pinky3",
    "left_ring1",
    "left_ring2",
    "left_ring3",
    "left_thumb1",
    "left_thumb2",
    "left_thumb3",
    "right_index1",
    "right_index2",
    "right_index3",
    "right_middle1",
    "right_middle2",
    "right_middle3",
    "right_pinky1",
    "right_pinky2",
    "right_pinky3",
    "right_ring1",
    "right_ring2",
    "right_ring3",
    "right_thumb1",
    "right_thumb2",
    "right_thumb3",
};

constexpr std::array<int, kSmplxJointCount> kParents = {
    -1, 0,  0,  0,  1,  2,  3,  4,  5,  6,  7,  8,  9,  9,  9,  12, 13, 14, 16, 17, 18, 19, 15, 15, 15, 20, 25, 26,
    20, 28, 29, 20, 31, 32, 20, 34, 35, 20, 37, 38, 21, 40, 41, 21, 43, 44, 21, 46, 47, 21, 49, 50, 21, 52, 53,
};

std::string jointLabel(const Skeleton& skeleton, int joint) {
    const auto i = static_cast<std::size_t>(joint);
    if (i < skeleton.names.size() && !skeleton.names[i].empty()) {
        return fmt::format("joint {} (\"{}\")", joint, skeleton.names[i]);
    }
    return fmt::format("joint {}", joint);
}

/// Whether going up from `joint` comes back to it.
bool liesOnCycle(const std::vector<int>& parents, int joint) {
    int at = parents[static_cast<std::size_t>(joint)];
    for (std::size_t steps = 0; steps < parents.size(); ++steps) {
        if (at == joint) return true;
        if (at < 0 || at >= static_cast<int>(parents.size())) return false;
        at = parents[static_cast<std::size_t>(at)];
    }
    return false;
}

Status checkLengths(const Skeleton& skeleton) {
    const std::size_t joints = skeleton.parents.size();
    if (joints == 0) return makeError(ErrorCode::BadFile, "", "the skeleton has no joints");
    const std::uint32_t limit = defaultReadLimits().maxJoints;
    if (joints > limit) {
        return makeError(ErrorCode::LimitExceeded, "",
                         fmt::format("the skeleton has {} joints, the limit is {}", joints, limit));
    }
    if (skeleton.names.size() != joints || skeleton.restPositions.size() != joints) {
        return makeError(ErrorCode::BadFile, "",
                         fmt::format("{} parents, {} names and {} joint positions, expected as many of each", joints,
                                     skeleton.names.size(), skeleton.restPositions.size()));
    }
    if (!skeleton.restOrientations.empty() && skeleton.restOrientations.size() != joints) {
        return makeError(ErrorCode::BadFile, "",
                         fmt::format("{} rest orientations for {} joints, expected one each or none",
                                     skeleton.restOrientations.size(), joints));
    }
    return {};
}

Status checkParent(const Skeleton& skeleton, int joint) {
    const int parent = skeleton.parents[static_cast<std::size_t>(joint)];
    if (parent < -1 || parent >= skeleton.jointCount()) {
        return makeError(ErrorCode::BadFile, jointLabel(skeleton, joint),
                         fmt::format("its parent is {}, expected -1 (a root) or a joint below {}", parent, joint));
    }
    if (parent < joint) return {};
    if (liesOnCycle(skeleton.parents, joint)) {
        return makeError(ErrorCode::BadFile, jointLabel(skeleton, joint),
                         fmt::format("its parents form a cycle through {}, expected a tree",
                                     parent == joint ? "itself" : jointLabel(skeleton, parent)));
    }
    return makeError(ErrorCode::BadFile, jointLabel(skeleton, joint),
                     fmt::format("its parent {} comes after it, expected parents before their children",
                                 jointLabel(skeleton, parent)));
}

bool isFinite(const glm::vec3& v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }

Status checkRestPose(const Skeleton& skeleton, int joint) {
    const auto j = static_cast<std::size_t>(joint);
    if (!isFinite(skeleton.restPositions[j])) {
        return makeError(ErrorCode::BadFile, jointLabel(skeleton, joint), "its rest position is not finite");
    }
    if (skeleton.restOrientations.empty()) return {};
    const float norm2 = glm::dot(skeleton.restOrientations[j], skeleton.restOrientations[j]);
    if (!(std::fabs(norm2 - 1.0f) < 1e-3f)) {
        return makeError(ErrorCode::BadFile, jointLabel(skeleton, joint),
                         fmt::format("its rest orientation has the squared norm {}, expected 1", norm2));
    }
    return {};
}

} // namespace

std::string_view smplxJointName(int joint) {
    assert(joint >= 0 && joint < kSmplxJointCount);
    return kNames[static_cast<std::size_t>(joint)];
}

int smplxJointParent(int joint) {
    assert(joint >= 0 && joint < kSmplxJointCount);
    return kParents[static_cast<std::size_t>(joint)];
}

int smplxJointIndex(std::string_view name) {
    const auto found = std::find(kNames.begin(), kNames.end(), name);
    return found == kNames.end() ? -1 : static_cast<int>(found - kNames.begin());
}

int Skeleton::find(std::string_view name) const {
    const auto found = std::find(names.begin(), names.end(), name);
    return found == names.end() ? -1 : static_cast<int>(found - names.begin());
}

std::vector<int> Skeleton::children(int joint) const {
    std::vector<int> result;
    for (int j = 0; j < jointCount(); ++j) {
        if (parents[static_cast<std::size_t>(j)] == joint) result.push_back(j);
    }
    return result;
}

Status validateSkeleton(const Skeleton& skeleton) {
    ARS_TRY_STATUS(checkLengths(skeleton));
    for (int j = 0; j < skeleton.jointCount(); ++j) {
        ARS_TRY_STATUS(checkParent(skeleton, j));
        ARS_TRY_STATUS(checkRestPose(skeleton, j));
    }
    return {};
}

Skeleton smplxSkeleton(std::vector<glm::vec3> positions) {
    assert(positions.size() == kSmplxJointCount);
    Skeleton skeleton;
    skeleton.names.assign(kNames.begin(), kNames.end());
    skeleton.parents.assign(kParents.begin(), kParents.end());
    skeleton.restPositions = std::move(positions);
    skeleton.restOrientations.assign(kSmplxJointCount, glm::quat(1.0f, 0.0f, 0.0f, 0.0f));
    return skeleton;
}

} // namespace ars
