#pragma once

#include "engine/core/error.h"
#include "engine/core/progress.h"
#include "model/run/run_writer.h"

#include <atomic>
#include <filesystem>
#include <functional>
#include <map>
#include <string>

namespace ars {

/// What one step did.
struct StepReport {
    std::string stage;
    std::map<std::string, double>
        values; ///< as MetricsRow: "loss.l1", "loss.total", "rate.network", "time.read_ms", ...
    double milliseconds = 0;
};

/// The thing that is trained, as the run sees it: it steps and keeps its state in files. The trainer of avatars is one;
/// tests have another.
class TrainingTask {
public:
    virtual ~TrainingTask() = default;
    /// Reads data, makes networks; long. Everything that can be wrong with the input is found here.
    virtual Status load(const ProgressFunction& progress) = 0;
    virtual std::int64_t totalSteps() const = 0;
    virtual std::int64_t stepsDone() const = 0;
    /// One step; Failure names the culprit ("loss term l1 is not a number at step 812: ...").
    virtual Result<StepReport> step() = 0;
    /// Everything that the next step depends on, into an empty folder, and back. A failed restore may leave the task
    /// half changed: another checkpoint is restored next, or the run ends. InvalidArgument says that the checkpoint is
    /// sound, but does not go with the task's parameters: no other is tried. Saving changes nothing.
    virtual Status save(const std::filesystem::path& folder) = 0;
    virtual Status restore(const std::filesystem::path& folder) = 0;
    /// Pictures for people, into an existing folder, names begin with the step. Changes nothing that steps depend on.
    virtual Status preview(const std::filesystem::path& folder) = 0;
};

struct RunOptions {
    int checkpointSteps = 500; ///< a checkpoint every so many steps, and at the end, at pauses and stops
    int previewSteps = 500;    ///< 0: none
    int metricsSteps = 1;
    CheckpointPolicy policy;
    /// Called once a resume has restored its checkpoint, or found that there is none, with the step where it goes on.
    std::function<Status(std::int64_t step)> onRestored;
};

/// What a person at a terminal, or SIGINT/SIGTERM, wants: read each step. SIGINT and SIGTERM: stop with a checkpoint.
struct RunSignals {
    std::atomic<bool> stop{false};
};

/// Told after each step and change of state; for progress lines.
using RunListener = std::function<void(const RunStatus&)>;

/// Works through a task: loading, steps, pauses, saves, stops, one state machine told in status.json (the transitions
/// of runStateMayFollow, docs/user/training.md), which a thread refreshes every second also while a step or the loading
/// is long. With `resume` the newest checkpoint that restores is where it goes on: broken ones are named, passed over
/// and set aside, metrics are cut to it; a run without any checkpoint starts from its beginning.
///
/// Every failure, exceptions of LibTorch and of memory included, ends in the state failed with one sentence that says
/// which checkpoint is intact (but not while a new run loads: it has none). A loss that is not a number is one, whether
/// or not the task says so itself.
/// @return the last status (Finished, or Idle when stopped before the end, Paused never); an error after Failed was
///         written. After a discard the folder is gone and the status Idle.
Result<RunStatus> runTraining(RunWriter& writer, TrainingTask& task, const RunOptions& options, bool resume,
                              const RunSignals& signals, const RunListener& listener = {});

} // namespace ars
