#pragma once

#include "app/command.h"
#include "engine/core/progress.h"
#include "engine/rig/body_model.h"
#include "engine/rig/motion.h"
#include "engine/rig/motion_import.h"

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace ars::app {

/// "open", or the path of a body file.
Result<BodyModel> loadBody(const std::string& name);

/// Frames first..end-1 of a motion.
struct FrameRange {
    std::size_t first = 0;
    std::optional<std::size_t> end; ///< unset: to the last
};

/// "a:b", "a:", ":b" or "a" (that frame alone). InvalidArgument for anything else and for an empty range.
Result<FrameRange> parseFrameRange(std::string_view text);

/// Keeps the frames of the range. InvalidArgument when the motion ends before it.
Status cutFrames(Motion& motion, const FrameRange& range);

/// Height of the lowest vertex, where the soles are, metres.
float soleHeightM(std::span<const glm::vec3> vertices);

/// "1.5,-2" as numbers. InvalidArgument names what is no number.
Result<std::vector<float>> parseNumbers(std::string_view text, std::string_view option);

} // namespace ars::app
