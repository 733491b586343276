// Inverse kinematics on a body of round numbers: a drag must cost less than 0.2 ms.
#include "engine/rig/inverse_kinematics.h"

#include <benchmark/benchmark.h>

#include <cmath>

namespace {

using namespace ars;

Skeleton person() {
    std::vector<glm::vec3> p(kSmplxJointCount);
    // Only the chains matter: trunk up, arms out, legs down, each bone 0.25 m.
    const auto set = [&](const char* name, glm::vec3 place) {
        p[static_cast<std::size_t>(smplxJointIndex(name))] = place;
    };
    set("spine1", {0, 0.1f, 0}), set("spine2", {0, 0.2f, 0}), set("spine3", {0, 0.3f, 0}), set("neck", {0, 0.5f, 0});
    set("head", {0, 0.6f, 0}), set("left_collar", {0.02f, 0.45f, 0}), set("left_shoulder", {0.2f, 0.45f, 0});
    set("left_elbow", {0.45f, 0.45f, 0}), set("left_wrist", {0.7f, 0.45f, 0}), set("left_index1", {0.8f, 0.45f, 0});
    set("left_hip", {0.1f, -0.1f, 0}), set("left_knee", {0.1f, -0.5f, 0}), set("left_ankle", {0.1f, -0.9f, 0});
    return smplxSkeleton(p);
}

/// Drags a joint along a circle of 30 cm; `away` metres further out than it rests.
void drag(benchmark::State& state, const char* name, const char* root, float away) {
    const Skeleton skeleton = person();
    Pose pose = restPose(kSmplxJointCount);
    const int joint = smplxJointIndex(name);
    const glm::vec3 rest = skeleton.restPositions[static_cast<std::size_t>(joint)];
    IkOptions options;
    if (root) options.chainRoot = smplxJointIndex(root);
    float angle = 0.0f;
    int iterations = 0;
    for (auto _ : state) {
        angle += 0.02f;
        const glm::vec3 circle(std::cos(angle) - 1.0f, std::sin(angle), 0.5f + 0.5f * std::sin(angle));
        auto result = solveIk(skeleton, pose, joint, rest * (1.0f + away) + 0.3f * circle, options);
        benchmark::DoNotOptimize(result);
        iterations += result->iterations;
    }
    state.counters["iterations"] = benchmark::Counter(iterations, benchmark::Counter::kAvgIterations);
}

BENCHMARK_CAPTURE(drag, wrist, "left_wrist", nullptr, 0.0f)->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(drag, wrist_from_spine, "left_wrist", "spine1", 0.0f)->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(drag, wrist_out_of_reach, "left_wrist", nullptr, 1.0f)->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(drag, wrist_from_spine_out_of_reach, "left_wrist", "spine1", 1.0f)->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(drag, ankle, "left_ankle", nullptr, 0.0f)->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(drag, head, "head", nullptr, 0.0f)->Unit(benchmark::kMicrosecond);

} // namespace
