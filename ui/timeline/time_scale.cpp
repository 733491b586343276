#include "ui/timeline/time_scale.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace ars::ui {
namespace {

/// Frames between labels and between fine lines.
struct TickSteps {
    long label = 1;
    long fine = 1;
};

TickSteps ticksFor(double pixelsPerFrame, double framesPerSecond, float labelSpacing) {
    const long second = std::max(1L, std::lround(framesPerSecond));
    std::array<TickSteps, 16> steps{{{1, 1},
                                     {2, 1},
                                     {5, 1},
                                     {10, 5},
                                     {(second + 1) / 2, std::max(1L, second / 6)},
                                     {second, std::max(1L, second / 6)},
                                     {2 * second, std::max(1L, second / 2)},
                                     {5 * second, second},
                                     {10 * second, 2 * second},
                                     {30 * second, 5 * second},
                                     {60 * second, 10 * second},
                                     {120 * second, 30 * second},
                                     {300 * second, 60 * second},
                                     {600 * second, 120 * second},
                                     {1800 * second, 300 * second},
                                     {3600 * second, 600 * second}}};
    std::sort(steps.begin(), steps.end(), [](const TickSteps& a, const TickSteps& b) { return a.label < b.label; });
    for (const TickSteps& step : steps) {
        if (static_cast<double>(step.label) * pixelsPerFrame >= labelSpacing) return step;
    }
    return steps.back();
}

} // namespace

void TimeScale::fit(double startS, double endS) {
    const double length = std::max(endS - startS, 1e-3);
    const double air = 14.0; // pixels on either side, so that keys at both ends can be taken hold of
    pixelsPerSecond = std::max(1.0, static_cast<double>(width) - 2.0 * air) / length;
    firstS = startS - air / pixelsPerSecond;
}

void TimeScale::zoom(double factor, float x) {
    const double kept = time(x);
    const double low = static_cast<double>(width) / 36000.0;
    const double high = static_cast<double>(width) / 1e-3;
    pixelsPerSecond = std::clamp(pixelsPerSecond * factor, std::min(low, high), high);
    firstS = kept - static_cast<double>(x - left) / pixelsPerSecond;
}

std::vector<RulerTick> rulerTicks(const TimeScale& scale, double framesPerSecond, float labelSpacing) {
    std::vector<RulerTick> ticks;
    if (!(framesPerSecond > 0.0) || !(scale.width > 0.0f)) return ticks;
    const TickSteps steps = ticksFor(scale.pixelsPerSecond / framesPerSecond, framesPerSecond, labelSpacing);
    const auto first = static_cast<long>(std::floor(scale.firstS * framesPerSecond));
    const auto last = static_cast<long>(std::ceil(scale.lastS() * framesPerSecond));
    // Fine lines need not divide the labels' step: both are walked over.
    const auto walk = [&](long step, bool labelled) {
        long frame = first - ((first % step) + step) % step;
        for (int guard = 0; frame <= last && guard < 4096; frame += step, ++guard) {
            ticks.push_back({static_cast<double>(frame) / framesPerSecond, frame, labelled});
        }
    };
    walk(steps.label, true);
    if (steps.fine < steps.label) walk(steps.fine, false);
    return ticks;
}

double snapToFrame(double timeS, double framesPerSecond) {
    return framesPerSecond > 0.0 ? std::round(timeS * framesPerSecond) / framesPerSecond : timeS;
}

long frameAt(double timeS, double framesPerSecond) { return std::lround(timeS * framesPerSecond); }

} // namespace ars::ui
