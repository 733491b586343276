#include "engine/core/process.h"

#include "engine/core/file.h"
#include "tests/support/test_data.h"

#include <gtest/gtest.h>

#include <csignal>

namespace ars {
namespace {

using namespace std::chrono_literals;

TEST(Process, BothStreamsAndTheExitCodeComeBack) {
    const auto result = runProcess({"sh", "-c", "cat; echo oops >&2; exit 3"}, {.input = "hello"});
    ASSERT_TRUE(result.ok());
    EXPECT_EQ(result->output, "hello");
    EXPECT_EQ(result->errors, "oops\n");
    EXPECT_EQ(result->exitCode, 3);
    EXPECT_FALSE(result->timedOut);
}

TEST(Process, AFedChildTakesPiecesAndItsWordsComeBack) {
    auto child = FedProcess::start({"sh", "-c", "tee /dev/stderr; exit 5"});
    ASSERT_TRUE(child.ok());
    const std::string piece(1 << 20, 'y');
    for (int i = 0; i < 8; ++i) {
        ASSERT_TRUE(child->write(std::as_bytes(std::span(piece))).ok());
    }
    const auto result = child->finish();
    ASSERT_TRUE(result.ok());
    EXPECT_EQ(result->output.size(), 8 * piece.size());
    EXPECT_EQ(result->errors.size(), 8 * piece.size());
    EXPECT_EQ(result->exitCode, 5);
}

TEST(Process, AFedChildThatStopsReadingIsAnError) {
    auto child = FedProcess::start({"sh", "-c", "echo enough >&2; exit 1"});
    ASSERT_TRUE(child.ok());
    const std::string piece(4 << 20, 'y');
    const Status written = child->write(std::as_bytes(std::span(piece)));
    ASSERT_FALSE(written.ok());
    EXPECT_NE(written.error().message.find("enough"), std::string::npos);
}

TEST(Process, MegabytesInBothDirectionsDoNotBlock) {
    const std::string input(8 << 20, 'x');
    const auto result = runProcess({"sh", "-c", "tee /dev/stderr"}, {.input = input});
    ASSERT_TRUE(result.ok());
    EXPECT_EQ(result->output.size(), input.size());
    EXPECT_EQ(result->errors.size(), input.size());
}

TEST(Process, ArgumentsAreNotSeenByAShell) {
    EXPECT_EQ(runProcess({"printf", "%s|", "a b", "$HOME", "`id`"})->output, "a b|$HOME|`id`|");
}

TEST(Process, EnvironmentAndFolderAreSet) {
    const test::TemporaryFolder folder;
    ProcessOptions options;
    options.environment = {{"ARS_PROBE", "42"}};
    options.workingFolder = folder.path();
    const auto result = runProcess({"sh", "-c", "echo $ARS_PROBE; pwd"}, options);
    EXPECT_EQ(result->output, "42\n" + folder.path().string() + "\n");
}

TEST(Process, AMissingProgramIsNamed) {
    const auto result = runProcess({"no-such-program-anywhere"});
    ASSERT_FALSE(result.ok());
    EXPECT_EQ(result.error().code, ErrorCode::NotFound);
    EXPECT_EQ(result.error().place, "no-such-program-anywhere");
}

TEST(Process, OneThatRunsTooLongIsEnded) {
    const auto start = std::chrono::steady_clock::now();
    const auto result = runProcess({"sleep", "60"}, {.timeout = 100ms});
    EXPECT_TRUE(result->timedOut);
    EXPECT_EQ(result->exitCode, 128 + SIGTERM);
    EXPECT_LT(std::chrono::steady_clock::now() - start, 10s);
}

TEST(Process, AChildWritesItsLogAndReportsItsEnd) {
    const test::TemporaryFolder folder;
    auto child = ChildProcess::start({"sh", "-c", "echo working; exec sleep 60"}, folder / "log", true);
    ASSERT_TRUE(child.ok());
    EXPECT_TRUE(child->running());
    while (readTextFile(folder / "log").value().empty()) {
    }
    ASSERT_TRUE(child->signal(SIGTERM).ok());
    ASSERT_TRUE(child->wait(5s));
    EXPECT_EQ(child->exitCode(), 128 + SIGTERM);
    EXPECT_FALSE(child->signal(SIGTERM).ok());
    EXPECT_EQ(readTextFile(folder / "log").value(), "working\n");
}

} // namespace
} // namespace ars
