// Motions of every kind: npz and npy of poses, BVH and glTF with transfer to SMPL-X, and the maps of joint names. The
// first byte chooses: a joint map, or a motion told by its content.
#include "engine/rig/motion_import.h"

#include <cmath>
#include <cstdint>
#include <cstdlib>

namespace {

using namespace ars;

Skeleton person() {
    std::vector<glm::vec3> joints(kSmplxJointCount);
    for (int j = 0; j < kSmplxJointCount; ++j) {
        // Any person with limbs: left to the left, trunk up, legs down.
        const std::string_view name = smplxJointName(j);
        const float side = name.starts_with("left_") ? 1.0f : name.starts_with("right_") ? -1.0f : 0.0f;
        const int parent = smplxJointParent(j);
        const glm::vec3 above = parent < 0 ? glm::vec3(0.0f) : joints[static_cast<std::size_t>(parent)];
        const bool leg = j == 4 || j == 5 || j == 7 || j == 8 || j == 10 || j == 11;
        const glm::vec3 step =
            leg ? glm::vec3(0, -0.4f, 0.01f) : glm::vec3(0.15f * side, side == 0.0f ? 0.15f : 0.0f, 0.0f);
        joints[static_cast<std::size_t>(j)] = above + step;
    }
    return smplxSkeleton(joints);
}

} // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    static const Skeleton target = person();
    const auto bytes = std::as_bytes(std::span(data, size));
    if (size > 0 && data[0] == '{') (void)parseRetargetMap(bytes);
    ReadLimits limits;
    limits.maxBytes = 64 << 20;
    limits.maxElements = 1 << 20;
    // Names are recognised, not looked up in files, so that a run touches no disk.
    static const std::vector<RetargetMap> noMaps;
    MotionImportOptions options;
    options.framesPerSecond = (size & 1) ? 30.0 : 0.0;
    options.up = static_cast<UpAxis>(size >> 1 & 3);
    options.skipLeadIn = (size & 8) != 0;
    const auto motion = importMotionBytes(bytes, target, options, nullptr, limits, &noMaps);
    if (!motion) return 0;
    for (const Pose& pose : motion->frames) {
        for (const glm::quat& q : pose.rotations) {
            if (!(std::abs(glm::length(q) - 1.0f) < 1e-3f)) std::abort();
        }
    }
    const auto bvh = bvhFromMotion(*motion, target);
    if (!bvh || !checkBvh(*bvh)) std::abort();
    return 0;
}
