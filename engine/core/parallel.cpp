#include "engine/core/parallel.h"

#include <omp.h>
#include <sched.h>

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <cstdlib>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

namespace ars {
namespace {

int processorsOfProcess() {
    cpu_set_t set;
    CPU_ZERO(&set);
    if (sched_getaffinity(0, sizeof set, &set) == 0) return std::max(1, CPU_COUNT(&set));
    return 1;
}

int initialThreadCount() {
    if (const char* text = std::getenv("ARS_THREADS")) {
        const int wanted = std::atoi(text);
        if (wanted >= 1) return std::min(wanted, 1024);
    }
    return processorsOfProcess();
}

std::atomic<int>& budget() {
    static std::atomic<int> count{initialThreadCount()};
    return count;
}

std::mutex leaseMutex;
int leased = 0;
thread_local int leaseDepth = 0;
// Threads of the team that OpenMP keeps for this thread, itself included.
thread_local int team = 1;

} // namespace

int threadCount() { return budget().load(std::memory_order_relaxed); }

void setThreadCount(int count) { budget().store(std::clamp(count, 1, 1024), std::memory_order_relaxed); }

int threadsInUse() {
    const std::lock_guard lock(leaseMutex);
    return leased;
}

ThreadLease::ThreadLease(int wanted) : count_(1), nested_(leaseDepth > 0 || omp_in_parallel()) {
    ++leaseDepth;
    if (nested_) return; // an outer loop of this thread already holds the cores
    const std::lock_guard lock(leaseMutex);
    const int most = wanted > 0 ? std::min(wanted, threadCount()) : threadCount();
    count_ = std::clamp(threadCount() - leased, 1, most);
    leased += count_;
}

ThreadLease::~ThreadLease() {
    --leaseDepth;
    if (nested_) return;
    const std::lock_guard lock(leaseMutex);
    leased -= count_;
}

bool threadsAvailable(int count) {
    std::vector<std::thread> started;
    std::mutex mutex;
    std::condition_variable over;
    bool asked = false;
    try {
        started.reserve(static_cast<std::size_t>(std::max(count, 0)));
        while (static_cast<int>(started.size()) < count) {
            started.emplace_back([&] {
                std::unique_lock lock(mutex);
                over.wait(lock, [&] { return asked; });
            });
        }
    } catch (const std::exception&) { // system_error for a thread, bad_alloc for what it is to do
        count = -1;
    }
    {
        const std::lock_guard lock(mutex);
        asked = true;
    }
    over.notify_all();
    for (std::thread& thread : started) thread.join();
    return count >= 0;
}

namespace detail {

void runRanges(std::size_t count, std::size_t grain, void* context, RangeFunction function) {
    if (count == 0) return;
    grain = std::max<std::size_t>(grain, 1);
    // At most 64 pieces a thread of a large machine: enough to balance, few enough to cost nothing. The piece size
    // depends on count and grain alone, so a reduction over pieces gives the same sum for any number of threads.
    constexpr std::size_t kMaxPieces = 1024;
    const std::size_t piece = std::max(grain, (count + kMaxPieces - 1) / kMaxPieces);
    const std::size_t pieces = (count + piece - 1) / piece;
    if (pieces == 1) {
        function(context, 0, count);
        return;
    }
    const ThreadLease lease(static_cast<int>(std::min<std::size_t>(pieces, 1024)));
    if (lease.count() == 1 || (lease.count() > team && !threadsAvailable(lease.count() - team))) {
        for (std::size_t p = 0; p < pieces; ++p) function(context, p * piece, std::min(count, (p + 1) * piece));
        return;
    }
    team = lease.count(); // a smaller team lets go of the others
    std::exception_ptr failure;
    std::atomic<bool> failed{false};
    std::mutex failureMutex;
#pragma omp parallel for schedule(dynamic, 1) num_threads(lease.count())
    for (std::size_t p = 0; p < pieces; ++p) {
        if (failed.load(std::memory_order_relaxed)) continue;
        try {
            function(context, p * piece, std::min(count, (p + 1) * piece));
        } catch (...) {
            const std::lock_guard lock(failureMutex);
            if (!failure) failure = std::current_exception();
            failed = true;
        }
    }
    if (failure) std::rethrow_exception(failure);
}

} // namespace detail
} // namespace ars
