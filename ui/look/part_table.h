#pragma once

#include "ui/look/controls.h"

namespace ars::ui {

/// The nine parts of the body as objects: colour, name, radius r_g as a slider within its bounds, value relative to
/// the initial one, lock and reset. Clicking a name selects the part, as clicking the body in the viewport does.
void partTable(StudioContext& context);

} // namespace ars::ui
