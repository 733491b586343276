#pragma once

#include "app/command.h"
#include "engine/scene/run_folder.h"

#include <chrono>
#include <filesystem>
#include <string>

namespace ars::app {

/// "2 h 05 min", "27 min", "42 s".
std::string durationText(double seconds);

/// "step 120 of 4,000 (radiance)  l1 0.0412  total 0.1432  0.42 s a step  27 min left  1.21 GB": what a status says, on
/// one line.
std::string progressText(const RunStatus& status);

/// Shows a training on standard error, redrawn in place on a terminal and as a line now and then elsewhere; with --json
/// prints the rows of metrics that come in as lines on standard output instead.
class TrainProgress {
public:
    TrainProgress(std::filesystem::path run, const OutputOptions& output);
    ~TrainProgress(); ///< removes the line from the terminal
    TrainProgress(const TrainProgress&) = delete;
    TrainProgress& operator=(const TrainProgress&) = delete;

    /// Called by the training, one thread at a time.
    void show(const RunStatus& status);
    /// The last rows, and a clean terminal.
    void finish();

private:
    using Clock = std::chrono::steady_clock;
    void draw(const RunStatus& status);
    void printRows();

    OutputOptions output_;
    bool terminal_;
    MetricsFollower metrics_;
    std::int64_t printedStep_ = -1; ///< rows up to here are not new; -1: the run has not started yet
    RunState lastState_ = RunState::Idle;
    Clock::time_point lastShown_{};
    bool drawn_ = false;
};

} // namespace ars::app
