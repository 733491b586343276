#include "engine/core/parallel.h"
#include "engine/occlusion/ambient_occlusion.h"
#include "tests/unit/occlusion/occlusion_scene.h"

#include <benchmark/benchmark.h>

// Screen-space ambient occlusion of a body of capsules, 512x512, radii 0.25 m.
//
// Floor: depth taps, directions x steps; `taps` counts those that a ray-by-ray evaluation makes until each ray is
// hidden or outside, `tapsPerSecond` divides them by the measured time, so that skipping work shows as a rate above
// what the memory gives. The machine gives about 1.3e9 taps a second on one core (one 16-lane gather of 20 cycles and
// 10 cycles of projection at 2.6 GHz), measured with the loop alone: 1.0 of that is the share of a loop that skips
// nothing.

namespace {

using namespace ars;

const test::OcclusionScene& body() {
    static const test::OcclusionScene scene = [] {
        test::OcclusionScene made = test::capsuleBody(512);
        // Exactly 45,000 foreground pixels: the rows at the feet go.
        std::size_t count = 0;
        for (std::size_t p = 0; p < made.pixels(); ++p) {
            if (made.depth[p] > 0.0f && ++count > 45000) made.depth[p] = 0.0f;
        }
        return made;
    }();
    return scene;
}

void measure(benchmark::State& state, const OcclusionParams& params) {
    const test::OcclusionScene& scene = body();
    const auto cost = occlusionCost(params, scene.inputs());
    std::vector<float> out(scene.pixels());
    OcclusionWorkspace workspace;
    for (auto _ : state) {
        if (!ambientOcclusion(params, scene.inputs(), workspace, {out.data(), 512, 512, 1})) {
            state.SkipWithError("ambientOcclusion failed");
        }
        benchmark::DoNotOptimize(out.data());
    }
    state.counters["pixels"] = static_cast<double>(cost->pixels);
    state.counters["directionsPerPixel"] = static_cast<double>(cost->directions) / static_cast<double>(cost->pixels);
    state.counters["tapsBound"] = static_cast<double>(cost->tapsBound);
    state.counters["taps"] = static_cast<double>(cost->tapsTaken);
    state.counters["tapsPerSecond"] = benchmark::Counter(
        static_cast<double>(cost->tapsTaken) * static_cast<double>(state.iterations()), benchmark::Counter::kIsRate);
    state.counters["threads"] = threadCount();
}

void occlusionBody512Directions(benchmark::State& state) {
    OcclusionParams params = bodyOcclusion();
    params.adaptive = OcclusionAdaptive::Off;
    measure(state, params);
}
BENCHMARK(occlusionBody512Directions)->Unit(benchmark::kMillisecond)->UseRealTime();

void occlusionBodyAdaptive(benchmark::State& state) { measure(state, bodyOcclusion()); }
BENCHMARK(occlusionBodyAdaptive)->Unit(benchmark::kMillisecond)->UseRealTime();

void occlusionInteractive(benchmark::State& state) {
    OcclusionParams params = bodyOcclusion();
    params.quality = OcclusionQuality::Interactive;
    params.interactiveDirections = static_cast<int>(state.range(0));
    measure(state, params);
}
BENCHMARK(occlusionInteractive)->Arg(64)->Arg(128)->Unit(benchmark::kMillisecond)->UseRealTime();

void occlusionReference512Directions(benchmark::State& state) {
    OcclusionParams params = referenceOcclusion();
    params.adaptive = OcclusionAdaptive::Off;
    measure(state, params);
}
BENCHMARK(occlusionReference512Directions)->Unit(benchmark::kMillisecond)->UseRealTime();

/// O, O+ and O- of a training step at interactive quality.
void occlusionTripleInteractive(benchmark::State& state) {
    const test::OcclusionScene& scene = body();
    OcclusionParams params = bodyOcclusion();
    params.quality = OcclusionQuality::Interactive;
    const std::vector<float> plus(scene.pixels(), 0.2625f), minus(scene.pixels(), 0.2375f);
    std::vector<float> out(3 * scene.pixels());
    OcclusionWorkspace workspace;
    const auto part = [&](std::size_t k) { return ImageView<float>{out.data() + k * scene.pixels(), 512, 512, 1}; };
    for (auto _ : state) {
        if (!ambientOcclusionTriple(params, scene.inputs(), scene.picture(plus, 1), scene.picture(minus, 1), workspace,
                                    part(0), part(1), part(2))) {
            state.SkipWithError("ambientOcclusionTriple failed");
        }
        benchmark::DoNotOptimize(out.data());
    }
    state.counters["threads"] = threadCount();
}
BENCHMARK(occlusionTripleInteractive)->Unit(benchmark::kMillisecond)->UseRealTime();

/// From a rested camera to the full quality: all passes.
void occlusionRefinedToTheEnd(benchmark::State& state) {
    const test::OcclusionScene& scene = body();
    std::vector<float> out(scene.pixels());
    OcclusionWorkspace workspace;
    OcclusionRefinement refinement;
    for (auto _ : state) {
        refinement.reset();
        do {
            if (!refinement.refine(bodyOcclusion(), scene.inputs(), 1, workspace, {out.data(), 512, 512, 1})) {
                state.SkipWithError("refine failed");
                return;
            }
        } while (!refinement.complete());
    }
    state.counters["passes"] = refinement.passes();
    state.counters["threads"] = threadCount();
}
BENCHMARK(occlusionRefinedToTheEnd)->Unit(benchmark::kMillisecond)->UseRealTime();

} // namespace
