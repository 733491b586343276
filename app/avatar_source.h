#pragma once

#include "engine/core/progress.h"
#include "engine/frame/avatar_evaluator.h"
#include "engine/frame/rest_avatar.h"

#include <memory>
#include <string>
#include <vector>

namespace ars::app {

struct LoadedAvatar {
    std::shared_ptr<AvatarEvaluator> avatar;
    RestAvatarOptions options; ///< that it was made with
    std::vector<std::string> notes;
};

/// `rest:TEMPLATE` or `rest:open`: surfels straight from a skinned mesh. Errors' place is --avatar for what is no
/// avatar.
/// @param surfels  how many, about; 0: the default
/// @param settings "rest.NAME=VALUE" of --set; others are passed over
Result<LoadedAvatar> loadAvatar(const std::string& source, int surfels, const std::vector<std::string>& settings,
                                const ProgressFunction& progress);

/// Whether a --set is one of the avatar's.
bool isAvatarSetting(const std::string& setting);
/// The rows that --set rest.NAME reaches, for help.
std::string describeAvatarSettings();

} // namespace ars::app
