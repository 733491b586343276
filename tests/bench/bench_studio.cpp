// What the studio's viewport gets from its frame worker: frames a second while something is dragged, and the time until
// the full picture stands. A rest: avatar of 20 k surfels at 960x720; the window itself is not drawn.
#include "engine/scene/evaluate.h"
#include "engine/scene/frame_worker.h"

#include <benchmark/benchmark.h>

#include <atomic>
#include <cmath>
#include <condition_variable>
#include <cstdio>
#include <cstdlib>
#include <mutex>

namespace {

using namespace ars;
using Clock = std::chrono::steady_clock;

/// A document of 20 k surfels, its worker, and a person who waits for frames.
class Viewport {
public:
    Viewport() : worker_(Device{}, [this] { changed_.notify_all(); }) {
        document = newDocument();
        document.avatar.rest.maxSurfels = 20000;
        auto loaded = loadAssets(document, {});
        if (!loaded.ok()) {
            std::fprintf(stderr, "%s\n", loaded.error().describe().c_str());
            std::exit(1);
        }
        assets = std::move(*loaded);
        rest();
    }

    FrameRequest request(bool moving) const {
        FrameRequest result;
        result.avatar = assets.avatar;
        result.light = assets.light;
        result.inputs = frameInputs(document, assets, document.timeline.timeS, 960, 720);
        result.buffers = {document.view.buffer};
        result.moving = moving;
        return result;
    }
    /// Asks for the document as it is now and waits for the first frame that answers.
    std::shared_ptr<const Frame> drag() {
        const std::uint64_t number = worker_.submit(request(true));
        std::unique_lock lock(mutex_);
        std::shared_ptr<const Frame> frame;
        while (!(frame = worker_.latest()) || frame->request < number)
            changed_.wait_for(lock, std::chrono::milliseconds(1));
        return frame;
    }
    /// Lets go and waits until the full picture stands.
    void rest() {
        worker_.submit(request(false));
        worker_.waitUntilIdle(std::chrono::minutes(1));
    }

