#include "engine/core/parallel.h"
#include "engine/occlusion/rasterised_visibility.h"
#include "tests/unit/occlusion/baseline_meshes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <numeric>
#include <set>

namespace ars {
namespace {

using test::floorAndWall;
using test::mean;
using test::sheet;
using test::sphere;
using test::TestMesh;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
/// 72 directions and coarse pictures, where a test asks for no more.
const RasterisedVisibilityParams kCoarse{.rows = 6, .pixelsPerMetre = 60};
const RasterisedVisibilityParams kCoarseRaw{.rows = 6, .pixelsPerMetre = 60, .neighbourhood = 1};

RasterisedVisibility built(const TestMesh& mesh, const RasterisedVisibilityParams& params = {}) {
    auto result = RasterisedVisibility::build(mesh.vertices, mesh.triangles, params);
    EXPECT_TRUE(result.ok()) << result.error().describe();
    return std::move(result).value();
}

std::vector<float> ask(const RasterisedVisibility& visibility, const std::vector<glm::vec3>& points,
                       const std::vector<glm::vec3>& normals) {
    std::vector<float> values(points.size(), -1.0f);
    const Status status = visibility.atPoints({points, normals, {}}, values);
    EXPECT_TRUE(status.ok()) << status.error().describe();
    return values;
}

TEST(DirectionGrid, SolidAnglesFillTheSphereAndFollowTheRow) {
    const DirectionGrid grid = latLongDirections(16, 32);
    ASSERT_EQ(grid.directions.size(), 512u);
    double sum = 0;
    for (const float w : grid.solidAnglesSr) sum += static_cast<double>(w);
    EXPECT_NEAR(sum, 4 * glm::pi<double>(), 1e-5);
    const double step = glm::pi<double>() / 16;
    EXPECT_NEAR(grid.solidAnglesSr[5 * 32 + 7], (std::cos(5 * step) - std::cos(6 * step)) * step, 1e-7);
    EXPECT_NEAR(grid.directions[5 * 32 + 7].y, std::cos(5.5 * step), 1e-6);
    for (const glm::vec3& d : grid.directions) EXPECT_NEAR(glm::length(d), 1.0f, 1e-6f);
}

TEST(RasterisedVisibility, ConvexMeshIsSeenFromEveryDirectionAboveItsHorizon) {
    const TestMesh mesh = sphere(0.5f, 4);
    const RasterisedVisibility visibility = built(mesh, {.pixelsPerMetre = 120, .neighbourhood = 1});
    const DirectionGrid& grid = visibility.directions();
    // A vertex shows while one of its triangles does; a triangle here spans 6 degrees, so the horizon blurs by sin(6).
    const float blur = 0.12f;
    for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
        const glm::vec3 n = glm::normalize(mesh.vertices[v]);
        for (std::size_t d = 0; d < grid.directions.size(); ++d) {
            const float cosine = glm::dot(n, grid.directions[d]);
            const std::uint8_t seen = visibility.visibility()[v * grid.directions.size() + d];
            if (std::abs(cosine) < blur) continue;
            EXPECT_EQ(seen, cosine > 0 ? 255 : 0) << v << " " << d << " " << cosine;
        }
    }
}

TEST(RasterisedVisibility, ConvexMeshIsUnoccluded) {
    const TestMesh mesh = sphere(0.5f, 4);
    const RasterisedVisibility visibility = built(mesh, {.pixelsPerMetre = 120});
    const std::vector<glm::vec3> normals = test::spreadDirections(300);
    std::vector<glm::vec3> points;
    for (const glm::vec3& n : normals) points.push_back(0.501f * n);
    // 16 rows of directions integrate the cosine to about a hundredth; smoothing over 30 vertices (12 degrees of this
    // sphere) takes some of the directions near the horizon, which count least.
    for (const float v : visibility.vertexOcclusion()) EXPECT_NEAR(v, 1.0f, 0.03f);
    for (const float v : ask(visibility, points, normals)) EXPECT_NEAR(v, 1.0f, 0.03f);
}

TEST(RasterisedVisibility, StepHidesItsClosedFormShare) {
    // 4 m of floor with a 0.3 m wall; triangles of 2 to 8 cm (2 pixels and more). The wall's ends and the smoothing
    // over 30 vertices (8 cm) blur the share.
    TestMesh mesh = sheet({0, 0, -2}, {0, 0, 4}, {1, 0, 0}, 50);
    mesh.append(sheet({0, 0, -2}, {0, 0.3f, 0}, {0, 0, 4}, 50));
    const RasterisedVisibility visibility = built(mesh, {.pixelsPerMetre = 60});
    std::vector<glm::vec3> points;
    const std::vector<float> distances{0.2f, 0.3f, 0.5f};
    for (const float d : distances) points.emplace_back(d, 0, 0);
    const std::vector<float> values = ask(visibility, points, std::vector(points.size(), glm::vec3(0, 1, 0)));
    for (std::size_t i = 0; i < values.size(); ++i) {
        EXPECT_NEAR(values[i], 1 - test::stepShare(distances[i], 0.3), 0.03) << distances[i];
    }
}

TEST(RasterisedVisibility, NearerSurfaceHidesTheFartherFromOneSideOnly) {
    // Two sheets; directions from straight above see the upper alone, from below the lower alone.
    TestMesh mesh = sheet({-1, 0, -1}, {0, 0, 2}, {2, 0, 0}, 8);
    mesh.append(sheet({-1, 0.5f, -1}, {0, 0, 2}, {2, 0, 0}, 8));
    const RasterisedVisibility visibility = built(mesh, kCoarseRaw);
    const std::size_t directions = visibility.directions().directions.size(), lower = 40, upper = 81 + 40;
    ASSERT_EQ(mesh.vertices[lower], glm::vec3(0, 0, 0));
    ASSERT_EQ(mesh.vertices[upper], glm::vec3(0, 0.5f, 0));
    EXPECT_EQ(visibility.visibility()[lower * directions], 0);
    EXPECT_EQ(visibility.visibility()[upper * directions], 255);
    EXPECT_EQ(visibility.visibility()[lower * directions + directions - 1], 255);
    EXPECT_EQ(visibility.visibility()[upper * directions + directions - 1], 0);
}

/// The same smoothing by sorting, vertex by vertex.
std::vector<std::uint8_t> smoothedBySorting(std::span<const std::uint8_t> raw, const TestMesh& mesh,
                                            std::size_t directions, bool median) {
    std::vector<std::set<std::uint32_t>> joined(mesh.vertices.size());
    for (const glm::uvec3& t : mesh.triangles) {
        for (int a = 0; a < 3; ++a) joined[t[a]].insert({t[(a + 1) % 3], t[(a + 2) % 3]});
    }
    std::vector<std::uint8_t> result(raw.size());
    for (std::uint32_t v = 0; v < mesh.vertices.size(); ++v) {
        std::vector<std::uint32_t> near{v};
        for (std::size_t next = 0; next < near.size() && near.size() < 30; ++next) {
            for (const std::uint32_t other : joined[near[next]]) {
                if (near.size() < 30 && std::find(near.begin(), near.end(), other) == near.end()) near.push_back(other);
            }
        }
        for (std::size_t d = 0; d < directions; ++d) {
            std::vector<int> values;
            for (const std::uint32_t other : near) values.push_back(raw[other * directions + d]);
            std::sort(values.begin(), values.end());
            const double sum = std::accumulate(values.begin(), values.end(), 0.0);
            result[v * directions + d] = static_cast<std::uint8_t>(
                median ? values[(values.size() - 1) / 2] : std::lround(sum / static_cast<double>(values.size())));
        }
    }
    return result;
}

TEST(RasterisedVisibility, SmoothingIsMedianMedianMeanOverThirtyVertices) {
    TestMesh mesh = sphere(0.3f, 3);
    mesh.append(sheet({-0.5f, -0.1f, -0.5f}, {0, 0, 1}, {1, 0, 0}, 9));
    // Pixels coarser than the triangles: visibility has holes to fill.
    const RasterisedVisibilityParams coarse{.rows = 6, .pixelsPerMetre = 30};
    RasterisedVisibilityParams raw = coarse;
    raw.neighbourhood = 1;
    const RasterisedVisibility unsmoothed = built(mesh, raw), smooth = built(mesh, coarse);
    const std::size_t directions = smooth.directions().directions.size();
    auto expected = smoothedBySorting(unsmoothed.visibility(), mesh, directions, true);
    expected = smoothedBySorting(expected, mesh, directions, true);
    expected = smoothedBySorting(expected, mesh, directions, false);
    const auto found = smooth.visibility();
    ASSERT_EQ(found.size(), expected.size());
    std::size_t differing = 0, changed = 0;
    for (std::size_t i = 0; i < found.size(); ++i) {
        differing += std::abs(int(found[i]) - int(expected[i])) > 1; // a half may round either way
        changed += found[i] != unsmoothed.visibility()[i];
    }
    EXPECT_EQ(differing, 0u);
    EXPECT_GT(changed, found.size() / 20);
}

TEST(RasterisedVisibility, TextureSeamsChangeNothing) {
    // Every triangle with three vertices of its own: the same surface.
    const TestMesh mesh = floorAndWall(0.5f, 0.3f, 8);
    TestMesh split;
    std::vector<std::uint32_t> origin;
    for (const glm::uvec3& t : mesh.triangles) {
        split.triangles.emplace_back(origin.size(), origin.size() + 1, origin.size() + 2);
        for (int corner = 0; corner < 3; ++corner) {
            origin.push_back(t[corner]);
            split.vertices.push_back(mesh.vertices[t[corner]]);
        }
    }
    // Without smoothing, and with all of the connected surface in every neighbourhood.
    for (const int neighbourhood : {1, 255}) {
        const RasterisedVisibilityParams params{.rows = 6, .neighbourhood = neighbourhood};
        const RasterisedVisibility one = built(mesh, params), many = built(split, params);
        const std::size_t directions = one.directions().directions.size();
        for (std::size_t v = 0; v < origin.size(); ++v) {
            for (std::size_t d = 0; d < directions; ++d) {
                ASSERT_EQ(many.visibility()[v * directions + d], one.visibility()[origin[v] * directions + d]);
            }
            EXPECT_EQ(many.vertexOcclusion()[v], one.vertexOcclusion()[origin[v]]);
        }
        const std::vector<glm::vec3> points{{0.1f, 0, 0}, {0.2f, 0, 0.1f}}, up(2, glm::vec3(0, 1, 0));
        EXPECT_NEAR(mean(ask(many, points, up)), mean(ask(one, points, up)), 1e-6);
    }
}

TEST(RasterisedVisibility, PointOnAVertexGetsThatVertex) {
    const TestMesh mesh = floorAndWall(1, 0.5f, 12);
    const RasterisedVisibility visibility = built(mesh, kCoarse);
    const std::vector<glm::vec3> point{mesh.vertices[7 * 13 + 4]}, up{{0, 3, 0}};
    EXPECT_NEAR(ask(visibility, point, up)[0], visibility.vertexOcclusion()[7 * 13 + 4], 1e-3f);
}

TEST(RasterisedVisibility, ThreadsDoNotChangeTheNumbers) {
    const TestMesh mesh = floorAndWall(1, 0.5f, 20);
    const int before = threadCount();
    setThreadCount(1);
    const RasterisedVisibility one = built(mesh, kCoarse);
    setThreadCount(4);
    const RasterisedVisibility four = built(mesh, kCoarse);
    setThreadCount(before);
    EXPECT_TRUE(std::ranges::equal(one.visibility(), four.visibility()));
    EXPECT_TRUE(std::ranges::equal(one.vertexOcclusion(), four.vertexOcclusion()));
}

TEST(RasterisedVisibility, HugeMeshesGetFewerPixelsNotMoreMemory) {
    const TestMesh mesh = sphere(5e5f, 2); // 240 million pixels a side at the default resolution
    const RasterisedVisibility visibility = built(mesh, {.maxSide = 128, .neighbourhood = 1});
    for (const float v : visibility.vertexOcclusion()) EXPECT_NEAR(v, 1.0f, 0.05f);
}

TEST(RasterisedVisibility, StrangeInputHasADefinedAnswer) {
    TestMesh mesh = sphere(0.5f, 2);
    mesh.vertices.insert(mesh.vertices.begin(), {0, 0.6f, 0}); // in no triangle: dark, and must not be asked
    for (glm::uvec3& t : mesh.triangles) t += 1;
    mesh.triangles.emplace_back(1, 1, 2);
    const RasterisedVisibility visibility = built(mesh, {.pixelsPerMetre = 60, .neighbourhood = 1});
    EXPECT_EQ(visibility.vertexOcclusion()[0], 1.0f); // no normal
    const std::vector<float> values = ask(visibility, {{0, 0.6f, 0}, {kNan, 0, 0}, {0, 0.5f, 0}, {1e30f, 0, 0}},
                                          {{0, 1, 0}, {0, 1, 0}, {0, 0, 0}, {1, 0, 0}});
    EXPECT_NEAR(values[0], 1.0f, 0.05f);
    EXPECT_EQ(values[1], 1.0f);
    EXPECT_EQ(values[2], 1.0f);
    EXPECT_TRUE(values[3] >= 0.0f && values[3] <= 1.0f);

    const std::vector<glm::vec3> flat(3, glm::vec3(1)); // a triangle that is one point
    const std::vector<glm::uvec3> one{{0, 1, 2}};
    ASSERT_TRUE(RasterisedVisibility::build(flat, one, kCoarse).ok());
    ASSERT_TRUE(
        RasterisedVisibility::build(std::span(flat).first(1), std::vector<glm::uvec3>{{0, 0, 0}}, kCoarse).ok());
}

TEST(RasterisedVisibility, BrokenMeshesAndRequestsAreNamed) {
    const TestMesh good = sphere(1, 1);
    EXPECT_FALSE(RasterisedVisibility::build({}, {}).ok());
    TestMesh bad = good;
    bad.triangles[3].y = 1000;
    const auto range = RasterisedVisibility::build(bad.vertices, bad.triangles);
    ASSERT_FALSE(range.ok());
    EXPECT_EQ(range.error().describe(),
              "rasterised visibility: triangle 3: vertex 1000 does not exist, the mesh has 18");
    bad = good;
    bad.vertices[5].z = kNan;
    EXPECT_FALSE(RasterisedVisibility::build(bad.vertices, bad.triangles).ok());
    for (const RasterisedVisibilityParams& params :
         {RasterisedVisibilityParams{.rows = 1}, {.pixelsPerMetre = kNan}, {.maxSide = 0}, {.neighbourhood = 256}}) {
        EXPECT_FALSE(RasterisedVisibility::build(good.vertices, good.triangles, params).ok());
    }
    const std::vector<glm::vec3> point(2);
    std::vector<float> out(1);
    EXPECT_FALSE(built(good, {.rows = 4}).atPoints({point, point, {}}, out).ok());
}

} // namespace
} // namespace ars
