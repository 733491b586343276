#include "engine/core/parallel.h"
#include "engine/occlusion/baked_visibility.h"
#include "engine/occlusion/mesh_occlusion.h"
#include "engine/occlusion/rasterised_visibility.h"
#include "engine/rig/body_model.h"

#include <benchmark/benchmark.h>

#include <algorithm>
#include <map>

// The open body cut to 54 k vertices and 107 k triangles, 50 k points on it. Processor time of one of two threads that
// share the work, on an EPYC (AVX-512) that other programs used too; no frame waits for any of these.
//   meshRays             0.54 s: 24 M rays/s; nearly all of it is Embree's traversal
//   meshRefit            33 ms, one thread
//   rasteriseVisibility  1.6 s: 512 z-buffers, 34 M triangles a second, most of about one pixel, and three passes
//                        over 27 MB x 30 neighbours
//   rasterisedQuery      40 ms: 50 k x 512 directions x 3 vertices, 1.9 G products a second
//   bakeVisibility       1.4 s: 15.7 k grid vertices x 1,152 rays, 13 M rays/s
//   bakedQuery           50 ms: 50 k x 256 series of 16 terms, 4 G products a second

namespace {

using namespace ars;

struct Scene {
    std::vector<glm::vec3> vertices, points, normals;
    std::vector<glm::uvec3> triangles;
    std::vector<float> radii;

    Scene() {
        const auto body = readOpenBody();
        if (!body) return;
        vertices = posedVertices(*body, {}, canonicalPose());
        triangles = body->triangles;
        refine();
        for (std::size_t i = 0; i < 50000; ++i) {
            const glm::uvec3 t = triangles[i * triangles.size() / 50000];
            const glm::vec3 a = vertices[t.x], b = vertices[t.y], c = vertices[t.z];
            points.push_back((a + b + c) / 3.0f);
            normals.push_back(glm::normalize(glm::cross(b - a, c - a)));
        }
        radii.assign(points.size(), 0.25f);
    }

    /// Every triangle into four.
    void refine() {
        std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> middles;
        const auto middle = [&](std::uint32_t a, std::uint32_t b) {
            const auto key = std::minmax(a, b);
            const auto found = middles.find(key);
            if (found != middles.end()) return found->second;
            vertices.push_back(0.5f * (vertices[a] + vertices[b]));
            return middles[key] = static_cast<std::uint32_t>(vertices.size() - 1);
        };
        std::vector<glm::uvec3> finer;
        for (const glm::uvec3& t : triangles) {
            const std::uint32_t ab = middle(t.x, t.y), bc = middle(t.y, t.z), ca = middle(t.z, t.x);
            finer.insert(finer.end(), {{t.x, ab, ca}, {ab, t.y, bc}, {ca, bc, t.z}, {ab, bc, ca}});
        }
        triangles = finer;
    }
};

const Scene& scene() {
    static const Scene instance;
    return instance;
}

void meshRays50kTimes256(benchmark::State& state) {
    const Scene& s = scene();
    const auto mesh = MeshOcclusion::build(s.vertices, s.triangles);
    std::vector<float> out(s.points.size());
    for (auto _ : state) {
        if (!mesh || !mesh->atPoints({}, {s.points, s.normals, s.radii}, out)) state.SkipWithError("failed");
        benchmark::DoNotOptimize(out.data());
    }
    state.counters["threads"] = threadCount();
    state.counters["rays/s"] =
        benchmark::Counter(static_cast<double>(out.size()) * 256, benchmark::Counter::kIsIterationInvariantRate);
}
BENCHMARK(meshRays50kTimes256)->Unit(benchmark::kMillisecond)->UseRealTime();

void meshRefit(benchmark::State& state) {
    const Scene& s = scene();
    auto mesh = MeshOcclusion::build(s.vertices, s.triangles);
    for (auto _ : state) {
        if (!mesh || !mesh->update(s.vertices)) state.SkipWithError("failed");
    }
    state.counters["triangles"] = static_cast<double>(s.triangles.size());
}
BENCHMARK(meshRefit)->Unit(benchmark::kMillisecond)->UseRealTime();

void rasteriseVisibility(benchmark::State& state) {
    const Scene& s = scene();
    for (auto _ : state) benchmark::DoNotOptimize(RasterisedVisibility::build(s.vertices, s.triangles));
    state.counters["vertices"] = static_cast<double>(s.vertices.size());
}
BENCHMARK(rasteriseVisibility)->Unit(benchmark::kMillisecond)->UseRealTime();

void rasterisedQuery50k(benchmark::State& state) {
    const Scene& s = scene();
    const auto visibility = RasterisedVisibility::build(s.vertices, s.triangles);
    std::vector<float> out(s.points.size());
    for (auto _ : state) {
        if (!visibility || !visibility->atPoints({s.points, s.normals, {}}, out)) state.SkipWithError("failed");
        benchmark::DoNotOptimize(out.data());
    }
}
BENCHMARK(rasterisedQuery50k)->Unit(benchmark::kMillisecond)->UseRealTime();

void bakeVisibility(benchmark::State& state) {
    const Scene& s = scene();
    std::size_t count = 0;
    for (auto _ : state) {
        const auto baked = BakedVisibility::bake(s.vertices, s.triangles);
        if (baked) count = baked->bakedCount();
    }
    state.counters["grid_vertices"] = static_cast<double>(count);
    state.counters["rays/s"] =
        benchmark::Counter(static_cast<double>(count) * 1152, benchmark::Counter::kIsIterationInvariantRate);
}
BENCHMARK(bakeVisibility)->Unit(benchmark::kMillisecond)->UseRealTime();

void bakedQuery50k(benchmark::State& state) {
    const Scene& s = scene();
    const auto baked = BakedVisibility::bake(s.vertices, s.triangles);
    std::vector<float> out(s.points.size());
    for (auto _ : state) {
        if (!baked || !baked->atPoints({s.points, s.normals, {}}, out)) state.SkipWithError("failed");
        benchmark::DoNotOptimize(out.data());
    }
}
BENCHMARK(bakedQuery50k)->Unit(benchmark::kMillisecond)->UseRealTime();

} // namespace
