#pragma once

#include "ui/viewport/probe.h"

namespace ars::ui {

/// Behind the functions of probe.h; the viewport alone writes it.
struct ProbeState {
    ViewportProbe probe;
    int wantedFrames = 0; ///< window frames for which a panel wants all buffers
    bool pinned = false;
};
ProbeState& probeState();

} // namespace ars::ui
