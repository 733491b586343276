#pragma once

#include "engine/scene/session.h"

#include <filesystem>
#include <string>

namespace ars {

/// A failure as people read it: the error's sentence and, unless one is given, a hint of what to do about it.
Notice failureNotice(std::string title, const Error& error, std::string hint = {});

/// "forest.exr" for "/home/me/lights/forest.exr", "the open body" for "rest:open".
std::string shortName(const std::string& source);

} // namespace ars
