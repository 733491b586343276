#pragma once

#include "engine/core/error.h"
#include "engine/core/process.h"
#include "engine/scene/run_folder.h"

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace ars {

/// One number of metrics.jsonl over the steps, thinned out for a plot.
struct RunCurve {
    std::string name;             ///< "loss.total"
    std::vector<double> steps;    ///< at most kMostCurvePoints, ascending
    std::vector<double> values;   ///< means of the steps that a point stands for
    std::vector<double> smoothed; ///< running mean of the whole series, at the same places
};
inline constexpr std::size_t kMostCurvePoints = 1200;

/// What a run folder says at a moment; immutable.
struct RunSnapshot {
    std::filesystem::path folder;
    std::optional<Error> error; ///< why the rest is older, or empty
    bool gone = false;          ///< there is no such folder (any more)
    RunStatus status;
    bool owned = false;                       ///< a live process works on it
    std::string capture, preset;              ///< of its config; empty where it does not say
    std::vector<CheckpointEntry> checkpoints; ///< oldest first
    std::filesystem::path preview;            ///< newest; empty: none
    std::vector<RunCurve> curves;             ///< every "loss." of the metrics, the total first, else by name
    std::size_t rows = 0;
    int brokenLines = 0;
};

/// `weight` in [0, 1): share of what was before; the start is not drawn towards 0. NaN stays where it is and is passed
/// over. All rows of one name, thinned out.
std::vector<RunCurve> runCurves(const std::vector<MetricsRow>& rows, double weight);

/// Follows a run folder on a thread of its own, so that a slow disk or long metrics never hold up the window.
class RunMonitor {
public:
    /// @param wake  called on that thread after every snapshot that differs; may be null
    explicit RunMonitor(std::function<void()> wake = {});
    ~RunMonitor();
    RunMonitor(const RunMonitor&) = delete;
    RunMonitor& operator=(const RunMonitor&) = delete;

    /// From now on this one; empty: none. The same again reads at once.
    void follow(const std::filesystem::path& folder);
    void setSmoothing(double weight);
    /// Of the folder that is followed, or null while it is read for the first time.
    std::shared_ptr<const RunSnapshot> latest() const;

private:
    struct State;
    std::unique_ptr<State> state_;
};

/// A new run, or one that goes on.
struct TrainingStart {
    std::filesystem::path run;
    std::filesystem::path capture;     ///< resuming: empty, the run knows it
    std::string preset;                ///< resuming: empty
    std::vector<std::string> settings; ///< "name=value"
    bool resume = false;
};
/// The program whose `train` is run: this one (/proc/self/exe) unless another was set.
std::filesystem::path trainingProgram();
void setTrainingProgram(std::filesystem::path program);
std::vector<std::string> trainingCommand(const TrainingStart& start);
/// Lines "name=value", without empty ones and comments: from a "#" that begins a line or stands behind a blank to the
/// line's end. InvalidArgument names a line that is neither.
Result<std::vector<std::string>> parseSettingLines(const std::string& text);
/// Starts it in a session of its own, so that it outlives this program; what it says goes to the run's log.txt. At nice
/// 5, for the window's sake. InvalidArgument where capture or run is missing or the run is owned; Io.
Result<ChildProcess> startTraining(const TrainingStart& start);
/// The last lines of a run's log, for a process that ended without a status.
std::string endOfLog(const std::filesystem::path& run, std::size_t lines = 4);

} // namespace ars
