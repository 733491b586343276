#pragma once

#include "ui/panel.h"

namespace ars::ui {

/// The row over the picture: buffer, layout, dataset cameras, overlays. @return its height in pixels
float drawViewportToolbar(StudioContext& context);

} // namespace ars::ui
