#include "engine/scene/frame_worker.h"

#include "engine/core/standard_exception.h"
#include "engine/scene/frame_renderer.h"

#include <condition_variable>
#include <deque>
#include <exception>
#include <mutex>
#include <thread>

namespace ars {

namespace {

using Clock = std::chrono::steady_clock;

/// What is held still for so long is drawn in full although it is still held.
constexpr std::chrono::milliseconds kHeldStill{300};

bool sameRequest(const FrameRequest& a, const FrameRequest& b) {
    return a.avatar == b.avatar && a.light == b.light && a.moving == b.moving && a.parts == b.parts &&
           a.surfels == b.surfels && a.buffers == b.buffers && sameInputs(a.inputs, b.inputs);
}

} // namespace

std::string_view frameQualityName(FrameQuality quality) {
    switch (quality) {
    case FrameQuality::Draft:
        return "draft";
    case FrameQuality::Refining:
        return "refining";
    case FrameQuality::Full:
        break;
    }
    return "full";
}

const Image* Frame::picture(BufferId id) const {
    const auto found = pictures.find(id);
    return found == pictures.end() ? nullptr : found->second.get();
}

struct FrameWorker::State {
    Device device;
    std::function<void()> wake;

    mutable std::mutex mutex;
    std::condition_variable asked, ended;
    std::optional<FrameRequest> last; ///< that was submitted
    std::optional<FrameRequest> next; ///< the same, until the thread takes it
    std::uint64_t number = 0;         ///< of both
    bool stop = false;
    bool busy = false;
    std::shared_ptr<const Frame> latest;
    std::optional<Error> error;
    std::uint64_t frames = 0;
    mutable std::deque<Clock::time_point> finished;
    std::thread thread;

    void run();
    /// Waits for something to do: true with a request to begin or to go on with, false at the end.
    bool take(std::optional<FrameRequest>& request, std::uint64_t& taken, Clock::time_point& stillFrom);
    void publish(const Result<std::shared_ptr<const Frame>>& result, std::uint64_t taken);
};

bool FrameWorker::State::take(std::optional<FrameRequest>& request, std::uint64_t& taken,
                              Clock::time_point& stillFrom) {
    std::unique_lock lock(mutex);
    const auto due = [this] { return stop || next.has_value(); };
    if (!request && !next) {
        busy = false;
        ended.notify_all();
        asked.wait(lock, due);
    } else if (request && stillFrom != Clock::time_point()) {
        asked.wait_until(lock, stillFrom, due);
    }
    if (stop) return false;
    stillFrom = Clock::time_point();
    if (!next) return true;
    request = std::move(next);
    next.reset();
    taken = number;
    busy = true;
    return true;
}

void FrameWorker::State::publish(const Result<std::shared_ptr<const Frame>>& result, std::uint64_t taken) {
    {
        const std::lock_guard lock(mutex);
        if (result.ok()) {
            latest = *result;
            error.reset();
            ++frames;
            finished.push_back(Clock::now());
            while (finished.front() + std::chrono::seconds(1) < finished.back()) finished.pop_front();
        } else if (taken == number) { // a newer request may well go right
            error = result.error();
        }
    }
    if (wake) wake();
}

void FrameWorker::State::run() {
    FrameRenderer renderer(device);
    std::optional<FrameRequest> request; // in work; none when it stands
    std::uint64_t taken = 0, drafted = 0;
    Clock::time_point stillFrom;
    while (take(request, taken, stillFrom)) {
        const bool draft = request->moving && drafted != taken;
        Result<std::shared_ptr<const Frame>> result = std::shared_ptr<const Frame>();
        try {
            result = draft ? renderer.draft(*request, taken) : renderer.advance(*request, taken);
        } catch (const std::bad_alloc&) {
            result = makeError(ErrorCode::OutOfMemory, "frame",
                               fmt::format("no memory for pictures of {}x{}", request->inputs.camera.width,
                                           request->inputs.camera.height));
        } catch (const std::exception& exception) {
            result = errorOfStandardException(exception, "frame");
        }
        if (draft) {
            drafted = taken;
            stillFrom = Clock::now() + kHeldStill;
        }
        const bool over = !result.ok() || (!draft && renderer.complete());
        if (!result.ok() || *result) publish(result, taken);
        if (over) request.reset();
    }
}

FrameWorker::FrameWorker(const Device& device, std::function<void()> wake) : state_(std::make_unique<State>()) {
    state_->device = device;
    state_->wake = std::move(wake);
    state_->thread = std::thread([state = state_.get()] { state->run(); });
}

FrameWorker::~FrameWorker() {
    {
        const std::lock_guard lock(state_->mutex);
        state_->stop = true;
    }
    state_->asked.notify_all();
    state_->thread.join();
}

std::uint64_t FrameWorker::submit(FrameRequest request) {
    std::optional<FrameRequest> dropped; // what was overtaken is freed outside of the lock
    const std::lock_guard lock(state_->mutex);
    if (state_->last && sameRequest(*state_->last, request)) return state_->number;
    dropped = std::move(state_->last);
    state_->last = request;
    state_->next = std::move(request);
    state_->busy = true;
    ++state_->number;
    state_->asked.notify_all();
    return state_->number;
}

std::shared_ptr<const Frame> FrameWorker::latest() const {
    const std::lock_guard lock(state_->mutex);
    return state_->latest;
}

std::optional<Error> FrameWorker::takeError() {
    const std::lock_guard lock(state_->mutex);
    return std::exchange(state_->error, std::nullopt);
}

bool FrameWorker::idle() const {
    const std::lock_guard lock(state_->mutex);
    return !state_->busy && !state_->next;
}

bool FrameWorker::waitUntilIdle(std::chrono::milliseconds timeout) {
    std::unique_lock lock(state_->mutex);
    return state_->ended.wait_for(lock, timeout, [this] { return !state_->busy && !state_->next; });
}

FrameWorker::Rates FrameWorker::rates() const {
    const std::lock_guard lock(state_->mutex);
    const auto now = Clock::now();
    while (!state_->finished.empty() && state_->finished.front() + std::chrono::seconds(1) < now)
        state_->finished.pop_front();
    return {state_->frames, static_cast<double>(state_->finished.size())};
}

const Device& FrameWorker::device() const { return state_->device; }

} // namespace ars
