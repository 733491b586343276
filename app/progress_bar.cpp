#include "app/progress_bar.h"

#include "app/interrupt.h"
#include "app/text.h"

#include <fmt/format.h>

#include <unistd.h>

#include <algorithm>
#include <cstdio>

namespace ars::app {
namespace {

constexpr auto kFirstShown = std::chrono::milliseconds(500);
constexpr auto kRedraw = std::chrono::milliseconds(100);
constexpr auto kLineEvery = std::chrono::seconds(2); ///< plain lines, so that logs stay short
constexpr int kBarCells = 28;

} // namespace

ProgressBar::ProgressBar(bool quiet)
    : quiet_(quiet), terminal_(::isatty(STDERR_FILENO) == 1), start_(Clock::now()), lastShown_(start_) {}

ProgressBar::~ProgressBar() { clear(); }

ProgressFunction ProgressBar::function() { return part(0.0, 1.0); }

ProgressFunction ProgressBar::part(double begin, double end) {
    return [this, begin, end](double fraction, std::string_view what) {
        return report(begin + (end - begin) * std::clamp(fraction, 0.0, 1.0), what);
    };
}

bool ProgressBar::report(double fraction, std::string_view what) {
    const Clock::time_point now = Clock::now();
    const bool first = lastFraction_ < 0.0;
    const auto wait = first ? Clock::duration(kFirstShown) : terminal_ ? Clock::duration(kRedraw) : kLineEvery;
    if (!quiet_ && now - lastShown_ >= wait) {
        draw(fraction, what);
        lastShown_ = now;
        lastFraction_ = fraction;
    }
    return !interruptRequested();
}

void ProgressBar::draw(double fraction, std::string_view what) {
    const int percent = static_cast<int>(fraction * 100.0);
    if (!terminal_) {
        fmt::print(stderr, "{}: {} %\n", printable(what), percent);
        return;
    }
    const int full = static_cast<int>(fraction * kBarCells);
    std::string bar;
    for (int i = 0; i < kBarCells; ++i) bar += i < full ? "━" : "╌";
    fmt::print(stderr, "\r\033[K{} {:3} %  {}", bar, percent, printable(what).substr(0, 60));
    std::fflush(stderr);
    drawn_ = true;
}

void ProgressBar::clear() {
    if (!drawn_) return;
    fmt::print(stderr, "\r\033[K");
    std::fflush(stderr);
    drawn_ = false;
}

} // namespace ars::app
