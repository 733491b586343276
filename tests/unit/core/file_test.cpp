#include "engine/core/file.h"

#include "tests/support/test_data.h"

#include <gtest/gtest.h>

#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <fstream>

namespace ars {
namespace {

namespace fs = std::filesystem;

std::size_t entries(const fs::path& folder) {
    return static_cast<std::size_t>(std::distance(fs::directory_iterator(folder), fs::directory_iterator()));
}

TEST(File, WhatIsWrittenIsRead) {
    const test::TemporaryFolder folder;
    const fs::path path = folder / "deep/er/notes.txt";
    ASSERT_TRUE(writeFileAtomic(path, "first").ok());
    ASSERT_TRUE(writeFileAtomic(path, std::string_view("second\0half", 11)).ok());
    EXPECT_EQ(readTextFile(path).value(), std::string("second\0half", 11));
    EXPECT_EQ(readFile(path)->size(), 11u);
    EXPECT_EQ(readFileHead(path, 3)->size(), 3u);
    EXPECT_EQ(entries(path.parent_path()), 1u) << "no temporary file may stay";
}

TEST(File, NothingChangesWithoutCommit) {
    const test::TemporaryFolder folder;
    ASSERT_TRUE(writeFileAtomic(folder / "a", "old").ok());
    {
        auto file = AtomicFile::open(folder / "a");
        ASSERT_TRUE(file.ok());
        ASSERT_TRUE(file->write("new").ok());
        EXPECT_EQ(readTextFile(folder / "a").value(), "old");
    }
    EXPECT_EQ(readTextFile(folder / "a").value(), "old");
    EXPECT_EQ(entries(folder.path()), 1u);
}

TEST(File, AProcessKilledWhileWritingLeavesTheOldFileWhole) {
    const test::TemporaryFolder folder;
    ASSERT_TRUE(writeFileAtomic(folder / "a", "old").ok());
    const pid_t child = fork();
    if (child == 0) {
        auto file = AtomicFile::open(folder / "a");
        (void)file->write(std::string(1 << 20, 'n'));
        ::raise(SIGKILL);
    }
    int status = 0;
    ::waitpid(child, &status, 0);
    EXPECT_EQ(readTextFile(folder / "a").value(), "old");
}

TEST(File, AFileThatCannotGrowIsReportedAndTheOldOneStays) {
    const test::TemporaryFolder folder;
    ASSERT_TRUE(writeFileAtomic(folder / "a", "old").ok());
    const pid_t child = fork();
    if (child == 0) {
        // A limit on the file size stands in for a full disk: the kernel refuses the write in the same place.
        ::signal(SIGXFSZ, SIG_IGN);
        const rlimit limit{4096, 4096};
        ::setrlimit(RLIMIT_FSIZE, &limit);
        const Status status = writeFileAtomic(folder / "a", std::string(1 << 20, 'n'));
        const bool right = !status.ok() && status.error().code == ErrorCode::Io &&
                           status.error().describe().find("cannot be written") != std::string::npos;
        ::_exit(right ? 0 : 1);
    }
    int status = 0;
    ::waitpid(child, &status, 0);
    EXPECT_EQ(WEXITSTATUS(status), 0);
    EXPECT_EQ(readTextFile(folder / "a").value(), "old");
    EXPECT_EQ(entries(folder.path()), 1u);
}

TEST(File, WhatCannotBeReadIsNamed) {
    const test::TemporaryFolder folder;
    const Error missing = readFile(folder / "none").error();
    EXPECT_EQ(missing.code, ErrorCode::NotFound);
    EXPECT_EQ(missing.describe(), (folder / "none").string() + ": cannot be opened: no such file");
    EXPECT_NE(readFile(folder.path()).error().describe().find("this is a folder"), std::string::npos);
    EXPECT_NE(readFile("/dev/zero").error().describe().find("not a regular file"), std::string::npos);
}

TEST(File, AFileAboveTheLimitIsRefusedBeforeMemoryIsTaken) {
    const test::TemporaryFolder folder;
    ASSERT_TRUE(writeFileAtomic(folder / "sparse", "x").ok());
    fs::resize_file(folder / "sparse", 1ull << 40);
    ReadLimits limits;
    limits.maxBytes = 1 << 20;
    const Error error = readFile(folder / "sparse", limits).error();
    EXPECT_EQ(error.code, ErrorCode::LimitExceeded);
    EXPECT_NE(error.describe().find("1.0 TiB, the limit is 1.0 MiB"), std::string::npos) << error.describe();
}

} // namespace
} // namespace ars
