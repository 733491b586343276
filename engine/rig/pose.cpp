#include "engine/rig/pose.h"

#include <algorithm>
#include <cmath>

namespace ars {
namespace {

const glm::quat kIdentity(1.0f, 0.0f, 0.0f, 0.0f);

glm::quat rotationOf(const Pose& pose, std::size_t joint) {
    return joint < pose.rotations.size() ? pose.rotations[joint] : kIdentity;
}

glm::dmat4 rigid(const glm::dquat& rotation, const glm::dvec3& position) {
    glm::dmat4 matrix = glm::mat4_cast(rotation);
    matrix[3] = glm::dvec4(position, 1.0);
    return matrix;
}

/// Inverse of a rotation with a translation.
glm::dmat4 rigidInverse(const glm::dmat4& matrix) {
    const glm::dmat3 transposed = glm::transpose(glm::dmat3(matrix));
    glm::dmat4 inverse(transposed);
    inverse[3] = glm::dvec4(-(transposed * glm::dvec3(matrix[3])), 1.0);
    return inverse;
}

struct ChainMatrices {
    std::vector<glm::dmat4> rest;  ///< joint axes to model space, rest pose
    std::vector<glm::dmat4> world; ///< joint axes to world space, posed
};

/// In double, so that the long way from the root to a finger tip costs no accuracy.
ChainMatrices chainMatrices(const Skeleton& skeleton, const Pose& pose) {
    const auto joints = static_cast<std::size_t>(skeleton.jointCount());
    ChainMatrices chain{std::vector<glm::dmat4>(joints), std::vector<glm::dmat4>(joints)};
    glm::dmat4 origin(1.0);
    origin[3] = glm::dvec4(glm::dvec3(pose.translation), 1.0);
    for (std::size_t j = 0; j < joints; ++j) {
        const glm::quat orientation = skeleton.restOrientations.empty() ? kIdentity : skeleton.restOrientations[j];
        chain.rest[j] = rigid(glm::dquat(orientation), glm::dvec3(skeleton.restPositions[j]));
        const glm::dmat4 turn = glm::mat4_cast(glm::normalize(glm::dquat(rotationOf(pose, j))));
        const int parent = skeleton.parents[j];
        if (parent < 0) {
            chain.world[j] = origin * chain.rest[j] * turn;
        } else {
            const auto p = static_cast<std::size_t>(parent);
            chain.world[j] = chain.world[p] * (rigidInverse(chain.rest[p]) * chain.rest[j]) * turn;
        }
    }
    return chain;
}

/// The joint of the other side, or the joint itself.
int mirroredJoint(int joint) {
    const std::string_view name = smplxJointName(joint);
    if (name.substr(0, 5) == "left_") return smplxJointIndex("right_" + std::string(name.substr(5)));
    if (name.substr(0, 6) == "right_") return smplxJointIndex("left_" + std::string(name.substr(6)));
    return joint;
}

} // namespace

Pose restPose(int jointCount) {
    Pose pose;
    pose.rotations.assign(static_cast<std::size_t>(std::max(jointCount, 0)), kIdentity);
    return pose;
}

glm::quat quatFromAxisAngle(const glm::vec3& axisAngle) {
    const glm::dvec3 r(axisAngle);
    const double angle = glm::length(r);
    // sin(a/2)/a, whose series is exact to double precision below the threshold.
    const double scale = angle < 1e-4 ? 0.5 - angle * angle / 48.0 : std::sin(0.5 * angle) / angle;
    return glm::quat(glm::normalize(glm::dquat(std::cos(0.5 * angle), scale * r.x, scale * r.y, scale * r.z)));
}

glm::vec3 axisAngleFromQuat(const glm::quat& rotation) {
    glm::dquat q = glm::normalize(glm::dquat(rotation));
    if (q.w < 0.0) q = -q;
    const glm::dvec3 v(q.x, q.y, q.z);
    const double sine = glm::length(v);
    const double scale = sine < 1e-8 ? 2.0 : 2.0 * std::atan2(sine, q.w) / sine;
    return glm::vec3(scale * v);
}

std::vector<glm::mat4> jointWorldMatrices(const Skeleton& skeleton, const Pose& pose) {
    const ChainMatrices chain = chainMatrices(skeleton, pose);
    return std::vector<glm::mat4>(chain.world.begin(), chain.world.end());
}

std::vector<glm::mat4> skinningMatrices(const Skeleton& skeleton, const Pose& pose) {
    const ChainMatrices chain = chainMatrices(skeleton, pose);
    std::vector<glm::mat4> matrices(chain.world.size());
    for (std::size_t j = 0; j < matrices.size(); ++j) {
        matrices[j] = glm::mat4(chain.world[j] * rigidInverse(chain.rest[j]));
    }
    return matrices;
}

Pose canonicalPose() {
    Pose pose = restPose(kSmplxJointCount);
    const float angle = glm::radians(25.0f);
    pose.rotations[static_cast<std::size_t>(smplxJointIndex("left_hip"))] = quatFromAxisAngle({0.0f, 0.0f, angle});
    pose.rotations[static_cast<std::size_t>(smplxJointIndex("right_hip"))] = quatFromAxisAngle({0.0f, 0.0f, -angle});
    return pose;
}

Pose mirroredPose(const Pose& pose) {
    Pose mirrored = pose;
    for (std::size_t j = 0; j < pose.rotations.size(); ++j) {
        const std::size_t source =
            j < kSmplxJointCount ? static_cast<std::size_t>(mirroredJoint(static_cast<int>(j))) : j;
        // A reflection at x = 0 keeps the turn about x and reverses the other two.
        const glm::quat q = rotationOf(pose, source);
        mirrored.rotations[j] = glm::quat(q.w, q.x, -q.y, -q.z);
    }
    mirrored.translation.x = -pose.translation.x;
    return mirrored;
}

Pose interpolatePoses(const Pose& a, const Pose& b, float t) {
    Pose result;
    result.rotations.resize(std::max(a.rotations.size(), b.rotations.size()));
    for (std::size_t j = 0; j < result.rotations.size(); ++j) {
        result.rotations[j] = glm::normalize(glm::slerp(rotationOf(a, j), rotationOf(b, j), t));
    }
    result.translation = glm::mix(a.translation, b.translation, t);
    result.expression.resize(std::max(a.expression.size(), b.expression.size()));
    for (std::size_t i = 0; i < result.expression.size(); ++i) {
        const float from = i < a.expression.size() ? a.expression[i] : 0.0f;
        const float to = i < b.expression.size() ? b.expression[i] : 0.0f;
        result.expression[i] = glm::mix(from, to, t);
    }
    return result;
}

} // namespace ars
