#pragma once

#include "engine/scene/trained_avatar.h"

#include <filesystem>

namespace ars::test {

/// Writes NAME.avatar/ of the open body with untrained networks of small random weights, so that every attribute
/// follows the pose and the colours the view; with a light and with radii of its own.
Status writeSmallTrainedAvatar(const std::filesystem::path& folder);

/// Opens one as the program does: through the interface of model/, LibTorch stays behind it.
Result<OpenedTrainedAvatar> openThroughPlugin(const std::filesystem::path& folder, bool project);

} // namespace ars::test
