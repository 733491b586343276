#include "tests/unit/occlusion/ambient_occlusion_oracle.h"
#include "tests/unit/occlusion/ambient_occlusion_scenes.h"

#include "engine/occlusion/ambient_occlusion.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

// The oracles A1 to A8 of closed-form scenes, each by the operator in float on every device and by a plain evaluation
// in double that shares no code with it.

namespace ars {
namespace {

using test::devicesUnderTest;
using test::occlusionOf;
using test::OcclusionScene;
using test::oracleOcclusion;

/// Preset body without what closed forms do not have: no bias, everything is solid, one grid for all.
OcclusionParams solid() {
    OcclusionParams params = bodyOcclusion();
    params.adaptive = OcclusionAdaptive::Off;
    params.biasPerRadius = 0.0f;
    params.thicknessM = std::numeric_limits<float>::infinity();
    return params;
}

OcclusionScene wallFacingTheCamera(double radius, double z) {
    OcclusionScene scene(65, 65, 400.0);
    scene.fill(radius, [z](const glm::dvec3&, double& depth, glm::dvec3& normal) {
        depth = z;
        normal = {0.0, 0.0, -1.0};
        return true;
    });
    return scene;
}

/// Floor z = 2 m with a wall x = 0.3 m that comes towards the camera by `height`. Only row kRow has a radius.
constexpr int kRow = 250;
OcclusionScene floorAndWall(double radius, double height) {
    OcclusionScene scene(901, 501, 1000.0);
    scene.fill(radius, [height](const glm::dvec3& ray, double& depth, glm::dvec3& normal) {
        const double floor = 2.0, wall = 0.3;
        depth = floor;
        normal = {0.0, 0.0, -1.0};
        if (ray.x * floor <= wall) return true;
        depth = std::max(wall / ray.x, floor - height);
        if (depth > floor - height) normal = {-1.0, 0.0, 0.0};
        return true;
    });
    for (std::size_t p = 0; p < scene.pixels(); ++p) {
        if (p / 901 != kRow) scene.radius[p] = 0.0f;
    }
    return scene;
}

/// Column of the floor's pixel at distance d from the wall.
int columnAtDistance(const OcclusionScene& scene, double d) {
    return static_cast<int>(std::floor(scene.camera.cx + scene.camera.fx * (0.3 - d) / 2.0));
}
double distanceOfColumn(const OcclusionScene& scene, int column) {
    return 0.3 - 2.0 * (column + 0.5 - scene.camera.cx) / scene.camera.fx;
}

TEST(AmbientOcclusion, FlatPlaneUnderTheReferenceConstantsIsDarkAsDerived) {
    // A1: V = 1 - (bias step / (R f_z start))^2; a 32 x 16 grid was measured at .962 for .964 and .854 for .855.
    for (const double radius : {0.1, 0.05}) {
        const double z = 2.0;
        const OcclusionScene scene = wallFacingTheCamera(radius, z);
        const double grow = (1.0 + z / 100.0) * (1.0 + z / 100.0);
        const double expected = 1.0 - std::pow(0.01 * 16.0 / (radius * grow * 8.0), 2.0);
        OcclusionParams params = referenceOcclusion();
        params.adaptive = OcclusionAdaptive::Off;
        EXPECT_NEAR(oracleOcclusion(params, scene, 32, 32), expected, 0.005) << radius;
        for (const Device& device : devicesUnderTest()) {
            EXPECT_NEAR(occlusionOf(params, scene, device)[scene.at(32, 32)], expected, 0.005) << radius;
        }
    }
}

TEST(AmbientOcclusion, FlatPlaneIsUnoccluded) {
    for (const double radius : {0.02, 0.1, 0.25}) {
        const OcclusionScene scene = wallFacingTheCamera(radius, 2.0);
        OcclusionParams reference = referenceOcclusion();
        reference.biasM = 0.0f;
        reference.median = false; // which makes the picture's corners empty
        OcclusionParams negative = reference;
        negative.biasM = -0.002f;
        for (const OcclusionParams& params : {bodyOcclusion(), solid(), reference, negative}) {
            for (const Device& device : devicesUnderTest()) {
                const std::vector<float> o = occlusionOf(params, scene, device);
                EXPECT_EQ(*std::min_element(o.begin(), o.end()), 1.0f) << radius;
            }
            EXPECT_EQ(oracleOcclusion(params, scene, 20, 40), 1.0) << radius;
        }
    }
}

TEST(AmbientOcclusion, TiltedPlanesAreAllButUnoccluded) {
    // Depth is constant within a pixel, so a tilted plane is a staircase: R/100 of bias has to cover half a step.
    for (const double degrees : {30.0, 45.0, 60.0}) {
        OcclusionScene scene(96, 96, 500.0);
        const double t = degrees * std::numbers::pi / 180.0;
        const glm::dvec3 n(std::sin(t), 0.0, -std::cos(t));
        scene.fill(0.25, [&n](const glm::dvec3& ray, double& depth, glm::dvec3& normal) {
            depth = n.z * 2.0 / glm::dot(n, ray);
            normal = n;
            return depth > 0.0;
        });
        for (const Device& device : devicesUnderTest()) {
            const std::vector<float> o = occlusionOf(bodyOcclusion(), scene, device);
            double sum = 0.0;
            for (const float v : o) sum += v;
            std::printf("plane tilted by %.0f degrees: mean O %.5f\n", degrees, sum / static_cast<double>(o.size()));
            EXPECT_GT(sum / static_cast<double>(o.size()), 0.99) << degrees;
        }
    }
}

TEST(AmbientOcclusion, WallOccludesItsShareOfTheHemisphere) {
    // A2: F = (acos c - c sqrt(1 - c^2)) / pi, c = d / R.
    const double radius = 0.25;
    const OcclusionScene scene = floorAndWall(radius, 10.0);
    for (const double c : {0.2, 0.5, 0.8}) {
        const int column = columnAtDistance(scene, c * radius);
        const double exact = distanceOfColumn(scene, column) / radius;
        const double expected = 1.0 - (std::acos(exact) - exact * std::sqrt(1.0 - exact * exact)) / std::numbers::pi;
        EXPECT_NEAR(oracleOcclusion(solid(), scene, kRow, column), expected, 0.005) << c;
        for (const Device& device : devicesUnderTest()) {
            EXPECT_NEAR(occlusionOf(solid(), scene, device)[scene.at(kRow, column)], expected, 0.005) << c;
        }
    }
}

/// Cosine-weighted share of the hemisphere whose rays meet, within `length`, a wall of a height at a distance.
double shareOfStep(double distance, double height, double length) {
    double hit = 0.0, total = 0.0;
    constexpr int kCount = 1000;
    for (int k = 0; k < kCount; ++k) {
        const double theta = (k + 0.5) * 0.5 * std::numbers::pi / kCount;
        for (int i = 0; i < kCount; ++i) {
            const double phi = (i + 0.5) * 2.0 * std::numbers::pi / kCount;
            const double towards = std::sin(theta) * std::cos(phi);
            const double weight = std::sin(theta) * std::cos(theta);
            total += weight;
            if (towards <= 0.0 || distance / towards > length) continue;
            if (distance / towards * std::cos(theta) <= height) hit += weight;
        }
    }
    return hit / total;
}

TEST(AmbientOcclusion, StepOccludesByItsHeight) {
    // A2b: F = (1 - d / sqrt(d^2 + h^2)) / 2 for unlimited rays. Ours are 0.45 m long: the same integral cut at that
    // length.
    const double height = 0.2;
    EXPECT_NEAR(shareOfStep(0.1, height, 1e9), 0.5 * (1.0 - 0.1 / std::hypot(0.1, height)), 1e-3);
    OcclusionParams params = solid();
    params.steps = params.lastStep = 64;
    const OcclusionScene scene = floorAndWall(0.45, height);
    const int column = columnAtDistance(scene, 0.1);
    const double expected = 1.0 - shareOfStep(distanceOfColumn(scene, column), height, 0.45);
    EXPECT_NEAR(oracleOcclusion(params, scene, kRow, column), expected, 0.006);
    for (const Device& device : devicesUnderTest()) {
        EXPECT_NEAR(occlusionOf(params, scene, device)[scene.at(kRow, column)], expected, 0.006);
    }
}

/// A bowl of radius 0.2 m around (0, 0, 3), open towards the camera, sunk into the plane z = 3 m.
OcclusionScene bowl(double radius) {
    OcclusionScene scene(701, 701, 1500.0);
    scene.fill(radius, [](const glm::dvec3& ray, double& depth, glm::dvec3& normal) {
        const glm::dvec3 centre(0.0, 0.0, 3.0);
        const double a = glm::dot(ray, ray), b = glm::dot(ray, centre), c = glm::dot(centre, centre) - 0.04;
        const double root = b * b - a * c;
        depth = root > 0.0 ? (b + std::sqrt(root)) / a : 0.0;
        normal = (centre - depth * ray) / 0.2;
        if (depth < 3.0) depth = 3.0, normal = {0.0, 0.0, -1.0};
        return true;
    });
    for (std::size_t p = 0; p < scene.pixels(); ++p) {
        if (p / 701 != 350) scene.radius[p] = 0.0f;
    }
    return scene;
}

TEST(AmbientOcclusion, ConcaveHemisphereShowsTheOpening) {
    // A3, at the pole: V = 1 - min(1/2, (t / 2 rho)^2); anywhere inside with unlimited rays: 1/2.
    OcclusionParams params = solid();
    params.delta = 1.0f / 32.0f; // half a polar step of the coarser grid alone is 0.024 at the rim
    params.steps = params.lastStep = 64;
    for (const double ratio : {3.0, 1.0, 0.5}) {
        const OcclusionScene scene = bowl(0.2 * ratio);
        const double expected = 1.0 - std::min(0.5, 0.25 * ratio * ratio);
        EXPECT_NEAR(oracleOcclusion(params, scene, 350, 350), expected, 0.02) << ratio;
        for (const Device& device : devicesUnderTest()) {
            const std::vector<float> o = occlusionOf(params, scene, device);
            EXPECT_NEAR(o[scene.at(350, 350)], expected, 0.02) << ratio;
            if (ratio < 3.0) continue;
            for (const int column : {290, 320, 380, 410}) EXPECT_NEAR(o[scene.at(350, column)], 0.5, 0.02) << column;
        }
    }
}

/// Cosine-weighted share of the hemisphere over a face whose rays meet, within `length`, the other face of a groove of
/// an opening angle; the edge is at a distance.
double shareOfGroove(double opening, double distance, double length) {
    double hit = 0.0, total = 0.0;
    constexpr int kCount = 1000;
    for (int k = 0; k < kCount; ++k) {
        const double theta = (k + 0.5) * 0.5 * std::numbers::pi / kCount;
        for (int i = 0; i < kCount; ++i) {
            const double phi = (i + 0.5) * 2.0 * std::numbers::pi / kCount;
            const double weight = std::sin(theta) * std::cos(theta);
            total += weight;
            const double rate = std::sin(theta) * std::cos(phi) + std::cos(theta) / std::tan(opening);
            if (rate > 0.0 && distance / rate <= length) hit += weight;
        }
    }
    return hit / total;
}

TEST(AmbientOcclusion, GrooveShowsItsOpeningAngle) {
    // A4: V = (1 - cos psi) / 2 at any distance from the edge for unlimited rays; ours are 0.6 m long.
    constexpr float kLength = 0.6f;
    for (const double degrees : {90.0, 60.0}) {
        const double opening = degrees * std::numbers::pi / 180.0, half = 0.5 * opening;
        EXPECT_NEAR(1.0 - shareOfGroove(opening, 0.05, 1e9), 0.5 * (1.0 - std::cos(opening)), 2e-3);
        OcclusionScene scene(801, 801, 700.0);
        scene.fill(0.0, [half](const glm::dvec3& ray, double& depth, glm::dvec3& normal) {
            // |x| = (2 - z) tan(half)
            const double slope = std::fabs(ray.x) / std::tan(half);
            depth = 2.0 / (1.0 + slope);
            normal = {ray.x > 0.0 ? -std::cos(half) : std::cos(half), 0.0, -std::sin(half)};
            return true;
        });
        OcclusionParams params = solid();
        params.delta = 1.0f / 32.0f;
        params.steps = params.lastStep = 64;
        const std::array columns{392, 420, 440};
        for (const int column : columns) scene.radius[scene.at(400, column)] = kLength;
        for (const int column : columns) {
            const double edge = (2.0 - scene.depth[scene.at(400, column)]) / std::cos(half);
            const double expected = 1.0 - shareOfGroove(opening, edge, kLength);
            EXPECT_NEAR(oracleOcclusion(params, scene, 400, column), expected, 0.01) << degrees << " at " << column;
            for (const Device& device : devicesUnderTest()) {
                const std::vector<float> o = occlusionOf(params, scene, device);
                EXPECT_NEAR(o[scene.at(400, column)], expected, 0.01) << degrees << " at " << column;
            }
        }
    }
}

TEST(AmbientOcclusion, WhatHangsInFrontCountsAsDeepAsTheThickness) {
    // A5, a limit of one depth layer: a plate 0.4 m before the floor is out of reach of rays of 0.3 m, so the truth
    // is 1. With a thickness below the gap that is found; with more, the plate counts as a block.
    OcclusionScene scene(301, 61, 500.0);
    scene.fill(0.3, [](const glm::dvec3& ray, double& depth, glm::dvec3& normal) {
        depth = ray.x * 1.6 > 0.05 ? 1.6 : 2.0;
        normal = {0.0, 0.0, -1.0};
        return true;
    });
    OcclusionParams thin = solid(), thick = solid();
    thin.thicknessM = 0.09f;
    thick.thicknessM = 0.25f;
    const std::size_t pixel = scene.at(30, 160);
    ASSERT_EQ(scene.depth[pixel], 2.0f);
    for (const Device& device : devicesUnderTest()) {
        EXPECT_EQ(occlusionOf(thin, scene, device)[pixel], 1.0f);
        EXPECT_LT(occlusionOf(thick, scene, device)[pixel], 0.95f);
    }
}

TEST(AmbientOcclusion, ConvexSphereIsUnoccluded) {
    // A6. Half a pixel of the staircase at the rim is all that is left.
    OcclusionScene scene(161, 161, 600.0);
    scene.fill(0.15, [](const glm::dvec3& ray, double& depth, glm::dvec3& normal) {
        const glm::dvec3 centre(0.0, 0.0, 2.5);
        const double a = glm::dot(ray, ray), b = glm::dot(ray, centre), c = glm::dot(centre, centre) - 0.09;
        const double root = b * b - a * c;
        if (root < 0.0) return false;
        depth = (b - std::sqrt(root)) / a;
        normal = (depth * ray - centre) / 0.3;
        return true;
    });
    for (const Device& device : devicesUnderTest()) {
        const std::vector<float> o = occlusionOf(bodyOcclusion(), scene, device);
        double sum = 0.0, count = 0.0;
        float least = 1.0f;
        for (std::size_t p = 0; p < o.size(); ++p) {
            if (scene.depth[p] == 0.0f) continue;
            sum += o[p], count += 1.0;
            if (scene.normal[3 * p + 2] < -0.5f) least = std::min(least, o[p]);
        }
        EXPECT_GT(sum / count, 0.995);
        EXPECT_GT(least, 0.99f);
    }
}

TEST(AmbientOcclusion, TurningTheBoneDirectionChangesLittle) {
    // A7: below 0.02 at delta 1/16.
    OcclusionScene scene = floorAndWall(0.25, 10.0);
    std::vector<float> least, most;
    for (const Device& device : devicesUnderTest()) {
        for (int turn = 0; turn < 8; ++turn) {
            const double angle = 0.11 * turn;
            scene.bone.clear();
            for (std::size_t p = 0; p < scene.pixels(); ++p) {
                scene.bone.insert(scene.bone.end(),
                                  {static_cast<float>(std::sin(angle)), static_cast<float>(-std::cos(angle)), 0.3f});
            }
            const std::vector<float> o = occlusionOf(solid(), scene, device);
            if (turn == 0) least = most = o;
            for (std::size_t p = 0; p < o.size(); ++p) {
                least[p] = std::min(least[p], o[p]);
                most[p] = std::max(most[p], o[p]);
            }
        }
        for (int column = 400; column < columnAtDistance(scene, 0.0); ++column) {
            // At the foot of the wall half the horizon is hidden, and a whole azimuth of it comes or goes.
            const float allowed = distanceOfColumn(scene, column) > 0.025 ? 0.02f : 0.035f;
            EXPECT_LT(most[scene.at(kRow, column)] - least[scene.at(kRow, column)], allowed) << column;
        }
    }
}

TEST(AmbientOcclusion, LargerRadiiSeeMoreOccluders) {
    // A8 with nested samples: twice the radius in twice the steps.
    OcclusionScene scene = test::capsuleBody(128);
    OcclusionParams params = solid();
    for (const Device& device : devicesUnderTest()) {
        std::vector<float> before(scene.pixels(), 1.0f);
        for (int doubling = 0; doubling < 4; ++doubling) {
            params.steps = params.lastStep = 8 << doubling;
            std::fill(scene.radius.begin(), scene.radius.end(), 0.05f * static_cast<float>(1 << doubling));
            const std::vector<float> o = occlusionOf(params, scene, device);
            for (std::size_t p = 0; p < o.size(); ++p) {
                ASSERT_GE(o[p], 0.0f);
                ASSERT_LE(o[p], before[p] + 1e-6f) << "pixel " << p;
            }
            before = o;
        }
    }
}

TEST(AmbientOcclusion, AnyPrincipalPointAndPixelAspectSeeTheSameWall) {
    const double radius = 0.25;
    OcclusionScene other(700, 261, 1000.0);
    other.camera.fy = 700.0;
    other.camera.cx = 120.25;
    other.camera.cy = -20.75;
    other.fill(radius, [](const glm::dvec3& ray, double& depth, glm::dvec3& normal) {
        depth = ray.x * 2.0 > 0.3 ? 0.3 / ray.x : 2.0;
        normal = ray.x * 2.0 > 0.3 ? glm::dvec3(-1.0, 0.0, 0.0) : glm::dvec3(0.0, 0.0, -1.0);
        return true;
    });
    for (std::size_t p = 0; p < other.pixels(); ++p) {
        if (p / 700 != 130) other.radius[p] = 0.0f;
    }
    for (const double c : {0.2, 0.5, 0.8}) {
        const int column = columnAtDistance(other, c * radius);
        const double exact = distanceOfColumn(other, column) / radius;
        const double expected = 1.0 - (std::acos(exact) - exact * std::sqrt(1.0 - exact * exact)) / std::numbers::pi;
        EXPECT_NEAR(oracleOcclusion(solid(), other, 130, column), expected, 0.005) << c;
        for (const Device& device : devicesUnderTest()) {
            EXPECT_NEAR(occlusionOf(solid(), other, device)[other.at(130, column)], expected, 0.005) << c;
        }
    }
}

TEST(AmbientOcclusion, BodyAgreesWithThePlainEvaluationInDouble) {
    OcclusionScene scene = test::capsuleBody(96);
    for (OcclusionParams params : {bodyOcclusion(), referenceOcclusion()}) {
        params.delta = 0.125f;
        for (const Device& device : devicesUnderTest()) {
            const std::vector<float> o = occlusionOf(params, scene, device);
            double sum = 0.0, worst = 0.0, count = 0.0;
            for (int r = 0; r < 96; ++r) {
                for (int c = 0; c < 96; ++c) {
                    if (scene.depth[scene.at(r, c)] == 0.0f) {
                        EXPECT_EQ(o[scene.at(r, c)], 1.0f);
                        continue;
                    }
                    const double difference = std::fabs(o[scene.at(r, c)] - oracleOcclusion(params, scene, r, c));
                    sum += difference, count += 1.0;
                    worst = std::max(worst, difference);
                }
            }
            std::printf("float against double: mean %.2g, worst %.2g over %.0f pixels\n", sum / count, worst, count);
            EXPECT_LT(sum / count, 2e-4); // a ray in some thousand falls to the other side of a pixel border
            EXPECT_LT(worst, 0.03);
        }
    }
}

TEST(AmbientOcclusion, ImportanceAddsDirections) {
    const auto grid = [](OcclusionAdaptive adaptive, float importance) {
        OcclusionParams params;
        params.adaptive = adaptive;
        const OcclusionDirections d = occlusionDirections(params, importance);
        return std::array{d.azimuths, d.polarAngles};
    };
    using enum OcclusionAdaptive;
    EXPECT_EQ(grid(Both, 0.0f), (std::array{32, 16}));
    EXPECT_EQ(grid(Both, 1.0f / 6.0f), (std::array{48, 24}));
    EXPECT_EQ(grid(Both, 1.0f / 3.0f), (std::array{64, 32}));
    EXPECT_EQ(grid(Both, 0.5f), (std::array{80, 40}));
    EXPECT_EQ(grid(Both, 1.0f), (std::array{128, 64}));
    EXPECT_EQ(grid(Both, 7.0f), (std::array{128, 64}));
    EXPECT_EQ(grid(Both, -1.0f), (std::array{32, 16}));
    EXPECT_EQ(grid(Both, std::nanf("")), (std::array{32, 16}));
    EXPECT_EQ(grid(Azimuth, 1.0f), (std::array{128, 16}));
    EXPECT_EQ(grid(Off, 1.0f), (std::array{32, 16}));

    OcclusionScene scene(9, 9, 50.0);
    scene.fill(0.1, [](const glm::dvec3&, double& depth, glm::dvec3& normal) {
        depth = 2.0;
        normal = {0.0, 0.0, -1.0};
        return true;
    });
    scene.importance.assign(scene.pixels(), 1.0f);
    const auto cost = occlusionCost(bodyOcclusion(), scene.inputs());
    ASSERT_TRUE(cost.ok());
    EXPECT_EQ(cost->pixels, scene.pixels());
    EXPECT_EQ(cost->directions, scene.pixels() * 8192);
    EXPECT_EQ(cost->tapsBound, scene.pixels() * 8192 * 16);
    EXPECT_LE(cost->tapsTaken, cost->tapsBound);
}

} // namespace
} // namespace ars
