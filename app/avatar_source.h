#pragma once

#include "engine/core/progress.h"
#include "engine/frame/avatar_evaluator.h"
#include "engine/frame/rest_avatar.h"
#include "engine/scene/trained_avatar.h"
#include "model/plugin.h"

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace ars::app {

struct LoadedAvatar {
    std::shared_ptr<AvatarEvaluator> avatar;
    RestAvatarOptions options;                  ///< that a rest: avatar was made with
    std::optional<OpenedTrainedAvatar> trained; ///< nothing for rest: avatars
    std::vector<std::string> notes;
};

/// Lets documents and loadAvatar open trained avatars: model/ and with it LibTorch are loaded when the first is opened.
void offerTrainedAvatars(AvatarPrecision precision = AvatarPrecision::Exact);

/// `rest:TEMPLATE` or `rest:open`: surfels straight from a skinned mesh; else a trained avatar: NAME.avatar, a run (its
/// newest checkpoint) or a checkpoint. Errors' place is --avatar for what is no avatar.
/// @param surfels  how many, about; 0: the default
/// @param settings "rest.NAME=VALUE" of --set; others are passed over
Result<LoadedAvatar> loadAvatar(const std::string& source, int surfels, const std::vector<std::string>& settings,
                                const ProgressFunction& progress);

/// Whether a --set is one of the avatar's.
bool isAvatarSetting(const std::string& setting);
/// The rows that --set rest.NAME reaches, for help.
std::string describeAvatarSettings();

} // namespace ars::app
