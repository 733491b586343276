#pragma once

#include "engine/core/limits.h"
#include "engine/io/npz.h"
#include "engine/rig/pose.h"

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace ars {

/// A sequence of SMPL-X poses (55 joints) at a constant rate.
struct Motion {
    std::string name;
    double framesPerSecond = 30.0;
    std::vector<Pose> frames;
    std::vector<float> betas; ///< shape of the recorded person in SMPL-X's shape space; may be empty
    std::string source;       ///< "smpl_params", "amass smpl+h", "amass smpl-x", "poses", "bvh", "gltf"

    /// Time of the last frame, seconds.
    double durationS() const;
};

/// Rates that a file may have; others are refused, so that a duration never explodes.
inline constexpr double kMinFramesPerSecond = 1.0 / 60.0;
inline constexpr double kMaxFramesPerSecond = 10000.0;

/// Which axis of a file points up. NegativeY is a world in camera axes (x right, y down, z forward).
enum class UpAxis { Auto, Y, Z, NegativeY };

/// "auto", "y", "z", "-y".
std::string_view upAxisName(UpAxis up);
Result<UpAxis> parseUpAxis(std::string_view name);

/// Rest position of the pelvis in the neutral models without shape, metres: where the root of a recording turns when
/// its body is not at hand. (Published model values; the shape moves them by some centimetres.)
inline constexpr glm::vec3 kSmplxPelvisM{0.0031f, -0.3514f, 0.0120f};
inline constexpr glm::vec3 kSmplhPelvisM{-0.0018f, -0.2233f, 0.0282f};

/// How numpy motions are read.
struct MotionReadOptions {
    /// Auto: smpl_params are y-up and files of AMASS z-up; for other files the axis along which the pelvis's own y
    /// points on average.
    UpAxis up = UpAxis::Auto;
    double framesPerSecond = 0.0; ///< overrides the file's rate; 0: the file's, 30 where it says none
    /// Rest pelvis of the body that was recorded. Unset: kSmplxPelvisM, or kSmplhPelvisM for SMPL+H.
    std::optional<glm::vec3> recordedPelvisM;
    /// Rest pelvis of the body that will play the motion. Unset: the recorded one, for SMPL+H kSmplxPelvisM.
    std::optional<glm::vec3> targetPelvisM;
};

/// AvatarReX-style smpl_params.npz, AMASS (SMPL+H with 156 numbers a frame, SMPL-X with 165, or its root_orient,
/// pose_body, pose_hand, pose_jaw, pose_eye) or a plain (F,165) npy/npz of poses (also 156, 72 and 66: SMPL-H, SMPL and
/// body only); which one is told by the keys.
///
/// Hands are full axis-angle rotations with the hand mean already in them (smplx's flat_hand_mean=True): nothing is
/// added. Non-finite numbers, angles beyond 1,000 radians, wrong widths and frame counts that differ are BadFile with
/// the key, what was expected and what was found; more frames than the limits allow are LimitExceeded.
///
/// A world that is not y-up is turned by Q: x' = Q x. The root turns about its own rest position p, x = R (v - p) + p +
/// t, so R' = Q R and t' = Q (p + t) - p', with p the recorded body's pelvis and p' the playing body's. smpl_params
/// that are already y-up are kept as they are.
Result<Motion> readMotionNpz(const std::filesystem::path& path, const MotionReadOptions& options = {},
                             const ReadLimits& limits = defaultReadLimits());
Result<Motion> motionFromArrays(const NpzFile& file, const MotionReadOptions& options = {},
                                const ReadLimits& limits = defaultReadLimits());

/// The same as smpl_params.npz: float32 axis-angle arrays with AvatarReX's eight keys, and `mocap_framerate` (a
/// scalar); `leye_pose` and `reye_pose` (F,3) only where an eye turns. InvalidArgument for an empty motion or one
/// without 55 joints.
Status writeSmplParams(const std::filesystem::path& path, const Motion& motion);

/// Pose at a time in seconds, spherical interpolation, clamped at both ends. An empty motion gives the rest pose.
Pose sampleMotion(const Motion& motion, double timeS);

/// Another rate by spherical interpolation of the rotations; the last frame is kept within one step. A rate outside
/// [kMinFramesPerSecond, kMaxFramesPerSecond] is clamped to it.
Motion resampleMotion(const Motion& motion, double framesPerSecond);

} // namespace ars
