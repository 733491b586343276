#pragma once

#include "engine/scene/command.h"

#include <string>

namespace ars::edit {

/// Cameras that frame a body or parts of it; field and, where it makes sense, direction are those of `from`.

/// One of camera.preset's words. NotFound where the avatar has no such joint.
Result<SceneCamera> presetCamera(const std::string& name, const SceneCamera& from, const Document& document,
                                 const CommandContext& context);
/// Looks at a joint and what hangs from it, or at everything (-1), from the direction of `from`.
Result<SceneCamera> focusedCamera(int joint, const SceneCamera& from, const Document& document,
                                  const CommandContext& context);

} // namespace ars::edit
