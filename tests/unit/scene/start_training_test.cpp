// A training that the window starts goes behind the window: nice 5, all of its threads.
#include "engine/scene/run_monitor.h"

#include "tests/support/test_data.h"

#include <gtest/gtest.h>

#include <sys/resource.h>

#include <algorithm>
#include <chrono>
#include <fstream>
#include <sstream>
#include <string>

namespace ars {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;

/// Field 19 of /proc/PID/stat. The name before it may hold spaces, so fields count from its bracket.
int nicenessOf(const fs::path& stat) {
    std::string text;
    std::getline(std::ifstream(stat) >> std::ws, text);
    std::istringstream fields(text.substr(text.rfind(')') + 1));
    std::string field;
    for (int i = 3; i <= 19; ++i) fields >> field;
    return std::stoi(field);
}

TEST(StartTraining, RunsAtNiceFiveWithEverythingThatItStarts) {
    const test::TemporaryFolder folder;
    const fs::path script = folder / "train.sh";
    // It and a child of its own say how nice they are once they are told to, whatever came before.
    std::ofstream(script) << "#!/bin/sh\nwhile [ ! -e '" << (folder / "go").string()
                          << "' ]; do sleep 0.05; done\ncat /proc/$$/stat > '" << (folder / "stat").string()
                          << "'\nnice > '" << (folder / "child").string() << "'\n";
    fs::permissions(script, fs::perms::owner_all);
    setTrainingProgram(script);
    TrainingStart start;
    start.run = folder / "run";
    start.capture = folder.path();
    auto training = startTraining(start);
    setTrainingProgram({});
    ASSERT_TRUE(training.ok()) << training.error().describe();
    const int own = ::getpriority(PRIO_PROCESS, 0);
    EXPECT_EQ(::getpriority(PRIO_PROCESS, static_cast<id_t>(training->id())), std::max(own, 5));
    std::ofstream(folder / "go") << "\n";
    ASSERT_TRUE(training->wait(60s));
    EXPECT_EQ(training->exitCode(), 0);
    EXPECT_EQ(nicenessOf(folder / "stat"), std::max(own, 5));
    int child = -1;
    std::ifstream(folder / "child") >> child;
    EXPECT_EQ(child, std::max(own, 5));
    EXPECT_EQ(::getpriority(PRIO_PROCESS, 0), own) << "this program stays as it is";
}

TEST(StartTraining, ARunWithADamagedStatusGoesOn) {
    const test::TemporaryFolder folder;
    setTrainingProgram("/bin/true");
    TrainingStart start;
    start.run = folder / "run";
    start.resume = true;
    fs::create_directories(start.run);
    EXPECT_FALSE(startTraining(start).ok()) << "no run yet";
    std::ofstream(start.run / kRunConfigFile) << "{}\n";
    std::ofstream(start.run / kRunStatusFile) << "{\"sta";
    auto training = startTraining(start);
    setTrainingProgram({});
    ASSERT_TRUE(training.ok()) << training.error().describe();
    ASSERT_TRUE(training->wait(60s));
    EXPECT_EQ(training->exitCode(), 0);
}

} // namespace
} // namespace ars
