#include "tests/support/test_data.h"
#include "tests/unit/model/run_fake_task.h"

#include <gtest/gtest.h>

#include <sys/mount.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <fstream>

namespace ars {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;
using test::ChaoticTask;
using test::metricsText;
using test::quickOptions;
using test::runIn;

/// A process that works on a run until it is killed. Never returns in the child.
template <typename Work>
pid_t inProcess(Work work) {
    const pid_t child = ::fork();
    if (child != 0) return child;
    work();
    ::_exit(0);
}

/// How a child ended: the signal, or 0.
int endOf(pid_t child) {
    int status = 0;
    ::waitpid(child, &status, 0);
    return WIFSIGNALED(status) ? WTERMSIG(status) : 0;
}

bool waitUntil(const std::function<bool()>& condition) {
    for (int i = 0; i < 2000; ++i) {
        if (condition()) return true;
        std::this_thread::sleep_for(5ms);
    }
    return false;
}

RunOptions killOptions() {
    RunOptions options = quickOptions();
    options.checkpointSteps = 25;
    return options;
}

constexpr int kWholeSteps = 1200;

ChaoticTask slowTask() {
    ChaoticTask task;
    task.total = kWholeSteps;
    task.stepTime = 300us;
    task.ballastBytes = 20000;
    return task;
}

/// Every checkpoint that is listed must open, whenever the writer died.
void expectCheckpointsOpen(const fs::path& folder) {
    const auto entries = listCheckpoints(folder);
    ASSERT_TRUE(entries.ok());
    for (const CheckpointEntry& entry : *entries) {
        ChaoticTask task = slowTask();
        const Status restored = task.restore(entry.folder);
        EXPECT_TRUE(restored.ok()) << restored.error().describe();
        EXPECT_EQ(task.stepsDone(), entry.step);
    }
}

struct Kills {
    int atWork = 0;
    std::map<std::string, int> moments;
};

/// Twenty kills of a run that goes on after each.
Kills killTwentyTimes(const fs::path& run, std::chrono::microseconds longestLife) {
    std::mt19937 random(20);
    std::uniform_int_distribution<std::int64_t> lifeUs(0, longestLife.count());
    Kills kills;
    for (int i = 0; i < 20; ++i) {
        const pid_t child = inProcess([&] {
            setLogToStderr(false);
            ChaoticTask task = slowTask();
            (void)runIn(run, task, killOptions());
        });
        std::this_thread::sleep_for(std::chrono::microseconds(lifeUs(random)));
        ::kill(child, SIGKILL);
        kills.atWork += endOf(child) == SIGKILL ? 1 : 0;
        EXPECT_FALSE(runOwned(run)) << "a dead owner holds no lock";
        if (const auto status = readRunStatus(run)) ++kills.moments[status->note];
        expectCheckpointsOpen(run);
    }
    return kills;
}

TEST(RunKill, KilledRunsEndInTheSameNumbersBitForBit) {
    const test::TemporaryFolder folder;
    ChaoticTask whole = slowTask();
    const auto begin = std::chrono::steady_clock::now();
    ASSERT_TRUE(runIn(folder / "whole", whole, killOptions()).ok());
    const auto wholeTime = std::chrono::steady_clock::now() - begin;

    // Lives are shares of what the whole takes here. Where the machine became faster or slower since, kills may have
    // come after the end or before the beginning: the twenty are then tried again with other lives.
    auto life = std::chrono::duration_cast<std::chrono::microseconds>(wholeTime / 10);
    fs::path run;
    Kills kills;
    for (int attempt = 0; attempt < 4; ++attempt) {
        run = folder / fmt::format("killed{}", attempt);
        kills = killTwentyTimes(run, life);
        if (kills.atWork < 15) {
            life /= 3;
        } else if (kills.moments.size() < 3) {
            life *= 3;
        } else {
            break;
        }
    }
    EXPECT_GE(kills.atWork, 15) << "most children must have been killed at work";
    EXPECT_GE(kills.moments.size(), 3u) << "kills must meet different moments";

    ChaoticTask last = slowTask();
    const auto finished = runIn(run, last, killOptions());
    ASSERT_TRUE(finished.ok()) << finished.error().describe();
    EXPECT_EQ(finished->state, RunState::Finished);
    EXPECT_EQ(last.stateText(), whole.stateText());
    EXPECT_EQ(metricsText(run), metricsText(folder / "whole"));
    EXPECT_EQ(test::metricsLines(run), static_cast<std::size_t>(kWholeSteps)) << "no row twice, none too many";
}

TEST(RunKill, SecondWriterIsRefusedAndADeadOwnerTakenOver) {
    const test::TemporaryFolder folder;
    const fs::path run = folder / "run";
    const pid_t owner = inProcess([&] {
        ChaoticTask task = slowTask();
        task.total = 1000000;
        (void)runIn(run, task, quickOptions());
    });
    ASSERT_TRUE(waitUntil([&] {
        const auto status = readRunStatus(run);
        return status && status->step > 20;
    }));
    EXPECT_TRUE(runOwned(run));
    EXPECT_EQ(readRunOwner(run).process, owner);
    const auto second = RunWriter::open(run);
    ASSERT_FALSE(second.ok());
    EXPECT_EQ(second.error().code, ErrorCode::Unavailable);
    EXPECT_NE(second.error().message.find(fmt::format("process {}", owner)), std::string::npos)
        << second.error().describe();
    const auto another = RunWriter::create(run, nlohmann::json::object());
    ASSERT_FALSE(another.ok());
    EXPECT_EQ(readRunStatus(run)->state == RunState::Failed, false) << "the owner is not disturbed";

    ::kill(owner, SIGKILL);
    EXPECT_EQ(endOf(owner), SIGKILL);
    const auto dead = readRunStatus(run);
    ASSERT_TRUE(dead.ok());
    EXPECT_EQ(dead->state, RunState::Failed);
    EXPECT_EQ(dead->error, "the process ended without a word");
    const auto successor = RunWriter::open(run);
    ASSERT_TRUE(successor.ok()) << successor.error().describe();
    EXPECT_EQ(readRunOwner(run).process, ::getpid());
    EXPECT_EQ((*successor)->lastStatus().state, RunState::Failed) << "written, not only told";
}

TEST(RunKill, RequestForADeadOwnerDoesNotMoveItsSuccessor) {
    const test::TemporaryFolder folder;
    const fs::path run = folder / "run";
    const pid_t owner = inProcess([&] {
        const auto writer = RunWriter::create(run, nlohmann::json::object());
        std::this_thread::sleep_for(60s); // does not look at requests
    });
    ASSERT_TRUE(waitUntil([&] { return looksLikeRunFolder(run) && readRunOwner(run).process == owner; }));
    ASSERT_TRUE(requestOfRun(run, RunRequest::Stop).ok());
    ::kill(owner, SIGKILL);
    endOf(owner);
    const auto refused = requestOfRun(run, RunRequest::Stop);
    ASSERT_FALSE(refused.ok());
    EXPECT_EQ(refused.error().code, ErrorCode::Unavailable);
    ChaoticTask task;
    const auto status = runIn(run, task, quickOptions());
    ASSERT_TRUE(status.ok()) << status.error().describe();
    EXPECT_EQ(status->state, RunState::Finished);
}

/// A disk of its own, small; needs the right to mount.
class SmallDisk {
public:
    explicit SmallDisk(const fs::path& path, const char* options) : path_(path) {
        fs::create_directories(path);
        mounted_ = ::mount("tmpfs", path.c_str(), "tmpfs", 0, options) == 0;
    }
    ~SmallDisk() {
        if (mounted_) ::umount2(path_.c_str(), MNT_DETACH);
    }
    bool mounted() const { return mounted_; }

private:
    fs::path path_;
    bool mounted_ = false;
};

class RunDisk : public ::testing::Test {
protected:
    bool mounted() {
        if (disk_.mounted()) return true;
        test::notRun("needs the right to mount a small tmpfs");
        return false;
    }
    void fill(std::size_t leaveBytes) {
        std::error_code ignored;
        const std::uint64_t available = fs::space(run_.parent_path(), ignored).available;
        std::ofstream(run_.parent_path() / "other", std::ios::binary) << std::string(available - leaveBytes, 'o');
    }
    void expectIntactAndResumable(std::int64_t step, const std::string& state) {
        const auto status = readRunStatus(run_);
        ASSERT_TRUE(status.ok()) << status.error().describe();
        EXPECT_EQ(status->state, RunState::Failed);
        EXPECT_NE(status->error.find(fmt::format("the checkpoint of step {} is intact", step)), std::string::npos)
            << status->error;
        ASSERT_TRUE(status->process == 0);
        const auto entries = listCheckpoints(run_);
        ASSERT_TRUE(entries.ok());
        ASSERT_FALSE(entries->empty());
        EXPECT_EQ(entries->back().step, step);
        for (const auto& entry : fs::directory_iterator(run_ / kRunCheckpointFolder)) {
            EXPECT_EQ(entry.path().extension(), "") << "nothing half written stays: " << entry.path();
        }
        fs::remove(run_.parent_path() / "other");
        ChaoticTask task = diskTask();
        const auto finished = runIn(run_, task, quickOptions());
        ASSERT_TRUE(finished.ok()) << finished.error().describe();
        EXPECT_EQ(task.stateText(), state);
        EXPECT_EQ(test::metricsLines(run_), 100u);
    }
    static ChaoticTask diskTask() {
        ChaoticTask task;
        task.ballastBytes = 300000;
        return task;
    }
    static std::string finalState() {
        ChaoticTask task;
        for (int i = 0; i < 100; ++i) EXPECT_TRUE(task.step().ok());
        return task.stateText();
    }

