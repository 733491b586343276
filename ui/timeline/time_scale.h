#pragma once

#include <vector>

namespace ars::ui {

/// What part of time a strip of pixels shows.
struct TimeScale {
    double firstS = 0.0; ///< at the left edge
    double pixelsPerSecond = 100.0;
    float left = 0.0f; ///< screen position of the left edge
    float width = 1.0f;

    float x(double timeS) const { return left + static_cast<float>((timeS - firstS) * pixelsPerSecond); }
    double time(float x) const { return firstS + static_cast<double>(x - left) / pixelsPerSecond; }
    double lastS() const { return time(left + width); }

    /// Shows [startS, endS] with some air on both sides.
    void fit(double startS, double endS);
    /// Zooms by a factor; the moment under `x` stays where it is. From a thousandth of a second to hours per screen.
    void zoom(double factor, float x);
    void pan(float pixels) { firstS -= static_cast<double>(pixels) / pixelsPerSecond; }
};

/// A line of the ruler.
struct RulerTick {
    double timeS = 0.0;
    long frame = 0;
    bool labelled = false;
};
/// Ticks at whole frames: labels at least `labelSpacing` pixels apart, on round numbers of frames or of seconds, with
/// finer lines between.
std::vector<RulerTick> rulerTicks(const TimeScale& scale, double framesPerSecond, float labelSpacing);

/// The nearest whole frame's time.
double snapToFrame(double timeS, double framesPerSecond);
/// The frame on the screen at a time: the nearest whole number.
long frameAt(double timeS, double framesPerSecond);

} // namespace ars::ui
