#include "engine/scene/run_folder.h"

#include "engine/core/file.h"
#include "tests/support/test_data.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <fstream>
#include <limits>
#include <map>

namespace ars {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

void write(const fs::path& path, const std::string& text) {
    fs::create_directories(path.parent_path());
    std::ofstream(path, std::ios::binary) << text;
}

void append(const fs::path& path, const std::string& text) {
    std::ofstream(path, std::ios::binary | std::ios::app) << text;
}

/// A run whose lock nobody holds, as seen from here: its status was written `secondsAgo` on `host`.
void writeRunning(const fs::path& folder, const std::string& host, double secondsAgo) {
    const auto now = std::chrono::system_clock::now().time_since_epoch();
    RunStatus status;
    status.state = RunState::Running;
    status.step = 7;
    status.process = 123;
    status.host = host;
    status.updatedUnixS = std::chrono::duration<double>(now).count() - secondsAgo;
    write(folder / kRunConfigFile, "{}");
    write(folder / kRunStatusFile, runStatusToJson(status).dump());
}

std::string rowLine(std::int64_t step, double value) {
    return metricsRowToJson({step, "radiance", {{"loss.l1", value}}}).dump() + "\n";
}

TEST(RunStatus, ReadsBackAsItWasWritten) {
    RunStatus status;
    status.state = RunState::Saving;
    status.stage = "pbr";
    status.step = 1234567890123;
    status.totalSteps = 1234567890124;
    status.stepMs = 0.1;
    status.etaS = 1e9;
    status.memoryBytes = 123456789012345ull;
    status.peakMemoryBytes = 2;
    status.losses = {{"l1", 0.1}, {"total", 1.0 / 3}};
    status.error = "a \"quoted\" sentence";
    status.note = "note";
    status.process = 42;
    status.host = "host";
    status.updatedUnixS = 1.7e9;
    status.checkpoint = "checkpoints/00000012";
    const auto back = runStatusFromJson(Json::parse(runStatusToJson(status).dump()));
    ASSERT_TRUE(back.ok()) << back.error().describe();
    EXPECT_EQ(runStatusToJson(*back), runStatusToJson(status));
    EXPECT_EQ(back->step, status.step);
    EXPECT_EQ(back->losses, status.losses);
}

TEST(RunStatus, LossesThatAreNoNumbersAreNull) {
    RunStatus status;
    status.losses["l1"] = std::numeric_limits<double>::quiet_NaN();
    const Json json = Json::parse(runStatusToJson(status).dump());
    EXPECT_TRUE(json["losses"]["l1"].is_null());
    EXPECT_TRUE(std::isnan(runStatusFromJson(json)->losses["l1"]));
}

TEST(RunStatus, BrokenOnesNameTheKey) {
    const auto failure = [](const char* text) {
        const auto status = runStatusFromJson(Json::parse(text));
        EXPECT_TRUE(status.ok() || status.error().code == ErrorCode::BadFile);
        return status ? std::string() : status.error().describe();
    };
    EXPECT_EQ(failure(R"({"state": "dancing"})"), "state: expected the name of a state, found \"dancing\"");
    EXPECT_EQ(failure(R"({"state": "idle", "step": "3"})"),
              "step: expected a whole number of at least 0, found string");
    EXPECT_EQ(failure(R"({"state": "idle", "step": -3})").substr(0, 5), "step:");
    EXPECT_EQ(failure(R"({"state": "idle", "process": 99999999999})").substr(0, 8), "process:");
    EXPECT_EQ(failure(R"({"state": "idle", "losses": {"l1": []}})"), "losses: l1: expected a number, found array");
    EXPECT_NE(failure("[]"), "");
    EXPECT_NE(failure("{}"), "");
    EXPECT_EQ(failure(R"({"state": "idle", "later": 1})"), "") << "keys of later versions are left alone";
}

TEST(RunStatus, TransitionsAreThoseOfTheTable) {
    // docs/user/training.md, written out once more.
    const std::map<std::string, std::vector<std::string>> table{
        {"idle", {"loading"}},
        {"loading", {"running", "stopping", "failed"}},
        {"running", {"pausing", "saving", "stopping", "finished", "failed"}},
        {"pausing", {"paused", "failed"}},
        {"paused", {"running", "saving", "stopping", "failed"}},
        {"saving", {"running", "paused", "finished", "failed"}},
        {"stopping", {"idle", "failed"}},
        {"finished", {"loading"}},
        {"failed", {"loading"}}};
    for (const std::string_view from : kRunStateNames) {
        for (const std::string_view to : kRunStateNames) {
            const auto& after = table.at(std::string(from));
            const bool listed = from == to || std::find(after.begin(), after.end(), to) != after.end();
            EXPECT_EQ(runStateMayFollow(*runStateFromName(from), *runStateFromName(to)), listed) << from << " " << to;
        }
    }
    EXPECT_FALSE(runStateFromName("resting").has_value());
}

TEST(RunFolder, IsKnownByItsConfigurationAndStatus) {
    const test::TemporaryFolder folder;
    EXPECT_FALSE(looksLikeRunFolder(folder.path()));
    write(folder / kRunConfigFile, "{}");
    EXPECT_FALSE(looksLikeRunFolder(folder.path()));
    write(folder / kRunStatusFile, "{\"state\": \"teapot\"}");
    EXPECT_FALSE(looksLikeRunFolder(folder.path()));
    write(folder / kRunStatusFile, "{\"state\": \"idle\"}");
    EXPECT_TRUE(looksLikeRunFolder(folder.path()));
    EXPECT_TRUE(readRunConfig(folder.path()).ok());
    write(folder / kRunConfigFile, "{");
    const auto config = readRunConfig(folder.path());
    ASSERT_FALSE(config.ok());
    EXPECT_NE(config.error().place.find("config.json"), std::string::npos);
}

TEST(RunFolder, StateWithoutItsProcessIsFailed) {
    const test::TemporaryFolder folder;
    write(folder / kRunConfigFile, "{}");
    for (const char* state : {"loading", "running", "pausing", "paused", "saving", "stopping"}) {
        write(folder / kRunStatusFile, fmt::format(R"({{"state": "{}", "step": 7, "process": 1}})", state));
        const auto status = readRunStatus(folder.path());
        ASSERT_TRUE(status.ok());
        EXPECT_EQ(status->state, RunState::Failed);
        EXPECT_EQ(status->error, "the process ended without a word");
        EXPECT_EQ(status->note, fmt::format("it was {} at step 7", state));
    }
    write(folder / kRunStatusFile, R"({"state": "finished"})");
    EXPECT_EQ(readRunStatus(folder.path())->state, RunState::Finished);
    const Status asked = requestOfRun(folder.path(), RunRequest::Stop);
    ASSERT_FALSE(asked.ok());
    EXPECT_EQ(asked.error().code, ErrorCode::Unavailable);
    EXPECT_FALSE(fs::exists(folder / kRunControlFile));
}

TEST(RunFolder, AFreshStatusOfAnotherMachineShowsAnOwnerWhoseLockIsNotSeen) {
    const test::TemporaryFolder folder;
    writeRunning(folder.path(), "elsewhere", 0.0);
    EXPECT_EQ(runOwnerElsewhere(folder.path()).process, 123);
    EXPECT_EQ(runOwnerElsewhere(folder.path()).host, "elsewhere");
    EXPECT_TRUE(runOwned(folder.path()));
    EXPECT_EQ(readRunStatus(folder.path())->state, RunState::Running);
    EXPECT_TRUE(requestOfRun(folder.path(), RunRequest::Pause).ok());
    EXPECT_TRUE(fs::exists(folder / kRunControlFile));

    char here[256] = {};
    ASSERT_EQ(::gethostname(here, sizeof here - 1), 0);
    for (const auto& [host, age] :
         std::map<std::string, double>{{"elsewhere", 11.0}, {"ahead", -11.0}, {here, 0.0}, {"", 0.0}}) {
        writeRunning(folder.path(), host, age);
        EXPECT_EQ(runOwnerElsewhere(folder.path()).process, 0) << host;
        EXPECT_FALSE(runOwned(folder.path())) << host;
        EXPECT_EQ(readRunStatus(folder.path())->state, RunState::Failed) << host;
    }
    write(folder / kRunStatusFile, R"({"state": "finished", "process": 123, "host": "elsewhere"})");
    EXPECT_EQ(runOwnerElsewhere(folder.path()).process, 0);
}

TEST(RunFolder, ListsOnlyCompleteCheckpointsOldestFirst) {
    const test::TemporaryFolder folder;
    EXPECT_TRUE(listCheckpoints(folder.path())->empty());
    const auto complete = [&](const char* name, const char* text) {
        write(folder / "checkpoints" / name / "complete.json", text);
    };
    complete("00000100", R"({"step": 100})");
    complete("00000020", R"({"step": 20, "kept": true})");
    complete("1000000000", R"({"step": 1000000000})");
    complete("00000030", R"({"step": 31})");         // says another step
    complete("00000040", R"({"step)");               // half
    complete("00000050.partial", R"({"step": 50})"); // not in place
    complete("00000060.broken", R"({"step": 60})");
    write(folder / "checkpoints/00000070/state.bin", "no mark");
    write(folder / "checkpoints/notes.txt", "text");
    const auto entries = listCheckpoints(folder.path());
    ASSERT_TRUE(entries.ok());
    ASSERT_EQ(entries->size(), 3u);
    EXPECT_EQ((*entries)[0].step, 20);
    EXPECT_TRUE((*entries)[0].kept);
    EXPECT_EQ((*entries)[1].step, 100);
    EXPECT_FALSE((*entries)[1].kept);
    EXPECT_EQ((*entries)[2].step, 1000000000);
}

TEST(RunFolder, ListsPreviewsByStep) {
    const test::TemporaryFolder folder;
    for (const char* name : {"00000200_a.png", "00000100_b.png", "00000100_a.jpg", "notes.txt", "cover.png"}) {
        write(folder / "previews" / name, "x");
    }
    std::string names;
    for (const fs::path& path : listPreviews(folder.path())) names += path.filename().string() + " ";
    EXPECT_EQ(names, "00000100_a.jpg 00000100_b.png 00000200_a.png ");
    EXPECT_TRUE(listPreviews(folder / "nowhere").empty());
}

TEST(MetricsFollower, WaitsForTheEndOfALine) {
    const test::TemporaryFolder folder;
    MetricsFollower follower(folder.path());
    EXPECT_FALSE(*follower.poll()) << "there is no file yet";
    const fs::path path = folder / kRunMetricsFile;
    const std::string second = rowLine(2, 0.2);
    append(path, rowLine(1, 0.1) + second.substr(0, 9));
    EXPECT_TRUE(*follower.poll());
    ASSERT_EQ(follower.rows().size(), 1u);
    EXPECT_FALSE(*follower.poll());
    append(path, second.substr(9));
    EXPECT_TRUE(*follower.poll());
    ASSERT_EQ(follower.rows().size(), 2u);
    EXPECT_EQ(follower.rows()[1].values.at("loss.l1"), 0.2);
    EXPECT_EQ(follower.rows()[1].stage, "radiance");
    EXPECT_EQ(follower.brokenLines(), 0);
}

TEST(MetricsFollower, SkipsAndCountsBrokenLines) {
    const test::TemporaryFolder folder;
    const fs::path path = folder / kRunMetricsFile;
    append(path, rowLine(1, 0.1) +
                     "{\"step\": 2, \"lo\n\n[1]\n{\"stage\": \"pbr\"}\n{\"step\": 3, \"loss.l1\": \"x\"}\n" +
                     rowLine(4, 0.4));
    MetricsFollower follower(folder.path());
    EXPECT_TRUE(*follower.poll());
    EXPECT_EQ(follower.brokenLines(), 5);
    ASSERT_EQ(follower.rows().size(), 2u);
    EXPECT_EQ(follower.rows()[1].step, 4);
}

TEST(MetricsFollower, RowsOfAnEarlierStepSupersedeLaterOnes) {
    const test::TemporaryFolder folder;
    const fs::path path = folder / kRunMetricsFile;
    for (int step = 1; step <= 5; ++step) append(path, rowLine(step, step));
    append(path, rowLine(3, 30));
    MetricsFollower follower(folder.path());
    EXPECT_TRUE(*follower.poll());
    ASSERT_EQ(follower.rows().size(), 3u);
    EXPECT_EQ(follower.rows()[2].values.at("loss.l1"), 30);
    append(path, rowLine(4, 40));
    EXPECT_TRUE(*follower.poll());
    EXPECT_EQ(follower.rows().back().values.at("loss.l1"), 40);
}

TEST(MetricsFollower, ReadsAFileAnewThatWasCutOrReplaced) {
    const test::TemporaryFolder folder;
    const fs::path path = folder / kRunMetricsFile;
    for (int step = 1; step <= 5; ++step) append(path, rowLine(step, step));
    MetricsFollower follower(folder.path());
    EXPECT_TRUE(*follower.poll());
    fs::resize_file(path, 2 * rowLine(1, 1.0).size());
    EXPECT_TRUE(*follower.poll());
    EXPECT_EQ(follower.rows().size(), 2u);
    // Cut and grown beyond where we were, between two looks.
    fs::resize_file(path, rowLine(1, 1.0).size());
    for (int step = 2; step <= 9; ++step) append(path, rowLine(step, 0.5 + step));
    EXPECT_TRUE(*follower.poll());
    ASSERT_EQ(follower.rows().size(), 9u);
    EXPECT_EQ(follower.rows()[1].values.at("loss.l1"), 2.5);
    fs::remove(path);
    EXPECT_TRUE(*follower.poll());
    EXPECT_TRUE(follower.rows().empty());
}

TEST(MetricsFollower, TakesLongFilesInPieces) {
    const test::TemporaryFolder folder;
    std::string text;
    for (int step = 1; step <= 40000; ++step) text += rowLine(step, 1.0 / step);
    ASSERT_GT(text.size(), 1u << 20);
    write(folder / kRunMetricsFile, text);
    MetricsFollower follower(folder.path());
    EXPECT_TRUE(*follower.poll());
    ASSERT_EQ(follower.rows().size(), 40000u);
    for (int step = 1; step <= 40000; ++step) {
        ASSERT_EQ(follower.rows()[static_cast<std::size_t>(step - 1)].step, step);
    }
    EXPECT_EQ(follower.brokenLines(), 0);
}

} // namespace
} // namespace ars
