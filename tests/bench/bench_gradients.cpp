#include "engine/core/parallel.h"
#include "engine/light/prefilter_gradient.h"
#include "engine/occlusion/ambient_occlusion.h"
#include "engine/shade/shading_gradient.h"
#include "engine/surfel/pose_surfels_gradient.h"
#include "engine/surfel/splat_gradient.h"

#include <benchmark/benchmark.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <numbers>
#include <random>
#include <vector>

// Backward operators on the host. Floor of splatBackward: one pair of a surfel and a pixel needs, at least, at the
// pixel offset 2, falloff 6, exp2 7, alpha, transmittance and suffix 6 and one multiply-add for each channel; at the
// surfel offset 2, conic and place 10 and one multiply-add for each channel; with depth 8 more. The rate is that of
// bench_surfel.cpp:
//     floor = pairs x (33 + 2 channels) / (56e9 x cores).

namespace {

using namespace ars;

constexpr double kMultiplyAddsPerSecondAndCore = 56e9;

/// Times one call and keeps the best of all iterations: what a loaded machine disturbs least.
template <typename Function>
void measure(benchmark::State& state, Function&& function) {
    double best = 1e9;
    for (auto _ : state) {
        const auto start = std::chrono::steady_clock::now();
        if (const Status status = function(); !status) state.SkipWithError(status.error().describe().c_str());
        best = std::min(best, std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
    }
    state.counters["threads"] = threadCount();
    state.counters["best_ms"] = 1e3 * best;
}

struct Numbers {
    std::mt19937 random{1};
    float operator()(float low = 0.0f, float high = 1.0f) {
        return std::uniform_real_distribution<float>(low, high)(random);
    }
    std::vector<float> many(std::size_t count, float low = 0.0f, float high = 1.0f) {
        std::vector<float> values(count);
        for (float& v : values) v = (*this)(low, high);
        return values;
    }
};

void addSurfel(Surfels& s, const glm::vec3& mean, const glm::vec3& normal, float sigma, float opacity, Numbers& n) {
    glm::vec4 q(1.0f + normal.z, -normal.y, normal.x, 0.0f); // the shortest turn from +z
    q = glm::dot(q, q) > 1e-6f ? glm::normalize(q) : glm::vec4(0, 1, 0, 0);
    s.means.push_back(mean);
    for (int k = 0; k < 4; ++k) s.rotations.push_back(q[k]);
    s.scales.emplace_back(sigma, sigma);
    s.opacities.push_back(opacity);
    s.colors.emplace_back(n(), n(), n());
    s.albedos.emplace_back(n(), n(), n());
    s.roughnesses.push_back(n());
    s.radii.push_back(0.2f * n());
    s.radiiPlus.push_back(s.radii.back() + 0.01f);
    s.radiiMinus.push_back(s.radii.back() - 0.01f);
    s.importances.push_back(n());
    s.bones.emplace_back(0.0f, 1.0f, 0.0f);
}

/// As in bench_surfel.cpp: surfels of 2 px that face the camera all over 28 % of the picture, none hidden by a body.
Surfels facingCloud(std::size_t count, const Camera& camera) {
    Surfels surfels;
    Numbers n;
    while (surfels.count() < count) {
        const float x = n(-1.0f), y = n(-1.0f), z = n(-0.5f, 0.5f);
        if (x * x + y * y > 1) continue;
        const auto pixel = static_cast<float>((3.0 - z) / camera.fx);
        const float half = 0.5f * static_cast<float>(camera.height) * pixel;
        addSurfel(surfels, {0.4f * half * x, 0.891f * half * y, z}, {0, 0, 1}, 2.0f * pixel, n(0.5f), n);
    }
    return surfels;
}

/// An even sheet on an ellipsoid of a body's size, half of it seen from behind: what an avatar is.
Surfels body(std::size_t count) {
    Surfels surfels;
    Numbers n;
    const glm::vec3 axes(0.36f, 0.98f, 0.25f);
    const float spacing = std::sqrt(2.9f / static_cast<float>(count));
    for (std::size_t i = 0; i < count; ++i) {
        const double z = 1.0 - 2.0 * (static_cast<double>(i) + 0.5) / static_cast<double>(count);
        const double turn = std::numbers::pi * (3.0 - std::sqrt(5.0)) * static_cast<double>(i);
        const double r = std::sqrt(1.0 - z * z);
        const glm::vec3 s(static_cast<float>(r * std::cos(turn)), static_cast<float>(z),
                          static_cast<float>(r * std::sin(turn)));
        addSurfel(surfels, axes * s, glm::normalize(s / axes), 0.6f * spacing, n(0.9f), n);
    }
    return surfels;
}

constexpr ChannelSet kThreeChannels{Channel::Opacity, Channel::Radiance};
/// What the material stage splats; gradients come for the first seven and the radius.
constexpr ChannelSet kTraining{Channel::Opacity,     Channel::Depth,      Channel::Normal, Channel::Radiance,
                               Channel::Albedo,      Channel::Roughness,  Channel::Radius, Channel::RadiusPlus,
                               Channel::RadiusMinus, Channel::Importance, Channel::Bone};
constexpr ChannelSet kWithGradient{Channel::Opacity, Channel::Depth,     Channel::Normal, Channel::Radiance,
                                   Channel::Albedo,  Channel::Roughness, Channel::Radius};

void splatBackwardOf(benchmark::State& state, const Surfels& surfels, const Camera& camera, ChannelSet channels,
                     SplatParams params = {}) {
    const SurfelView view = viewOf(surfels);
    GBuffer gbuffer;
    SplatWorkspace workspace;
    SplatStats stats;
    if (!splat(params, view, camera, channels, gbuffer, workspace, nullptr, &stats)) {
        state.SkipWithError("splat");
        return;
    }
    Numbers n;
    std::array<std::vector<float>, kChannelCount> pictures;
    GBufferGradients gradients;
    int width = 0;
    double depth = 0;
    for (int i = 0; i < kChannelCount; ++i) {
        const auto channel = static_cast<Channel>(i);
        if (!channels.has(channel) || !kWithGradient.has(channel)) continue;
        auto& values = pictures[static_cast<std::size_t>(i)];
        values = n.many(gbuffer[channel].view().valueCount(), -1.0f);
        gradients[channel] = {values.data(), camera.width, camera.height, channelWidth(channel)};
        if (channel == Channel::Depth) depth = 8;
        if (channel != Channel::Opacity && channel != Channel::Depth) width += channelWidth(channel);
    }
    SplatGradientWorkspace memory;
    SurfelGradients out;
    measure(state, [&] { return splatBackward(params, view, camera, gbuffer, nullptr, gradients, memory, out); });
    const double floor =
        static_cast<double>(stats.blended) * (33 + depth + 2 * width) / (kMultiplyAddsPerSecondAndCore * threadCount());
    state.counters["pairs_M"] = 1e-6 * static_cast<double>(stats.blended);
    state.counters["channels"] = width;
    state.counters["floor_ms"] = 1e3 * floor;
    state.counters["times_floor"] = state.counters["best_ms"] / (1e3 * floor);
}

Camera cameraOf(int side) { return lookAtCamera({0, 0, 3}, {0, 0, 0}, 45.0, side, side); }

void splatFacing20kThree512(benchmark::State& state) {
    splatBackwardOf(state, facingCloud(20000, cameraOf(512)), cameraOf(512), kThreeChannels);
}
void splatFacing20kTraining512(benchmark::State& state) {
    splatBackwardOf(state, facingCloud(20000, cameraOf(512)), cameraOf(512), kTraining);
}
void splatBody20kThree512(benchmark::State& state) {
    splatBackwardOf(state, body(20000), cameraOf(512), kThreeChannels);
}
void splatBody20kTraining512(benchmark::State& state) { splatBackwardOf(state, body(20000), cameraOf(512), kTraining); }
void splatBody20kTraining512Filtered(benchmark::State& state) {
    splatBackwardOf(state, body(20000), cameraOf(512), kTraining, {.depth = DepthMode::Filtered});
}
void splatBody20kTraining256(benchmark::State& state) { splatBackwardOf(state, body(20000), cameraOf(256), kTraining); }
void splatBody20kTraining512RaySplat(benchmark::State& state) {
    splatBackwardOf(state, body(20000), cameraOf(512), kTraining, {.kernel = SurfelKernel::RaySplat});
}

void poseSurfels20k(benchmark::State& state) {
    const Surfels surfels = body(20000);
    Numbers n;
    SkinWeights weights;
    std::vector<glm::mat4> matrices(55, glm::mat4(1.0f));
    std::vector<glm::vec3> positions(55, glm::vec3(0.0f));
    std::vector<BodyPart> parts;
    for (std::size_t j = 0; j < matrices.size(); ++j) parts.push_back(static_cast<BodyPart>(j % kBodyPartCount));
    for (std::size_t i = 0; i < surfels.count(); ++i) {
        for (std::size_t k = 0; k < kMaxInfluences; ++k) {
            weights.joints.push_back(static_cast<std::uint16_t>((i / 400 + k) % 55));
            weights.weights.push_back(k < 4 ? 0.25f : 0.0f);
        }
    }
    std::vector<glm::vec3> gMeans(surfels.count(), glm::vec3(1.0f)), means(surfels.count());
    std::vector<float> gRotations = n.many(4 * surfels.count()), gRadii = n.many(surfels.count());
    std::vector<float> rotations(4 * surfels.count());
    PartRadii radii{};
    measure(state, [&] {
        return poseSurfelsBackward({matrices, positions, parts}, weights, surfels, {gMeans, gRotations, gRadii}, means,
                                   rotations, radii);
    });
}

PrefilteredLight filteredLight(int side) {
    Numbers n;
    CubeMap cube;
    cube.size = side;
    cube.texels = n.many(static_cast<std::size_t>(18 * side * side));
    PrefilteredLight light;
    if (!prefilterLight({}, cube, {}, light)) light = {};
    return light;
}

/// Pictures of a body for shading and occlusion.
struct View {
    Camera camera;
    GBuffer gbuffer;
    std::uint64_t foreground = 0;

    explicit View(int side) : camera(lookAtCamera({0, 0, 2.6}, {0, 0, 0}, 45.0, side, side)) {
        SplatWorkspace workspace;
        SplatStats stats;
        const Surfels surfels = body(20000);
        if (splat({}, viewOf(surfels), camera, kTraining, gbuffer, workspace, nullptr, &stats)) {
            foreground = stats.foreground;
        }
    }
    ImageView<const float> operator[](Channel channel) const { return gbuffer[channel].view(); }
};

void shade256(benchmark::State& state) {
    const View view(256);
    const PrefilteredLight light = filteredLight(64);
    Numbers n;
    const std::size_t pixels = 256 * 256;
    const std::vector<float> gradBeauty = n.many(4 * pixels, -1.0f), occlusion = n.many(pixels);
    std::vector<float> albedo(3 * pixels), roughness(pixels), normal(3 * pixels), opacity(pixels), gOcclusion(pixels);
    const ShadingInputs inputs{view[Channel::Albedo],
                               view[Channel::Roughness],
                               view[Channel::Normal],
                               view[Channel::Opacity],
                               {occlusion.data(), 256, 256, 1},
                               {},
                               view.camera,
                               light.view()};
    LightLevelGradients levels;
    levels.reset(inputs.light);
    const ShadingGradientOutputs outputs{{albedo.data(), 256, 256, 3},     {roughness.data(), 256, 256, 1},
                                         {normal.data(), 256, 256, 3},     {opacity.data(), 256, 256, 1},
                                         {gOcclusion.data(), 256, 256, 1}, levels.view()};
    ShadingGradientWorkspace workspace;
    measure(state, [&] { return shadeBackward({}, {}, inputs, {gradBeauty.data(), 256, 256, 4}, outputs, workspace); });
    state.counters["foreground_k"] = 1e-3 * static_cast<double>(view.foreground);
}

void prefilterLight64(benchmark::State& state) {
    const PrefilteredLight light = filteredLight(64);
    Numbers n;
    LightLevelGradients levels;
    levels.reset(light.view());
    for (auto& level : levels.specular) level = n.many(level.size());
    levels.diffuse = n.many(levels.diffuse.size());
    std::vector<float> gradient(18 * 64 * 64);
    PrefilterGradientWorkspace workspace;
    measure(state, [&] {
        return prefilterLightBackward({}, 64, {}, levels.view(), {gradient.data(), 64, 384, 3}, workspace);
    });
}

void occlusionTriple256(benchmark::State& state) {
    const View view(256);
    OcclusionParams params;
    params.quality = OcclusionQuality::Interactive;
    params.interactiveDirections = 128;
    const auto inputs = occlusionInputs(view.gbuffer, view.camera);
    OcclusionWorkspace workspace;
    std::vector<float> maps[3] = {std::vector<float>(65536), std::vector<float>(65536), std::vector<float>(65536)};
    const auto map = [&](int k) { return ImageView<float>{maps[k].data(), 256, 256, 1}; };
    int pass = 0;
    measure(state, [&] {
        return ambientOcclusionTriple(params, *inputs, view[Channel::RadiusPlus], view[Channel::RadiusMinus], workspace,
                                      map(0), map(1), map(2), pass++);
    });
    state.counters["foreground_k"] = 1e-3 * static_cast<double>(view.foreground);
}

#define ARS_GRADIENT_BENCH(name) BENCHMARK(name)->Unit(benchmark::kMillisecond)->MeasureProcessCPUTime()->UseRealTime()
ARS_GRADIENT_BENCH(splatFacing20kThree512);
ARS_GRADIENT_BENCH(splatFacing20kTraining512);
ARS_GRADIENT_BENCH(splatBody20kThree512);
ARS_GRADIENT_BENCH(splatBody20kTraining512);
ARS_GRADIENT_BENCH(splatBody20kTraining512Filtered);
ARS_GRADIENT_BENCH(splatBody20kTraining256);
ARS_GRADIENT_BENCH(splatBody20kTraining512RaySplat);
ARS_GRADIENT_BENCH(poseSurfels20k);
ARS_GRADIENT_BENCH(shade256);
ARS_GRADIENT_BENCH(prefilterLight64);
ARS_GRADIENT_BENCH(occlusionTriple256);

} // namespace
