#pragma once

#include "ui/look/controls.h"
#include "ui/look/sun_clock.h"

namespace ars::ui {

/// Rows of the light panel that belong to one kind of light.

/// Time of day, day and latitude, which set the sun's direction; then the sky's own rows. `place` is the panel's.
void skyRows(StudioContext& context, SunPlace& place);

/// The list of lamps with add and remove, the rows of the selected one, and those of the room.
/// @param lamp  index of the selected lamp; kept inside the list
void studioRows(StudioContext& context, int& lamp);

} // namespace ars::ui
