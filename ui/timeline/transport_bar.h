#pragma once

#include "ui/panel.h"

#include <vector>

namespace ars::ui {

/// Moves to a time as a person's edit; stops playing.
void seekFromWidget(StudioContext& context, double timeS);

/// Play, keys before and after, time, frame, speed, range, rate, keys. Wraps where the panel is narrow.
/// @param keyTimes  of all tracks, sorted
void drawTransportBar(StudioContext& context, const std::vector<double>& keyTimes);

} // namespace ars::ui
