#include "engine/core/parallel.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
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

} // namespace
} // namespace ars
