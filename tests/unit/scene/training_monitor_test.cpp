// What is followed of a run, and how one is started: without model/, with a shell script for `ars train`.
#include "engine/scene/run_monitor.h"

#include "engine/core/file.h"
#include "tests/support/test_data.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <atomic>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <fstream>
#include <limits>
#include <mutex>
#include <thread>

namespace ars {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;

MetricsRow row(std::int64_t step, double total, double l1) {
    return {step, "radiance", {{"loss.total", total}, {"loss.l1", l1}, {"time.step_ms", 5.0}}};
}

bool waitFor(const std::function<bool()>& holds) {
    for (int i = 0; i < 6000; ++i) {
        if (holds()) return true;
        std::this_thread::sleep_for(5ms);
    }
    return false;
}

class TrainingMonitorTest : public ::testing::Test {
protected:
    void SetUp() override {
        fs::create_directories(run_);
        write(kRunConfigFile, R"({"sources": {"capture": "/data/casual"}, "training": {"preset": "tiny"}})");
        status_.state = RunState::Idle;
        status_.totalSteps = 100;
        tell();
    }
    void write(const fs::path& name, const std::string& text) {
        fs::create_directories((run_ / name).parent_path());
        ASSERT_TRUE(writeFileAtomic(run_ / name, text).ok());
    }
    void tell() {
        status_.updatedUnixS += 1.0;
        write(kRunStatusFile, runStatusToJson(status_).dump());
    }
    void add(const MetricsRow& metrics) {
        std::ofstream(run_ / kRunMetricsFile, std::ios::app) << metricsRowToJson(metrics).dump() << "\n";
    }

