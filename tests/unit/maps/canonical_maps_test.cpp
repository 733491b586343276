// The z-buffer of the canonical maps against closed forms and against Embree.
#include "engine/maps/canonical_maps.h"

#include "tests/support/test_data.h"
#include "tests/unit/maps/map_meshes.h"

#include <embree3/rtcore.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

namespace ars {
namespace {

using test::addRectangle;
using test::followTheRoot;
using test::sphereTemplate;

CanonicalMapOptions ofSize(int size) {
    CanonicalMapOptions options;
    options.size = size;
    return options;
}

/// Row, column and side (0 front, 1 back) of point i.
struct MapPixel {
    int row, column, side;
};

MapPixel pixelOf(const CanonicalMaps& maps, std::size_t i) {
    const int width = 2 * maps.size, pixel = static_cast<int>(maps.pixels[i]);
    return {pixel / width, pixel % width % maps.size, pixel % width / maps.size};
}

/// The definition of a pixel's centre: x = cx + ((j + 1/2) 2/N - 1), y = cy + 1 - (i + 1/2) 2/N.
glm::dvec2 centreOf(const CanonicalMaps& maps, const MapPixel& p) {
    return {maps.centerM.x + (p.column + 0.5) * 2.0 / maps.size - 1.0,
            maps.centerM.y + 1.0 - (p.row + 0.5) * 2.0 / maps.size};
}

TEST(CanonicalMaps, ASphereIsWhereRaysMeetIt) {
    const double radius = 0.8;
    const auto maps = canonicalMaps(sphereTemplate(0.8f, 200), ofSize(64));
    ASSERT_TRUE(maps.ok()) << maps.error().describe();
    EXPECT_LT(glm::length(maps->centerM), 1e-6f);
    std::size_t expected = 0;
    for (int row = 0; row < 64; ++row) {
        for (int column = 0; column < 64; ++column) {
            const glm::dvec2 c = centreOf(*maps, {row, column, 0});
            if (glm::dot(c, c) < radius * radius) expected += 2;
        }
    }
    // Pixels that graze the rim may fall off the faceted sphere.
    EXPECT_NEAR(static_cast<double>(maps->pointCount()), static_cast<double>(expected), 4.0);
    for (std::size_t i = 0; i < maps->pointCount(); ++i) {
        const MapPixel pixel = pixelOf(*maps, i);
        const glm::dvec2 c = centreOf(*maps, pixel);
        const glm::vec3& p = maps->positions[i];
        EXPECT_EQ(p.x, static_cast<float>(c.x));
        EXPECT_EQ(p.y, static_cast<float>(c.y));
        const double z = std::sqrt(std::max(0.0, radius * radius - glm::dot(c, c)));
        // Facets lie up to r (1 - cos(pi / 400)) = 0.05 mm deep, seen at a slant of up to r / z.
        EXPECT_NEAR(p.z, pixel.side == 0 ? z : -z, 1e-4 * radius / std::max(z, 0.02));
        if (z > 0.2) {
            EXPECT_GT(glm::dot(maps->normals[i], glm::normalize(p)), 0.999f);
        }
        EXPECT_NEAR(glm::length(maps->normals[i]), 1.0f, 1e-5f);
    }
}

TEST(CanonicalMaps, FrontHoldsTheNearestAndBackTheFarthestNotMirrored) {
    TemplateMesh mesh;
    addRectangle(mesh.mesh, -0.5f, -0.5f, 0.5f, 0.5f, 0.0f);
    addRectangle(mesh.mesh, -0.5f, -0.5f, 0.0f, 0.5f, 0.2f); // in front of the right half of the body
    addRectangle(mesh.mesh, 0.25f, -0.5f, 0.5f, 0.5f, -0.3f);
    followTheRoot(mesh);
    CanonicalMapOptions options = ofSize(32);
    options.centerM = glm::vec3(0.0f);
    const auto maps = canonicalMaps(mesh, options);
    ASSERT_TRUE(maps.ok());
    ASSERT_EQ(maps->pointCount(), 2u * 16 * 16);
    for (std::size_t i = 0; i < maps->pointCount(); ++i) {
        const glm::vec3& p = maps->positions[i];
        const float nearest = p.x < 0.0f ? 0.2f : 0.0f, farthest = p.x > 0.25f ? -0.3f : 0.0f;
        EXPECT_FLOAT_EQ(p.z, pixelOf(*maps, i).side == 0 ? nearest : farthest) << p.x;
    }
}

// A rectangle covers exactly the centres within it, wherever its edges lie between them.
TEST(CanonicalMaps, APixelCountsWhenItsCentreIsCovered) {
    for (const float shift : {0.0f, 0.24f, 0.26f, 0.5f, 0.74f, 0.76f}) {
        const float step = 2.0f / 64.0f, left = (-10.0f + shift) * step, right = (7.0f + shift) * step;
        TemplateMesh mesh;
        addRectangle(mesh.mesh, left, -0.5f, right, 0.5f, 0.0f);
        followTheRoot(mesh);
        CanonicalMapOptions options = ofSize(64);
        options.centerM = glm::vec3(0.0f);
        const auto maps = canonicalMaps(mesh, options);
        ASSERT_TRUE(maps.ok());
        int columns = 0;
        for (int j = 0; j < 64; ++j) {
            const double x = (j + 0.5) * 2.0 / 64.0 - 1.0;
            columns += x >= left && x <= right ? 1 : 0;
        }
        EXPECT_EQ(maps->pointCount(), static_cast<std::size_t>(2 * 32 * columns)) << shift;
    }
}

TEST(CanonicalMaps, SharedEdgesLeaveNoGaps) {
    // Vertices on and between the centres, displaced at random: whatever the edges do, every pixel is covered.
    std::mt19937 random(5);
    std::uniform_real_distribution<float> number(-0.3f, 0.3f);
    TemplateMesh mesh;
    constexpr int kCells = 48;
    for (int r = 0; r <= kCells; ++r) {
        for (int c = 0; c <= kCells; ++c) {
            const bool border = r == 0 || c == 0 || r == kCells || c == kCells, exact = (r + c) % 3 == 0;
            const float dx = border || exact ? 0.0f : number(random), dy = border || exact ? 0.0f : number(random);
            mesh.mesh.positions.emplace_back((static_cast<float>(c) + dx) * 2.0f / kCells - 1.0f,
                                             (static_cast<float>(r) + dy) * 2.0f / kCells - 1.0f,
                                             0.1f * number(random));
        }
    }
    for (unsigned r = 0; r < kCells; ++r) {
        for (unsigned c = 0; c < kCells; ++c) {
            const unsigned a = r * (kCells + 1) + c, d = a + kCells + 1;
            mesh.mesh.triangles.push_back({a, a + 1, d + 1});
            mesh.mesh.triangles.push_back({d, a, d + 1}); // wound the other way round: both count
        }
    }
    followTheRoot(mesh);
    const auto maps = canonicalMaps(mesh, ofSize(kCells));
    ASSERT_TRUE(maps.ok());
    EXPECT_EQ(maps->pointCount(), maps->pixelCount());
}

// Edges that run through pixel centres: rounding must not put such a centre outside of both triangles.
TEST(CanonicalMaps, CentresOnACommonEdgeBelongToOneOfItsTriangles) {
    std::mt19937 random(8);
    std::uniform_real_distribution<float> step(0.003f, 0.03f);
    for (const float extent : {0.9f, 0.7f, 1.1f, 0.37f, 0.61f}) {
        TemplateMesh mesh;
        auto& v = mesh.mesh.positions;
        v.emplace_back(-2.0f, 2.0f, 0.0f); // 0: above the diagonal
        v.emplace_back(2.0f, -2.0f, 0.0f); // 1: below
        for (float at = -2.0f; at < 2.0f; at += step(random)) v.emplace_back(at, at, 0.0f);
        v.emplace_back(2.0f, 2.0f, 0.0f);
        for (unsigned i = 2; i + 1 < v.size(); ++i) {
            mesh.mesh.triangles.push_back({0, i, i + 1});
            mesh.mesh.triangles.push_back({1, i + 1, i});
        }
        followTheRoot(mesh);
        CanonicalMapOptions options = ofSize(200);
        options.halfExtentM = extent;
        options.centerM = glm::vec3(0.0f);
        const auto maps = canonicalMaps(mesh, options);
        ASSERT_TRUE(maps.ok());
        EXPECT_EQ(maps->pointCount(), maps->pixelCount()) << extent;
    }
}

TEST(CanonicalMaps, PointsStandInTheOrderOfThePictureAndOnTheirTriangles) {
    TemplateMesh mesh = sphereTemplate(0.6f, 16);
    for (const glm::vec3& p : mesh.mesh.positions) mesh.mesh.uvs.emplace_back(p.x, 2.0f * p.y);
    for (std::size_t v = 0; v < mesh.mesh.positions.size(); ++v) {
        const float upper = 0.5f + mesh.mesh.positions[v].y / 1.2f; // joint 6 takes over from below to above
        mesh.weights.joints[v * kMaxInfluences + 1] = 6;
        mesh.weights.weights[v * kMaxInfluences] = 1.0f - upper;
        mesh.weights.weights[v * kMaxInfluences + 1] = upper;
    }
    const auto maps = canonicalMaps(mesh, ofSize(40));
    ASSERT_TRUE(maps.ok());
    EXPECT_TRUE(std::is_sorted(maps->pixels.begin(), maps->pixels.end()));
    EXPECT_EQ(std::adjacent_find(maps->pixels.begin(), maps->pixels.end()), maps->pixels.end());
    const std::vector<std::uint8_t> mask = mapMask(*maps);
    EXPECT_EQ(static_cast<std::size_t>(std::count(mask.begin(), mask.end(), 1)), maps->pointCount());
    const std::vector<float> dense = denseWeights(maps->weights, kSmplxJointCount);
    for (std::size_t i = 0; i < maps->pointCount(); ++i) {
        EXPECT_EQ(mask[maps->pixels[i]], 1);
        const glm::uvec3& t = mesh.mesh.triangles[maps->triangles[i]];
        const glm::vec3& b = maps->barycentrics[i];
        const auto& v = mesh.mesh.positions;
        EXPECT_LT(glm::distance(b.x * v[t.x] + b.y * v[t.y] + b.z * v[t.z], maps->positions[i]), 1e-6f);
        EXPECT_NEAR(maps->uvs[i].x, maps->positions[i].x, 1e-6f);
        EXPECT_NEAR(maps->uvs[i].y, 2.0f * maps->positions[i].y, 2e-6f);
        EXPECT_NEAR(dense[i * kSmplxJointCount + 6], 0.5f + maps->positions[i].y / 1.2f, 1e-5f);
    }
}

TEST(CanonicalMaps, HalvingKeepsEverySecondRowAndColumn) {
    const auto maps = canonicalMaps(sphereTemplate(0.6f, 16), ofSize(40));
    ASSERT_TRUE(maps.ok());
    const auto half = halvedMaps(*maps);
    ASSERT_TRUE(half.ok());
    EXPECT_EQ(half->size, 20);
    std::size_t next = 0;
    for (std::size_t i = 0; i < maps->pointCount(); ++i) {
        const MapPixel p = pixelOf(*maps, i);
        if (p.row % 2 != 0 || p.column % 2 != 0) continue;
        ASSERT_LT(next, half->pointCount());
        const MapPixel q = pixelOf(*half, next);
        EXPECT_EQ(q.row, p.row / 2);
        EXPECT_EQ(q.column, p.column / 2);
        EXPECT_EQ(q.side, p.side);
        EXPECT_EQ(half->positions[next], maps->positions[i]);
        EXPECT_EQ(half->weights.weights[next * kMaxInfluences], maps->weights.weights[i * kMaxInfluences]);
        ++next;
    }
    EXPECT_EQ(next, half->pointCount());
    EXPECT_EQ(half->weights.pointCount(), half->pointCount());
}

/// Embree over the canonical vertices: the oracle of the z-buffer.
class RayCaster {
public:
    RayCaster(const std::vector<glm::vec3>& vertices, const std::vector<glm::uvec3>& triangles)
        : device_(rtcNewDevice("threads=1")), scene_(rtcNewScene(device_)) {
        rtcSetSceneFlags(scene_, RTC_SCENE_FLAG_ROBUST);
        const RTCGeometry geometry = rtcNewGeometry(device_, RTC_GEOMETRY_TYPE_TRIANGLE);
        void* v = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 12, vertices.size());
        std::copy(vertices.begin(), vertices.end(), static_cast<glm::vec3*>(v));
        void* t = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, triangles.size());
        std::copy(triangles.begin(), triangles.end(), static_cast<glm::uvec3*>(t));
        rtcCommitGeometry(geometry);
        rtcAttachGeometry(scene_, geometry);
        rtcReleaseGeometry(geometry);
        rtcCommitScene(scene_);
    }
    ~RayCaster() {
        rtcReleaseScene(scene_);
        rtcReleaseDevice(device_);
    }
    RayCaster(const RayCaster&) = delete;
    RayCaster& operator=(const RayCaster&) = delete;

