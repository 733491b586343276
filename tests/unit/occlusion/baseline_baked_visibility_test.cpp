#include "engine/core/parallel.h"
#include "engine/occlusion/baked_visibility.h"
#include "engine/occlusion/cosine_directions_math.h"
#include "tests/unit/occlusion/baseline_meshes.h"

#include <gtest/gtest.h>

#include <array>
#include <limits>
#include <set>

namespace ars {
namespace {

using test::floorAndWall;
using test::mean;
using test::sheet;
using test::sphere;
using test::spreadDirections;
using test::TestMesh;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
/// A cube of 40 vertices a side with 2 cm between them: small enough for the sanitizers.
const BakedVisibilityParams kSmall{.resolution = 40, .boundM = 0.4f, .rows = 16};

BakedVisibility baked(const TestMesh& mesh, const BakedVisibilityParams& params = kSmall) {
    auto result = BakedVisibility::bake(mesh.vertices, mesh.triangles, params);
    EXPECT_TRUE(result.ok()) << result.error().describe();
    return std::move(result).value();
}

std::vector<float> ask(const BakedVisibility& visibility, const std::vector<glm::vec3>& points,
                       const std::vector<glm::vec3>& normals) {
    std::vector<float> values(points.size(), -1.0f);
    const Status status = visibility.atPoints({points, normals, {}}, values);
    EXPECT_TRUE(status.ok()) << status.error().describe();
    return values;
}

template <typename T>
void expectOrthonormalHarmonics(double tolerance) {
    // Gauss-Legendre of 8 points in z times 16 even angles: exact for products of two harmonics of degree 3.
    const double z[4] = {0.1834346424956498, 0.5255324099163290, 0.7966664774136267, 0.9602898564975363};
    const double weight[4] = {0.3626837833783620, 0.3137066458778873, 0.2223810344533745, 0.1012285362903763};
    double product[kHarmonicCount][kHarmonicCount] = {};
    for (int i = 0; i < 8; ++i) {
        for (int j = 0; j < 16; ++j) {
            const double height = (i < 4 ? 1 : -1) * z[i % 4], r = std::sqrt(1 - height * height);
            const double phi = (j + 0.25) * glm::pi<double>() / 8;
            T y[kHarmonicCount];
            sphericalHarmonics(glm::vec<3, T, glm::defaultp>(r * std::cos(phi), r * std::sin(phi), height), y);
            for (int a = 0; a < kHarmonicCount; ++a) {
                for (int b = 0; b < kHarmonicCount; ++b) {
                    product[a][b] += weight[i % 4] * glm::pi<double>() / 8 * double(y[a]) * double(y[b]);
                }
            }
        }
    }
    for (int a = 0; a < kHarmonicCount; ++a) {
        for (int b = 0; b < kHarmonicCount; ++b) EXPECT_NEAR(product[a][b], a == b, tolerance) << a << " " << b;
    }
}

TEST(SphericalHarmonics, AreOrthonormalInFloatAndDouble) {
    expectOrthonormalHarmonics<double>(1e-12);
    expectOrthonormalHarmonics<float>(2e-6);
}

template <typename T>
void expectCosineDistribution(double tolerance) {
    glm::dvec3 sum(0);
    double squares = 0;
    for (std::uint32_t i = 0; i < 256; ++i) {
        const auto d = cosineDirection<T>(i, 256);
        EXPECT_NEAR(double(glm::length(d)), 1.0, 1e-6);
        sum += glm::dvec3(d);
        squares += double(d.z) * double(d.z);
    }
    // E[cos] = 2/3 and E[cos^2] = 1/2 of a cosine-distributed direction; no side is preferred.
    EXPECT_NEAR(sum.z / 256, 2.0 / 3, tolerance);
    EXPECT_NEAR(squares / 256, 0.5, 1e-6);
    EXPECT_NEAR(sum.x / 256, 0, 0.01);
    EXPECT_NEAR(sum.y / 256, 0, 0.01);
}

TEST(CosineDirections, FollowTheCosineInFloatAndDouble) {
    expectCosineDistribution<float>(1e-3);
    expectCosineDistribution<double>(1e-3);
}

TEST(CosineDirections, EveryNormalHasARightHandedFrame) {
    std::vector<glm::vec3> normals = spreadDirections(500);
    for (const glm::vec3& axis : {glm::vec3(0, 0, 1), {0, 0, -1}, {0, 1, 0}, {1, 0, 0}, {0, -0.0f, -1}})
        normals.push_back(axis);
    for (const glm::vec3& n : normals) {
        glm::vec3 t, b;
        tangentFrame(n, t, b);
        EXPECT_NEAR(glm::length(t), 1.0f, 1e-5f);
        EXPECT_NEAR(glm::distance(glm::cross(t, b), n), 0.0f, 1e-5f);
    }
}

TEST(VisibilityHarmonics, ConstantVisibilityIsItsFirstCoefficient) {
    const DirectionGrid grid = latLongDirections(24, 48);
    const VisibilityHarmonics c = projectVisibility(grid, std::vector<std::uint8_t>(grid.directions.size(), 1));
    EXPECT_NEAR(c.values[0], 3.5449077, 1e-4); // sqrt(4 pi)
    // Mid-points of 24 rows leave a trace of the even zonal harmonic: 0.0064 of it.
    for (int i = 1; i < kHarmonicCount; ++i) EXPECT_NEAR(c.values[i], 0.0f, 0.01f) << i;
    for (const glm::vec3& n : spreadDirections(50)) EXPECT_NEAR(occlusionFromHarmonics(c, n), 1.0f, 0.005f);
    VisibilityHarmonics exact;
    exact.values[0] = std::sqrt(4 * glm::pi<float>());
    for (const glm::vec3& n : spreadDirections(50)) EXPECT_NEAR(occlusionFromHarmonics(exact, n), 1.0f, 1e-6f);
}

TEST(VisibilityHarmonics, HalfSpaceRingsByLessThanATenth) {
    const DirectionGrid grid = latLongDirections(48, 96);
    for (const glm::vec3& n : spreadDirections(30)) {
        std::vector<std::uint8_t> visible;
        for (const glm::vec3& d : grid.directions) visible.push_back(glm::dot(d, n) > 0);
        const VisibilityHarmonics c = projectVisibility(grid, visible);
        glm::vec3 t, b;
        tangentFrame(n, t, b);
        EXPECT_NEAR(occlusionFromHarmonics(c, n), 1.0f, 0.1f);
        EXPECT_NEAR(occlusionFromHarmonics(c, -n), 0.0f, 0.1f);
        EXPECT_NEAR(occlusionFromHarmonics(c, t), 0.5f, 0.1f);
    }
}

TEST(BakedVisibility, FlatSheetIsUnoccludedUpToRinging) {
    // Away from the rim and at heights that put the sheet anywhere between two layers of the grid.
    for (const float height : {0.0f, 0.0051f, -0.0103f}) {
        const BakedVisibility visibility = baked(sheet({-2, height, -2}, {0, 0, 4}, {4, 0, 0}, 4));
        std::vector<glm::vec3> points;
        for (const glm::vec3& d : spreadDirections(100)) points.emplace_back(0.3f * d.x, height, 0.3f * d.z);
        for (const float v : ask(visibility, points, std::vector(points.size(), glm::vec3(0, 1, 0)))) {
            EXPECT_NEAR(v, 1.0f, 0.1f) << height;
        }
    }
}

TEST(BakedVisibility, WallHidesItsClosedFormShareWithinTheThreshold) {
    const BakedVisibility visibility = baked(floorAndWall(2, 2, 4));
    for (const float d : {0.08f, 0.2f, 0.32f}) {
        const float value = ask(visibility, {{d, 0, 0.01f}}, {{0, 1, 0}})[0];
        // Ringing 0.1 and up to one cell (2 cm) between the point and the corners that speak for it.
        EXPECT_NEAR(value, 1 - test::wallShare(d, 0.4), 0.12) << d;
    }
}

TEST(BakedVisibility, CornersBehindTheSurfaceDoNotCount) {
    // Inside a closed ball everything is dark; its outside must not be.
    const BakedVisibility visibility = baked(sphere(0.2f, 5));
    const std::vector<glm::vec3> normals = spreadDirections(300);
    std::vector<glm::vec3> points, inward;
    for (const glm::vec3& n : normals) {
        points.push_back(0.2f * n);
        inward.push_back(-n);
    }
    const std::vector<float> outside = ask(visibility, points, normals), inside = ask(visibility, points, inward);
    EXPECT_GT(mean(outside), 0.85);
    EXPECT_LT(mean(inside), 0.15);
}

TEST(BakedVisibility, OnlyCornersOfTouchedCellsAreBaked) {
    // A sheet inside one layer of cells over the whole box: two layers of vertices.
    const float between = 0.4f * (2.0f / 39 * 20.5f - 1);
    const BakedVisibility visibility = baked(sheet({-1, between, -1}, {0, 0, 2}, {2, 0, 0}));
    EXPECT_EQ(visibility.bakedCount(), 2u * 40 * 40);
    EXPECT_GT(visibility.bakeMilliseconds(), 0.0);
}

TEST(BakedVisibility, EveryCellOfASlantedSheetIsBakedAndFewOthers) {
    const glm::vec3 corner(-1, -0.9f, -1), u(0, 0.3f, 2), v(2, 1.3f, 0.2f);
    const float cellM = 0.8f / 39;
    std::set<std::array<int, 3>> expected; // corners of the cells that points of the sheet lie in
    for (int i = 0; i <= 600; ++i) {
        for (int j = 0; j <= 600; ++j) {
            const glm::vec3 cell = glm::floor(
                (corner + u * (static_cast<float>(i) / 600) + v * (static_cast<float>(j) / 600) + 0.4f) / cellM);
            if (glm::any(glm::lessThan(cell, glm::vec3(0))) || glm::any(glm::greaterThan(cell, glm::vec3(38))))
                continue;
            for (int k = 0; k < 8; ++k) {
                expected.insert({int(cell.x) + (k & 1), int(cell.y) + (k >> 1 & 1), int(cell.z) + (k >> 2)});
            }
        }
    }
    const std::size_t found = baked(sheet(corner, u, v, 3)).bakedCount();
    EXPECT_GE(found, expected.size());
    EXPECT_LT(found, expected.size() + expected.size() / 10); // not its whole bounding box
}

TEST(BakedVisibility, EverywhereElseTheNearestBakedVertexAnswers) {
    const BakedVisibility visibility = baked(floorAndWall(2, 0.1f, 4));
    // High over the floor nothing was baked; the layer over the floor speaks, as for the floor itself.
    const glm::vec3 up(0, 1, 0);
    const std::vector<float> values =
        ask(visibility, {{0.3f, 0.0f, 0}, {0.3f, 0.3f, 0}, {0.3f, 99, 0}, {1e30f, 0, 0}}, {up, up, up, up});
    EXPECT_NEAR(values[1], values[0], 0.1f);
    EXPECT_NEAR(values[2], values[1], 0.01f);
    EXPECT_TRUE(values[3] >= 0.0f && values[3] <= 1.0f);
}

TEST(BakedVisibility, ThreadsDoNotChangeTheNumbers) {
    const TestMesh mesh = floorAndWall(2, 0.3f, 4);
    const std::vector<glm::vec3> normals = spreadDirections(500);
    const int before = threadCount();
    setThreadCount(1);
    const std::vector<float> one = ask(baked(mesh), normals, normals);
    setThreadCount(4);
    const std::vector<float> four = ask(baked(mesh), normals, normals);
    setThreadCount(before);
    EXPECT_EQ(one, four);
}

TEST(BakedVisibility, BrokenMeshesAndRequestsAreNamed) {
    TestMesh good = sphere(0.2f, 1);
    EXPECT_FALSE(BakedVisibility::bake({}, {}).ok());
    TestMesh bad = good;
    bad.triangles[3].y = 1000;
    const auto range = BakedVisibility::bake(bad.vertices, bad.triangles);
    ASSERT_FALSE(range.ok());
    EXPECT_NE(range.error().describe().find("triangle 3: vertex 1000 does not exist"), std::string::npos);
    bad = good;
    bad.vertices[5].z = kNan;
    EXPECT_FALSE(BakedVisibility::bake(bad.vertices, bad.triangles).ok());
    for (glm::vec3& v : good.vertices) v += 10.0f;
    const auto outside = BakedVisibility::bake(good.vertices, good.triangles);
    ASSERT_FALSE(outside.ok());
    EXPECT_NE(outside.error().describe().find("wholly outside the box"), std::string::npos);
    BakedVisibilityParams moved = kSmall;
    moved.centerM = glm::vec3(10);
    const BakedVisibility visibility = baked(good, moved);
    for (const BakedVisibilityParams& params : {BakedVisibilityParams{.resolution = 1},
                                                {.centerM = glm::vec3(kNan)},
                                                {.boundM = 0},
                                                {.thresholdM = kNan},
                                                {.rows = 0},
                                                {.samples = 0}}) {
        EXPECT_FALSE(BakedVisibility::bake(good.vertices, good.triangles, params).ok());
    }
    std::vector<float> out(1);
    const std::vector<glm::vec3> two(2);
    EXPECT_FALSE(visibility.atPoints({two, two, {}}, out).ok());
    const std::vector<float> values = ask(visibility, {{kNan, 0, 0}, {0, 0, 0}}, {{0, 1, 0}, {0, 0, 0}});
    EXPECT_EQ(values[0], 1.0f);
    EXPECT_EQ(values[1], 1.0f);
}

} // namespace
} // namespace ars
