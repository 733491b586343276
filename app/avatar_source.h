#pragma once

#include "engine/core/progress.h"
#include "engine/frame/avatar_evaluator.h"

#include <memory>
#include <string>
#include <vector>

namespace ars::app {

struct LoadedAvatar {
    std::shared_ptr<AvatarEvaluator> avatar;
    std::vector<std::string> notes;
};

/// `rest:TEMPLATE` or `rest:open`: surfels straight from a skinned mesh. Errors' place is --avatar for what is no
/// avatar.
/// @param surfels  how many, about; 0: the default
Result<LoadedAvatar> loadAvatar(const std::string& source, int surfels, const ProgressFunction& progress);

} // namespace ars::app
