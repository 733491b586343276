#include "model/run/training_run.h"

#include "engine/core/log.h"
#include "model/run/run_failure.h"
#include "model/run/run_log.h"
#include "model/run/status_keeper.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <deque>
#include <thread>

namespace ars {
namespace fs = std::filesystem;
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::milliseconds kPausedPoll{50};

/// Whether the run goes on after a request.
enum class Flow { GoOn, Ended };

/// One run of a task from its start to finished, idle or failed.
class Run {
public:
    Run(RunWriter& writer, TrainingTask& task, const RunOptions& options, const RunSignals& signals,
        const RunListener& listener)
        : writer_(writer), task_(task), options_(options), signals_(signals), listener_(listener),
          log_(writer.folder()), keeper_(writer) {}

    Result<RunStatus> work(bool resume);

private:
    Status whole(bool resume);
    Result<Flow> load(bool resume);
    Status restoreNewest();
    Status restoreOne(const CheckpointEntry& entry);
    Result<Flow> steps();
    Status oneStep();
    Status checkNumbers(const StepReport& report) const;
    Status finish();

    Result<Flow> obey(RunRequest request);
    Result<Flow> pause();
    Result<Flow> stop();
    Result<Flow> discard();
    Status saveBetweenSteps(RunState after);
    Status saveCheckpoint();
    void preview();

    Status go(RunState state, const std::string& note = "");
    void tell() {
        if (listener_) listener_(keeper_.status());
    }
    std::optional<RunRequest> nextRequest();
    bool asked(RunRequest request) const {
        return std::find(waiting_.begin(), waiting_.end(), request) != waiting_.end();
    }
    bool wanted(std::int64_t every) const { return every > 0 && task_.stepsDone() % every == 0; }
    void pace(double milliseconds);