    test::TemporaryFolder folder_;
    fs::path run_ = folder_ / "casual-tiny";
    RunStatus status_;
};

TEST(RunCurves, HoldTheLossesAloneWithTheTotalFirst) {
    const auto curves = runCurves({row(1, 3.0, 2.0), row(2, 1.0, 0.5)}, 0.0);
    ASSERT_EQ(curves.size(), 2u);
    EXPECT_EQ(curves[0].name, "loss.total");
    EXPECT_EQ(curves[1].name, "loss.l1");
    EXPECT_EQ(curves[0].steps, (std::vector<double>{1, 2}));
    EXPECT_EQ(curves[0].values, (std::vector<double>{3, 1}));
    EXPECT_EQ(curves[0].smoothed, curves[0].values) << "weight 0 smooths nothing";
}

TEST(RunCurves, SmoothingBeginsAtTheFirstValueAndPassesOverWhatIsNoNumber) {
    std::vector<MetricsRow> rows;
    for (int i = 1; i <= 50; ++i) rows.push_back(row(i, 4.0, 1.0));
    rows[20].values["loss.total"] = std::numeric_limits<double>::quiet_NaN();
    const auto curves = runCurves(rows, 0.9);
    for (std::size_t i = 0; i < 50; ++i) {
        if (i == 20)
            EXPECT_TRUE(std::isnan(curves[0].values[i]));
        else
            EXPECT_NEAR(curves[0].smoothed[i], 4.0, 1e-12) << i;
    }
}

TEST(RunCurves, LongOnesAreThinnedOutByMeans) {
    std::vector<MetricsRow> rows;
    const int count = 10 * static_cast<int>(kMostCurvePoints);
    for (int i = 1; i <= count; ++i) rows.push_back(row(i, i, 0.0));
    const auto curves = runCurves(rows, 0.0);
    ASSERT_EQ(curves[0].steps.size(), kMostCurvePoints);
    EXPECT_EQ(curves[0].values.front(), 5.5) << "the mean of 1 to 10";
    EXPECT_EQ(curves[0].steps.back(), count);
    EXPECT_EQ(curves[0].values.back(), count - 4.5);
}

TEST_F(TrainingMonitorTest, FollowsStatusMetricsCheckpointsAndPreviews) {
    std::atomic<int> wakes{0};
    RunMonitor monitor([&] { ++wakes; });
    EXPECT_FALSE(monitor.latest());
    monitor.follow(run_);
    ASSERT_TRUE(waitFor([&] { return monitor.latest() != nullptr; }));
    EXPECT_EQ(monitor.latest()->capture, "/data/casual");
    EXPECT_EQ(monitor.latest()->preset, "tiny");
    EXPECT_FALSE(monitor.latest()->owned);
    EXPECT_FALSE(monitor.latest()->error);
    EXPECT_GT(wakes, 0);

    add(row(1, 2.0, 1.0));
    write("checkpoints/00000001/complete.json", R"({"step": 1})");
    write("previews/00000001.png", "x");
    status_.state = RunState::Finished;
    status_.step = 100;
    tell();
    ASSERT_TRUE(waitFor([&] { return monitor.latest()->status.step == 100 && monitor.latest()->rows == 1; }));
    EXPECT_EQ(monitor.latest()->status.state, RunState::Finished);
    ASSERT_EQ(monitor.latest()->checkpoints.size(), 1u);
    EXPECT_EQ(monitor.latest()->preview, run_ / "previews" / "00000001.png");

    const int before = wakes;
    std::this_thread::sleep_for(1s);
    EXPECT_EQ(wakes, before) << "where nothing happens nobody is woken";
    monitor.setSmoothing(0.5);
    ASSERT_TRUE(waitFor([&] { return wakes > before; }));
}

TEST_F(TrainingMonitorTest, SaysWhyAFolderCannotBeReadAndComesBack) {
    RunMonitor monitor;
    fs::remove(run_ / kRunStatusFile);
    monitor.follow(run_);
    ASSERT_TRUE(waitFor([&] { return monitor.latest() != nullptr; }));
    ASSERT_TRUE(monitor.latest()->error);
    tell();
    ASSERT_TRUE(waitFor([&] { return !monitor.latest()->error; }));
    monitor.follow({});
    EXPECT_FALSE(monitor.latest());
}

TEST_F(TrainingMonitorTest, AFolderThatIsFollowedAgainBeforeTheNextLookIsTold) {
    // The monitor's thread is held in its call back, so that both wishes come between two looks at the same folder.
    std::mutex mutex;
    std::condition_variable changed;
    bool called = false, goOn = false;
    RunMonitor monitor([&] {
        std::unique_lock lock(mutex);
        called = true;
        changed.notify_all();
        changed.wait(lock, [&] { return goOn; });
    });
    monitor.follow(run_);
    {
        std::unique_lock lock(mutex);
        ASSERT_TRUE(changed.wait_for(lock, 60s, [&] { return called; }));
    }
    ASSERT_TRUE(monitor.latest());
    monitor.follow(folder_ / "another");
    monitor.follow(run_);
    EXPECT_FALSE(monitor.latest());
    {
        const std::lock_guard lock(mutex);
        goOn = true;
    }
    changed.notify_all();
    EXPECT_TRUE(waitFor([&] { return monitor.latest() != nullptr; })) << "nothing is told of a run that stands still";
}

TEST_F(TrainingMonitorTest, SaysThatAFolderIsGone) {
    RunMonitor monitor;
    monitor.follow(run_);
    ASSERT_TRUE(waitFor([&] { return monitor.latest() != nullptr; }));
    EXPECT_FALSE(monitor.latest()->gone);
    fs::remove(run_ / kRunStatusFile);
    ASSERT_TRUE(waitFor([&] { return monitor.latest()->error.has_value(); }));
    EXPECT_FALSE(monitor.latest()->gone) << "the folder itself is there";
    fs::remove_all(run_);
    ASSERT_TRUE(waitFor([&] { return monitor.latest()->gone; }));
    EXPECT_TRUE(monitor.latest()->error);
    fs::create_directories(run_);
    tell();
    EXPECT_TRUE(waitFor([&] { return !monitor.latest()->gone && !monitor.latest()->error; }));
}

TEST(TrainingStarts, OnlyAHashBehindABlankBeginsAComment) {
    const auto settings =
        parseSettingLines("#a=1\n  # b=2\ndata.cameras=#3,4#5 # two\nloss.l1=2\t#tab\ndata.frames=#\n");
    ASSERT_TRUE(settings.ok());
    EXPECT_EQ(*settings, (std::vector<std::string>{"data.cameras=#3,4#5", "loss.l1=2", "data.frames=#"}));
}

TEST(TrainingStarts, SettingLinesAreReadOrNamed) {
    const auto settings = parseSettingLines(" schedule.radiance_steps = 20 \n\n# a word\nloss.l1=2 # twice\n");
    ASSERT_TRUE(settings.ok());
    EXPECT_EQ(*settings, (std::vector<std::string>{"schedule.radiance_steps=20", "loss.l1=2"}));
    const auto broken = parseSettingLines("loss.l1 2");
    ASSERT_FALSE(broken.ok());
    EXPECT_NE(broken.error().message.find("loss.l1 2"), std::string::npos);
}

TEST_F(TrainingMonitorTest, AStartIsACallOfTheProgramWhoseWordsGoToTheLog) {
    const fs::path script = folder_ / "train.sh";
    std::ofstream(script) << "#!/bin/sh\nfor word in \"$@\"; do echo \"$word\"; done\nexit 3\n";
    fs::permissions(script, fs::perms::owner_all);
    setTrainingProgram(script);
    TrainingStart start;
    start.run = folder_ / "new run";
    start.preset = "tiny";
    EXPECT_EQ(startTraining(start).error().place, "capture");
    start.capture = folder_ / "none";
    EXPECT_EQ(startTraining(start).error().code, ErrorCode::NotFound);
    start.capture = folder_.path();
    start.settings = {"loss.l1=2"};
    auto child = startTraining(start);
    ASSERT_TRUE(child.ok()) << child.error().describe();
    ASSERT_TRUE(child->wait(30s));
    EXPECT_EQ(child->exitCode(), 3);
    EXPECT_EQ(endOfLog(start.run, 9), "train\n--run\n" + start.run.string() + "\n--capture\n" +
                                          folder_.path().string() + "\n--preset\ntiny\n--set\nloss.l1=2");

    start.run = run_;
    EXPECT_NE(startTraining(start).error().message.find("resume it"), std::string::npos);
    child = startTraining({run_, {}, {}, {}, true});
    ASSERT_TRUE(child.ok());
    ASSERT_TRUE(child->wait(30s));
    EXPECT_EQ(endOfLog(run_), "train\n--run\n" + run_.string() + "\n--resume");
    EXPECT_FALSE(startTraining({folder_ / "nowhere", {}, {}, {}, true}).ok());
    // Alive on another machine whose lock is not seen here.
    status_.state = RunState::Running;
    status_.process = 123;
    status_.host = "elsewhere";
    status_.updatedUnixS = std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
    tell();
    const auto second = startTraining({run_, {}, {}, {}, true});
    ASSERT_FALSE(second.ok());
    EXPECT_NE(second.error().message.find("works on this run already"), std::string::npos);
    setTrainingProgram({});
}

} // namespace
} // namespace ars
