#include "model/training/data_reader.h"

#include "engine/capture/view_cache.h"
#include "engine/core/parallel.h"
#include "engine/core/standard_exception.h"

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <exception>
#include <mutex>
#include <new>
#include <numeric>
#include <thread>

namespace ars {
namespace {

/// One step of SplitMix64 (Steele, Lea and Flood 2014): the same numbers on every machine, unlike std's distributions.
std::uint64_t splitMix(std::uint64_t& state) {
    std::uint64_t z = (state += 0x9E3779B97F4A7C15ull);
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ull;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBull;
    return z ^ (z >> 31);
}

/// A generator of its own for each (seed, purpose, index).
std::uint64_t stream(std::uint64_t seed, std::uint64_t purpose, std::uint64_t index) {
    std::uint64_t state = seed;
    state = splitMix(state) ^ purpose;
    state = splitMix(state) ^ index;
    return splitMix(state);
}

/// A uniform number below `count` < 2^32: the high half of a product, whose bias of count / 2^32 nobody will see.
std::size_t below(std::uint64_t& state, std::size_t count) {
    return static_cast<std::size_t>(((splitMix(state) >> 32) * count) >> 32);
}

std::vector<int> permutation(std::vector<int> values, std::uint64_t state) {
    for (std::size_t i = values.size(); i > 1; --i) std::swap(values[i - 1], values[below(state, i)]);
    return values;
}

constexpr std::uint64_t kFrameOrder = 1, kCameraOrder = 2;

/// Cameras of the split that have a picture of a frame.
std::vector<int> camerasOf(const Capture& capture, const CaptureSplit& split, int frame) {
    std::vector<int> cameras;
    for (const int camera : split.cameras) {
        if (capture.has({camera, frame})) cameras.push_back(camera);
    }
    return cameras;
}

std::vector<int> usedFrames(const Capture& capture, const CaptureSplit& split) {
    std::vector<int> frames;
    for (const int frame : split.frames) {
        const bool seen = std::any_of(split.cameras.begin(), split.cameras.end(),
                                      [&](int camera) { return capture.has({camera, frame}); });
        if (seen) frames.push_back(frame);
    }
    return frames;
}

/// The views of a step, given the frames that any camera sees.
std::vector<ViewId> viewsAmong(const Capture& capture, const CaptureSplit& split, const std::vector<int>& frames,
                               const DataOptions& options, std::int64_t step) {
    if (frames.empty() || step < 0 || options.viewsPerStep < 1) return {};
    const auto count = static_cast<std::int64_t>(frames.size());
    const auto epoch = static_cast<std::uint64_t>(step / count);
    const int frame =
        permutation(frames, stream(options.seed, kFrameOrder, epoch))[static_cast<std::size_t>(step % count)];
    const std::vector<int> cameras = camerasOf(capture, split, frame);
    const std::size_t wanted = std::min(cameras.size(), static_cast<std::size_t>(options.viewsPerStep));
    // A frame comes once an epoch. Its cameras are dealt out over as many epochs as it takes to show all of them; the
    // last of these is filled up with cameras of the first.
    const std::uint64_t visits = (cameras.size() + wanted - 1) / wanted;
    const std::uint64_t round = epoch / visits;
    std::uint64_t state = stream(options.seed, kCameraOrder, static_cast<std::uint64_t>(frame));
    state = stream(state, kCameraOrder, round);
    const std::vector<int> order = permutation(cameras, state);
    std::vector<ViewId> views;
    for (std::size_t i = 0; i < wanted; ++i) {
        views.push_back({order[((epoch % visits) * wanted + i) % order.size()], frame});
    }
    return views;
}

Status checkIndices(const char* what, const std::vector<int>& indices, std::size_t count) {
    for (const int index : indices) {
        if (index >= 0 && static_cast<std::size_t>(index) < count) continue;
        return makeError(ErrorCode::InvalidArgument, "data reader",
                         fmt::format("{} {} of the split is not among the {} of the capture", what, index, count));
    }
    return {};
}

Status checkArguments(const Capture* capture, const CaptureSplit& split, const DataOptions& options,
                      std::int64_t firstStep) {
    const auto bad = [](std::string message) {
        return makeError(ErrorCode::InvalidArgument, "data reader", std::move(message));
    };
    if (!capture) return bad("needs a capture");
    if (options.viewsPerStep < 1) return bad(fmt::format("needs a view a step, found {}", options.viewsPerStep));
    if (options.prefetch < 1) return bad(fmt::format("must read at least 1 sample ahead, found {}", options.prefetch));
    if (firstStep < 0) return bad(fmt::format("the first step is {}, expected 0 or more", firstStep));
    ARS_TRY_STATUS(checkIndices("camera", split.cameras, capture->cameras.size()));
    ARS_TRY_STATUS(checkIndices("frame", split.frames, capture->frames.size()));
    return validateViewOptions(options.view);
}

} // namespace

std::vector<ViewId> viewsOfStep(const Capture& capture, const CaptureSplit& split, const DataOptions& options,
                                std::int64_t step) {
    return viewsAmong(capture, split, usedFrames(capture, split), options, step);
}

std::size_t sampleBytes(const TrainingSample& sample) {
    std::size_t values = 0;
    for (const auto& view : sample.views) {
        for (const Image* image : {&view->color, &view->mask, &view->band, &view->unknown}) {
            values += image->pixels.size();
        }
    }
    return values * sizeof(float);
}

struct DataReader::State {
    std::shared_ptr<const Capture> capture;
    CaptureSplit split;
    DataOptions options;
    std::vector<int> frames; ///< of the split, those that a camera sees
    std::unique_ptr<ViewCache> cache;
    double waitedMs = 0.0; ///< the consumer's own

