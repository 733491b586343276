#include "engine/core/log.h"
#include "model/run/run_failure.h"
#include "tests/support/test_data.h"
#include "tests/unit/model/run_fake_task.h"

#include <c10/util/Exception.h>
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <fstream>
#include <limits>
#include <new>
#include <system_error>

namespace ars {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;
using test::ChaoticTask;
using test::metricsText;
using test::quickOptions;
using test::runIn;

/// State and random numbers after so many steps without any run around them.
std::string stateAfter(int steps) {
    ChaoticTask task;
    for (int i = 0; i < steps; ++i) EXPECT_TRUE(task.step().ok());
    return task.stateText();
}

template <typename Condition>
bool waitUntil(Condition condition) {
    for (int i = 0; i < 2000; ++i) {
        if (condition()) return true;
        std::this_thread::sleep_for(5ms);
    }
    return false;
}

/// Every state that status.json says when the listener is told, in order, checked against the table.
class Transitions {
public:
    explicit Transitions(fs::path folder) : folder_(std::move(folder)) {}
    RunListener listener() {
        return [this](const RunStatus&) {
            const auto status = readRunStatus(folder_);
            if (!status) return;
            if (states_.empty() || states_.back() != status->state) {
                const RunState before = states_.empty() ? RunState::Idle : states_.back();
                EXPECT_TRUE(runStateMayFollow(before, status->state))
                    << runStateName(status->state) << " after " << runStateName(before);
                states_.push_back(status->state);
            }
        };
    }
    std::string text() const {
        std::string text;
        for (const RunState state : states_) text.append(text.empty() ? "" : " ").append(runStateName(state));
        return text;
    }

private:
    fs::path folder_;
    std::vector<RunState> states_;
};

TEST(Run, WorksThroughItsTaskAndKeepsTheNewestCheckpoints) {
    const test::TemporaryFolder folder;
    const fs::path run = folder / "run";
    ChaoticTask task;
    RunOptions options = quickOptions();
    options.previewSteps = 50;
    options.policy.milestoneSteps = 40;
    Transitions transitions(run);
    const auto status = runIn(run, task, options, transitions.listener());
    ASSERT_TRUE(status.ok()) << status.error().describe();
    EXPECT_EQ(status->state, RunState::Finished);
    EXPECT_EQ(status->step, 100);
    EXPECT_EQ(status->checkpoint, "checkpoints/00000100");
    EXPECT_EQ(task.stateText(), stateAfter(100));
    EXPECT_TRUE(transitions.text().starts_with("loading running saving running saving")) << transitions.text();
    EXPECT_TRUE(transitions.text().ends_with("running saving finished")) << transitions.text();

    const auto entries = listCheckpoints(run);
    ASSERT_TRUE(entries.ok());
    std::vector<std::int64_t> steps;
    for (const CheckpointEntry& entry : *entries) steps.push_back(entry.step);
    EXPECT_EQ(steps, (std::vector<std::int64_t>{40, 80, 90, 100})) << "milestones 40 and 80, and the two newest";
    EXPECT_TRUE(entries->front().kept);
    EXPECT_EQ(task.previews, (std::vector<std::int64_t>{50, 100})) << "each once";
    EXPECT_EQ(listPreviews(run).size(), 2u);
    EXPECT_EQ(test::metricsLines(run), 100u);
    EXPECT_FALSE(runOwned(run));
}

TEST(Run, FinishedRunResumesToFinishedWithoutAStep) {
    const test::TemporaryFolder folder;
    ChaoticTask task;
    ASSERT_TRUE(runIn(folder / "run", task, quickOptions()).ok());
    ChaoticTask again;
    again.onStep = [](std::int64_t) { return Status(makeError(ErrorCode::Internal, "", "stepped")); };
    Transitions transitions(folder / "run");
    const auto status = runIn(folder / "run", again, quickOptions(), transitions.listener());
    ASSERT_TRUE(status.ok()) << status.error().describe();
    EXPECT_EQ(status->state, RunState::Finished);
    EXPECT_EQ(transitions.text(), "loading running finished");
}

TEST(Run, ObeysTheControlFileFromAnotherThread) {
    const test::TemporaryFolder folder;
    const fs::path run = folder / "run";
    const auto stateIs = [&](RunState state) {
        return waitUntil([&] {
            const auto status = readRunStatus(run);
            return status && status->state == state;
        });
    };
    ChaoticTask task;
    task.stepTime = 1ms;
    task.total = 100000;
    std::thread person([&] {
        EXPECT_TRUE(waitUntil([&] { return test::metricsLines(run) > 5; }));
        EXPECT_TRUE(requestOfRun(run, RunRequest::Pause).ok());
        EXPECT_TRUE(stateIs(RunState::Paused));
        const std::int64_t at = readRunStatus(run)->step;
        const std::size_t lines = test::metricsLines(run);
        EXPECT_EQ(listCheckpoints(run)->back().step, at) << "a pause leaves a checkpoint";
        std::this_thread::sleep_for(60ms);
        EXPECT_EQ(test::metricsLines(run), lines) << "nothing happens while it is paused";
        EXPECT_TRUE(requestOfRun(run, RunRequest::Resume).ok());
        EXPECT_TRUE(stateIs(RunState::Running));
        EXPECT_TRUE(waitUntil([&] { return test::metricsLines(run) > lines + 3; }));
        EXPECT_TRUE(requestOfRun(run, RunRequest::Save).ok());
        EXPECT_TRUE(waitUntil([&] { return !fs::exists(run / kRunControlFile); }));
        EXPECT_TRUE(waitUntil([&] { return listCheckpoints(run)->back().step > at; }));
        std::ofstream(run / kRunControlFile) << "{\"request\": \"dance\"}";
        EXPECT_TRUE(waitUntil([&] { return !fs::exists(run / kRunControlFile); })) << "nonsense is taken away";
        EXPECT_TRUE(requestOfRun(run, RunRequest::Stop).ok());
    });
    RunOptions options = quickOptions();
    options.checkpointSteps = 1000000;
    Transitions transitions(run);
    const auto status = runIn(run, task, options, transitions.listener());
    person.join();
    ASSERT_TRUE(status.ok()) << status.error().describe();
    EXPECT_EQ(status->state, RunState::Idle);
    EXPECT_EQ(transitions.text(), "loading running pausing paused running saving running stopping idle");
    EXPECT_EQ(listCheckpoints(run)->back().step, status->step);

    ChaoticTask rest;
    rest.total = status->step + 20;
    ASSERT_TRUE(runIn(run, rest, options).ok());
    EXPECT_EQ(rest.stateText(), stateAfter(static_cast<int>(rest.total))) << "as if it had never been stopped";
}

TEST(Run, DiscardRemovesTheFolderAlsoWhilePaused) {
    const test::TemporaryFolder folder;
    const fs::path run = folder / "run";
    ChaoticTask task;
    task.stepTime = 1ms;
    task.total = 100000;
    std::thread person([&] {
        EXPECT_TRUE(waitUntil([&] { return test::metricsLines(run) > 5; }));
        EXPECT_TRUE(requestOfRun(run, RunRequest::Pause).ok());
        EXPECT_TRUE(waitUntil([&] { return readRunStatus(run)->state == RunState::Paused; }));
        EXPECT_TRUE(requestOfRun(run, RunRequest::Discard).ok());
    });
    const auto status = runIn(run, task, quickOptions());
    person.join();
    ASSERT_TRUE(status.ok()) << status.error().describe();
    EXPECT_EQ(status->state, RunState::Idle);
    EXPECT_FALSE(fs::exists(run));
}

TEST(Run, SignalStopsWithACheckpointAlsoWhilePausedOrLoading) {
    const test::TemporaryFolder folder;
    for (const bool paused : {false, true}) {
        const fs::path run = folder / (paused ? "paused" : "running");
        const auto writer = RunWriter::create(run, nlohmann::json::object());
        ASSERT_TRUE(writer.ok());
        RunSignals signals;
        ChaoticTask task;
        task.total = 100000;
        task.onStep = [&](std::int64_t step) {
            if (step == 25) {
                if (paused) return requestOfRun(run, RunRequest::Pause);
                signals.stop = true;
            }
            return Status();
        };
        const auto listener = [&](const RunStatus& status) {
            if (status.state == RunState::Paused) signals.stop = true;
        };
        const auto status = runTraining(**writer, task, quickOptions(), false, signals, listener);
        ASSERT_TRUE(status.ok()) << status.error().describe();
        EXPECT_EQ(status->state, RunState::Idle);
        EXPECT_EQ(status->note, "stopped on request at step 25");
        EXPECT_EQ(listCheckpoints(run)->back().step, 25);
    }
    const auto writer = RunWriter::create(folder / "loading", nlohmann::json::object());
    RunSignals signals;
    ChaoticTask task;
    task.onLoad = [&](const ProgressFunction& progress) {
        EXPECT_TRUE(reportProgress(progress, 0.25, "reading").ok());
        EXPECT_EQ((*writer)->lastStatus().state, RunState::Loading);
        signals.stop = true;
        return reportProgress(progress, 0.5, "reading");
    };
    const auto status = runTraining(**writer, task, quickOptions(), false, signals);
    ASSERT_TRUE(status.ok());
    EXPECT_EQ(status->state, RunState::Idle);
    EXPECT_TRUE(listCheckpoints(folder / "loading")->empty());
}

TEST(Run, StopAndDiscardEndTheLoadingWhateverWasAskedBefore) {
    const test::TemporaryFolder folder;
    for (const RunRequest last : {RunRequest::Stop, RunRequest::Discard}) {
        const fs::path run = folder / std::string(runRequestName(last));
        const auto writer = RunWriter::create(run, nlohmann::json::object());
        ASSERT_TRUE(writer.ok());
        ChaoticTask task;
        task.onLoad = [&](const ProgressFunction& progress) -> Status {
            for (const RunRequest request : {RunRequest::Save, RunRequest::Pause, last}) {
                ARS_TRY_STATUS(requestOfRun(run, request));
                ARS_TRY_STATUS(reportProgress(progress, 0.5, "reading"));
            }
            return makeError(ErrorCode::Internal, "", "it went on loading");
        };
        const RunSignals signals;
        const auto status = runTraining(**writer, task, quickOptions(), false, signals);
        ASSERT_TRUE(status.ok()) << status.error().describe();
        EXPECT_EQ(status->state, RunState::Idle);
        EXPECT_EQ(fs::exists(run), last == RunRequest::Stop);
    }
}

TEST(Run, WhatIsAskedWhileLoadingIsDoneInItsOrder) {
    const test::TemporaryFolder folder;
    const fs::path run = folder / "run";
    const auto writer = RunWriter::create(run, nlohmann::json::object());
    ASSERT_TRUE(writer.ok());
    ChaoticTask task;
    task.onLoad = [&](const ProgressFunction& progress) -> Status {
        for (const RunRequest request : {RunRequest::Pause, RunRequest::Resume}) {
            ARS_TRY_STATUS(requestOfRun(run, request));
            ARS_TRY_STATUS(reportProgress(progress, 0.5, "reading"));
        }
        return {};
    };
    Transitions transitions(run);
    const RunSignals signals;
    const auto status = runTraining(**writer, task, quickOptions(), false, signals, transitions.listener());
    ASSERT_TRUE(status.ok()) << status.error().describe();
    EXPECT_TRUE(transitions.text().starts_with("loading running pausing paused running")) << transitions.text();
}

TEST(Run, StatusIsValidJsonWhileItIsRewritten) {
    const test::TemporaryFolder folder;
    const fs::path run = folder / "run";
    std::atomic<bool> done{false};
    int seen = 0;
    int broken = 0;
    std::thread reader([&] {
        while (!done) {
            std::ifstream file(run / kRunStatusFile);
            if (!file) continue;
            const auto json = nlohmann::json::parse(file, nullptr, false);
            ++seen;
            broken += json.is_discarded() || !runStatusFromJson(json).ok() ? 1 : 0;
        }
    });
    ChaoticTask task;
    task.total = 80;
    RunOptions options = quickOptions();
    options.checkpointSteps = 2; // two changes of state each
    const auto status = runIn(run, task, options);
    done = true;
    reader.join();
    ASSERT_TRUE(status.ok());
    EXPECT_GT(seen, 20);
    EXPECT_EQ(broken, 0);
}

TEST(Run, StatusIsRefreshedDuringALongStep) {
    const test::TemporaryFolder folder;
    const fs::path run = folder / "run";
    ChaoticTask task;
    task.total = 2;
    double before = 0;
    double during = 0;
    task.onStep = [&](std::int64_t step) {
        if (step != 2) return Status();
        before = readRunStatus(run)->updatedUnixS;
        // As long as a busy machine takes; waited for, not timed.
        for (int i = 0; i < 600 && during <= before; ++i) {
            std::this_thread::sleep_for(50ms);
            during = readRunStatus(run)->updatedUnixS;
        }
        return Status();
    };
    ASSERT_TRUE(runIn(run, task, quickOptions()).ok());
    EXPECT_GT(during, before);
}

/// What a failure of the step at 35 must leave, whatever it was.
void expectFailedAt30(const fs::path& run, ErrorCode code, const std::string& part,
                      const std::function<void(ChaoticTask&)>& prepare) {
    ChaoticTask task;
    prepare(task);
    Transitions transitions(run);
    const auto status = runIn(run, task, quickOptions(), transitions.listener());
    ASSERT_FALSE(status.ok());
    EXPECT_EQ(status.error().code, code) << status.error().describe();
    const std::string text = status.error().describe();
    EXPECT_NE(text.find(part), std::string::npos) << text;
    EXPECT_NE(text.find("the checkpoint of step 30 is intact"), std::string::npos) << text;
    EXPECT_EQ(text.find('\n'), std::string::npos) << text;
    EXPECT_TRUE(transitions.text().ends_with("running failed")) << transitions.text();
    const auto told = readRunStatus(run);
    ASSERT_TRUE(told.ok());
    EXPECT_EQ(told->error, text);
    ChaoticTask again;
    const auto finished = runIn(run, again, quickOptions());
    ASSERT_TRUE(finished.ok()) << finished.error().describe();
    EXPECT_EQ(finished->error, "") << "what failed before is over";
    EXPECT_EQ(again.stateText(), stateAfter(100));
    EXPECT_EQ(test::metricsLines(run), 100u);
}

TEST(Run, FailuresAreNamedAndLeaveTheCheckpoint) {
    const test::TemporaryFolder folder;
    expectFailedAt30(folder / "error", ErrorCode::BadFile, "0012.png: no picture", [](ChaoticTask& task) {
        task.onStep = [](std::int64_t step) {
            return step == 35 ? Status(makeError(ErrorCode::BadFile, "0012.png", "no picture")) : Status();
        };
    });
    expectFailedAt30(folder / "nan", ErrorCode::Internal, "loss term l1 is nan", [](ChaoticTask& task) {
        task.loss = [](std::int64_t step, double x) {
            return step == 35 ? std::numeric_limits<double>::quiet_NaN() : x;
        };
    });
    expectFailedAt30(folder / "memory", ErrorCode::OutOfMemory, "not enough memory", [](ChaoticTask& task) {
        task.onStep = [](std::int64_t step) -> Status {
            if (step == 35) throw std::bad_alloc();
            return {};
        };
    });
    expectFailedAt30(
        folder / "tensor", ErrorCode::OutOfMemory, "not enough memory: 3.0 GiB were refused", [](ChaoticTask& task) {
            task.onStep = [](std::int64_t step) -> Status {
                TORCH_CHECK(step != 35, "DefaultCPUAllocator: can't allocate memory: you tried to allocate "
                                        "3221225472 bytes. Error code 12 (Cannot allocate memory)");
                return {};
            };
        });
    expectFailedAt30(folder / "torch", ErrorCode::Internal, "sizes do not match", [](ChaoticTask& task) {
        task.onStep = [](std::int64_t step) -> Status {
            TORCH_CHECK(step != 35, "sizes do not match\nwith a trace");
            return {};
        };
    });
}

TEST(Run, MemoryThatIsRefusedOutsideAStepIsNamedToo) {
    // In what tells of the run, at a moment when nothing of the task is at work.
    const test::TemporaryFolder folder;
    const fs::path run = folder / "run";
    ChaoticTask task;
    const auto status = runIn(run, task, quickOptions(), [](const RunStatus& told) {
        if (told.step == 35 && told.state == RunState::Running) throw std::bad_alloc();
    });
    ASSERT_FALSE(status.ok());
    EXPECT_EQ(status.error().code, ErrorCode::OutOfMemory);
    EXPECT_EQ(status.error().describe(), "training: not enough memory; the checkpoint of step 30 is intact");
    EXPECT_EQ(readRunStatus(run)->state, RunState::Failed);
    EXPECT_EQ(listCheckpoints(run)->back().step, 30);
    ChaoticTask again;
    ASSERT_TRUE(runIn(run, again, quickOptions()).ok());
    EXPECT_EQ(again.stateText(), stateAfter(100));

    // A checkpoint that is half written by then is taken away.
    const fs::path saved = folder / "saved";
    const auto writer = RunWriter::create(saved, nlohmann::json::object());
    ASSERT_TRUE(writer.ok());
    const Status thrown = (*writer)->saveCheckpoint(1, {}, [](const fs::path& temporary) -> Status {
        std::ofstream(temporary / "half") << "half";
        throw std::bad_alloc();
    });
    ASSERT_FALSE(thrown.ok());
    EXPECT_EQ(thrown.error().code, ErrorCode::OutOfMemory);
    EXPECT_TRUE(fs::is_empty(saved / kRunCheckpointFolder));
}

TEST(Run, AThreadThatIsRefusedIsMemoryThatIsRefused) {
    const auto failure = withoutExceptions<Status>("loading", []() -> Status {
        throw std::system_error(std::make_error_code(std::errc::resource_unavailable_try_again));
    });
    EXPECT_EQ(failure.error().code, ErrorCode::OutOfMemory);
    EXPECT_EQ(failure.error().describe(), "loading: not enough memory: a thread was refused");
    const auto other = withoutExceptions<Status>("loading", []() -> Status {
        throw std::system_error(std::make_error_code(std::errc::permission_denied), "a door");
    });
    EXPECT_EQ(other.error().code, ErrorCode::Internal);
    EXPECT_NE(other.error().message.find("a door"), std::string::npos);
}

TEST(Run, FailureBeforeTheFirstCheckpointSaysSo) {
    const test::TemporaryFolder folder;
    ChaoticTask task;
    task.onStep = [](std::int64_t) -> Status { return makeError(ErrorCode::Internal, "step", "broke"); };
    const auto status = runIn(folder / "run", task, quickOptions());
    ASSERT_FALSE(status.ok());
    EXPECT_EQ(status.error().describe(), "step: broke; there is no earlier checkpoint");

    ChaoticTask unloadable;
    unloadable.onLoad = [](const ProgressFunction&) -> Status { throw std::bad_alloc(); };
    const auto loading = runIn(folder / "loading", unloadable, quickOptions());
    ASSERT_FALSE(loading.ok());
    EXPECT_EQ(loading.error().describe(), "loading: not enough memory");
}

TEST(Run, FailuresOfAResumeSayWhichCheckpointIsIntact) {
    const test::TemporaryFolder folder;
    const fs::path run = folder / "run";
    ChaoticTask task;
    ASSERT_TRUE(runIn(run, task, quickOptions()).ok());
    ChaoticTask unloadable;
    unloadable.onLoad = [](const ProgressFunction&) { return Status(makeError(ErrorCode::NotFound, "cam", "gone")); };
    const auto loading = runIn(run, unloadable, quickOptions());
    ASSERT_FALSE(loading.ok());
    EXPECT_EQ(loading.error().describe(), "cam: gone; the checkpoint of step 100 is intact");
    EXPECT_EQ(readRunStatus(run)->error, loading.error().describe());
    ChaoticTask large;
    large.onRestore = []() -> Status { throw std::bad_alloc(); };
    const auto restoring = runIn(run, large, quickOptions());
    ASSERT_FALSE(restoring.ok());
    EXPECT_EQ(restoring.error().describe(), "restoring: not enough memory; the checkpoint of step 100 is intact");
}

TEST(Run, ParametersThatDoNotGoWithTheCheckpointCostNone) {
    const test::TemporaryFolder folder;
    const fs::path run = folder / "run";
    ChaoticTask task;
    ASSERT_TRUE(runIn(run, task, quickOptions()).ok());
    ChaoticTask other;
    int tried = 0;
    other.onRestore = [&] {
        ++tried;
        return Status(makeError(ErrorCode::InvalidArgument, "size", "is 3 now, expected 2"));
    };
    const auto status = runIn(run, other, quickOptions());
    ASSERT_FALSE(status.ok());
    EXPECT_EQ(status.error().describe(), "size: is 3 now, expected 2; the checkpoint of step 100 is intact");
    EXPECT_EQ(tried, 1) << "what does not go with one goes with none";
    EXPECT_EQ(listCheckpoints(run)->size(), 2u);
    EXPECT_EQ(test::metricsLines(run), 100u);
}

TEST(Run, ToldOfAResumeOnlyOnceItsCheckpointIsRestored) {
    const test::TemporaryFolder folder;
    const fs::path run = folder / "run";
    std::vector<std::int64_t> told;
    RunOptions options = quickOptions();
    options.onRestored = [&](std::int64_t step) {
        EXPECT_EQ(readRunStatus(run)->state, RunState::Loading);
        told.push_back(step);
        return Status();
    };
    ChaoticTask task;
    ASSERT_TRUE(runIn(run, task, options).ok());
    EXPECT_TRUE(told.empty()) << "a new run is no resume";
    ChaoticTask other;
    other.onRestore = [] { return Status(makeError(ErrorCode::InvalidArgument, "size", "is 3")); };
    EXPECT_FALSE(runIn(run, other, options).ok());
    other.onRestore = [] { return Status(makeError(ErrorCode::BadFile, "state", "cut")); };
    setLogToStderr(false);
    EXPECT_FALSE(runIn(run, other, options).ok());
    setLogToStderr(true);
    ChaoticTask unloadable;
    unloadable.onLoad = [](const ProgressFunction&) { return Status(makeError(ErrorCode::NotFound, "cam", "gone")); };
    EXPECT_FALSE(runIn(run, unloadable, options).ok());
    EXPECT_TRUE(told.empty());
    ChaoticTask again;
    ASSERT_TRUE(runIn(run, again, options).ok());
    EXPECT_EQ(told, (std::vector<std::int64_t>{100}));
}

TEST(Run, BrokenCheckpointsArePassedOverNamedAndKept) {
    const test::TemporaryFolder folder;
    const fs::path run = folder / "run";
    ChaoticTask task;
    RunOptions options = quickOptions();
    options.policy.newest = 4;
    ASSERT_TRUE(runIn(run, task, options).ok());
    std::ofstream(run / "checkpoints/00000100/state.txt") << "half";
    fs::remove(run / "checkpoints/00000090/complete.json");
    fs::remove(run / "checkpoints/00000080/state.txt");
    std::vector<std::string> said;
    const int sink = addLogSink([&](const LogRecord& record) { said.push_back(record.text); });
    setLogToStderr(false);
    ChaoticTask again;
    const auto status = runIn(run, again, options);
    removeLogSink(sink);
    setLogToStderr(true);
    ASSERT_TRUE(status.ok()) << status.error().describe();
    EXPECT_EQ(again.stateText(), stateAfter(100));
    ASSERT_EQ(said.size(), 2u);
    EXPECT_NE(said[0].find("00000100"), std::string::npos) << said[0];
    EXPECT_NE(said[1].find("00000080"), std::string::npos) << said[1];
    EXPECT_TRUE(fs::exists(run / "checkpoints/00000100.broken/state.txt")) << "kept for who wants to look";
    EXPECT_EQ(test::metricsLines(run), 100u);
}

TEST(Run, WhereNoCheckpointRestoresNothingIsTouched) {
    const test::TemporaryFolder folder;
    const fs::path run = folder / "run";
    ChaoticTask task;
    ASSERT_TRUE(runIn(run, task, quickOptions()).ok());
    for (const char* name : {"00000090", "00000100"}) std::ofstream(run / "checkpoints" / name / "state.txt") << "half";
    setLogToStderr(false);
    ChaoticTask again;
    const auto status = runIn(run, again, quickOptions());
    setLogToStderr(true);
    ASSERT_FALSE(status.ok());
    EXPECT_NE(status.error().message.find("none of 2 checkpoints restores"), std::string::npos);
    EXPECT_EQ(listCheckpoints(run)->size(), 2u);
    EXPECT_EQ(test::metricsLines(run), 100u);
}

TEST(RunWriter, MakesRunsOnlyWhereNothingElseLies) {
    const test::TemporaryFolder folder;
    std::ofstream(folder / "file") << "text";
    fs::create_directories(folder / "full");
    std::ofstream(folder / "full" / "thesis.tex") << "text";
    for (const char* name : {"file", "full"}) {
        const auto writer = RunWriter::create(folder / name, nlohmann::json::object());
        ASSERT_FALSE(writer.ok());
        EXPECT_EQ(writer.error().code, ErrorCode::InvalidArgument) << writer.error().describe();
    }
    EXPECT_FALSE(fs::exists(folder / "full" / kRunLockFile)) << "nothing is left in folders of others";
    const auto missing = RunWriter::open(folder / "full");
    ASSERT_FALSE(missing.ok());
    EXPECT_EQ(missing.error().code, ErrorCode::NotFound);

    // A starter's log file, or a process that died before the configuration stood there, is no hindrance.
    fs::create_directories(folder / "new");
    std::ofstream(folder / "new" / kRunLogFile) << "log";
    std::ofstream(folder / "new" / kRunLockFile) << "{}";
    EXPECT_TRUE(RunWriter::create(folder / "new", nlohmann::json::object()).ok());
    const auto twice = RunWriter::create(folder / "new", nlohmann::json::object());
    ASSERT_FALSE(twice.ok());
    EXPECT_NE(twice.error().message.find("there is a run"), std::string::npos);
}

TEST(RunWriter, KeepsTheFormerConfiguration) {
    const test::TemporaryFolder folder;
    const auto writer = RunWriter::create(folder / "run", {{"rate", 1}});
    ASSERT_TRUE(writer.ok());
    ASSERT_TRUE((*writer)->rewriteConfig({{"rate", 2}}, 40).ok());
    EXPECT_EQ((*readRunConfig(folder / "run"))["rate"], 2);
    EXPECT_NE(readTextFile(folder / "run/config.40.json")->find("\"rate\": 1"), std::string::npos);
}

TEST(RunWriter, LeavesARunAloneThatAnotherMachineWorksOn) {
    const test::TemporaryFolder folder;
    const fs::path run = folder / "run";
    ASSERT_TRUE(RunWriter::create(run, nlohmann::json::object()).ok());
    // As it is seen over a file system whose locks stay on the other machine.
    const std::string owner = R"({"process": 123, "host": "elsewhere"})";
    std::ofstream(run / kRunLockFile) << owner;
    RunStatus status;
    status.state = RunState::Running;
    status.process = 123;
    status.host = "elsewhere";
    status.updatedUnixS = std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
    std::ofstream(run / kRunStatusFile) << runStatusToJson(status).dump();
    const auto second = RunWriter::open(run);
    ASSERT_FALSE(second.ok());
    EXPECT_EQ(second.error().code, ErrorCode::Unavailable);
    EXPECT_EQ(second.error().message, "process 123 on elsewhere works on this run; stop it first");
    EXPECT_EQ(*readTextFile(run / kRunLockFile), owner);

    status.updatedUnixS -= 60.0;
    std::ofstream(run / kRunStatusFile) << runStatusToJson(status).dump();
    setLogToStderr(false);
    EXPECT_TRUE(RunWriter::open(run).ok());
    setLogToStderr(true);
}

TEST(RunWriter, CutsMetricsAfterAStepAndTheHalfLineOfAKilledProcess) {
    const test::TemporaryFolder folder;
    const auto writer = RunWriter::create(folder / "run", nlohmann::json::object());
    ASSERT_TRUE(writer.ok());
    for (int step = 1; step <= 5; ++step) ASSERT_TRUE((*writer)->appendMetrics({step, "radiance", {}}).ok());
    std::ofstream(folder / "run" / kRunMetricsFile, std::ios::app) << "{\"step\": 6, \"sta";
    ASSERT_TRUE((*writer)->truncateAfter(9).ok());
    EXPECT_EQ(test::metricsLines(folder / "run"), 5u);
    EXPECT_TRUE(readTextFile(folder / "run" / kRunMetricsFile)->ends_with("}\n"));
    ASSERT_TRUE((*writer)->truncateAfter(3).ok());
    EXPECT_EQ(test::metricsLines(folder / "run"), 3u);
    ASSERT_TRUE((*writer)->truncateAfter(0).ok());
    EXPECT_EQ(test::metricsLines(folder / "run"), 0u);
}

TEST(RunWriter, ClearsAwayWhatAKilledProcessLeftHalfWritten) {
    const test::TemporaryFolder folder;
    const fs::path run = folder / "run";
    ASSERT_TRUE(RunWriter::create(run, nlohmann::json::object()).ok());
    for (const char* parent : {kRunCheckpointFolder, kRunPreviewFolder}) fs::create_directories(run / parent);
    const fs::path left[]{run / "status.json.tmp-12-3", run / kRunPreviewFolder / "00000040_0.png.tmp-12-4",
                          run / kRunCheckpointFolder / "00000040.partial"};
    for (const fs::path& path : left) std::ofstream(path) << "half";
    std::ofstream(run / kRunPreviewFolder / "00000020_0.png") << "whole";
    ASSERT_TRUE(RunWriter::open(run).ok());
    for (const fs::path& path : left) EXPECT_FALSE(fs::exists(path)) << path;
    EXPECT_TRUE(fs::exists(run / kRunPreviewFolder / "00000020_0.png"));
}

TEST(RunWriter, AStatusThatIsDamagedOrGoneIsNoHindrance) {
    const test::TemporaryFolder folder;
    const fs::path run = folder / "run";
    ChaoticTask task;
    ASSERT_TRUE(runIn(run, task, quickOptions()).ok());
    for (const bool gone : {false, true}) {
        std::ofstream(run / kRunStatusFile) << "{\"sta";
        if (gone) fs::remove(run / kRunStatusFile);
        const auto writer = RunWriter::open(run);
        ASSERT_TRUE(writer.ok()) << writer.error().describe();
        ChaoticTask again;
        const auto status = runTraining(**writer, again, quickOptions(), true, RunSignals());
        ASSERT_TRUE(status.ok()) << status.error().describe();
        EXPECT_EQ(status->step, 100);
        EXPECT_EQ(status->checkpoint, "checkpoints/00000100");
        EXPECT_EQ(readRunStatus(run)->state, RunState::Finished);
    }
}

TEST(RunWriter, DoesNotBringBackAFolderThatSomebodyRemoved) {
    const test::TemporaryFolder folder;
    const auto writer = RunWriter::create(folder / "run", nlohmann::json::object());
    ASSERT_TRUE(writer.ok());
    fs::remove_all(folder / "run");
    EXPECT_FALSE((*writer)->writeStatus({}).ok());
    EXPECT_FALSE((*writer)->appendMetrics({1, "radiance", {}}).ok());
    EXPECT_FALSE(fs::exists(folder / "run"));
}

} // namespace
} // namespace ars
