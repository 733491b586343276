#include "engine/core/parallel.h"
#include "engine/light/cube_map.h"
#include "engine/light/prefilter.h"
#include "engine/light/prefilter_kernels.h"
#include "engine/light/prefilter_math.h"
#include "engine/light/sky.h"
#include "engine/light/studio.h"
#include "engine/shade/shading.h"
#include "engine/shade/tone.h"

#include <benchmark/benchmark.h>

#include <vector>

// Light and shading on the host. Floors, two cores at about 3 GHz with AVX2:
// - prefilter: every texel in a cone costs 5 loads, about 20 vector operations and a division for 8 texels, 5 to 6
// cycles
//   when nothing waits; the counter `texels` says how many, so 0.7e9 (exact) needs 0.08 s and 0.05e9 (draft) 6 ms.
// - shade: 45 k pixels x (16 inputs + 4 outputs) floats are 3.6 MB, the empty rest 4 MB: 1 ms of memory traffic. The
//   lookups, 12 texels of 3 floats from 25 MB of light, are what it waits for.
// - tone: 135 k powers at about 20 ns, 1.4 ms on two cores.

namespace {

using namespace ars;

const CubeMap& skyCube() {
    static const CubeMap cube = *cubeFromLatLong(generateSky({})->environment.picture, kDefaultLightBase);
    return cube;
}

/// Texels that the cones of all levels hold, from a sample of them.
double texelsInCones(int base, LightQuality quality) {
    double total = 0.0;
    const int levels = lightLevelCount(base);
    for (int l = 0; l < levels; ++l) {
        const int whole = base >> l,
                  side = quality == LightQuality::Draft ? std::max(whole / 2, std::min(whole, 32)) : whole;
        const double cosine = specularCutoffCosine(levelRoughness<double>(l, levels));
        // The cone's share of the sphere times all texels, for each output texel.
        total += 6.0 * side * side * (0.5 * (1.0 - cosine)) * 6.0 * side * side;
    }
    return total;
}

void prefilter512(benchmark::State& state, LightQuality quality, cpu::FilterInstructions instructions) {
    if (!cpu::useFilterInstructions(instructions)) {
        state.SkipWithError("this machine has not got these instructions");
        return;
    }
    PrefilteredLight light;
    PrefilterParams params;
    params.quality = quality;
    const CubeMap& cube = skyCube();
    for (auto _ : state) {
        if (!prefilterLight({}, cube, params, light).ok()) state.SkipWithError("prefilterLight failed");
    }
    cpu::useFilterInstructions(cpu::FilterInstructions::Best);
    state.counters["threads"] = threadCount();
    state.counters["texels"] = texelsInCones(kDefaultLightBase, quality);
}
BENCHMARK_CAPTURE(prefilter512, draft, LightQuality::Draft, cpu::FilterInstructions::Best)
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();
BENCHMARK_CAPTURE(prefilter512, exact, LightQuality::Exact, cpu::FilterInstructions::Best)
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();
BENCHMARK_CAPTURE(prefilter512, draftAvx2, LightQuality::Draft, cpu::FilterInstructions::Avx2)
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();
BENCHMARK_CAPTURE(prefilter512, draftPortable, LightQuality::Draft, cpu::FilterInstructions::Portable)
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

void latLong1kToCube512(benchmark::State& state) {
    const Sky sky = *generateSky({});
    for (auto _ : state) benchmark::DoNotOptimize(cubeFromLatLong(sky.environment.picture, kDefaultLightBase));
}
BENCHMARK(latLong1kToCube512)->Unit(benchmark::kMillisecond)->UseRealTime();

void generateSky1k(benchmark::State& state) {
    for (auto _ : state) benchmark::DoNotOptimize(generateSky({}));
}
BENCHMARK(generateSky1k)->Unit(benchmark::kMillisecond)->UseRealTime();

void generateStudio1k(benchmark::State& state) {
    const StudioParams studio = studioPreset(StudioPreset::ThreePoint);
    for (auto _ : state) benchmark::DoNotOptimize(generateStudio(studio));
}
BENCHMARK(generateStudio1k)->Unit(benchmark::kMillisecond)->UseRealTime();

/// A ball of 45 k pixels in a picture of 512 x 512.
struct Ball {
    static constexpr int kSide = 512;
    std::vector<float> albedo, roughness, normal, opacity, occlusion;
    std::vector<float> beauty, diffuse, specular;
    PrefilteredLight light;
    ShadingInputs inputs;
    ShadingOutputs outputs;
    int covered = 0;

