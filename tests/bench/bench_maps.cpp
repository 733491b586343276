// Maps, PCA of poses, posing of surfels, surfels from a mesh. Linked with ars::frame.
#include "engine/core/parallel.h"
#include "engine/frame/rest_avatar.h"
#include "engine/maps/pose_pca.h"
#include "engine/maps/position_maps.h"
#include "engine/surfel/knn.h"
#include "engine/surfel/pose_surfels.h"

#include <benchmark/benchmark.h>

#include <random>

namespace {

using namespace ars;

struct Body {
    BodyModel body = *readOpenBody();
    TemplateMesh mesh = templateFromBody(body);
    Skeleton skeleton = bodySkeleton(body, {});
    Pose pose = restPose(kSmplxJointCount);
    Body() {
        std::mt19937 random(1);
        std::normal_distribution<float> normal(0.0f, 0.25f);
        for (glm::quat& q : pose.rotations) q = quatFromAxisAngle({normal(random), normal(random), normal(random)});
    }
};

const Body& body() {
    static const Body instance;
    return instance;
}

const RestAvatar& avatar(int surfels) {
    static std::vector<std::pair<int, std::unique_ptr<RestAvatar>>> made;
    for (const auto& [count, known] : made) {
        if (count == surfels) return *known;
    }
    RestAvatarOptions options;
    options.maxSurfels = surfels;
    made.emplace_back(surfels, *RestAvatar::create(body().mesh, options));
    return *made.back().second;
}

// Floor: 140 bytes read and 52 written per surfel: 300 k surfels at 40 GB/s take 1.4 ms. Goals 2 ms and 20 ms.
void poseSurfelsOfTheBody(benchmark::State& state) {
    const RestAvatar& rest = avatar(static_cast<int>(state.range(0)));
    const auto matrices = canonicalToPosed(skinningMatrices(rest.rig().skeleton, body().pose), rest.rig().canonical);
    const std::vector<glm::vec3> joints = posedJointPositions(rest.rig().skeleton, body().pose);
    PosedSurfels posed;
    for (auto _ : state) {
        if (!poseSurfels({}, {*matrices, joints, rest.rig().parts}, rest.rig().weights, rest.surfels(), posed)) {
            state.SkipWithError("poseSurfels failed");
        }
        benchmark::DoNotOptimize(posed.means.data());
    }
    state.counters["surfels"] = static_cast<double>(posed.count());
    state.counters["threads"] = threadCount();
}
BENCHMARK(poseSurfelsOfTheBody)->Arg(20000)->Arg(340000)->Unit(benchmark::kMillisecond)->UseRealTime();

void radiiOnly(benchmark::State& state) {
    const RestAvatar& rest = avatar(340000);
    const std::vector<glm::vec3> joints = posedJointPositions(rest.rig().skeleton, body().pose);
    const std::vector<glm::mat4> matrices = skinningMatrices(rest.rig().skeleton, body().pose);
    PosedSurfels posed;
    const SurfelPosing posing{matrices, joints, rest.rig().parts};
    if (!poseSurfels({}, posing, rest.rig().weights, rest.surfels(), posed)) state.SkipWithError("failed");
    for (auto _ : state) {
        if (!poseRadii({}, posing, rest.rig().weights, posed)) state.SkipWithError("poseRadii failed");
    }
}
BENCHMARK(radiiOnly)->Unit(benchmark::kMillisecond)->UseRealTime();

void restAvatarFromTheBody(benchmark::State& state) {
    RestAvatarOptions options;
    options.maxSurfels = static_cast<int>(state.range(0));
    for (auto _ : state) benchmark::DoNotOptimize(RestAvatar::create(body().mesh, options));
}
BENCHMARK(restAvatarFromTheBody)->Arg(60000)->Arg(150000)->Unit(benchmark::kMillisecond)->UseRealTime();

void neighborDistances150k(benchmark::State& state) {
    const std::vector<glm::vec3>& points = avatar(150000).surfels().means;
    for (auto _ : state) benchmark::DoNotOptimize(neighborDistances(points));
}
BENCHMARK(neighborDistances150k)->Unit(benchmark::kMillisecond)->UseRealTime();

void makeCanonicalMaps(benchmark::State& state) {
    CanonicalMapOptions options;
    options.size = static_cast<int>(state.range(0));
    std::size_t points = 0;
    for (auto _ : state) points = canonicalMaps(body().mesh, options)->pointCount();
    state.counters["points"] = static_cast<double>(points);
}
BENCHMARK(makeCanonicalMaps)->Arg(256)->Arg(1024)->Unit(benchmark::kMillisecond)->UseRealTime();

/// What a new pose costs before the network runs: `paper` has inputs of 512, `compact` of 128.
void positionAndPriorMaps(benchmark::State& state) {
    CanonicalMapOptions options;
    options.size = 2 * static_cast<int>(state.range(0));
    const CanonicalMaps maps = *halvedMaps(*canonicalMaps(body().mesh, options));
    std::vector<float> priors(maps.pointCount() * kPriorWidth), planes(maps.pixelCount() * kPriorWidth);
    for (auto _ : state) {
        const auto points = posedMapPoints(body().skeleton, maps, body().pose);
        if (!deformationPriors(maps, *points, mapBodyVertices(body().body, {}, body().pose), priors) ||
            !spreadPlanes(maps, priors, kPriorWidth, planes)) {
            state.SkipWithError("maps failed");
        }
        benchmark::DoNotOptimize(planes.data());
    }
    state.counters["points"] = static_cast<double>(maps.pointCount());
}
BENCHMARK(positionAndPriorMaps)->Arg(128)->Arg(512)->Unit(benchmark::kMillisecond)->UseRealTime();

std::vector<std::vector<float>> randomPoses(std::size_t count, std::size_t dimension) {
    std::mt19937 random(1);
    std::vector<std::vector<float>> samples(count, std::vector<float>(dimension));
    for (auto& sample : samples) {
        for (float& value : sample) value = static_cast<float>(random()) * 2.3e-10f;
    }
    return samples;
}

void fitPcaOf300Poses(benchmark::State& state) {
    const auto samples = randomPoses(300, 100000);
    for (auto _ : state) benchmark::DoNotOptimize(fitPosePca(samples));
}
BENCHMARK(fitPcaOf300Poses)->Unit(benchmark::kMillisecond)->UseRealTime();

// Floor: 20 components of 100,000 numbers are read twice: 16 MB at 40 GB/s take 0.4 ms.
void projectOnTwentyComponents(benchmark::State& state) {
    const auto samples = randomPoses(40, 100000);
    const PosePca pca = *fitPosePca(samples);
    for (auto _ : state) {
        std::vector<float> values = samples[0];
        benchmark::DoNotOptimize(projectPose(pca, values));
    }
}
BENCHMARK(projectOnTwentyComponents)->Unit(benchmark::kMillisecond)->UseRealTime();

} // namespace