    std::mutex mutex; ///< of all that follows
    std::condition_variable changed;
    std::vector<Result<TrainingSample>> ready; ///< room for all that are read ahead is made before the thread starts
    std::size_t readyBytes = 0;                ///< of the samples in `ready`
    std::size_t largest = 0; ///< bytes of the largest sample so far: what the next one is taken to need
    bool stopping = false;
    std::thread thread;

    /// Crops differ in size, so the next sample may turn out larger than any before: the bound may be missed by that.
    bool hasRoom() const {
        if (ready.empty()) return true;
        return ready.size() < static_cast<std::size_t>(options.prefetch) &&
               readyBytes + largest <= options.prefetchBytes;
    }

    Result<TrainingSample> sampleOf(std::int64_t step) {
        const std::vector<ViewId> views = viewsAmong(*capture, split, frames, options, step);
        using View = Result<std::shared_ptr<const CapturedView>>;
        std::vector<View> results(views.size(), View(std::shared_ptr<const CapturedView>()));
        // One view a thread, as far as nobody else needs the threads: decoding a file cannot be divided.
        parallelFor(views.size(), [&](std::size_t i) { results[i] = cache->read(views[i]); }, 1);
        TrainingSample sample;
        sample.step = step;
        sample.frame = views.front().frame;
        for (View& view : results) {
            if (!view) return std::move(view).error();
            sample.views.push_back(std::move(*view));
        }
        return sample;
    }

    /// No exception may leave the thread; the error belongs to the step.
    Result<TrainingSample> guardedSampleOf(std::int64_t step) {
        try {
            return sampleOf(step);
        } catch (const std::bad_alloc&) {
            return makeError(ErrorCode::OutOfMemory, "data reader",
                             fmt::format("no memory for the {} views of step {}; try a smaller cache or picture scale",
                                         options.viewsPerStep, step));
        } catch (const std::exception& error) {
            return errorOfStandardException(error, "data reader");
        }
    }

    void run(std::int64_t step) {
        for (;; ++step) {
            {
                std::unique_lock lock(mutex);
                changed.wait(lock, [&] { return stopping || hasRoom(); });
                if (stopping) return;
            }
            Result<TrainingSample> sample = guardedSampleOf(step);
            const std::lock_guard lock(mutex);
            if (stopping) return;
            const std::size_t bytes = sample ? sampleBytes(*sample) : 0;
            readyBytes += bytes;
            largest = std::max(largest, bytes);
            ready.push_back(std::move(sample));
            changed.notify_all();
        }
    }
};

DataReader::DataReader() : state_(std::make_unique<State>()) {}

DataReader::~DataReader() {
    {
        const std::lock_guard lock(state_->mutex);
        state_->stopping = true;
    }
    state_->changed.notify_all();
    if (state_->thread.joinable()) state_->thread.join();
}

Result<std::unique_ptr<DataReader>> DataReader::start(std::shared_ptr<const Capture> capture, CaptureSplit split,
                                                      DataOptions options, std::int64_t firstStep) {
    ARS_TRY_STATUS(checkArguments(capture.get(), split, options, firstStep));
    std::unique_ptr<DataReader> reader(new DataReader);
    State& state = *reader->state_;
    state.ready.reserve(static_cast<std::size_t>(std::max(1, options.prefetch)));
    state.frames = usedFrames(*capture, split);
    if (state.frames.empty()) {
        return makeError(ErrorCode::InvalidArgument, capture->folder.string(),
                         fmt::format("the split \"{}\" has no picture", split.name));
    }
    ViewCache::Options cache;
    cache.view = options.view;
    cache.memoryBytes = options.cacheBytes;
    cache.folder = options.cacheFolder;
    cache.folderBytes = options.cacheFolderBytes;
    ARS_TRY(state.cache, ViewCache::open(capture, std::move(cache)));
    state.capture = std::move(capture);
    state.split = std::move(split);
    state.options = std::move(options);
    try {
        state.thread = std::thread([&state, firstStep] { state.run(firstStep); });
    } catch (const std::exception& error) {
        // Its stack is memory; nothing else makes a system refuse one thread.
        return makeError(ErrorCode::OutOfMemory, "data reader",
                         fmt::format("not enough memory: no thread can be started: {}", error.what()));
    }
    return reader;
}

Result<TrainingSample> DataReader::next() {
    const auto begin = std::chrono::steady_clock::now();
    std::unique_lock lock(state_->mutex);
    state_->changed.wait(lock, [&] { return !state_->ready.empty(); });
    Result<TrainingSample> sample = std::move(state_->ready.front());
    state_->ready.erase(state_->ready.begin());
    if (sample) state_->readyBytes -= sampleBytes(*sample);
    lock.unlock();
    state_->changed.notify_all();
    state_->waitedMs = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count();
    return sample;
}

double DataReader::waitedMs() const { return state_->waitedMs; }

std::size_t DataReader::cachedBytes() const { return state_->cache->memoryBytes(); }

} // namespace ars