    RunWriter& writer_;
    TrainingTask& task_;
    const RunOptions& options_;
    const RunSignals& signals_;
    const RunListener& listener_;
    RunLog log_;
    StatusKeeper keeper_;
    std::deque<RunRequest> waiting_; ///< came while loading, oldest first
    double stepMs_ = 0;              ///< moving mean
};

Status Run::go(RunState state, const std::string& note) {
    log_.line(
        fmt::format("{} at step {}{}{}", runStateName(state), keeper_.status().step, note.empty() ? "" : ": ", note));
    ARS_TRY_STATUS(keeper_.go(state, [&](RunStatus& status) { status.note = note; }));
    tell();
    return {};
}

/// What is asked now: a signal counts as stop and comes before everything else.
std::optional<RunRequest> Run::nextRequest() {
    if (signals_.stop.load()) return RunRequest::Stop;
    if (waiting_.empty()) return writer_.takeRequest();
    const RunRequest oldest = waiting_.front();
    waiting_.pop_front();
    return oldest;
}

Result<RunStatus> Run::work(bool resume) {
    Status worked = withoutExceptions<Status>("training", [&] { return whole(resume); });
    if (worked) return keeper_.status();
    Error error = std::move(worked).error();
    const std::string text = error.describe();
    log_.line("failed: " + text);
    const Status told = keeper_.go(RunState::Failed, [&](RunStatus& status) {
        status.error = text;
        status.note.clear();
        status.etaS = 0;
    });
    if (!told) logError("{}", told.error().describe());
    tell();
    return error;
}

Status Run::whole(bool resume) {
    ARS_TRY_STATUS(go(RunState::Loading));
    bool begun = resume; // before that there is nothing that could be intact
    // What throws here is no step of the task, but the run's own words that no memory was left for.
    auto worked = withoutExceptions<Result<Flow>>("training", [&]() -> Result<Flow> {
        ARS_TRY(const Flow flow, load(resume));
        if (flow == Flow::Ended) return flow;
        begun = true;
        return steps();
    });
    if (worked) return {};
    // Saving and restoring name it by themselves; every other failure leaves it just as intact.
    Error error = std::move(worked).error();
    const bool named = error.message.find("checkpoint") != std::string::npos;
    if (begun && !named) error.message += "; " + writer_.intactCheckpoint();
    return error;
}

Result<Flow> Run::load(bool resume) {
    const auto progress = [&](double fraction, std::string_view what) {
        keeper_.change([&](RunStatus& status) { status.note = fmt::format("{} ({:.0f} %)", what, 100 * fraction); });
        tell();
        if (const auto request = writer_.takeRequest()) waiting_.push_back(*request);
        return !signals_.stop.load() && !asked(RunRequest::Stop) && !asked(RunRequest::Discard);
    };
    const Status loaded = withoutExceptions<Status>("loading", [&] { return task_.load(progress); });
    if (!loaded) {
        if (loaded.error().code != ErrorCode::Cancelled) return loaded.error();
        if (asked(RunRequest::Discard) && !signals_.stop) return discard();
        ARS_TRY_STATUS(go(RunState::Stopping));
        ARS_TRY_STATUS(go(RunState::Idle, "stopped on request while loading"));
        return Flow::Ended;
    }
    if (resume) {
        ARS_TRY_STATUS(restoreNewest());
        if (options_.onRestored) ARS_TRY_STATUS(options_.onRestored(task_.stepsDone()));
    }
    keeper_.change([&](RunStatus& status) {
        status.note.clear();
        status.error.clear();
        status.step = task_.stepsDone();
        status.totalSteps = task_.totalSteps();
    });
    return Flow::GoOn;
}

Status Run::restoreOne(const CheckpointEntry& entry) {
    ARS_TRY_STATUS(withoutExceptions<Status>("restoring", [&] { return task_.restore(entry.folder); }));
    if (task_.stepsDone() == entry.step) return {};
    return makeError(ErrorCode::BadFile, entry.folder.string(),
                     fmt::format("expected the state after step {}, found step {}", entry.step, task_.stepsDone()));
}

Status Run::restoreNewest() {
    ARS_TRY(const std::vector<CheckpointEntry> entries, listCheckpoints(writer_.folder()));
    std::vector<std::int64_t> broken;
    std::string newestFailure;
    for (auto entry = entries.rbegin(); entry != entries.rend(); ++entry) {
        const Status restored = restoreOne(*entry);
        if (!restored) {
            const Error& error = restored.error();
            // Another checkpoint needs the same memory or meets the same parameters, and this one is not to blame.
            for (const ErrorCode code :
                 {ErrorCode::OutOfMemory, ErrorCode::Cancelled, ErrorCode::Unavailable, ErrorCode::InvalidArgument}) {
                if (error.code == code) return error;
            }
            logWarning("{}: does not restore, passed over: {}", entry->folder.string(), error.describe());
            if (newestFailure.empty()) newestFailure = error.describe();
            broken.push_back(entry->step);
            continue;
        }
        // Only now: had none restored, all would stay where they are.
        for (const std::int64_t step : broken) ARS_TRY_STATUS(writer_.setAside(step));
        keeper_.change([&](RunStatus& status) { status.checkpoint = fs::relative(entry->folder, writer_.folder()); });
        log_.line(fmt::format("restored the checkpoint of step {}", entry->step));
        return writer_.truncateAfter(entry->step);
    }
    if (!entries.empty()) {
        return makeError(ErrorCode::BadFile, writer_.folder().string(),
                         fmt::format("none of {} checkpoints restores; the newest: {}", entries.size(), newestFailure));
    }
    keeper_.change([](RunStatus& status) { status.checkpoint.clear(); });
    return writer_.truncateAfter(0);
}

Result<Flow> Run::steps() {
    ARS_TRY_STATUS(go(RunState::Running));
    while (task_.stepsDone() < task_.totalSteps()) {
        if (const auto request = nextRequest()) {
            ARS_TRY(const Flow flow, obey(*request));
            if (flow == Flow::Ended) return flow;
            continue;
        }
        ARS_TRY_STATUS(oneStep());
        if (task_.stepsDone() >= task_.totalSteps()) break; // the last checkpoint and preview are finish's
        if (wanted(options_.checkpointSteps)) ARS_TRY_STATUS(saveBetweenSteps(RunState::Running));
        if (wanted(options_.previewSteps)) preview();
    }
    ARS_TRY_STATUS(finish());
    return Flow::Ended;
}

Status Run::oneStep() {
    const auto begin = Clock::now();
    ARS_TRY(const StepReport report, withoutExceptions<Result<StepReport>>(
                                         fmt::format("step {}", task_.stepsDone() + 1), [&] { return task_.step(); }));
    ARS_TRY_STATUS(checkNumbers(report));
    pace(std::chrono::duration<double, std::milli>(Clock::now() - begin).count());
    const std::int64_t step = task_.stepsDone();
    keeper_.change([&](RunStatus& status) {
        status.stage = report.stage;
        status.step = step;
        status.stepMs = stepMs_;
        status.etaS = stepMs_ * 1e-3 * static_cast<double>(task_.totalSteps() - step);
        status.losses.clear();
        for (const auto& [name, value] : report.values) {
            if (name.starts_with("loss.")) status.losses[name.substr(5)] = value;
        }
    });
    if (step % std::max(options_.metricsSteps, 1) == 0 || step == task_.totalSteps()) {
        MetricsRow row{step, report.stage, report.values};
        row.values.try_emplace("time.step_ms", report.milliseconds);
        row.values.try_emplace("memory.resident_mb", static_cast<double>(writer_.lastStatus().memoryBytes) / 1e6);
        ARS_TRY_STATUS(writer_.appendMetrics(row));
    }
    tell();
    return {};
}

/// Names the first loss that is not a number: the sum, where it is one too, says less than its term.
Status Run::checkNumbers(const StepReport& report) const {
    const std::pair<const std::string, double>* culprit = nullptr;
    for (const auto& entry : report.values) {
        if (!entry.first.starts_with("loss.") || std::isfinite(entry.second)) continue;
        if (!culprit || culprit->first == "loss.total") culprit = &entry;
    }
    if (!culprit) return {};
    return makeError(ErrorCode::Internal, fmt::format("step {}", task_.stepsDone()),
                     fmt::format("loss term {} is {}, expected a number; the run was stopped", culprit->first.substr(5),
                                 culprit->second));
}

void Run::pace(double milliseconds) {
    constexpr double kShare = 1.0 / 32;
    stepMs_ = stepMs_ == 0 ? milliseconds : (1 - kShare) * stepMs_ + kShare * milliseconds;
}

Status Run::finish() {
    ARS_TRY(const std::vector<CheckpointEntry> entries, listCheckpoints(writer_.folder()));
    const bool saved = !entries.empty() && entries.back().step == task_.stepsDone();
    if (!saved) {
        ARS_TRY_STATUS(go(RunState::Saving));
        ARS_TRY_STATUS(saveCheckpoint());
        preview();
    }
    return go(RunState::Finished);
}

Result<Flow> Run::obey(RunRequest request) {
    switch (request) {
    case RunRequest::Pause:
        return pause();
    case RunRequest::Resume:
        return Flow::GoOn; // it runs
    case RunRequest::Save:
        ARS_TRY_STATUS(saveBetweenSteps(RunState::Running));
        return Flow::GoOn;
    case RunRequest::Stop:
        return stop();
    case RunRequest::Discard:
        return discard();
    }
    return Flow::GoOn;
}

Result<Flow> Run::pause() {
    ARS_TRY_STATUS(go(RunState::Pausing));
    ARS_TRY_STATUS(saveCheckpoint());
    ARS_TRY_STATUS(go(RunState::Paused, "paused on request"));
    for (;; std::this_thread::sleep_for(kPausedPoll)) {
        const auto request = nextRequest();
        if (!request || *request == RunRequest::Pause) continue;
        if (*request == RunRequest::Stop || *request == RunRequest::Discard) return obey(*request);
        if (*request == RunRequest::Save) {
            ARS_TRY_STATUS(saveBetweenSteps(RunState::Paused));
            continue;
        }
        ARS_TRY_STATUS(go(RunState::Running));
        return Flow::GoOn;
    }
}

Result<Flow> Run::stop() {
    ARS_TRY_STATUS(go(RunState::Stopping));
    ARS_TRY_STATUS(saveCheckpoint());
    keeper_.change([](RunStatus& status) { status.etaS = 0; });
    ARS_TRY_STATUS(go(RunState::Idle, fmt::format("stopped on request at step {}", task_.stepsDone())));
    return Flow::Ended;
}

Result<Flow> Run::discard() {
    ARS_TRY_STATUS(go(RunState::Stopping, "to be discarded"));
    log_.close();
    ARS_TRY_STATUS(keeper_.discard("the run was discarded on request"));
    tell();
    return Flow::Ended;
}

Status Run::saveBetweenSteps(RunState after) {
    ARS_TRY_STATUS(go(RunState::Saving));
    ARS_TRY_STATUS(saveCheckpoint());
    return go(after);
}

Status Run::saveCheckpoint() {
    const std::int64_t step = task_.stepsDone();
    const auto write = [&](const fs::path& folder) {
        return withoutExceptions<Status>("saving", [&] { return task_.save(folder); });
    };
    ARS_TRY_STATUS(writer_.saveCheckpoint(step, options_.policy, write));
    keeper_.change([&](RunStatus& status) { status.checkpoint = fmt::format("{}/{:08}", kRunCheckpointFolder, step); });
    return {};
}

/// Pictures are for people: one that fails is named, and the run goes on.
void Run::preview() {
    if (options_.previewSteps <= 0) return;
    const fs::path folder = writer_.folder() / kRunPreviewFolder;
    std::error_code ignored;
    fs::create_directories(folder, ignored);
    const Status made = withoutExceptions<Status>("preview", [&] { return task_.preview(folder); });
    if (!made) logWarning("preview of step {}: {}", task_.stepsDone(), made.error().describe());
}

} // namespace

Result<RunStatus> runTraining(RunWriter& writer, TrainingTask& task, const RunOptions& options, bool resume,
                              const RunSignals& signals, const RunListener& listener) {
    return withoutExceptions<Result<RunStatus>>("training", [&] {
        Run run(writer, task, options, signals, listener);
        return run.work(resume);
    });
}

} // namespace ars
