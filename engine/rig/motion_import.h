#pragma once

#include "engine/core/error.h"
#include "engine/core/limits.h"
#include "engine/rig/motion.h"
#include "engine/rig/retarget.h"
#include "engine/rig/skeleton.h"

#include <cstddef>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace ars {

enum class MotionFormat { Unknown, Npz, Npy, Bvh, Gltf };

/// "npz", "npy", "bvh", "gltf", "unknown".
std::string_view motionFormatName(MotionFormat format);

/// By the first bytes of a file, never by its name.
MotionFormat recogniseMotion(std::span<const std::byte> head);

/// Whether a clip is moved up or down so that it stands on y = 0 (floorShift).
enum class FloorPlacement {
    Auto,  ///< smpl_params.npz are kept (they belong to a body), everything else is placed
    Keep,  ///< heights as in the file
    Place, ///< the clip stands on the floor
};

struct MotionImportOptions {
    UpAxis up = UpAxis::Auto;
    double framesPerSecond = 0.0; ///< resample to this rate; 0: the file's own (glTF: 30)
    double metresPerUnit = 0.0;   ///< BVH and glTF; 0: leg lengths are made equal
    FloorPlacement floor = FloorPlacement::Auto;
    bool startAtOrigin = true;        ///< BVH and glTF: the pelvis starts above x = z = 0
    bool skipLeadIn = true;           ///< see RetargetOptions; not where firstFrame or frameCount choose frames
    std::optional<float> soleHeightM; ///< see RetargetOptions
    std::string map;            ///< a file of joint names, or the name of one in resources/retarget; empty: the best
    std::string animation;      ///< glTF: name or index; empty: the first
    std::size_t firstFrame = 0; ///< of the file, before resampling
    std::size_t frameCount = 0; ///< 0: to the end
};

/// Any motion that this program reads, as SMPL-X poses for `target`: npz and npy (motion.h), BVH and glTF (retarget.h).
/// The file is recognised by its content. Unsupported for anything else; other errors as in those headers, with the
/// path.
/// @param report  filled for BVH and glTF
Result<Motion> importMotion(const std::filesystem::path& path, const Skeleton& target,
                            const MotionImportOptions& options = {}, RetargetReport* report = nullptr,
                            const ReadLimits& limits = defaultReadLimits());

/// The same from memory. `maps`: the maps to choose from instead of those in resources/retarget. `folder`: where a
/// .gltf finds its buffers; empty: nowhere.
Result<Motion> importMotionBytes(std::span<const std::byte> file, const Skeleton& target,
                                 const MotionImportOptions& options = {}, RetargetReport* report = nullptr,
                                 const ReadLimits& limits = defaultReadLimits(),
                                 const std::vector<RetargetMap>* maps = nullptr,
                                 const std::filesystem::path& folder = {});

/// A motion as BVH of `skeleton`: centimetres, y up, the rest pose at zero angles, the root's position absolute (its
/// OFFSET is zero), rotations in the order Z X Y. InvalidArgument when joint counts differ or there is no frame.
Result<BvhFile> bvhFromMotion(const Motion& motion, const Skeleton& skeleton);
Status writeMotionBvh(const std::filesystem::path& path, const Motion& motion, const Skeleton& skeleton);

} // namespace ars
