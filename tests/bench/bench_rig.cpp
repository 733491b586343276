#include "engine/core/parallel.h"
#include "engine/rig/body_model.h"
#include "engine/rig/skinning.h"

#include <benchmark/benchmark.h>

#include <random>

namespace {

using namespace ars;

/// 300,000 points on the scale of a body, each with 8 different joints of 55.
struct Cloud {
    static constexpr std::size_t kPoints = 300000, kJoints = 55;
    SkinWeights weights;
    std::vector<glm::mat4> matrices;
    std::vector<glm::vec3> rest, normals, points, turned;

    Cloud() : rest(kPoints), normals(kPoints), points(kPoints), turned(kPoints) {
        std::mt19937 random(1);
        std::normal_distribution<float> normal;
        std::uniform_int_distribution<int> joint(0, kJoints - 8);
        for (std::size_t i = 0; i < kPoints; ++i) {
            rest[i] = {normal(random), normal(random), normal(random)};
            normals[i] = glm::normalize(glm::vec3(normal(random), normal(random), normal(random)));
            const int first = joint(random);
            for (int k = 0; k < 8; ++k) {
                weights.joints.push_back(static_cast<std::uint16_t>(first + k));
                weights.weights.push_back((8.0f - static_cast<float>(k)) / 36.0f);
            }
        }
        for (std::size_t j = 0; j < kJoints; ++j) {
            const glm::vec3 turn(normal(random), normal(random), normal(random));
            matrices.push_back(glm::mat4_cast(quatFromAxisAngle(0.4f * turn)));
            matrices.back()[3] = glm::vec4(normal(random), normal(random), normal(random), 1.0f);
        }
    }
};

Cloud& cloud() {
    static Cloud instance;
    return instance;
}

void skinPoints300k(benchmark::State& state) {
    Cloud& c = cloud();
    for (auto _ : state) {
        if (!skinPoints(c.matrices, c.weights, c.rest, c.points)) state.SkipWithError("skinPoints failed");
        benchmark::DoNotOptimize(c.points.data());
    }
    state.counters["threads"] = threadCount();
}
BENCHMARK(skinPoints300k)->Unit(benchmark::kMillisecond)->UseRealTime();

void skinPointsAndNormals300k(benchmark::State& state) {
    Cloud& c = cloud();
    for (auto _ : state) {
        if (!skinPointsAndNormals(c.matrices, c.weights, c.rest, c.normals, c.points, c.turned)) {
            state.SkipWithError("skinPointsAndNormals failed");
        }
        benchmark::DoNotOptimize(c.turned.data());
    }
    state.counters["threads"] = threadCount();
}
BENCHMARK(skinPointsAndNormals300k)->Unit(benchmark::kMillisecond)->UseRealTime();

void posedOpenBody(benchmark::State& state) {
    const auto body = readOpenBody();
    if (!body) {
        state.SkipWithError(body.error().describe().c_str());
        return;
    }
    Pose pose = canonicalPose();
    pose.expression = {1.0f};
    for (auto _ : state) benchmark::DoNotOptimize(posedVertices(*body, {{0.5f, 1.0f}, {}}, pose));
}
BENCHMARK(posedOpenBody)->Unit(benchmark::kMillisecond)->UseRealTime();

void openTheOpenBody(benchmark::State& state) {
    for (auto _ : state) benchmark::DoNotOptimize(readOpenBody());
}
BENCHMARK(openTheOpenBody)->Unit(benchmark::kMillisecond)->UseRealTime();

/// A body of SMPL-X's size and tables (10,475 vertices, 300 + 100 components, pose blend shapes).
void posedFullSizeBody(benchmark::State& state) {
    BodyModel body;
    std::mt19937 random(2);
    std::normal_distribution<float> normal;
    const std::size_t vertices = 10475;
    body.shapeCount = 300;
    body.expressionCount = 100;
    body.templateVertices.resize(vertices);
    for (glm::vec3& v : body.templateVertices) v = {normal(random), normal(random), normal(random)};
    body.shapeDirs.assign(vertices * 3 * 300, 0.001f);
    body.expressionDirs.assign(vertices * 3 * 100, 0.001f);
    body.poseDirs.assign(vertices * 3 * 486, 0.001f);
    body.jointRegressor.assign(55 * vertices, 1.0f / static_cast<float>(vertices));
    body.weights.joints.assign(vertices * 8, 3);
    body.weights.weights.assign(vertices * 8, 0.125f);
    for (int j = 0; j < kSmplxJointCount; ++j) body.parents.push_back(smplxJointParent(j));
    const BodyShape shape{std::vector<float>(300, 0.1f), std::vector<float>(100, 0.1f)};
    for (auto _ : state) benchmark::DoNotOptimize(posedVertices(body, shape, canonicalPose()));
}
BENCHMARK(posedFullSizeBody)->Unit(benchmark::kMillisecond)->UseRealTime();

} // namespace
