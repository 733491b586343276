#pragma once

#include "engine/core/progress.h"

#include <chrono>
#include <string>
#include <string_view>

namespace ars::app {

/// Shows on standard error how far long work has come: a bar that is redrawn on a terminal, a plain line now and then
/// elsewhere, nothing at all when the work is over within half a second or the user wants quiet. Also passes the wish
/// to stop (Ctrl-C) on to the work.
class ProgressBar {
public:
    explicit ProgressBar(bool quiet);
    ~ProgressBar(); ///< removes the bar from the terminal
    ProgressBar(const ProgressBar&) = delete;
    ProgressBar& operator=(const ProgressBar&) = delete;

    /// To be called by the work, from one thread at a time; the bar must outlive it.
    ProgressFunction function();
    /// For work in several steps: what follows fills [begin, end) of the whole.
    ProgressFunction part(double begin, double end);
    void clear();

private:
    using Clock = std::chrono::steady_clock;
    bool report(double fraction, std::string_view what);
    void draw(double fraction, std::string_view what);

    bool quiet_;
    bool terminal_;
    Clock::time_point start_;
    Clock::time_point lastShown_;
    double lastFraction_ = -1.0;
    std::string lastWhat_;
    bool drawn_ = false;
};

} // namespace ars::app
