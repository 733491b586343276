#pragma once

#include "engine/core/error.h"
#include "engine/frame/avatar_evaluator.h"
#include "engine/light/cube_map.h"
#include "engine/light/environment.h"
#include "engine/occlusion/ambient_occlusion.h"
#include "engine/surfel/pose_surfels.h"
#include "engine/surfel/splat.h"

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

namespace ars {

/// A trained avatar as documents use it. Networks live in model/, which this room does not know: the program hands in
/// what opens them (setTrainedAvatarOpener).
struct OpenedTrainedAvatar {
    std::shared_ptr<AvatarEvaluator> evaluator;
    PartRadii radii = initialPartRadii(); ///< learned, metres
    std::optional<CubeMap> light;         ///< learned or given in training
    // That it was trained with: its pictures are right under these alone.
    SplatParams splat;
    bool occluded = true; ///< false: shaded without occlusion
    OcclusionParams occlusion;
    PoseSurfelsParams posing;
    std::string preset; ///< "compact"
    std::string origin; ///< where it comes from, in words
};

/// Opens NAME.avatar/ or a checkpoint of a run; called on loaders' threads, also on several at once.
/// @param project  brings poses into the range of the training poses
using TrainedAvatarOpener =
    std::function<Result<OpenedTrainedAvatar>(const std::filesystem::path& folder, bool project)>;
/// The program calls it once, before anything is opened; a null one takes it away again.
void setTrainedAvatarOpener(TrainedAvatarOpener opener);

/// Whether an avatar's source in a document names a trained one: a path without "rest:" before it.
bool namesTrainedAvatar(std::string_view source);

/// Whether a folder on disk is NAME.avatar/ or a checkpoint (both have avatar.json), or a run with a status.
bool looksLikeTrainedAvatar(const std::filesystem::path& folder);

/// The folder that holds the avatar: the newest complete checkpoint of a run, else `source` itself. NotFound where
/// there is nothing or no checkpoint yet; Unsupported for what is neither avatar nor run.
Result<std::filesystem::path> trainedAvatarFolder(const std::filesystem::path& source);

/// Resolves the source and opens it. Errors of the above and of the opener, with the path; Unavailable where the
/// program set none.
Result<OpenedTrainedAvatar> openTrainedAvatar(const std::filesystem::path& source, bool project = true);
/// The same with an opener of the caller's own.
Result<OpenedTrainedAvatar> openTrainedAvatar(const std::filesystem::path& source, bool project,
                                              const TrainedAvatarOpener& opener);

/// The light that came out of the training: light.exr beside the avatar, else what opening it gives. NotFound where it
/// has none.
Result<Environment> trainedAvatarLight(const std::filesystem::path& source);

} // namespace ars
