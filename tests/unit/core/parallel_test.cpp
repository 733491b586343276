#include "engine/core/parallel.h"

#include <gtest/gtest.h>

#include <sys/resource.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cstdlib>
#include <fstream>
#include <mutex>
#include <set>
#include <stdexcept>
#include <thread>
#include <vector>

namespace ars {
namespace {

class Parallel : public ::testing::Test {
protected:
    void SetUp() override { before_ = threadCount(); }
    void TearDown() override { setThreadCount(before_); }
    int before_ = 1;
};

TEST_F(Parallel, EveryIndexIsVisitedOnce) {
    for (const int threads : {1, 2, 5}) {
        setThreadCount(threads);
        std::vector<std::atomic<int>> visits(100'003);
        parallelFor(visits.size(), [&](std::size_t i) { ++visits[i]; }, 7);
        for (const auto& count : visits) ASSERT_EQ(count.load(), 1);
    }
}

TEST_F(Parallel, PieceBordersDoNotDependOnTheThreads) {
    std::set<std::pair<std::size_t, std::size_t>> pieces[2];
    for (const int threads : {1, 4}) {
        setThreadCount(threads);
        std::mutex mutex;
        parallelRanges(5000, 100, [&](std::size_t begin, std::size_t end) {
            const std::lock_guard lock(mutex);
            pieces[threads == 4].emplace(begin, end);
        });
    }
    EXPECT_EQ(pieces[0], pieces[1]);
    EXPECT_EQ(pieces[0].size(), 50u);
}

TEST_F(Parallel, WorksOnSeveralThreadsAtOnce) {
    setThreadCount(2);
    std::mutex mutex;
    std::set<std::thread::id> ids;
    parallelRanges(64, 1, [&](std::size_t, std::size_t) {
        std::this_thread::sleep_for(std::chrono::milliseconds(2));
        const std::lock_guard lock(mutex);
        ids.insert(std::this_thread::get_id());
    });
    EXPECT_EQ(ids.size(), 2u);
}

TEST_F(Parallel, LoopsThatRunAtOnceShareTheBudget) {
    setThreadCount(4);
    std::atomic<int> running{0}, most{0};
    auto loop = [&] {
        parallelRanges(200, 1, [&](std::size_t, std::size_t) {
            const int now = ++running;
            int seen = most.load();
            while (now > seen && !most.compare_exchange_weak(seen, now)) {
            }
            std::this_thread::sleep_for(std::chrono::microseconds(300));
            --running;
        });
    };
    std::vector<std::thread> threads;
    for (int i = 0; i < 3; ++i) threads.emplace_back(loop);
    for (std::thread& thread : threads) thread.join();
    // The first loop takes all four; each that starts meanwhile works on its own thread alone.
    EXPECT_LE(most.load(), 4 + 2);
    EXPECT_EQ(threadsInUse(), 0);
}

TEST_F(Parallel, InnerLoopsRunOnTheThreadOfTheOuter) {
    setThreadCount(4);
    std::atomic<bool> strayed{false};
    parallelRanges(16, 1, [&](std::size_t, std::size_t) {
        const auto mine = std::this_thread::get_id();
        parallelRanges(16, 1, [&](std::size_t, std::size_t) {
            if (std::this_thread::get_id() != mine) strayed = true;
        });
    });
    EXPECT_FALSE(strayed);
}

TEST_F(Parallel, AnExceptionOfAPieceArrivesAtTheCaller) {
    setThreadCount(3);
    EXPECT_THROW(parallelFor(
                     10'000,
                     [](std::size_t i) {
                         if (i == 7777) throw std::runtime_error("7777");
                     },
                     10),
                 std::runtime_error);
    EXPECT_EQ(threadsInUse(), 0);
}

TEST_F(Parallel, LeaseTakesAndReturns) {
    setThreadCount(4);
    {
        const ThreadLease first(3);
        EXPECT_EQ(first.count(), 3);
        EXPECT_EQ(threadsInUse(), 3);
        std::thread([] {
            const ThreadLease second;
            EXPECT_EQ(second.count(), 1);
        }).join();
    }
    EXPECT_EQ(threadsInUse(), 0);
}

TEST_F(Parallel, ThreadsAreThereWhenNothingLimitsThem) {
    EXPECT_TRUE(threadsAvailable(0));
    EXPECT_TRUE(threadsAvailable(3));
}

#ifndef __SANITIZE_ADDRESS__ // which needs address space of its own
/// Sums 0...9999 on four threads with no room for a fifth stack; the exit code says what happened.
void sumWithoutRoom() {
    std::ifstream file("/proc/self/statm");
    rlim_t pages = 0;
    file >> pages;
    const rlim_t bytes = pages * static_cast<rlim_t>(sysconf(_SC_PAGESIZE)) + (4 << 20);
    const rlimit limit{bytes, bytes};
    if (pages == 0 || setrlimit(RLIMIT_AS, &limit) != 0) std::exit(2);
    setThreadCount(4);
    if (threadsAvailable(3)) std::exit(3);
    std::atomic<std::size_t> sum{0};
    parallelFor(10'000, [&](std::size_t i) { sum += i; }, 1);
    std::exit(sum == 49'995'000 ? 0 : 4);
}

TEST_F(Parallel, WhereThreadsAreRefusedTheCallingOneDoesIt) {
    GTEST_FLAG_SET(death_test_style, "threadsafe"); // a process that has made no threads yet
    EXPECT_EXIT(sumWithoutRoom(), ::testing::ExitedWithCode(0), "");
}
#endif

} // namespace
} // namespace ars