    Ball() {
        const std::size_t n = static_cast<std::size_t>(kSide) * kSide;
        albedo.assign(3 * n, 0.0f);
        roughness.assign(n, 0.0f);
        normal.assign(3 * n, 0.0f);
        opacity.assign(n, 0.0f);
        occlusion.assign(n, 1.0f);
        beauty.resize(4 * n);
        diffuse.resize(3 * n);
        specular.resize(3 * n);
        fill();
        if (!prefilterLight({}, skyCube(), {}, light).ok()) std::abort();
        const auto in = [](const std::vector<float>& v, int channels) {
            return ImageView<const float>{v.data(), kSide, kSide, channels};
        };
        inputs.albedo = in(albedo, 3);
        inputs.roughness = in(roughness, 1);
        inputs.normal = in(normal, 3);
        inputs.opacity = in(opacity, 1);
        inputs.occlusion = in(occlusion, 1);
        inputs.camera = lookAtCamera({0, 1, 3}, {0, 1, 0}, 40.0, kSide, kSide);
        inputs.light = light.view();
        outputs.beauty = {beauty.data(), kSide, kSide, 4};
        outputs.diffuse = {diffuse.data(), kSide, kSide, 3};
        outputs.specular = {specular.data(), kSide, kSide, 3};
    }

    void fill() {
        for (int row = 0; row < kSide; ++row) {
            for (int column = 0; column < kSide; ++column) {
                const float x = (static_cast<float>(column) - 256.0f) / 120.0f,
                            y = (static_cast<float>(row) - 256.0f) / 120.0f;
                if (x * x + y * y >= 1.0f) continue;
                const std::size_t i = static_cast<std::size_t>(row) * kSide + static_cast<std::size_t>(column);
                const float rest[3] = {x, y, -std::sqrt(1.0f - x * x - y * y)};
                for (std::size_t c = 0; c < 3; ++c) {
                    normal[3 * i + c] = rest[c];
                    albedo[3 * i + c] = 0.4f;
                }
                // Roughness of cloth and skin, changing from pixel to pixel as networks make it.
                roughness[i] = 0.3f + 0.5f * static_cast<float>((row * 7 + column * 13) % 16) / 16.0f;
                opacity[i] = 1.0f;
                ++covered;
            }
        }
    }
};

Ball& ball() {
    static Ball instance;
    return instance;
}

void shade45k(benchmark::State& state) {
    Ball& b = ball();
    for (auto _ : state) {
        if (!shade({}, {}, b.inputs, b.outputs).ok()) state.SkipWithError("shade failed");
    }
    state.counters["pixels"] = b.covered;
    state.counters["threads"] = threadCount();
}
BENCHMARK(shade45k)->Unit(benchmark::kMillisecond)->UseRealTime();

void tone512(benchmark::State& state, ToneCurve curve) {
    Ball& b = ball();
    if (!shade({}, {}, b.inputs, b.outputs).ok()) state.SkipWithError("shade failed");
    std::vector<std::uint8_t> bytes(4 * 512 * 512);
    ToneParams params;
    params.curve = curve;
    const ImageView<std::uint8_t> out{bytes.data(), 512, 512, 4};
    for (auto _ : state) {
        if (!toneMap({}, params, b.outputs.beauty, out).ok()) state.SkipWithError("toneMap failed");
    }
}
BENCHMARK_CAPTURE(tone512, none, ToneCurve::None)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK_CAPTURE(tone512, aces, ToneCurve::Aces)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK_CAPTURE(tone512, agx, ToneCurve::Agx)->Unit(benchmark::kMillisecond)->UseRealTime();

} // namespace
