#include "tests/unit/cli/run_ars.h"

#include <sys/resource.h>

namespace ars::test {
namespace {

const std::vector<std::string> kCommands{"info", "export", "import", "render", "light"};

TEST(CommandLine, HelpNamesEveryCommand) {
    const ProcessResult result = runArs({"--help"});
    EXPECT_EQ(result.exitCode, 0);
    for (const std::string& command : kCommands) EXPECT_NE(result.output.find("  " + command + " "), std::string::npos);
    EXPECT_NE(result.output.find("  stage "), std::string::npos);
    EXPECT_EQ(result.errors, "");
}

TEST(CommandLine, VersionIsOneLine) {
    const ProcessResult result = runArs({"--version"});
    EXPECT_EQ(result.exitCode, 0);
    EXPECT_TRUE(result.output.starts_with("ars ")) << result.output;
    EXPECT_EQ(countLines(result.output), 1u);
}

TEST(CommandLine, EveryCommandHasHelpThatNamesItsOptions) {
    for (const std::string& command : kCommands) {
        const ProcessResult result = runArs({command, "--help"});
        EXPECT_EQ(result.exitCode, 0) << command;
        EXPECT_NE(result.output.find("--json"), std::string::npos) << command;
        EXPECT_NE(result.output.find("--quiet"), std::string::npos) << command;
        EXPECT_EQ(result.errors, "") << command;
    }
    for (const char* option : {"--body", "--template", "--betas", "--pose", "--motion", "--frames", "--out"}) {
        EXPECT_NE(runArs({"export", "--help"}).output.find(option), std::string::npos) << option;
    }
    for (const char* option : {"--map", "--up", "--fps", "--floor", "--out"}) {
        EXPECT_NE(runArs({"import", "--help"}).output.find(option), std::string::npos) << option;
    }
}

TEST(CommandLine, WrongUsageIsExitCodeTwoAndOneErrorLine) {
    const std::vector<std::vector<std::string>> wrong{
        {"inof"},
        {"--nonsense"},
        {"info", "x", "--nonsense"},
        {"export"},
        {"export", "--out"},
        {"export", "--out", "x.obj", "stray"},
        {"export", "--out", "x.bmp"},
        {"export", "--out", "x.obj", "--frames", "1:2"},
        {"export", "--out", "x.obj", "--motion", "a.npz", "--pose", "b.npz"},
        {"export", "--out", "x.obj", "--betas", "one,two"},
        {"import"},
        {"import", "a.bvh"},
        {"import", "a.bvh", "--out", "a.txt"},
        {"import", "a.bvh", "--out", "a.npz", "--fps", "0"},
        {"import", "a.bvh", "--out", "a.npz", "--fps", "fast"},
        {"import", "a.bvh", "--out", "a.npz", "--up", "sideways"},
        {"import", "a.bvh", "--out", "a.npz", "--floor", "lava"},
        {"import", "a.bvh", "--out", "a.npz", "--frames", "9:3"},
        {"info", "x", "--log-level", "loud"},
    };
    for (const auto& arguments : wrong) {
        const ProcessResult result = runArs(arguments);
        const std::string shown = ::testing::PrintToString(arguments);
        EXPECT_EQ(result.exitCode, 2) << shown << result.errors;
        EXPECT_TRUE(result.errors.starts_with("error: ")) << shown << result.errors;
        EXPECT_EQ(result.output, "") << shown;
        EXPECT_FALSE(std::filesystem::exists("x.obj"));
    }
}

TEST(CommandLine, AMisspeltCommandOrOptionGetsTheNearOne) {
    EXPECT_NE(runArs({"inof"}).errors.find("did you mean info?"), std::string::npos);
    EXPECT_NE(runArs({"exprt", "--out", "x"}).errors.find("did you mean export?"), std::string::npos);
    EXPECT_NE(runArs({"export", "--out", "x.obj", "--btas", "1"}).errors.find("did you mean --betas?"),
              std::string::npos);
    EXPECT_EQ(runArs({"zzzzzz"}).errors.find("did you mean"), std::string::npos);
}

TEST(CommandLine, WithJsonErrorsAreJsonOnStandardOutput) {
    for (const auto& arguments :
         std::vector<std::vector<std::string>>{{"inof", "--json"},
                                               {"export", "--json"},
                                               {"export", "--json", "--out", "x.bmp"},
                                               {"export", "--json", "--out", "x.obj", "--body", "/nowhere.npz"},
                                               {"import", "--json", "/nowhere.bvh", "--out", "x.npz"}}) {
        const ProcessResult result = runArs(arguments);
        EXPECT_NE(result.exitCode, 0);
        const auto json = parsed(result);
        ASSERT_TRUE(json.contains("error")) << result.output;
        for (const char* key : {"code", "message", "place"}) EXPECT_TRUE(json["error"].contains(key)) << key;
        EXPECT_EQ(result.errors, "");
    }
    EXPECT_EQ(parsed(runArs({"export", "--json", "--out", "x.obj", "--body", "/nowhere.npz"}))["error"]["code"],
              "not_found");
}

/// Seconds of processor that all children which have ended took, their starts by the system included.
double processorOfChildren() {
    struct rusage usage{};
    EXPECT_EQ(::getrusage(RUSAGE_CHILDREN, &usage), 0);
    const auto seconds = [](const timeval& time) {
        return static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_usec);
    };
    return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

TEST(CommandLine, StartsWithinAFractionOfASecond) {
    // Nothing large may be linked: the median of five starts. The processor's time, not the clock's: a loaded machine
    // lets a program wait as long as it likes.
    std::vector<double> seconds;
    for (int i = 0; i < 5; ++i) {
        const double before = processorOfChildren();
        runArs({"--version"});
        seconds.push_back(processorOfChildren() - before);
    }
    std::sort(seconds.begin(), seconds.end());
    EXPECT_GT(seconds[2], 0.0) << "the children are not counted";
    EXPECT_LT(seconds[2], 0.25);
}

} // namespace
} // namespace ars::test