    test::TemporaryFolder folder_;
    SmallDisk disk_{folder_ / "disk", "size=2m"};
    fs::path run_ = folder_ / "disk" / "run";
};

TEST_F(RunDisk, FullDiskAtACheckpointIsNamedBeforeItIsWritten) {
    if (!mounted()) return;
    ChaoticTask task = diskTask();
    task.onStep = [&](std::int64_t step) {
        if (step == 35) fill(200000);
        return Status();
    };
    const auto status = runIn(run_, task, quickOptions());
    ASSERT_FALSE(status.ok());
    EXPECT_EQ(status.error().code, ErrorCode::Io);
    EXPECT_NE(status.error().message.find("not enough disk for"), std::string::npos) << status.error().describe();
    expectIntactAndResumable(30, finalState());
}

TEST_F(RunDisk, DiskThatFillsWhileACheckpointIsWrittenLeavesTheLastOne) {
    if (!mounted()) return;
    ChaoticTask task = diskTask();
    task.onStep = [&](std::int64_t step) {
        // There seems to be room for a checkpoint like the last one, but this one is larger.
        if (step == 35) {
            fill(400000);
            task.ballastBytes = 900000;
        }
        return Status();
    };
    const auto status = runIn(run_, task, quickOptions());
    ASSERT_FALSE(status.ok());
    EXPECT_NE(status.error().message.find("disk full"), std::string::npos) << status.error().describe();
    expectIntactAndResumable(30, finalState());
}

TEST_F(RunDisk, FullDiskAtAMetricsRowIsToldInTheStatusAllTheSame) {
    if (!mounted()) return;
    ChaoticTask task = diskTask();
    task.loss = [](std::int64_t, double x) { return x; };
    task.onStep = [&](std::int64_t step) {
        if (step == 35) fill(0);
        return Status();
    };
    RunOptions options = quickOptions();
    options.checkpointSteps = 30; // many rows before the next checkpoint, so that a row meets the end of a page
    task.total = 100;
    const auto status = runIn(run_, task, options);
    ASSERT_FALSE(status.ok());
    EXPECT_EQ(status.error().code, ErrorCode::Io);
    expectIntactAndResumable(30, finalState());
}

} // namespace
} // namespace ars
