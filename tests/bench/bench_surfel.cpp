#include "engine/core/parallel.h"
#include "engine/surfel/splat.h"

#include <benchmark/benchmark.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <numbers>
#include <random>
#include <string>

// Floor of the blending step. One pair of a surfel and a pixel needs, at least: offset 2, falloff 6, exp2 7, alpha and
// transmittance 4, depth 4, and one multiply-add per blended channel. A vector unit of the machine measured here does
// 32 floating-point operations of multiply-adds a cycle, 112 GFLOP/s a core at 3.5 GHz, that is 56 G multiply-adds:
//     floor = blended pairs x (23 + channels) / (56e9 x cores).
// Memory: every picture is written once (20 floats a pixel for the viewing channels: 21 MB at 512x512, about 1 ms).
// `floor_ms` and `share` (floor / measured time of the whole operator) stand beside each figure.

namespace {

using namespace ars;

constexpr double kPairCost = 23, kMultiplyAddsPerSecondAndCore = 56e9;

Camera benchCamera(int side) {
    Camera camera = lookAtCamera({0, 0, 3}, {0, 0, 0}, 45.0, side, side);
    return camera;
}

void addSurfel(Surfels& surfels, const glm::vec3& mean, const glm::vec3& normal, glm::vec2 scale, float opacity,
               std::mt19937& random) {
    std::uniform_real_distribution<float> unit(0.0f, 1.0f);
    // The shortest turn from +z to the normal.
    glm::vec4 q(1.0f + normal.z, -normal.y, normal.x, 0.0f);
    q = glm::dot(q, q) > 1e-6f ? glm::normalize(q) : glm::vec4(0, 1, 0, 0);
    surfels.means.push_back(mean);
    for (int k = 0; k < 4; ++k) surfels.rotations.push_back(q[k]);
    surfels.scales.push_back(scale);
    surfels.opacities.push_back(opacity);
    surfels.colors.emplace_back(unit(random), unit(random), unit(random));
    surfels.albedos.emplace_back(unit(random), unit(random), unit(random));
    surfels.roughnesses.push_back(unit(random));
    surfels.radii.push_back(0.2f * unit(random));
    surfels.importances.push_back(unit(random));
    surfels.bones.emplace_back(0.0f, 1.0f, 0.0f);
}

/// Surfels that face the camera, all over an ellipse of 28 % of the picture, `sigmaPx` wide, opacity 0.5 to 1: the load
/// of the older measurements (no surfel hides behind the body).
Surfels facingCloud(std::size_t count, float sigmaPx, int side) {
    Surfels surfels;
    std::mt19937 random(1);
    std::uniform_real_distribution<float> unit(0.0f, 1.0f);
    const Camera camera = benchCamera(side);
    while (surfels.count() < count) {
        const float x = 2 * unit(random) - 1, y = 2 * unit(random) - 1, z = unit(random) - 0.5f;
        if (x * x + y * y > 1) continue;
        const auto metresPerPixel = static_cast<float>((3.0 - z) / camera.fx);
        const float halfSide = 0.5f * static_cast<float>(side) * metresPerPixel;
        // Semi-axes a and b with pi a b = 0.28 of the picture's area.
        const float a = 0.4f * halfSide, b = 0.891f * halfSide;
        const float sigma = sigmaPx * metresPerPixel;
        addSurfel(surfels, {a * x, b * y, z}, {0, 0, 1}, {sigma, sigma}, 0.5f + 0.5f * unit(random), random);
    }
    return surfels;
}

/// An even sheet of surfels on the surface of an ellipsoid of a body's size, as an avatar is: half of them seen from
/// behind, scale from the spacing, opacity 0.9 to 1; about 45,000 foreground pixels at 512x512.
Surfels body(std::size_t count) {
    Surfels surfels;
    std::mt19937 random(2);
    std::uniform_real_distribution<float> unit(0.0f, 1.0f);
    const glm::vec3 axes(0.36f, 0.98f, 0.25f);
    const float spacing = std::sqrt(2.9f / static_cast<float>(count)); // area about 2.9 m^2
    for (std::size_t i = 0; i < count; ++i) {
        // A spiral of equal areas on the sphere; the ellipsoid stretches it, unevenly but without holes.
        const double z = 1.0 - 2.0 * (static_cast<double>(i) + 0.5) / static_cast<double>(count);
        const double turn = std::numbers::pi * (3.0 - std::sqrt(5.0)) * static_cast<double>(i);
        const double r = std::sqrt(1.0 - z * z);
        const glm::vec3 s(static_cast<float>(r * std::cos(turn)), static_cast<float>(z),
                          static_cast<float>(r * std::sin(turn)));
        addSurfel(surfels, axes * s, glm::normalize(s / axes), glm::vec2(0.6f * spacing), 0.9f + 0.1f * unit(random),
                  random);
    }
    return surfels;
}

constexpr ChannelSet kThreeChannels{Channel::Opacity, Channel::Radiance};

void run(benchmark::State& state, const Surfels& surfels, int side, ChannelSet channels, SplatParams params,
         CpuPath path = CpuPath::Best) {
    const Camera camera = benchCamera(side);
    const SurfelView view = viewOf(surfels);
    SplatWorkspace workspace;
    workspace.setCpuPath(path);
    GBuffer gbuffer;
    SplatStats stats;
    double best = 1e9;
    for (auto _ : state) {
        const auto start = std::chrono::steady_clock::now();
        if (!splat(params, view, camera, channels, gbuffer, workspace, nullptr, &stats)) state.SkipWithError("splat");
        best = std::min(best, std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
    }
    int width = 0;
    for (int i = 0; i < kChannelCount; ++i) {
        const auto channel = static_cast<Channel>(i);
        const bool blended = channel != Channel::Opacity && channel != Channel::Position;
        if (channels.has(channel) && blended) width += channelWidth(channel);
    }
    const double floor =
        static_cast<double>(stats.blended) * (kPairCost + width) / (kMultiplyAddsPerSecondAndCore * threadCount());
    state.counters["threads"] = threadCount();
    state.counters["visible"] = static_cast<double>(stats.visible());
    state.counters["pairs_M"] = 1e-6 * static_cast<double>(stats.blended);
    state.counters["instances_k"] = 1e-3 * static_cast<double>(stats.instances);
    state.counters["foreground_k"] = 1e-3 * static_cast<double>(stats.foreground);
    state.counters["best_ms"] = 1e3 * best;
    state.counters["floor_ms"] = 1e3 * floor;
    state.counters["share"] = floor / best;
}

void facing20kViewing(benchmark::State& state) { run(state, facingCloud(20000, 2.0f, 512), 512, kViewingChannels, {}); }
BENCHMARK(facing20kViewing)->Unit(benchmark::kMillisecond)->MeasureProcessCPUTime()->UseRealTime();

void facing20kThree(benchmark::State& state) { run(state, facingCloud(20000, 2.0f, 512), 512, kThreeChannels, {}); }
BENCHMARK(facing20kThree)->Unit(benchmark::kMillisecond)->MeasureProcessCPUTime()->UseRealTime();

void facing20kThreeRaySplat(benchmark::State& state) {
    run(state, facingCloud(20000, 2.0f, 512), 512, kThreeChannels, {.kernel = SurfelKernel::RaySplat});
}
BENCHMARK(facing20kThreeRaySplat)->Unit(benchmark::kMillisecond)->MeasureProcessCPUTime()->UseRealTime();

void facing200kThree(benchmark::State& state) { run(state, facingCloud(200000, 0.8f, 512), 512, kThreeChannels, {}); }
BENCHMARK(facing200kThree)->Unit(benchmark::kMillisecond)->MeasureProcessCPUTime()->UseRealTime();

void body20kViewing(benchmark::State& state) { run(state, body(20000), 512, kViewingChannels, {}); }
BENCHMARK(body20kViewing)->Unit(benchmark::kMillisecond)->MeasureProcessCPUTime()->UseRealTime();

void body20kViewingRaySplat(benchmark::State& state) {
    run(state, body(20000), 512, kViewingChannels, {.kernel = SurfelKernel::RaySplat});
}
BENCHMARK(body20kViewingRaySplat)->Unit(benchmark::kMillisecond)->MeasureProcessCPUTime()->UseRealTime();

void body20kThree(benchmark::State& state) { run(state, body(20000), 512, kThreeChannels, {}); }
BENCHMARK(body20kThree)->Unit(benchmark::kMillisecond)->MeasureProcessCPUTime()->UseRealTime();

void body300kViewing1024(benchmark::State& state) { run(state, body(300000), 1024, kViewingChannels, {}); }
BENCHMARK(body300kViewing1024)->Unit(benchmark::kMillisecond)->MeasureProcessCPUTime()->UseRealTime();

void body20kViewingPath(benchmark::State& state, CpuPath path) {
    run(state, body(20000), 512, kViewingChannels, {}, path);
}
BENCHMARK_CAPTURE(body20kViewingPath, portable, CpuPath::Portable)
    ->Unit(benchmark::kMillisecond)
    ->MeasureProcessCPUTime()
    ->UseRealTime();
BENCHMARK_CAPTURE(body20kViewingPath, avx2, CpuPath::Avx2)
    ->Unit(benchmark::kMillisecond)
    ->MeasureProcessCPUTime()
    ->UseRealTime();
BENCHMARK_CAPTURE(body20kViewingPath, avx512, CpuPath::Avx512)
    ->Unit(benchmark::kMillisecond)
    ->MeasureProcessCPUTime()
    ->UseRealTime();
void facing20kViewingPath(benchmark::State& state, CpuPath path) {
    run(state, facingCloud(20000, 2.0f, 512), 512, kViewingChannels, {}, path);
}
BENCHMARK_CAPTURE(facing20kViewingPath, portable, CpuPath::Portable)
    ->Unit(benchmark::kMillisecond)
    ->MeasureProcessCPUTime()
    ->UseRealTime();
BENCHMARK_CAPTURE(facing20kViewingPath, avx2, CpuPath::Avx2)
    ->Unit(benchmark::kMillisecond)
    ->MeasureProcessCPUTime()
    ->UseRealTime();
BENCHMARK_CAPTURE(facing20kViewingPath, avx512, CpuPath::Avx512)
    ->Unit(benchmark::kMillisecond)
    ->MeasureProcessCPUTime()
    ->UseRealTime();

} // namespace