    Document document;
    SceneAssets assets;

private:
    std::mutex mutex_;
    std::condition_variable changed_;
    FrameWorker worker_;
};

Viewport& viewport() {
    static Viewport shared;
    return shared;
}

/// One frame for every iteration of `move`; says how fine they were.
template <typename Move>
void dragged(benchmark::State& state, Move&& move) {
    Viewport& view = viewport();
    view.document = newDocument();
    view.document.avatar.rest.maxSurfels = 20000;
    view.rest();
    double width = 0.0, copies = 0.0;
    int full = 0, step = 0;
    for (auto _ : state) {
        move(view.document, ++step);
        const auto frame = view.drag();
        width += frame->inputs.camera.width;
        copies += frame->copyMs;
        full += frame->quality == FrameQuality::Full;
    }
    const auto frames = static_cast<double>(state.iterations());
    state.counters["frames/s"] = benchmark::Counter(frames, benchmark::Counter::kIsRate);
    state.counters["width"] = width / frames;
    state.counters["full %"] = 100.0 * full / frames;
    state.counters["copy ms"] = copies / frames;
}

void limb(Document& document, int step) {
    document.pose.pose.rotations[static_cast<std::size_t>(smplxJointIndex("left_elbow"))] =
        quatFromAxisAngle({0, -0.8f + 0.4f * static_cast<float>(std::sin(0.11 * step)), 0});
}
void camera(Document& document, int step) {
    const double angle = 0.02 * step;
    document.camera.camera.eye =
        document.camera.camera.target + glm::dvec3(3.6 * std::sin(angle), 0.2, 3.6 * std::cos(angle));
}
void light(Document& document, int step) { document.light.rotationDeg = static_cast<float>(step % 360); }
void radius(Document& document, int step) {
    document.occlusion.radii[0] = 0.25f + 0.1f * static_cast<float>(std::sin(0.13 * step));
}

void BM_DragLimb(benchmark::State& state) { dragged(state, limb); }
void BM_TurnCamera(benchmark::State& state) { dragged(state, camera); }
void BM_TurnLight(benchmark::State& state) { dragged(state, light); }
void BM_DragRadius(benchmark::State& state) { dragged(state, radius); }
/// The face fills the window.
void BM_DragLimbCloseUp(benchmark::State& state) {
    dragged(state, [](Document& document, int step) {
        document.camera.camera.target = {0.0, 1.5, 0.0};
        document.camera.camera.eye = {0.0, 1.5, 0.6};
        limb(document, step);
    });
}

/// From letting go of a limb to the full picture.
void fullAtRest(benchmark::State& state, double distanceM, OcclusionAdaptive adaptive) {
    Viewport& view = viewport();
    view.document = newDocument();
    view.document.avatar.rest.maxSurfels = 20000;
    view.document.occlusion.settings.screenSpace.adaptive = adaptive;
    if (distanceM > 0.0) {
        view.document.camera.camera.target = {0.0, 1.5, 0.0};
        view.document.camera.camera.eye = {0.0, 1.5, distanceM};
    }
    int step = 0;
    for (auto _ : state) {
        for (int i = 0; i < 5; ++i) {
            limb(view.document, ++step);
            view.drag();
        }
        const auto begin = Clock::now();
        view.rest();
        state.SetIterationTime(std::chrono::duration<double>(Clock::now() - begin).count());
    }
}
void BM_FullAtRest(benchmark::State& state) { fullAtRest(state, 0.0, OcclusionAdaptive::Both); }
void BM_FullAtRestNotAdaptive(benchmark::State& state) { fullAtRest(state, 0.0, OcclusionAdaptive::Off); }
void BM_FullAtRestCloseUp(benchmark::State& state) { fullAtRest(state, 0.6, OcclusionAdaptive::Both); }

/// How long a new request waits while the picture is being refined.
void answered(benchmark::State& state, double distanceM) {
    Viewport& view = viewport();
    view.document = newDocument();
    view.document.avatar.rest.maxSurfels = 20000;
    if (distanceM > 0.0) {
        view.document.camera.camera.target = {0.0, 1.5, 0.0};
        view.document.camera.camera.eye = {0.0, 1.5, distanceM};
    }
    int step = 0;
    double worst = 0.0;
    for (int i = 0; i < 10; ++i) { // so that the size of drafts has settled
        limb(view.document, ++step);
        view.drag();
    }
    for (auto _ : state) {
        limb(view.document, ++step);
        view.drag();
        std::this_thread::sleep_for(std::chrono::milliseconds(430 + 7 * (step % 10)));
        limb(view.document, ++step);
        const auto begin = Clock::now();
        view.drag();
        const double seconds = std::chrono::duration<double>(Clock::now() - begin).count();
        worst = std::max(worst, seconds);
        state.SetIterationTime(seconds);
    }
    state.counters["worst ms"] = 1e3 * worst;
}
void BM_AnswerWhileRefining(benchmark::State& state) { answered(state, 0.0); }
void BM_AnswerWhileRefiningCloseUp(benchmark::State& state) { answered(state, 0.6); }

BENCHMARK(BM_DragLimb)->UseRealTime()->Unit(benchmark::kMillisecond)->MinTime(2.0);
BENCHMARK(BM_TurnCamera)->UseRealTime()->Unit(benchmark::kMillisecond)->MinTime(2.0);
BENCHMARK(BM_TurnLight)->UseRealTime()->Unit(benchmark::kMillisecond)->MinTime(2.0);
BENCHMARK(BM_DragRadius)->UseRealTime()->Unit(benchmark::kMillisecond)->MinTime(2.0);
BENCHMARK(BM_DragLimbCloseUp)->UseRealTime()->Unit(benchmark::kMillisecond)->MinTime(2.0);
BENCHMARK(BM_FullAtRest)->UseManualTime()->Unit(benchmark::kMillisecond)->Iterations(5);
BENCHMARK(BM_FullAtRestNotAdaptive)->UseManualTime()->Unit(benchmark::kMillisecond)->Iterations(5);
BENCHMARK(BM_FullAtRestCloseUp)->UseManualTime()->Unit(benchmark::kMillisecond)->Iterations(2);
BENCHMARK(BM_AnswerWhileRefining)->UseManualTime()->Unit(benchmark::kMillisecond)->Iterations(10);
BENCHMARK(BM_AnswerWhileRefiningCloseUp)->UseManualTime()->Unit(benchmark::kMillisecond)->Iterations(10);

} // namespace
