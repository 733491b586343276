#pragma once

#include "engine/scene/run_monitor.h"
#include "ui/panel.h"

namespace ars::ui {

/// The losses of a training over its steps, with the few choices of how they are looked at.
class LossPlot {
public:
    /// @param height  of choices and plot together, pixels
    void draw(StudioContext& context, const RunSnapshot& run, float height);
    /// What the curves are to be smoothed by (RunMonitor::setSmoothing).
    double smoothing() const { return static_cast<double>(smoothing_); }

private:
    void drawChoices(StudioContext& context);

    bool terms_ = true;
    bool logarithmic_ = true;
    float smoothing_ = 0.9f;
};

} // namespace ars::ui
