#pragma once

#include <cstddef>
#include <type_traits>

namespace ars {

/// One pool for everything: loops run on OpenMP's team, the same libgomp that LibTorch uses, and every loop first takes
/// its threads from one budget. Two loops that run at once share the cores instead of doubling the threads.

/// Threads of this process, at least 1. Default: the processors that this process may run on, or ARS_THREADS.
int threadCount();
void setThreadCount(int count);

/// Takes up to `wanted` threads (0: all) out of the budget and gives them back at the end of its life. The calling
/// thread always counts as one, so count() >= 1. model/ holds one around LibTorch calls and sets at::set_num_threads.
class ThreadLease {
public:
    explicit ThreadLease(int wanted = 0);
    ~ThreadLease();
    ThreadLease(const ThreadLease&) = delete;
    ThreadLease& operator=(const ThreadLease&) = delete;
    int count() const { return count_; }

private:
    int count_;
    bool nested_;
};

/// Whether the system gives `count` more threads now: starts them, all alive at once, and ends them. To be asked before
/// a runtime makes threads for good: refused one, OpenMP's ends the program and LibTorch's waits for it for ever. The
/// stacks of those that were started stay with the process, for the threads that it makes next.
bool threadsAvailable(int count);

/// Threads now out of the budget, for tests and the memory/time panel.
int threadsInUse();

namespace detail {
using RangeFunction = void (*)(void* context, std::size_t begin, std::size_t end);
void runRanges(std::size_t count, std::size_t grain, void* context, RangeFunction function);
} // namespace detail

/// Calls body(begin, end) over [0, count) in pieces of at least `grain`, on the threads that are free. Returns when all
/// is done; the first exception of a piece is rethrown here after the others have ended. Inside another parallel loop,
/// and where the system refuses threads, it runs on the calling thread. Piece borders do not depend on the number of
/// threads.
template <typename Body>
void parallelRanges(std::size_t count, std::size_t grain, Body&& body) {
    auto call = [](void* context, std::size_t begin, std::size_t end) {
        (*static_cast<std::remove_reference_t<Body>*>(context))(begin, end);
    };
    detail::runRanges(count, grain, const_cast<void*>(static_cast<const void*>(&body)), call);
}

/// Calls body(i) for every i in [0, count); same rules as parallelRanges.
template <typename Body>
void parallelFor(std::size_t count, Body&& body, std::size_t grain = 256) {
    parallelRanges(count, grain, [&body](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) body(i);
    });
}

} // namespace ars
