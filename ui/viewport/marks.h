#pragma once

#include "ui/viewport/probe.h"
#include "ui/viewport/view.h"

#include <string>

namespace ars::ui {

/// What a frame is: "draft 480x360", "refining 35 %", "full".
std::string qualityText(const Frame& frame);
/// In the upper right corner.
void drawBadge(const ViewportInput& input);

/// Name and symbol of what a picture shows, in its upper left corner.
void drawLabel(const PictureView& view, float scale, const std::string& text);
/// "Ambient occlusion  O".
std::string bufferLabel(BufferId buffer);

/// Axes of the world in the lower left corner. A click on a tip looks along it.
void drawAxes(const ViewportInput& input);

/// All buffers' numbers beside the cursor.
void drawProbe(const ViewportInput& input, const ViewportProbe& probe);

/// A sentence in the middle of a picture that is not there.
void drawNotice(const PictureView& view, float scale, const std::string& text);

} // namespace ars::ui
