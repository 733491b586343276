#include "engine/scene/jobs.h"

#include "engine/core/log.h"
#include "engine/core/standard_exception.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <deque>
#include <map>
#include <mutex>
#include <new>
#include <optional>
#include <set>
#include <thread>

namespace ars {
namespace {

using Clock = std::chrono::steady_clock;

struct Job {
    std::uint64_t id = 0;
    JobRequest request;
    std::atomic<bool> cancelled{false};
    std::string what;     ///< under the runner's mutex
    double fraction = -1; ///< the same
    bool running = false; ///< the same
};

Status runWork(const Job& job, const ProgressFunction& progress) {
    try {
        return job.request.work(progress);
    } catch (const std::bad_alloc&) {
        return makeError(ErrorCode::OutOfMemory, job.request.title, "the memory of this computer is used up");
    } catch (const std::exception& failure) {
        return errorOfStandardException(failure, job.request.title);
    }
}

} // namespace

struct JobRunner::State {
    mutable std::mutex mutex;
    std::condition_variable work; ///< for the pool
    std::condition_variable time; ///< for the clock
    std::function<void()> wake;
    std::uint64_t lastId = 0;
    std::vector<std::shared_ptr<Job>> jobs; ///< not delivered, oldest first
    std::deque<std::shared_ptr<Job>> waiting;
    std::set<std::string> lanes; ///< that are taken
    std::deque<std::function<void()>> deliveries;
    std::vector<std::thread> threads;
    int idle = 0;
    std::optional<Clock::time_point> alarm;
    std::thread clock;
    bool ending = false;

    void tell() const {
        if (wake) wake();
    }

    /// The first waiting job whose lane is free.
    std::shared_ptr<Job> take() {
        const auto found = std::find_if(waiting.begin(), waiting.end(), [&](const std::shared_ptr<Job>& job) {
            return job->request.lane.empty() || !lanes.contains(job->request.lane);
        });
        if (found == waiting.end()) return nullptr;
        std::shared_ptr<Job> job = *found;
        waiting.erase(found);
        if (!job->request.lane.empty()) lanes.insert(job->request.lane);
        job->running = true;
        return job;
    }

    void finish(const std::shared_ptr<Job>& job, Status status) {
        {
            const std::lock_guard lock(mutex);
            lanes.erase(job->request.lane);
            deliver(job, std::move(status));
        }
        work.notify_all(); // its lane is free
        tell();
    }

    /// Under the mutex.
    void deliver(const std::shared_ptr<Job>& job, Status status) {
        if (ending) return;
        deliveries.push_back([this, job, status = std::move(status)] {
            {
                const std::lock_guard lock(mutex);
                std::erase(jobs, job);
            }
            if (job->request.done) job->request.done(status);
        });
    }

    void runJobs() {
        std::unique_lock lock(mutex);
        while (true) {
            std::shared_ptr<Job> job;
            ++idle;
            work.wait(lock, [&] { return ending || (job = take()) != nullptr; });
            --idle;
            if (!job) return;
            lock.unlock();
            Status status = runWork(*job, [this, &job](double fraction, std::string_view what) {
                const std::lock_guard progressLock(mutex);
                job->fraction = fraction;
                job->what = what;
                return !job->cancelled.load();
            });
            finish(job, std::move(status));
            lock.lock();
        }
    }

    void runClock() {
        std::unique_lock lock(mutex);
        while (!ending) {
            if (!alarm) {
                time.wait(lock);
            } else if (Clock::now() >= *alarm) {
                alarm.reset();
                lock.unlock();
                tell();
                lock.lock();
            } else {
                time.wait_until(lock, *alarm);
            }
        }
    }
};

JobRunner::JobRunner(std::function<void()> wake) : state_(std::make_shared<State>()) {
    state_->wake = std::move(wake);
    state_->clock = std::thread([state = state_.get()] { state->runClock(); });
}

JobRunner::~JobRunner() {
    {
        const std::lock_guard lock(state_->mutex);
        state_->ending = true;
        for (const std::shared_ptr<Job>& job : state_->jobs) job->cancelled = true;
        state_->waiting.clear();
    }
    state_->work.notify_all();
    state_->time.notify_all();
    for (std::thread& thread : state_->threads) thread.join();
    state_->clock.join();
}

std::uint64_t JobRunner::start(JobRequest request) {
    auto job = std::make_shared<Job>();
    job->request = std::move(request);
    const std::lock_guard lock(state_->mutex);
    job->id = ++state_->lastId;
    state_->jobs.push_back(job);
    state_->waiting.push_back(job);
    if (state_->idle < static_cast<int>(state_->waiting.size()) &&
        static_cast<int>(state_->threads.size()) < kMostThreads) {
        state_->threads.emplace_back([state = state_.get()] { state->runJobs(); });
    }
    state_->work.notify_one();
    return job->id;
}

void JobRunner::cancel(std::uint64_t id) {
    bool ended = false;
    {
        const std::lock_guard lock(state_->mutex);
        for (const std::shared_ptr<Job>& job : state_->jobs) {
            if (job->id != id || job->cancelled.exchange(true) || job->running) continue;
            std::erase(state_->waiting, job);
            state_->deliver(job, makeError(ErrorCode::Cancelled, "", job->request.title + " was stopped on request"));
            ended = true;
            break;
        }
    }
    if (ended) state_->tell();
}

std::vector<JobStatus> JobRunner::list() const {
    std::vector<JobStatus> statuses;
    const std::lock_guard lock(state_->mutex);
    for (const std::shared_ptr<Job>& job : state_->jobs) {
        if (!job->request.listed) continue;
        const bool stopping = job->cancelled.load();
        statuses.push_back({job->id, job->request.title,
                            stopping       ? "stopping"
                            : job->running ? job->what
                                           : "waiting",
                            job->fraction, job->request.cancellable && !stopping});
    }
    return statuses;
}

bool JobRunner::busy() const {
    const std::lock_guard lock(state_->mutex);
    return !state_->jobs.empty() || !state_->deliveries.empty();
}

void JobRunner::post(std::function<void()> deliver) {
    {
        const std::lock_guard lock(state_->mutex);
        if (state_->ending) return;
        state_->deliveries.push_back(std::move(deliver));
    }
    state_->tell();
}

bool JobRunner::pump() {
    bool any = false;
    while (true) {
        std::function<void()> deliver;
        {
            const std::lock_guard lock(state_->mutex);
            if (state_->deliveries.empty()) return any;
            deliver = std::move(state_->deliveries.front());
            state_->deliveries.pop_front();
        }
        deliver();
        any = true;
    }
}

void JobRunner::wakeAfter(std::chrono::milliseconds delay) {
    const Clock::time_point when = Clock::now() + delay;
    {
        const std::lock_guard lock(state_->mutex);
        if (state_->alarm && *state_->alarm <= when && *state_->alarm > Clock::now()) return;
        state_->alarm = when;
    }
    state_->time.notify_all();
}

} // namespace ars
