#pragma once

#include "engine/core/progress.h"
#include "engine/scene/session.h"

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace ars {

/// What is to be done beside the caller.
struct JobRequest {
    std::string title;                                   ///< "Opening forest.exr"
    std::function<Status(const ProgressFunction&)> work; ///< on a thread of the pool
    std::function<void(const Status&)> done;             ///< in pump(); Cancelled when it was stopped; may be null
    std::string lane;                                    ///< jobs of one lane run one after the other; empty: none
    bool listed = true;                                  ///< people see it among the jobs
    bool cancellable = true;                             ///< by people; the end of the program cancels every job
};

/// Threads for work beside the window: at most kMostThreads at once, further jobs wait. The callers' functions run on
/// the thread that calls pump(), in the order in which they came. An exception in a job becomes its error.
class JobRunner {
public:
    static constexpr int kMostThreads = 6;

    /// @param wake  called on any thread when pump() has something to do; may be null
    explicit JobRunner(std::function<void()> wake);
    ~JobRunner(); ///< cancels all jobs and waits for those that run; nothing is delivered any more
    JobRunner(const JobRunner&) = delete;
    JobRunner& operator=(const JobRunner&) = delete;

    std::uint64_t start(JobRequest request);
    /// Asks a job to stop; one that has not begun never does. Its `done` follows in pump().
    void cancel(std::uint64_t job);
    /// Listed jobs that are not done, oldest first.
    std::vector<JobStatus> list() const;
    /// Jobs whose `done` has not been called yet, listed or not.
    bool busy() const;
    /// From a job: runs `deliver` in the next pump(). Dropped at the end of the program.
    void post(std::function<void()> deliver);
    /// Delivers what has come; false when there was nothing.
    bool pump();
    /// Calls wake once at about this time from now.
    void wakeAfter(std::chrono::milliseconds delay);

private:
    struct State;
    std::shared_ptr<State> state_;
};

} // namespace ars