    /// z of the first surface from z = 2 downwards (or from -2 upwards); NaN where there is none.
    float depth(float x, float y, bool fromFront) const {
        RTCRayHit ray{};
        ray.ray.org_x = x;
        ray.ray.org_y = y;
        ray.ray.org_z = fromFront ? 2.0f : -2.0f;
        ray.ray.dir_z = fromFront ? -1.0f : 1.0f;
        ray.ray.tfar = 10.0f;
        ray.ray.mask = ~0u;
        ray.hit.geomID = RTC_INVALID_GEOMETRY_ID;
        RTCIntersectContext context;
        rtcInitIntersectContext(&context);
        rtcIntersect1(scene_, &context, &ray);
        if (ray.hit.geomID == RTC_INVALID_GEOMETRY_ID) return std::numeric_limits<float>::quiet_NaN();
        return ray.ray.org_z + ray.ray.dir_z * ray.ray.tfar;
    }

private:
    RTCDevice device_;
    RTCScene scene_;
};

TEST(CanonicalMaps, TheOpenBodyAgreesWithRayCasting) {
    const auto body = readOpenBody();
    ASSERT_TRUE(body.ok());
    CanonicalMapOptions options = ofSize(256);
    options.centerM = canonicalCenter(*body);
    const TemplateMesh mesh = templateFromBody(*body);
    const auto maps = canonicalMaps(mesh, options);
    ASSERT_TRUE(maps.ok());
    const auto posed = posedTemplate(mesh, canonicalPose());
    ASSERT_TRUE(posed.ok());
    const RayCaster rays(*posed, mesh.mesh.triangles);
    std::vector<float> depth(maps->pixelCount(), std::numeric_limits<float>::quiet_NaN());
    for (std::size_t i = 0; i < maps->pointCount(); ++i) depth[maps->pixels[i]] = maps->positions[i].z;
    int different = 0, covered = 0;
    for (int row = 0; row < 256; ++row) {
        for (int column = 0; column < 512; ++column) {
            const MapPixel pixel{row, column % 256, column / 256};
            const glm::dvec2 c = centreOf(*maps, pixel);
            const float expected = rays.depth(static_cast<float>(c.x), static_cast<float>(c.y), pixel.side == 0);
            const float found = depth[static_cast<std::size_t>(row * 512 + column)];
            if (std::isnan(expected) && std::isnan(found)) continue;
            ++covered;
            // Rays that graze an edge may go either way in float; a handful of the rim's pixels do.
            if (!(std::abs(expected - found) < 2e-5f)) ++different;
        }
    }
    EXPECT_GT(covered, 10000);
    EXPECT_LE(different, covered / 1000) << covered;
}

