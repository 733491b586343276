#include "engine/core/parallel.h"
#include "engine/occlusion/mesh_occlusion.h"
#include "engine/surfel/gbuffer.h"
#include "tests/unit/occlusion/baseline_meshes.h"

#include <gtest/gtest.h>

#include <limits>

namespace ars {
namespace {

using test::bowl;
using test::floorAndWall;
using test::mean;
using test::sheet;
using test::sphere;
using test::spreadDirections;
using test::TestMesh;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInfinity = std::numeric_limits<float>::infinity();

MeshOcclusion built(const TestMesh& mesh) {
    auto result = MeshOcclusion::build(mesh.vertices, mesh.triangles);
    EXPECT_TRUE(result.ok()) << result.error().describe();
    return std::move(result).value();
}

std::vector<float> ask(const MeshOcclusion& mesh, const std::vector<glm::vec3>& points,
                       const std::vector<glm::vec3>& normals, const std::vector<float>& radii = {},
                       const MeshOcclusionParams& params = {}) {
    std::vector<float> values(points.size(), -1.0f);
    const Status status = mesh.atPoints(params, {points, normals, radii}, values);
    EXPECT_TRUE(status.ok()) << status.error().describe();
    return values;
}

/// The same place 64 times: every index turns its rays by another angle.
std::vector<float> askOften(const MeshOcclusion& mesh, const glm::vec3& point, const glm::vec3& normal, float radius) {
    return ask(mesh, std::vector(64, point), std::vector(64, normal), std::vector(64, radius));
}

/// Each value within three standard deviations of 256 independent rays, the mean of 64 turns within 0.004: the samples
/// are stratified, so far better than independent ones.
void expectShare(const std::vector<float>& values, double hidden) {
    for (const float v : values) EXPECT_NEAR(v, 1 - hidden, 3 * 0.5 / std::sqrt(256.0));
    EXPECT_NEAR(mean(values), 1 - hidden, 0.004);
}

TEST(MeshOcclusion, InfiniteWallHidesItsClosedFormShare) {
    const MeshOcclusion mesh = built(floorAndWall(50, 50));
    for (const float c : {0.2f, 0.5f, 0.8f, 1.2f}) {
        SCOPED_TRACE(c);
        // 1 m rays: the millimetre that they start above the floor is small beside them.
        expectShare(askOften(mesh, {c, 0, 0}, {0, 1, 0}, 1.0f), test::wallShare(c, 1.0));
    }
}

TEST(MeshOcclusion, StepHidesItsClosedFormShareFromUnlimitedRays) {
    const MeshOcclusion mesh = built(floorAndWall(200, 0.2f));
    for (const float d : {0.05f, 0.1f, 0.4f}) {
        SCOPED_TRACE(d);
        expectShare(askOften(mesh, {d, 0, 0}, {0, 1, 0}, kInfinity), test::stepShare(d, 0.2));
    }
}

TEST(MeshOcclusion, BowlHidesHalfOfTheSky) {
    const MeshOcclusion mesh = built(bowl(1, 6));
    for (const glm::vec3& direction : spreadDirections(40)) {
        if (direction.z > -0.2f) continue; // the bowl's rim is a polygon
        SCOPED_TRACE(direction.z);
        expectShare(askOften(mesh, direction, -direction, kInfinity), 0.5);
    }
    for (const float t : {0.5f, 1.0f}) {
        SCOPED_TRACE(t);
        expectShare(askOften(mesh, {0, 0, -1}, {0, 0, 1}, t), (t / 2) * (t / 2));
    }
}

TEST(MeshOcclusion, GrooveSeesItsFormFactor) {
    for (const double opening : {glm::pi<double>() / 3, glm::pi<double>() / 2, 2.5}) {
        SCOPED_TRACE(opening);
        const glm::vec3 up(static_cast<float>(std::cos(opening)), static_cast<float>(std::sin(opening)), 0);
        TestMesh mesh = sheet({0, 0, -500}, {0, 0, 1000}, {1000, 0, 0});
        mesh.append(sheet({0, 0, -500}, 1000.0f * up, {0, 0, 1000}));
        expectShare(askOften(built(mesh), {0.5f, 0, 0}, {0, 1, 0}, kInfinity), (1 + std::cos(opening)) / 2);
    }
}

TEST(MeshOcclusion, ConvexBodyIsUnoccludedFromOnAboveAndBelowItsSurface) {
    const TestMesh body = sphere(0.15f, 5);
    const MeshOcclusion mesh = built(body);
    const std::vector<glm::vec3> normals = spreadDirections(500);
    for (const float heightM : {-0.002f, -0.0005f, 0.0f, 0.002f}) {
        SCOPED_TRACE(heightM);
        std::vector<glm::vec3> points;
        for (const glm::vec3& n : normals) points.push_back((0.15f + heightM) * n);
        for (const float v : ask(mesh, points, normals)) EXPECT_EQ(v, 1.0f);
        if (heightM < -0.001f) { // deeper than the rays' own offset: without the rule everything is dark
            EXPECT_LT(mean(ask(mesh, points, normals, {}, {.sinkM = 0})), 0.05);
        }
    }
}

TEST(MeshOcclusion, SunkenPointStillSeesTheWall) {
    // A solid step: the point lies 2 mm under the floor, whose sheet it may pass, but not the wall's.
    const MeshOcclusion mesh = built(floorAndWall(50, 50));
    expectShare(askOften(mesh, {0.5f, -0.002f, 0}, {0, 1, 0}, 1.0f), test::wallShare(0.5, 1.0));
}

TEST(MeshOcclusion, BothSidesOfATriangleOcclude) {
    const TestMesh down = sheet({-50, 0.1f, -50}, {100, 0, 0}, {0, 0, 100});
    const TestMesh up = sheet({-50, 0.1f, -50}, {0, 0, 100}, {100, 0, 0});
    // A ceiling at 0.1 m and rays of 0.2 m: all within 60 degrees of the normal are hidden, sin^2(60) = 3/4.
    expectShare(askOften(built(down), {0, 0, 0}, {0, 1, 0}, 0.2f), 0.75);
    expectShare(askOften(built(up), {0, 0, 0}, {0, 1, 0}, 0.2f), 0.75);
}

TEST(MeshOcclusion, RefitGivesWhatARebuildGives) {
    TestMesh mesh = sphere(0.5f, 4);
    mesh.append(floorAndWall(2, 1, 10));
    MeshOcclusion refitted = built(mesh);
    for (int step = 1; step <= 3; ++step) {
        for (glm::vec3& v : mesh.vertices) v += 0.1f * glm::sin(5.0f * glm::vec3(v.y, v.z, v.x));
        ASSERT_TRUE(refitted.update(mesh.vertices).ok());
        EXPECT_GE(refitted.buildMilliseconds(), 0.0);
        const std::vector<glm::vec3> points(mesh.vertices.begin(), mesh.vertices.begin() + 300);
        const std::vector<glm::vec3> normals = spreadDirections(300);
        const std::vector<float> radii(300, 0.3f), values = ask(refitted, points, normals, radii);
        EXPECT_EQ(values, ask(built(mesh), points, normals, radii));
        EXPECT_LT(mean(values), 0.95); // something occludes
    }
}

TEST(MeshOcclusion, ThreadsDoNotChangeTheNumbers) {
    TestMesh scene = bowl(1, 4);
    const MeshOcclusion mesh = built(scene);
    const std::vector<glm::vec3> normals = spreadDirections(1000);
    std::vector<glm::vec3> points;
    for (const glm::vec3& n : normals) points.push_back(0.9f * n);
    const int before = threadCount();
    setThreadCount(1);
    const std::vector<float> one = ask(mesh, points, normals);
    setThreadCount(4);
    const std::vector<float> four = ask(mesh, points, normals);
    setThreadCount(before);
    EXPECT_EQ(one, four);
}

TEST(MeshOcclusion, PointsWithoutAnAnswerAreUnoccluded) {
    const MeshOcclusion mesh = built(sheet({-50, 0.1f, -50}, {100, 0, 0}, {0, 0, 100}));
    const glm::vec3 origin(0), up(0, 1, 0);
    const std::vector<float> values =
        ask(mesh, {{kNan, 0, 0}, {kInfinity, 0, 0}, origin, origin, origin, origin, origin, origin, origin},
            {up, up, {0, kNan, 0}, {0, 0, 0}, up, up, up, up, 7.0f * up}, {1, 1, 1, 1, 0, -1, kNan, 0.2f, 0.2f});
    for (int i = 0; i < 7; ++i) EXPECT_EQ(values[static_cast<std::size_t>(i)], 1.0f) << i;
    EXPECT_NEAR(values[7], 0.25f, 0.1f);
    EXPECT_NEAR(values[8], 0.25f, 0.1f); // the length of a normal does not matter
}

TEST(MeshOcclusion, PictureIsThePointsBehindItsPixels) {
    // A camera 2 m above the floor that looks down; the left half of the picture is empty.
    const Camera camera = lookAtCamera({0.5, 2, 0}, {0.5, 0, 0}, 40, 12, 8);
    std::vector<float> position(12 * 8 * 3), normal(12 * 8 * 3), radius(12 * 8, 0.5f), opacity(12 * 8),
        out(12 * 8, -1.0f);
    std::vector<glm::vec3> points;
    for (int row = 0; row < 8; ++row) {
        for (int column = 0; column < 12; ++column) {
            const std::size_t p = static_cast<std::size_t>(row * 12 + column);
            const glm::dvec3 ray = glm::transpose(camera.rotation) * camera.ray(column + 0.5, row + 0.5);
            const glm::vec3 point(camera.centerWorld() + ray * (-camera.centerWorld().y / ray.y));
            const glm::vec3 n(camera.rotation * glm::dvec3(0, 1, 0));
            for (int k = 0; k < 3; ++k) {
                position[p * 3 + static_cast<std::size_t>(k)] = point[k];
                normal[p * 3 + static_cast<std::size_t>(k)] = n[k];
            }
            opacity[p] = column < 6 ? 0.5f * kMinOpacity : 1.0f;
            if (column >= 6) points.push_back(point);
        }
    }
    position[11 * 3] = kNan; // the pixel at the top right
    points.erase(points.begin() + 5);
    const MeshOcclusion mesh = built(floorAndWall(50, 1));
    const ImageView<const float> positions{position.data(), 12, 8, 3}, normals{normal.data(), 12, 8, 3},
        radii{radius.data(), 12, 8, 1}, opacities{opacity.data(), 12, 8, 1};
    const ImageView<float> picture{out.data(), 12, 8, 1};
    ASSERT_TRUE(mesh.atPixels({}, camera, positions, normals, radii, opacities, picture).ok());

    const std::vector<float> expected =
        ask(mesh, points, std::vector(points.size(), glm::vec3(0, 1, 0)), std::vector(points.size(), 0.5f));
    std::size_t next = 0;
    for (std::size_t p = 0; p < out.size(); ++p) {
        const bool empty = p % 12 < 6 || p == 11;
        // The normals went through the camera and back: a ray may pass an edge on the other side.
        EXPECT_NEAR(out[p], empty ? 1.0f : expected[next], empty ? 0.0f : 2.0f / 256) << p;
        next += !empty;
    }
    EXPECT_LT(mean(expected), 0.95);

    ASSERT_TRUE(mesh.atPixels({}, camera, positions, normals, {}, opacities, picture).ok()); // unlimited
    EXPECT_LT(mean(out), 0.99);
    const Status narrow = mesh.atPixels({}, camera, {position.data(), 11, 8, 3}, normals, radii, opacities, picture);
    ASSERT_FALSE(narrow.ok());
    EXPECT_NE(narrow.error().describe().find("the position picture is 11x8"), std::string::npos)
        << narrow.error().describe();
    EXPECT_FALSE(mesh.atPixels({}, camera, positions, normals, radii, {}, picture).ok());
    EXPECT_FALSE(mesh.atPixels({}, camera, positions, normals, radii, opacities, {out.data(), 8, 12, 1}).ok());
}

TEST(MeshOcclusion, RaysEndWhereTheyAreTold) {
    const MeshOcclusion mesh = built(sheet({-1, 1, -1}, {0, 0, 2}, {2, 0, 0}));
    const std::vector<glm::vec3> origins(20, glm::vec3(0)), up(20, glm::vec3(0, 1, 0)); // more than one packet
    std::vector<std::uint8_t> blocked(20, 7);
    for (const auto& [nearM, farM, expected] : {std::tuple(0.0f, 1.1f, 1), {0.0f, 0.9f, 0}, {1.1f, 2.0f, 0}}) {
        ASSERT_TRUE(mesh.blockedRays(origins, up, nearM, farM, blocked).ok());
        for (const std::uint8_t b : blocked) EXPECT_EQ(b, expected) << nearM << " to " << farM;
    }
    EXPECT_FALSE(mesh.blockedRays(origins, up, 1, 1, blocked).ok());
    EXPECT_FALSE(mesh.blockedRays(origins, up, kNan, 1, blocked).ok());
    EXPECT_FALSE(mesh.blockedRays(origins, up, 0, 1, {blocked.data(), 19}).ok());
}

TEST(MeshOcclusion, BrokenMeshesAndRequestsAreNamed) {
    const TestMesh good = sphere(1, 1);
    const auto complaint = [](const TestMesh& mesh) {
        const auto result = MeshOcclusion::build(mesh.vertices, mesh.triangles);
        return result.ok() ? std::string() : result.error().describe();
    };
    EXPECT_EQ(complaint({}), "mesh occlusion: the mesh has no triangles");
    TestMesh bad = good;
    bad.triangles[3].y = 1000;
    EXPECT_EQ(complaint(bad), "mesh occlusion: triangle 3: vertex 1000 does not exist, the mesh has 18");
    for (const float value : {kNan, -kInfinity, 1e9f}) {
        bad = good;
        bad.vertices[5].z = value;
        EXPECT_NE(complaint(bad).find("mesh occlusion: vertex 5: ("), std::string::npos) << complaint(bad);
    }
    MeshOcclusion mesh = built(good);
    const std::vector<glm::vec3> point{{0, 0, 2}};
    const std::vector<float> before = ask(mesh, point, {{0, 0, -1}});
    EXPECT_FALSE(mesh.update({bad.vertices.data(), 17}).ok());
    EXPECT_FALSE(mesh.update(bad.vertices).ok());
    EXPECT_EQ(ask(mesh, point, {{0, 0, -1}}), before); // the old mesh stays

    std::vector<float> out(1);
    EXPECT_FALSE(mesh.atPoints({}, {point, {}, {}}, out).ok());
    EXPECT_FALSE(mesh.atPoints({}, {point, point, std::vector<float>(2)}, out).ok());
    EXPECT_FALSE(mesh.atPoints({}, {point, point, {}}, std::span<float>()).ok());
    EXPECT_FALSE(mesh.atPoints({.rays = 0}, {point, point, {}}, out).ok());
    EXPECT_FALSE(mesh.atPoints({.offsetM = kNan}, {point, point, {}}, out).ok());
    EXPECT_TRUE(mesh.atPoints({}, {}, std::span<float>()).ok()); // nothing asked
}

TEST(MeshOcclusion, TrianglesWithoutAreaHideNothing) {
    TestMesh mesh = sheet({-1, 0.1f, -1}, {0, 0, 2}, {2, 0, 0});
    mesh.triangles = {{0, 0, 0}, {0, 1, 1}, {0, 1, 0}};
    for (const float v : askOften(built(mesh), {0, 0, 0}, {0, 1, 0}, kInfinity)) EXPECT_EQ(v, 1.0f);
}

} // namespace
} // namespace ars
