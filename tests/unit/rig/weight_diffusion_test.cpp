// Expected values come from closed forms (harmonic functions, distances to a cube) and from the body's own weights.
#include "engine/core/parallel.h"
#include "engine/io/mesh.h"
#include "engine/rig/body_model.h"
#include "engine/rig/cell_grid.h"
#include "engine/rig/closest_surface.h"
#include "engine/rig/weight_diffusion.h"
#include "tests/support/test_data.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <random>

namespace ars {
namespace {

using Field = std::function<double(const glm::dvec3&)>;

/// A grid over [-1,1]^3 (lower corner off the origin by `shift` cells) where everything outside the ball of radius 0.8
/// is fixed at a field's value at the cell's centre.
CellGrid ballGrid(int cells, const Field& field, float shift = 0.0f) {
    CellGrid grid;
    grid.size = glm::ivec3(cells, cells + 3, cells + 1);
    grid.cellM = 2.0f / static_cast<float>(cells);
    grid.originM = glm::vec3(-1.0f) + shift * grid.cellM;
    grid.channels = 1;
    grid.values.assign(grid.cellCount(), 0.0f);
    grid.fixed.assign(grid.cellCount(), 0);
    for (int k = 0; k < grid.size.z; ++k) {
        for (int j = 0; j < grid.size.y; ++j) {
            for (int i = 0; i < grid.size.x; ++i) {
                const glm::vec3 center = grid.centerM(i, j, k);
                if (glm::length(center) < 0.8f) continue;
                grid.fixed[grid.cellIndex(i, j, k)] = 1;
                grid.values[grid.cellIndex(i, j, k)] = static_cast<float>(field(center));
            }
        }
    }
    return grid;
}

/// Largest error at random points inside the ball.
double ballError(const CellGrid& grid, const Field& field) {
    std::mt19937 random(7);
    std::uniform_real_distribution<float> coordinate(-0.75f, 0.75f);
    double worst = 0.0;
    for (int n = 0; n < 2000; ++n) {
        const glm::vec3 p(coordinate(random), coordinate(random), coordinate(random));
        if (glm::length(p) > 0.75f) continue;
        float value = 0.0f;
        sampleGrid(grid, p, std::span(&value, 1));
        worst = std::max(worst, std::abs(static_cast<double>(value) - field(p)));
    }
    return worst;
}

TEST(CellGrid, ValuesStandAtCellCentres) {
    CellGrid grid;
    grid.size = {3, 2, 2};
    grid.originM = {1.0f, 2.0f, 3.0f};
    grid.cellM = 0.5f;
    grid.channels = 2;
    for (std::size_t i = 0; i < grid.cellCount(); ++i) {
        grid.values.push_back(static_cast<float>(i));
        grid.values.push_back(static_cast<float>(10 * i));
    }
    std::array<float, 2> value{};
    sampleGrid(grid, {1.25f, 2.25f, 3.25f}, value);
    EXPECT_FLOAT_EQ(value[0], 0.0f);
    sampleGrid(grid, {1.75f, 2.75f, 3.75f}, value); // cell (1,1,1) = 1 + 3 + 6
    EXPECT_FLOAT_EQ(value[0], 10.0f);
    EXPECT_FLOAT_EQ(value[1], 100.0f);
    sampleGrid(grid, {1.5f, 2.25f, 3.25f}, value); // half way between cells 0 and 1
    EXPECT_FLOAT_EQ(value[0], 0.5f);
    sampleGrid(grid, {-9.0f, -9.0f, -9.0f}, value); // outside: the nearest cell
    EXPECT_FLOAT_EQ(value[0], 0.0f);
}

TEST(CellGrid, LinearFieldIsReproducedWithoutHalfACellOfShift) {
    const Field field = [](const glm::dvec3& p) { return 0.3 + 0.5 * p.x - 0.7 * p.y + 0.2 * p.z; };
    for (const int cells : {16, 33, 50}) {
        CellGrid grid = ballGrid(cells, field, 0.37f);
        const auto solve = solveHarmonic(grid);
        ASSERT_TRUE(solve.ok());
        // Half a cell of shift would be an error of 0.5 * |gradient| * cell = 0.02 at 50 cells.
        EXPECT_LT(ballError(grid, field), 2e-5) << cells << " cells, " << solve->cycles << " cycles";
        EXPECT_LT(solve->cycles, 25) << cells;
    }
}

TEST(CellGrid, HarmonicFieldConvergesWithTheSquareOfTheCell) {
    // Laplace: (b^2 + c^2 - a^2) f = 0.
    const double b = 3.0, c = 2.0, a = std::sqrt(b * b + c * c);
    const Field field = [=](const glm::dvec3& p) {
        return 0.1 * std::exp(a * p.x) * std::sin(b * p.y) * std::cos(c * p.z);
    };
    std::array<double, 3> errors{};
    for (std::size_t level = 0; level < errors.size(); ++level) {
        CellGrid grid = ballGrid(16 << level, field);
        ASSERT_TRUE(solveHarmonic(grid).ok());
        errors[level] = ballError(grid, field);
        std::printf("harmonic field: %d cells, largest error %.5f\n", 16 << level, errors[level]);
    }
    EXPECT_GT(errors[0] / errors[1], 3.3);
    EXPECT_GT(errors[1] / errors[2], 3.3);
}

TEST(CellGrid, NothingFlowsThroughTheBox) {
    CellGrid grid;
    grid.size = {40, 7, 5};
    grid.cellM = 1.0f;
    grid.channels = 3;
    grid.values.assign(grid.cellCount() * 3, 0.0f);
    grid.fixed.assign(grid.cellCount(), 0);
    for (int k = 0; k < 5; ++k) {
        for (int j = 0; j < 7; ++j) {
            grid.fixed[grid.cellIndex(0, j, k)] = grid.fixed[grid.cellIndex(39, j, k)] = 1;
            grid.values[grid.cellIndex(39, j, k) * 3 + 1] = 1.0f;
            grid.values[grid.cellIndex(39, j, k) * 3 + 2] = grid.values[grid.cellIndex(0, j, k) * 3 + 2] = 0.7f;
        }
    }
    ASSERT_TRUE(solveHarmonic(grid).ok());
    for (int i = 0; i < 40; ++i) {
        const std::size_t cell = grid.cellIndex(i, i % 7, i % 5);
        EXPECT_NEAR(grid.values[cell * 3], 0.0f, 1e-6f);
        EXPECT_NEAR(grid.values[cell * 3 + 1], static_cast<float>(i) / 39.0f, 1e-4f);
        EXPECT_NEAR(grid.values[cell * 3 + 2], 0.7f, 1e-5f);
    }
}

TEST(CellGrid, UndeterminedAndMisfittingGridsAreRefused) {
    CellGrid grid;
    grid.size = {4, 4, 4};
    grid.cellM = 1.0f;
    grid.channels = 1;
    grid.values.assign(64, 0.0f);
    grid.fixed.assign(64, 0);
    EXPECT_EQ(solveHarmonic(grid).error().code, ErrorCode::InvalidArgument);
    grid.fixed.resize(63, 1);
    EXPECT_EQ(solveHarmonic(grid).error().code, ErrorCode::InvalidArgument);
}

/// Unit cube [0,1]^3.
void unitCube(std::vector<glm::vec3>& positions, std::vector<glm::uvec3>& triangles) {
    for (int c = 0; c < 8; ++c) positions.emplace_back(c & 1, (c >> 1) & 1, c >> 2);
    const std::array<glm::uvec4, 6> sides = {glm::uvec4{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4},
                                             {2, 6, 7, 3},           {0, 4, 6, 2}, {1, 3, 7, 5}};
    for (const glm::uvec4& s : sides) {
        triangles.emplace_back(s.x, s.y, s.z);
        triangles.emplace_back(s.x, s.z, s.w);
    }
}

TEST(ClosestSurface, DistanceToACubeIsTheClosedForm) {
    std::vector<glm::vec3> positions;
    std::vector<glm::uvec3> triangles;
    unitCube(positions, triangles);
    triangles.emplace_back(3, 3, 3); // a triangle without area must not disturb
    const auto surface = ClosestSurface::build(positions, triangles);
    ASSERT_TRUE(surface.ok());
    std::mt19937 random(3);
    std::uniform_real_distribution<float> coordinate(-1.0f, 2.0f);
    for (int n = 0; n < 500; ++n) {
        const glm::vec3 p(coordinate(random), coordinate(random), coordinate(random));
        const glm::vec3 outside = p - glm::clamp(p, 0.0f, 1.0f);
        float expected = glm::length(outside);
        if (expected == 0.0f) expected = std::min({p.x, p.y, p.z, 1.0f - p.x, 1.0f - p.y, 1.0f - p.z});
        SurfacePoint at;
        ASSERT_TRUE(surface->find(p, 10.0f, at));
        EXPECT_NEAR(at.distanceM, expected, 1e-5f);
        glm::vec3 q(0.0f);
        for (int c = 0; c < 3; ++c) q += at.barycentric[c] * positions[triangles[at.triangle][c]];
        EXPECT_NEAR(glm::distance(p, q), expected, 1e-5f);
        EXPECT_NEAR(at.barycentric.x + at.barycentric.y + at.barycentric.z, 1.0f, 1e-6f);
        EXPECT_EQ(surface->find(p, 0.99f * expected - 1e-5f, at), false);
    }
}

TEST(ClosestSurface, BadMeshesAreRefused) {
    const std::vector<glm::vec3> positions(3);
    EXPECT_EQ(ClosestSurface::build(positions, {}).error().code, ErrorCode::InvalidArgument);
    const std::vector<glm::uvec3> outOfRange = {{0, 1, 3}};
    EXPECT_EQ(ClosestSurface::build(positions, outOfRange).error().code, ErrorCode::InvalidArgument);
}

struct WeightedMesh {
    std::vector<glm::vec3> positions;
    std::vector<glm::uvec3> triangles;
    SkinWeights weights;
};

constexpr float kRadius = 0.7f;
const glm::vec3 kSphereCenter(0.113f, -0.271f, 0.057f);

/// A sphere whose two joints have the weights (1 +- z/R)/2: inside, that linear function is the harmonic one.
WeightedMesh linearSphere() {
    constexpr int kRings = 96, kSegments = 192;
    WeightedMesh mesh;
    for (int r = 0; r <= kRings; ++r) {
        const double theta = M_PI * r / kRings;
        for (int s = 0; s < kSegments; ++s) {
            const double phi = 2.0 * M_PI * s / kSegments;
            const glm::dvec3 n(std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi), std::cos(theta));
            mesh.positions.push_back(kSphereCenter + kRadius * glm::vec3(n));
            std::array<float, kMaxInfluences> w{static_cast<float>(0.5 + 0.5 * n.z),
                                                static_cast<float>(0.5 - 0.5 * n.z)};
            const std::array<std::uint16_t, kMaxInfluences> j{4, 2};
            mesh.weights.weights.insert(mesh.weights.weights.end(), w.begin(), w.end());
            mesh.weights.joints.insert(mesh.weights.joints.end(), j.begin(), j.end());
        }
    }
    for (unsigned r = 0; r < kRings; ++r) {
        for (unsigned s = 0; s < kSegments; ++s) {
            const unsigned a = r * kSegments + s, b = r * kSegments + (s + 1) % kSegments;
            mesh.triangles.emplace_back(a, a + kSegments, b);
            mesh.triangles.emplace_back(b, a + kSegments, b + kSegments);
        }
    }
    return mesh;
}

float weightOf(const SkinWeights& weights, std::size_t point, int joint) {
    for (std::size_t i = point * kMaxInfluences; i < (point + 1) * kMaxInfluences; ++i) {
        if (weights.joints[i] == joint && weights.weights[i] > 0.0f) return weights.weights[i];
    }
    return 0.0f;
}

TEST(WeightDiffusion, FieldInsideASphereIsTheHarmonicOne) {
    const WeightedMesh sphere = linearSphere();
    std::vector<glm::vec3> points;
    for (int n = -6; n <= 6; ++n)
        points.push_back(kSphereCenter + glm::vec3(0.05f, 0.02f, 0.1f * static_cast<float>(n)));
    std::array<double, 2> errors{};
    for (std::size_t level = 0; level < 2; ++level) {
        DiffusionOptions options;
        options.resolution = 48 << level;
        options.fixedBandM = 0.0f; // one cell
        options.surfaceBlendM = 0.0f;
        DiffusionReport report;
        const auto weights =
            diffuseWeights(sphere.positions, sphere.triangles, sphere.weights, 5, points, options, {}, &report);
        ASSERT_TRUE(weights.ok()) << weights.error().describe();
        EXPECT_EQ(report.channels, 2);
        for (std::size_t p = 0; p < points.size(); ++p) {
            const double expected = 0.5 + 0.5 * (points[p].z - kSphereCenter.z) / kRadius;
            errors[level] = std::max(errors[level], std::abs(weightOf(*weights, p, 4) - expected));
            // Antisymmetric about the centre: half a cell of shift would show as 0.5 * cell / R = 0.01 here.
            EXPECT_NEAR(weightOf(*weights, p, 4), weightOf(*weights, points.size() - 1 - p, 2), 1.5e-3);
        }
        std::printf("sphere: resolution %d, largest error %.4f\n", options.resolution, errors[level]);
    }
    // The band that is held constant along the normal is one cell deep: first order.
    EXPECT_LT(errors[0], 0.04);
    EXPECT_LT(errors[1], 0.65 * errors[0]);
}

TEST(WeightDiffusion, BetweenTwoLimbsTheWeightsGoOverSmoothly) {
    // Two plates, 6 cm apart, each with a joint of its own: closer to each other than twice the fixed band.
    WeightedMesh plates;
    for (int side = 0; side < 2; ++side) {
        const auto first = static_cast<unsigned>(plates.positions.size());
        const float x = side == 0 ? -0.03f : 0.03f;
        for (int c = 0; c < 4; ++c) {
            plates.positions.emplace_back(x, (c & 1) ? 0.2f : -0.2f, (c >> 1) ? 0.2f : -0.2f);
            for (int i = 0; i < kMaxInfluences; ++i) {
                plates.weights.joints.push_back(i == 0 ? static_cast<std::uint16_t>(side) : std::uint16_t{0});
                plates.weights.weights.push_back(i == 0 ? 1.0f : 0.0f);
            }
        }
        plates.triangles.emplace_back(first, first + 1, first + 2);
        plates.triangles.emplace_back(first + 1, first + 3, first + 2);
    }
    std::vector<glm::vec3> points;
    for (int n = -12; n <= 12; ++n) points.emplace_back(0.0025f * static_cast<float>(n), 0.011f, -0.017f);
    points.emplace_back(-0.05f, 0.0f, 0.0f); // 2 cm off the far side of the first
    for (const int resolution : {64, 128}) {
        DiffusionOptions options;
        options.resolution = resolution;
        const auto weights = diffuseWeights(plates.positions, plates.triangles, plates.weights, 2, points, options);
        ASSERT_TRUE(weights.ok()) << weights.error().describe();
        EXPECT_NEAR(weightOf(*weights, 0, 0), 1.0f, 1e-5f);
        EXPECT_NEAR(weightOf(*weights, 12, 0), 0.5f, 0.05f); // the cells lie anyhow to the middle
        EXPECT_GT(weightOf(*weights, 25, 0), 0.999f);
        for (std::size_t p = 1; p < 25; ++p) {
            const float step = weightOf(*weights, p - 1, 0) - weightOf(*weights, p, 0);
            EXPECT_GT(step, -1e-4f) << p;
            // A transition over 3 cm or more; the closest plate alone would jump by 1 within a cell.
            EXPECT_LT(step, 0.0025f / 0.03f + 0.02f) << p << " of resolution " << resolution;
        }
    }
}

TEST(WeightDiffusion, ThreadsDoNotChangeABit) {
    const WeightedMesh sphere = linearSphere();
    std::vector<glm::vec3> points;
    for (int n = 0; n < 50; ++n)
        points.push_back(kSphereCenter + 0.02f * static_cast<float>(n) * glm::vec3(0.4f, 0.3f, 0.8f));
    DiffusionOptions options;
    options.resolution = 48;
    const int threads = threadCount();
    setThreadCount(1);
    const auto one = diffuseWeights(sphere.positions, sphere.triangles, sphere.weights, 5, points, options);
    setThreadCount(2);
    const auto two = diffuseWeights(sphere.positions, sphere.triangles, sphere.weights, 5, points, options);
    setThreadCount(threads);
    ASSERT_TRUE(one.ok() && two.ok());
    EXPECT_EQ(one->weights, two->weights);
    EXPECT_EQ(one->joints, two->joints);
}

TEST(WeightDiffusion, BadArgumentsAndRequestsToStopAreErrors) {
    const WeightedMesh sphere = linearSphere();
    const std::vector<glm::vec3> points = {glm::vec3(0.0f)};
    const auto run = [&](const DiffusionOptions& options, std::span<const glm::vec3> at, int joints = 5,
                         const ProgressFunction& progress = {}, const ReadLimits& limits = {}) {
        const auto result = diffuseWeights(sphere.positions, sphere.triangles, sphere.weights, joints, at, options,
                                           progress, nullptr, limits);
        return result.ok() ? std::string("ok") : std::string(errorCodeName(result.error().code));
    };
    EXPECT_EQ(run({.resolution = 8}, points), "invalid_argument");
    EXPECT_EQ(run({.resolution = 4096}, points), "invalid_argument");
    EXPECT_EQ(run({.boxScale = std::nanf("")}, points), "invalid_argument");
    EXPECT_EQ(run({}, {}), "invalid_argument");
    EXPECT_EQ(run({}, points, 4), "invalid_argument"); // joint 4 does not exist
    const std::vector<glm::vec3> notFinite = {glm::vec3(INFINITY)};
    EXPECT_EQ(run({}, notFinite), "invalid_argument");
    EXPECT_EQ(run({.resolution = 512}, points, 5, {}, ReadLimits{.maxBytes = 64 << 20}), "limit_exceeded");
    int calls = 0;
    EXPECT_EQ(run({.resolution = 32}, points, 5, [&](double, std::string_view) { return ++calls < 2; }), "cancelled");
    EXPECT_EQ(calls, 2);
}

struct Difference {
    double mean = 0.0; ///< of sum over joints |a - b| / 2
    double max = 0.0;
    double within005 = 0.0; ///< share of points whose every weight agrees to 0.05
};

Difference compareWeights(const SkinWeights& a, const SkinWeights& b, int joints) {
    Difference result;
    const std::vector<float> da = denseWeights(a, static_cast<std::size_t>(joints));
    const std::vector<float> db = denseWeights(b, static_cast<std::size_t>(joints));
    const std::size_t points = a.pointCount();
    for (std::size_t p = 0; p < points; ++p) {
        double sum = 0.0, worst = 0.0;
        for (std::size_t j = p * static_cast<std::size_t>(joints); j < (p + 1) * static_cast<std::size_t>(joints);
             ++j) {
            const double d = std::abs(static_cast<double>(da[j]) - static_cast<double>(db[j]));
            sum += d;
            worst = std::max(worst, d);
        }
        result.mean += 0.5 * sum / static_cast<double>(points);
        result.max = std::max(result.max, worst);
        result.within005 += worst < 0.05 ? 1.0 / static_cast<double>(points) : 0.0;
    }
    return result;
}

TEST(WeightDiffusion, BodySurfaceGivesTheBodysWeights) {
    ARS_TEST_DATA_FILE(path, "open_body.npz");
    const auto body = readBodyModel(path);
    ASSERT_TRUE(body.ok()) << body.error().describe();
    for (const float blend : {0.008f, 0.0f}) {
        DiffusionOptions options;
        options.surfaceBlendM = blend;
        if (blend > 0.0f) options.resolution = 48; // on the surface itself the grid does not count
        DiffusionReport report;
        const auto weights = diffuseWeights(body->templateVertices, body->triangles, body->weights, kSmplxJointCount,
                                            body->templateVertices, options, {}, &report);
        ASSERT_TRUE(weights.ok()) << weights.error().describe();
        const Difference d = compareWeights(*weights, body->weights, kSmplxJointCount);
        std::printf("body surface, blend %.0f mm: %dx%dx%d cells of %.1f mm, %d joints, %d cycles, residual %.1e; "
                    "mean %.5f, largest %.4f, %.2f%% within 0.05\n",
                    1e3 * blend, report.gridSize.x, report.gridSize.y, report.gridSize.z, 1e3 * report.cellM,
                    report.channels, report.cycles, report.residual, d.mean, d.max, 100.0 * d.within005);
        EXPECT_LT(report.maxBodyDistanceM, 1e-5f);
        if (blend > 0.0f) {
            EXPECT_LT(d.max, 1e-3);
        } else {
            EXPECT_LT(d.mean, 0.06); // the grid alone: fingers are thinner than a cell
            EXPECT_GT(d.within005, 0.7);
        }
    }
}

TEST(WeightDiffusion, ClothTwoCentimetresOffTheBodyIsCloseToItAndSmooth) {
    ARS_TEST_DATA_FILE(path, "open_body.npz");
    const auto body = readBodyModel(path);
    ASSERT_TRUE(body.ok()) << body.error().describe();
    const std::vector<glm::vec3> normals = vertexNormals(body->templateVertices, body->triangles);
    std::vector<glm::vec3> points = body->templateVertices;
    for (std::size_t v = 0; v < points.size(); ++v) points[v] += 0.02f * normals[v];
    const auto weights =
        diffuseWeights(body->templateVertices, body->triangles, body->weights, kSmplxJointCount, points);
    ASSERT_TRUE(weights.ok()) << weights.error().describe();
    // Hands, face and feet are folded more tightly than 2 cm; cloth hangs on the rest.
    std::vector<bool> limb(points.size(), false);
    for (std::size_t v = 0; v < points.size(); ++v) {
        const int main = body->weights.joints[v * kMaxInfluences];
        limb[v] = main <= 19 && main != 10 && main != 11 && main != 15;
    }
    const std::vector<float> dense = denseWeights(*weights, kSmplxJointCount);
    const std::vector<float> own = denseWeights(body->weights, kSmplxJointCount);
    double mean = 0.0;
    std::size_t count = 0;
    const auto distance = [](const std::vector<float>& a, std::size_t i, const std::vector<float>& b, std::size_t j) {
        double sum = 0.0;
        for (std::size_t c = 0; c < kSmplxJointCount; ++c) {
            sum += 0.5 * std::abs(static_cast<double>(a[i * kSmplxJointCount + c]) - b[j * kSmplxJointCount + c]);
        }
        return sum;
    };
    for (std::size_t v = 0; v < points.size(); ++v) {
        if (!limb[v]) continue;
        mean += distance(dense, v, own, v);
        ++count;
    }
    mean /= static_cast<double>(count);
    double steepest = 0.0, steepestOwn = 0.0;
    for (const glm::uvec3& t : body->triangles) {
        for (int c = 0; c < 3; ++c) {
            const std::size_t a = t[c], b = t[(c + 1) % 3];
            if (!limb[a] || !limb[b]) continue;
            // Steps over less than 5 mm are measured as if over 5 mm: offset vertices crowd together in hollows.
            const double length = std::max(0.005f, glm::distance(points[a], points[b]));
            steepest = std::max(steepest, distance(dense, a, dense, b) / length);
            const double ownLength =
                std::max(0.005f, glm::distance(body->templateVertices[a], body->templateVertices[b]));
            steepestOwn = std::max(steepestOwn, distance(own, a, own, b) / ownLength);
        }
    }
    std::printf("cloth at 2 cm: mean difference to the skin below %.4f, steepest change %.1f per metre (skin %.1f)\n",
                mean, steepest, steepestOwn);
    EXPECT_LT(mean, 0.05);
    EXPECT_LT(steepest, 2.0 * steepestOwn);
}

} // namespace
} // namespace ars