TEST(CanonicalMaps, TheCanonicalPoseIsApplied) {
    // Hips turned out 25 degrees about z: the left foot of the open body moves to its left.
    const auto body = readOpenBody();
    ASSERT_TRUE(body.ok());
    const auto maps = canonicalMaps(templateFromBody(*body), ofSize(64));
    ASSERT_TRUE(maps.ok());
    const auto still = posedTemplate(templateFromBody(*body), restPose(kSmplxJointCount));
    float widest = 0.0f, floor = 10.0f, lowest = 10.0f;
    for (const glm::vec3& p : *still) floor = std::min(floor, p.y);
    for (const glm::vec3& p : maps->positions) lowest = std::min(lowest, p.y);
    for (const glm::vec3& p : maps->positions) widest = p.y < lowest + 0.1f ? std::max(widest, p.x) : widest;
    EXPECT_GT(widest, 0.35f);
    EXPECT_GT(lowest, floor + 0.03f) << "spread legs reach less far down";
}

TEST(CanonicalMaps, BadInputIsRefused) {
    const TemplateMesh mesh = sphereTemplate(0.5f, 8);
    for (const int size : {0, -2, 7, 33, 5000}) {
        EXPECT_EQ(canonicalMaps(mesh, ofSize(size)).error().code, ErrorCode::InvalidArgument) << size;
    }
    CanonicalMapOptions options = ofSize(32);
    options.halfExtentM = 0.0f;
    EXPECT_EQ(canonicalMaps(mesh, options).error().code, ErrorCode::InvalidArgument);
    options = ofSize(32);
    options.centerM = glm::vec3(std::numeric_limits<float>::quiet_NaN());
    EXPECT_EQ(canonicalMaps(mesh, options).error().code, ErrorCode::InvalidArgument);
    options.centerM = glm::vec3(50.0f, 0.0f, 0.0f);
    EXPECT_EQ(canonicalMaps(mesh, options).error().code, ErrorCode::Unsupported);
    TemplateMesh broken = mesh;
    broken.mesh.positions[3].y = std::numeric_limits<float>::infinity();
    EXPECT_EQ(canonicalMaps(broken, ofSize(32)).error().code, ErrorCode::InvalidArgument);
    broken = mesh;
    broken.weights = {};
    EXPECT_EQ(canonicalMaps(broken, ofSize(32)).error().code, ErrorCode::InvalidArgument);
    broken = mesh;
    broken.mesh.triangles.clear();
    EXPECT_NE(canonicalMaps(broken, ofSize(32)).error().describe().find("no triangle"), std::string::npos);
    broken = mesh;
    for (glm::vec3& p : broken.mesh.positions) p *= 1e30f;
    options = ofSize(32);
    options.centerM = glm::vec3(0.0f);
    EXPECT_TRUE(canonicalMaps(broken, options).ok()) << "huge is odd, but defined";
}

} // namespace
} // namespace ars
