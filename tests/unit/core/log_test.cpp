#include "engine/core/log.h"

#include <gtest/gtest.h>

#include <thread>

namespace ars {
namespace {

TEST(Log, SinkReceivesEveryRecordInOrderUntilItIsRemoved) {
    setLogToStderr(false);
    std::vector<LogRecord> seen;
    const int handle = addLogSink([&](const LogRecord& record) { seen.push_back(record); });
    logInfo("step {}", 1);
    logWarning("slow: {:.1f} s", 2.5);
    logDebug("below the level");
    std::thread([] { logError("from another thread"); }).join();
    removeLogSink(handle);
    logInfo("after");
    setLogToStderr(true);

    ASSERT_EQ(seen.size(), 3u);
    EXPECT_EQ(seen[0].text, "step 1");
    EXPECT_EQ(seen[1].text, "slow: 2.5 s");
    EXPECT_EQ(seen[1].level, LogLevel::Warning);
    EXPECT_EQ(seen[2].text, "from another thread");
    EXPECT_EQ(seen[0].index + 1, seen[1].index);
    EXPECT_GE(seen[1].timeS, seen[0].timeS);
}

TEST(Log, ALateWindowFindsTheLatestRecords) {
    setLogToStderr(false);
    for (int i = 0; i < 5000; ++i) logInfo("line {}", i);
    setLogToStderr(true);
    const std::vector<LogRecord> recent = recentLog();
    ASSERT_EQ(recent.size(), 4096u);
    EXPECT_EQ(recent.back().text, "line 4999");
    EXPECT_EQ(recent.front().text, "line 904");
    EXPECT_EQ(recentLog(2).front().text, "line 4998");
}

} // namespace
} // namespace ars
