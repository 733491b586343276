// Surfels straight from a mesh: their places, frames, materials and skinning against closed forms.
#include "engine/frame/rest_avatar.h"

#include "engine/core/file.h"
#include "engine/frame/surface_samples.h"
#include "engine/frame/template_materials.h"
#include "engine/io/png.h"
#include "engine/rig/closest_surface.h"
#include "engine/surfel/pose_surfels.h"
#include "tests/support/test_data.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>

namespace ars {
namespace {

/// Everything follows the root.
void addRigidWeights(TemplateMesh& mesh) {
    mesh.joints.assign(kSmplxJointCount, glm::vec3(0.0f));
    mesh.weights.joints.assign(mesh.mesh.positions.size() * kMaxInfluences, 0);
    mesh.weights.weights.assign(mesh.mesh.positions.size() * kMaxInfluences, 0.0f);
    for (std::size_t v = 0; v < mesh.mesh.positions.size(); ++v) mesh.weights.weights[v * kMaxInfluences] = 1.0f;
}

/// A sphere of rows x 2 rows quads around `center`, wound so that its outside is seen.
void addSphere(TriangleMesh& mesh, const glm::vec3& center, float radius, int rows) {
    const auto first = static_cast<unsigned>(mesh.positions.size());
    const int columns = 2 * rows;
    for (int r = 0; r <= rows; ++r) {
        for (int c = 0; c <= columns; ++c) {
            const double theta = std::numbers::pi * r / rows, phi = 2.0 * std::numbers::pi * c / columns;
            const glm::dvec3 n(std::sin(theta) * std::sin(phi), std::cos(theta), std::sin(theta) * std::cos(phi));
            mesh.positions.push_back(center + radius * glm::vec3(n));
        }
    }
    for (int r = 0; r < rows; ++r) {
        for (int c = 0; c < columns; ++c) {
            const unsigned a = first + static_cast<unsigned>(r * (columns + 1) + c), b = a + 1;
            const unsigned d = a + static_cast<unsigned>(columns) + 1, e = d + 1;
            mesh.triangles.push_back({a, d, b});
            mesh.triangles.push_back({b, d, e});
        }
    }
}

TemplateMesh sphereTemplate(int rows = 40) {
    TemplateMesh mesh;
    mesh.name = "sphere";
    addSphere(mesh.mesh, {0.0f, 1.0f, 0.0f}, 0.5f, rows);
    addRigidWeights(mesh);
    return mesh;
}

/// The unit square in the plane z = 0, seen from +z; (u, v) = (x, 1 - y).
TemplateMesh squareTemplate() {
    TemplateMesh mesh;
    mesh.name = "square";
    mesh.mesh.positions = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}};
    mesh.mesh.uvs = {{0, 1}, {1, 1}, {1, 0}, {0, 0}};
    mesh.mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
    addRigidWeights(mesh);
    return mesh;
}

GltfMaterial& addMaterial(TemplateMesh& mesh, std::string name) {
    mesh.materials.emplace_back();
    mesh.materials.back().name = std::move(name);
    mesh.mesh.materials.assign(mesh.mesh.triangles.size(), 0);
    return mesh.materials.back();
}

/// A picture as glTF carries it: PNG bytes of 8-bit numbers.
int addPicture(TemplateMesh& mesh, int width, int height, int channels, std::vector<int> bytes) {
    Image image;
    image.width = width;
    image.height = height;
    image.channels = channels;
    image.space = ColorSpace::Srgb;
    for (const int b : bytes) image.pixels.push_back(static_cast<float>(b) / 255.0f);
    GltfImage encoded;
    encoded.name = "picture";
    encoded.bytes = *encodePng(image);
    mesh.images.push_back(std::move(encoded));
    return static_cast<int>(mesh.images.size()) - 1;
}

RestAvatarOptions onTheSurface(int surfels) {
    RestAvatarOptions options;
    options.maxSurfels = surfels;
    options.insetM = 0.0f;
    return options;
}

std::unique_ptr<RestAvatar> created(TemplateMesh mesh, const RestAvatarOptions& options) {
    auto avatar = RestAvatar::create(std::move(mesh), options);
    EXPECT_TRUE(avatar.ok()) << avatar.error().describe();
    return avatar.ok() ? std::move(avatar).value() : nullptr;
}

glm::mat3 frameOf(const Surfels& surfels, std::size_t i) {
    const float* q = &surfels.rotations[4 * i];
    return glm::mat3_cast(glm::quat(q[0], q[1], q[2], q[3]));
}

TEST(RestAvatar, SurfelsOfASphereLieOnItAndLookOutwards) {
    const auto avatar = created(sphereTemplate(), onTheSurface(4000));
    ASSERT_TRUE(avatar);
    const Surfels& surfels = avatar->surfels();
    ASSERT_TRUE(checkSurfels(surfels).ok());
    EXPECT_LE(surfels.count(), 4000u);
    EXPECT_GE(surfels.count(), 3400u);
    for (std::size_t i = 0; i < surfels.count(); ++i) {
        const glm::vec3 out = surfels.means[i] - glm::vec3(0, 1, 0);
        // The sphere's 40 rows of flat faces lie up to 0.5 (1 - cos(pi / 80)) = 0.4 mm inside it.
        EXPECT_NEAR(glm::length(out), 0.4996f, 0.0006f);
        const glm::mat3 frame = frameOf(surfels, i);
        EXPECT_GT(glm::dot(frame[2], glm::normalize(out)), 0.999f);
        EXPECT_NEAR(glm::determinant(frame), 1.0f, 1e-5f);
        EXPECT_EQ(surfels.scales[i].x, surfels.scales[i].y);
        EXPECT_FLOAT_EQ(surfels.opacities[i], 0.99f);
    }
    EXPECT_EQ(avatar->rig().parts.size(), 55u);
    EXPECT_EQ(avatar->rig().weights.pointCount(), surfels.count());
    EXPECT_EQ(avatar->description(),
              fmt::format("rest avatar of sphere, {},{:03d} surfels", surfels.count() / 1000, surfels.count() % 1000));
    Surfels copy;
    ASSERT_TRUE(avatar->evaluate(restPose(55), nullptr, copy).ok());
    EXPECT_EQ(copy.means, surfels.means);
}

// Even: no two closer than the spacing, and no point of the surface much farther than it from all of them.
TEST(SurfaceSamples, AreEvenlySpreadAndLeaveNoHoles) {
    TriangleMesh mesh;
    addSphere(mesh, glm::vec3(0.0f), 0.5f, 24);
    const auto samples = sampleSurface(mesh, {1500, 0.0f, 3});
    ASSERT_TRUE(samples.ok());
    std::vector<glm::vec3> points;
    for (std::size_t i = 0; i < samples->triangles.size(); ++i) {
        const glm::uvec3& t = mesh.triangles[samples->triangles[i]];
        const glm::vec3& b = samples->barycentrics[i];
        EXPECT_NEAR(b.x + b.y + b.z, 1.0f, 1e-6f);
        EXPECT_GE(std::min({b.x, b.y, b.z}), 0.0f);
        points.push_back(b.x * mesh.positions[t.x] + b.y * mesh.positions[t.y] + b.z * mesh.positions[t.z]);
    }
    float closest = 1.0f;
    for (std::size_t i = 0; i < points.size(); ++i) {
        for (std::size_t j = 0; j < i; ++j) closest = std::min(closest, glm::distance(points[i], points[j]));
    }
    EXPECT_GE(closest, samples->spacingM * 0.9999f);
    std::mt19937 random(2);
    std::normal_distribution<float> number;
    float widest = 0.0f;
    for (int i = 0; i < 3000; ++i) {
        const glm::vec3 at = 0.5f * glm::normalize(glm::vec3(number(random), number(random), number(random)));
        float nearest = 1.0f;
        for (const glm::vec3& p : points) nearest = std::min(nearest, glm::distance(at, p));
        widest = std::max(widest, nearest);
    }
    EXPECT_LT(widest, 1.35f * samples->spacingM);
}

TEST(SurfaceSamples, SheetsThatLieCloselyDoNotPushEachOtherOff) {
    // Two spheres of nearly one size around one centre: as many samples on each as on one alone.
    TriangleMesh one, two;
    addSphere(one, glm::vec3(0.0f), 0.5f, 24);
    addSphere(two, glm::vec3(0.0f), 0.5f, 24);
    addSphere(two, glm::vec3(0.0f), 0.499f, 24);
    const auto single = sampleSurface(one, {10000, 0.02f, 1});
    const auto both = sampleSurface(two, {10000, 0.02f, 1});
    ASSERT_TRUE(single.ok());
    ASSERT_TRUE(both.ok());
    EXPECT_NEAR(static_cast<double>(both->triangles.size()) / static_cast<double>(single->triangles.size()), 2.0, 0.05);
    const std::vector<std::uint32_t> parts = connectedParts(two);
    EXPECT_EQ(*std::max_element(parts.begin(), parts.end()), 1u) << "the seam of a sphere does not part it";
}

TEST(RestAvatar, TheSameSeedGivesTheSameSurfels) {
    const auto first = created(sphereTemplate(), onTheSurface(1000)),
               second = created(sphereTemplate(), onTheSurface(1000));
    RestAvatarOptions other = onTheSurface(1000);
    other.seed = 2;
    const auto third = created(sphereTemplate(), other);
    ASSERT_TRUE(first && second && third);
    EXPECT_EQ(first->surfels().means, second->surfels().means);
    EXPECT_NE(first->surfels().means, third->surfels().means);
}

TEST(RestAvatar, ScalesFollowTheSpacing) {
    // On a plane sampled at spacing h the three nearest neighbours lie between h and 1.6 h.
    RestAvatarOptions options = onTheSurface(100000);
    options.spacingM = 0.02f;
    options.scaleFactor = 0.5f;
    const auto avatar = created(squareTemplate(), options);
    ASSERT_TRUE(avatar);
    for (const glm::vec2& s : avatar->surfels().scales) {
        EXPECT_GE(s.x, 0.0099f);
        EXPECT_LE(s.x, 0.0161f);
    }
    options.insetM = 0.05f;
    const auto deeper = created(squareTemplate(), options);
    ASSERT_TRUE(deeper);
    for (std::size_t i = 0; i < deeper->surfels().count(); ++i) {
        EXPECT_FLOAT_EQ(deeper->surfels().means[i].z, -0.05f);
        EXPECT_EQ(deeper->surfels().scales[i], avatar->surfels().scales[i]);
    }
}

// Red 188 is linear 0.502886; texel centres lie at (i + 1/2) / 2, between them the linear values are blended.
TEST(RestAvatar, AlbedoIsTheTextureDecodedAndBlended) {
    TemplateMesh mesh = squareTemplate();
    const int picture = addPicture(mesh, 2, 2, 3, {0, 0, 0, 188, 0, 0, 0, 255, 0, 188, 255, 0});
    GltfMaterial& material = addMaterial(mesh, "cloth");
    material.baseColorImage = picture;
    material.baseColorFactor = {0.5f, 1.0f, 1.0f, 1.0f};
    material.roughnessFactor = 0.3f;
    RestAvatarOptions options = onTheSurface(100000);
    options.spacingM = 0.03f;
    const auto avatar = created(std::move(mesh), options);
    ASSERT_TRUE(avatar);
    auto blend = [](float t) { // weight of the second texel at coordinate t of a repeating texture of two
        const float x = t * 2.0f - 0.5f;
        return x < 0.0f ? -x : x > 1.0f ? 2.0f - x : x;
    };
    for (std::size_t i = 0; i < avatar->surfels().count(); ++i) {
        const glm::vec3& p = avatar->surfels().means[i];
        const float right = blend(p.x), below = blend(1.0f - p.y);
        EXPECT_NEAR(avatar->surfels().albedos[i].x, 0.5f * 0.502886f * right, 2e-5f);
        EXPECT_NEAR(avatar->surfels().albedos[i].y, below, 2e-5f);
        EXPECT_FLOAT_EQ(avatar->surfels().roughnesses[i], 0.3f);
        EXPECT_FLOAT_EQ(avatar->surfels().colors[i].y, linearToSrgb(avatar->surfels().albedos[i].y));
    }
}

TEST(RestAvatar, FineTexturesAreAveragedOverASurfel) {
    // One-texel stripes of 0 and 1: a surfel of many texels sees a half, not one or the other.
    TemplateMesh mesh = squareTemplate();
    std::vector<int> stripes;
    for (int i = 0; i < 128 * 128; ++i) stripes.push_back(i % 2 ? 255 : 0);
    addMaterial(mesh, "stripes").baseColorImage = addPicture(mesh, 128, 128, 1, stripes);
    RestAvatarOptions options = onTheSurface(1000);
    options.spacingM = 0.05f;
    const auto avatar = created(std::move(mesh), options);
    ASSERT_TRUE(avatar);
    for (const glm::vec3& albedo : avatar->surfels().albedos) EXPECT_NEAR(albedo.x, 0.5f, 1e-5f);
}

TEST(RestAvatar, RoughnessIsGreenOfItsTextureTimesTheFactor) {
    TemplateMesh mesh = squareTemplate();
    const int picture = addPicture(mesh, 1, 1, 3, {255, 102, 0});
    GltfMaterial& material = addMaterial(mesh, "rough");
    material.baseColorFactor = {0.2f, 0.4f, 0.6f, 1.0f};
    material.metallicRoughnessImage = picture;
    material.roughnessFactor = 0.5f;
    const auto avatar = created(std::move(mesh), onTheSurface(500));
    ASSERT_TRUE(avatar);
    for (std::size_t i = 0; i < avatar->surfels().count(); ++i) {
        EXPECT_NEAR(avatar->surfels().roughnesses[i], 0.2f, 1e-6f) << "102 / 255 = 0.4, no sRGB";
        EXPECT_LT(glm::distance(avatar->surfels().albedos[i], glm::vec3(0.2f, 0.4f, 0.6f)), 1e-6f);
    }
}

TEST(RestAvatar, VertexColoursCountAndNothingAtAllIsGrey) {
    TemplateMesh mesh = squareTemplate();
    const auto gray = created(mesh, onTheSurface(200));
    mesh.mesh.colors = {{0, 0, 0.25f, 1}, {1, 0, 0.25f, 1}, {1, 1, 0.25f, 1}, {0, 1, 0.25f, 1}};
    const auto colored = created(mesh, onTheSurface(200));
    addMaterial(mesh, "plain").baseColorFactor = {0.5f, 1.0f, 1.0f, 1.0f};
    const auto both = created(mesh, onTheSurface(200));
    mesh.mesh.colors.clear();
    mesh.materials[0].baseColorFactor = glm::vec4(1.0f);
    const auto white = created(mesh, onTheSurface(200));
    ASSERT_TRUE(gray && colored && both && white);
    for (std::size_t i = 0; i < colored->surfels().count(); ++i) {
        const glm::vec3 expected(colored->surfels().means[i].x, colored->surfels().means[i].y, 0.25f);
        EXPECT_LT(glm::distance(colored->surfels().albedos[i], expected), 1e-6f);
        EXPECT_LT(glm::distance(both->surfels().albedos[i], expected * glm::vec3(0.5f, 1.0f, 1.0f)), 1e-6f);
        EXPECT_EQ(gray->surfels().albedos[i], glm::vec3(0.5f));
        EXPECT_EQ(white->surfels().albedos[i], glm::vec3(0.5f));
    }
    ASSERT_EQ(white->notes().size(), 1u);
    EXPECT_NE(white->notes()[0].find("\"plain\" has no colour"), std::string::npos);
}

TEST(RestAvatar, MaskedMaterialsHaveNoSurfelsInTheirHoles) {
    TemplateMesh mesh = squareTemplate();
    // Left half opaque, right half not; alpha is blended between x = 1/4 and 3/4 and crosses 1/2 in the middle.
    const int picture = addPicture(mesh, 2, 1, 2, {255, 255, 255, 0});
    GltfMaterial& material = addMaterial(mesh, "hair");
    material.baseColorImage = picture;
    material.alphaMode = GltfAlphaMode::Mask;
    const auto avatar = created(std::move(mesh), onTheSurface(2000));
    ASSERT_TRUE(avatar);
    EXPECT_GT(avatar->surfels().count(), 800u);
    for (const glm::vec3& p : avatar->surfels().means) EXPECT_LE(p.x, 0.5001f);
}

TEST(RestAvatar, TwoSidedSurfelsComeInPairsThatLookApart) {
    RestAvatarOptions options = onTheSurface(1000);
    options.twoSided = true;
    const auto avatar = created(sphereTemplate(), options);
    ASSERT_TRUE(avatar);
    const Surfels& surfels = avatar->surfels();
    ASSERT_TRUE(checkSurfels(surfels).ok());
    EXPECT_LE(surfels.count(), 1000u);
    ASSERT_EQ(avatar->rig().weights.pointCount(), surfels.count());
    const std::size_t half = surfels.count() / 2;
    for (std::size_t i = 0; i < half; ++i) {
        EXPECT_EQ(surfels.means[i], surfels.means[half + i]);
        EXPECT_LT(glm::distance(frameOf(surfels, i)[2], -frameOf(surfels, half + i)[2]), 1e-5f);
        EXPECT_NEAR(glm::determinant(frameOf(surfels, half + i)), 1.0f, 1e-5f);
    }
}

TEST(RestAvatar, OneSurfelAtEachVertex) {
    TemplateMesh mesh = squareTemplate();
    mesh.mesh.positions.emplace_back(9, 9, 9); // of no triangle
    mesh.mesh.uvs.emplace_back(0, 0);
    addRigidWeights(mesh);
    RestAvatarOptions options = onTheSurface(4);
    options.sampling = RestSampling::Vertices;
    const auto avatar = created(mesh, options);
    ASSERT_TRUE(avatar);
    ASSERT_EQ(avatar->surfels().count(), 4u);
    for (std::size_t v = 0; v < 4; ++v) {
        const auto& means = avatar->surfels().means;
        EXPECT_NE(std::find(means.begin(), means.end(), mesh.mesh.positions[v]), means.end());
    }
    options.maxSurfels = 3;
    EXPECT_EQ(RestAvatar::create(mesh, options).error().code, ErrorCode::LimitExceeded);
}

// Posing the surfels must follow the posed mesh: weights blend along an edge from one joint to another.
TEST(RestAvatar, PosedSurfelsStayOnThePosedMesh) {
    TemplateMesh mesh = squareTemplate();
    mesh.joints[3] = {0.0f, 0.2f, 0.0f}; // spine1 moves with the root unless it is turned itself
    for (std::size_t v : {2u, 3u}) mesh.weights.joints[v * kMaxInfluences] = 3;
    Pose pose = restPose(kSmplxJointCount);
    pose.rotations[3] = quatFromAxisAngle({0.0f, 0.0f, 0.4f});
    pose.rotations[0] = quatFromAxisAngle({0.3f, 1.0f, 0.0f});
    pose.translation = {0.5f, 0.0f, -1.0f};
    const auto avatar = created(mesh, onTheSurface(500));
    ASSERT_TRUE(avatar);
    const AvatarRig& rig = avatar->rig();
    const auto matrices = canonicalToPosed(skinningMatrices(rig.skeleton, pose), rig.canonical);
    ASSERT_TRUE(matrices.ok());
    const std::vector<glm::vec3> joints = posedJointPositions(rig.skeleton, pose);
    PosedSurfels posed;
    ASSERT_TRUE(poseSurfels({}, {*matrices, joints, rig.parts}, rig.weights, avatar->surfels(), posed).ok());
    const std::vector<glm::mat4> skinning = skinningMatrices(mesh.skeleton(), pose);
    const glm::vec3 normal = pose.rotations[0] * glm::vec3(0, 0, 1); // the square stays in its turned plane
    for (std::size_t i = 0; i < posed.count(); ++i) {
        const glm::vec3& rest = avatar->surfels().means[i];
        const float upper = rest.y; // weight of spine1
        const glm::vec4 p(rest, 1.0f);
        const glm::vec3 expected((1.0f - upper) * (skinning[0] * p) + upper * (skinning[3] * p));
        EXPECT_LT(glm::distance(posed.means[i], expected), 1e-5f);
        const float* q = &posed.rotations[4 * i];
        EXPECT_LT(glm::distance(glm::mat3_cast(glm::quat(q[0], q[1], q[2], q[3]))[2], normal), 1e-4f);
    }
}

TEST(RestAvatar, BadMeshesAndOptionsAreRefused) {
    auto failure = [](TemplateMesh mesh, const RestAvatarOptions& options) {
        auto avatar = RestAvatar::create(std::move(mesh), options);
        EXPECT_FALSE(avatar.ok());
        return avatar.ok() ? Error{} : avatar.error();
    };
    const RestAvatarOptions options = onTheSurface(100);
    EXPECT_EQ(failure(TemplateMesh{}, options).code, ErrorCode::InvalidArgument);
    TemplateMesh mesh = squareTemplate();
    mesh.mesh.triangles.clear();
    EXPECT_NE(failure(mesh, options).describe().find("4 vertices and no triangle"), std::string::npos);
    mesh = squareTemplate();
    mesh.mesh.positions[1].x = std::numeric_limits<float>::quiet_NaN();
    EXPECT_EQ(failure(mesh, options).code, ErrorCode::InvalidArgument);
    mesh = squareTemplate();
    mesh.weights = {};
    EXPECT_NE(failure(mesh, options).describe().find("0 rows of weights for 4 vertices"), std::string::npos);
    mesh = squareTemplate();
    for (glm::vec3& p : mesh.mesh.positions) p = glm::vec3(0.0f);
    EXPECT_NE(failure(mesh, options).describe().find("no finite area"), std::string::npos);
    mesh = squareTemplate();
    RestAvatarOptions dense = options;
    dense.spacingM = 0.001f;
    EXPECT_EQ(failure(mesh, dense).code, ErrorCode::LimitExceeded);
    dense = options;
    dense.opacity = 1.5f;
    EXPECT_NE(failure(mesh, dense).describe().find("opacity"), std::string::npos);
    dense = options;
    dense.opacity = 0.01f; // as a double it lies below the bound of 0.01
    dense.insetM = 0.1f;
    EXPECT_TRUE(RestAvatar::create(mesh, dense).ok());
    dense = options;
    dense.maxSurfels = 0;
    EXPECT_EQ(failure(mesh, dense).code, ErrorCode::InvalidArgument);
    int calls = 0;
    const auto stopped = RestAvatar::create(mesh, options, [&](double, std::string_view) { return ++calls < 2; });
    EXPECT_EQ(stopped.error().code, ErrorCode::Cancelled);
}

TEST(RestAvatar, ABrokenPictureIsNamedAndAMissingOneNoted) {
    TemplateMesh mesh = squareTemplate();
    const int picture = addPicture(mesh, 2, 2, 3, std::vector<int>(12, 100));
    addMaterial(mesh, "skin").baseColorImage = picture;
    mesh.images[0].bytes.resize(40);
    auto avatar = RestAvatar::create(mesh, onTheSurface(100));
    ASSERT_FALSE(avatar.ok());
    EXPECT_EQ(avatar.error().code, ErrorCode::BadFile);
    EXPECT_NE(avatar.error().describe().find("material \"skin\": picture 0 \"picture\""), std::string::npos);

    mesh.images[0].bytes.clear();
    const auto plain = created(mesh, onTheSurface(100));
    ASSERT_TRUE(plain);
    EXPECT_EQ(plain->notes().size(), 2u);
    EXPECT_EQ(plain->surfels().albedos[0], glm::vec3(0.5f));
    mesh.materials[0].baseColorImage = 5;
    EXPECT_EQ(RestAvatar::create(mesh, onTheSurface(100)).error().code, ErrorCode::InvalidArgument);
}

TEST(RestAvatar, ComesFromTheOpenBodyAndFromFiles) {
    RestAvatarOptions options = onTheSurface(2000);
    const auto open = restAvatarFromFile("open", options);
    ASSERT_TRUE(open.ok()) << open.error().describe();
    EXPECT_GT((*open)->surfels().count(), 1700u);
    const auto absent = restAvatarFromFile("/nowhere/body.npz", options);
    ASSERT_FALSE(absent.ok());
    EXPECT_NE(absent.error().describe().find("/nowhere/body.npz"), std::string::npos);
    test::TemporaryFolder folder;
    ASSERT_TRUE(writeFileAtomic(folder / "text.glb", std::string_view("no mesh")).ok());
    const auto text = restAvatarFromFile((folder / "text.glb").string(), options);
    ASSERT_FALSE(text.ok());
    EXPECT_NE(text.error().describe().find("text.glb"), std::string::npos);
}

TEST(RestAvatar, TheClothedTemplateHasItsColours) {
    ARS_TEST_DATA_FILE(path, "capture/casual/template.glb");
    const auto avatar = restAvatarFromFile(path.string(), onTheSurface(20000));
    ASSERT_TRUE(avatar.ok()) << avatar.error().describe();
    EXPECT_LE((*avatar)->surfels().count(), 20000u);
    EXPECT_GT((*avatar)->surfels().count(), 17000u);
    EXPECT_TRUE((*avatar)->notes().empty());
    // Roughness is constant for each of six materials (the capture's metadata).
    const std::array<float, 6> known{0.45f, 0.8f, 0.7f, 0.3f, 0.5f, 0.25f};
    for (const float roughness : (*avatar)->surfels().roughnesses) {
        EXPECT_TRUE(std::any_of(known.begin(), known.end(), [&](float k) { return std::abs(roughness - k) < 1e-6f; }));
    }
}

// ---- bodies: shape and expression, against the body model itself

class RestBody : public ::testing::Test {
protected:
    static const std::shared_ptr<const BodyModel>& body() {
        static const auto read = std::make_shared<const BodyModel>(*readOpenBody());
        return read;
    }
    static std::unique_ptr<RestAvatar> avatar(const std::vector<float>& betas, RestAvatarOptions options) {
        auto made = RestAvatar::create(body(), betas, options);
        EXPECT_TRUE(made.ok()) << made.error().describe();
        return made.ok() ? std::move(made).value() : nullptr;
    }
    /// Largest distance of a point from the body that posedVertices gives.
    static float distanceToBody(const std::vector<glm::vec3>& points, const BodyShape& shape) {
        const auto surface =
            ClosestSurface::build(posedVertices(*body(), shape, restPose(kSmplxJointCount)), body()->triangles);
        float largest = 0.0f;
        for (const glm::vec3& point : points) {
            SurfacePoint closest;
            largest = std::max(largest, surface->find(point, 0.1f, closest) ? closest.distanceM : 1.0f);
        }
        return largest;
    }
};

TEST_F(RestBody, ShapedSurfelsLieOnTheShapedBodyAndSoDoItsJoints) {
    const std::vector<float> betas{2.0f, -1.5f, 1.0f};
    const auto plain = avatar({}, onTheSurface(3000)), shaped = avatar(betas, onTheSurface(3000));
    ASSERT_TRUE(plain && shaped);
    EXPECT_LT(distanceToBody(plain->surfels().means, {}), 1e-5f);
    EXPECT_LT(distanceToBody(shaped->surfels().means, {betas, {}}), 1e-5f);
    EXPECT_GT(distanceToBody(plain->surfels().means, {betas, {}}), 0.01f) << "the shape shows";
    EXPECT_EQ(shaped->rig().skeleton.restPositions, bodySkeleton(*body(), {betas, {}}).restPositions);
    EXPECT_EQ(shaped->surfels().count(), plain->surfels().count()) << "the same points of the skin";
    const auto again = plain->withShape(betas);
    ASSERT_TRUE(again.ok());
    EXPECT_EQ((*again)->surfels().means, shaped->surfels().means);
    EXPECT_EQ((*again)->surfels().scales, shaped->surfels().scales);
}

TEST_F(RestBody, AnExpressionMovesExactlyTheFace) {
    const auto made = avatar({}, onTheSurface(12000));
    ASSERT_TRUE(made);
    EXPECT_TRUE(made->dependsOnPose());
    ASSERT_EQ(made->expressionNames().size(), 10u);
    // The throat follows the jaw; nothing below it does.
    const float throatM = made->mesh().joints[static_cast<std::size_t>(smplxJointIndex("neck"))].y - 0.08f;
    for (const std::vector<float>& expression :
         {std::vector<float>{1.0f}, std::vector<float>{0.0f, 0.8f, 0, 0, 0.5f}}) {
        Pose pose = restPose(kSmplxJointCount);
        pose.expression = expression;
        Surfels surfels;
        ASSERT_TRUE(made->evaluate(pose, nullptr, surfels).ok());
        ASSERT_TRUE(checkSurfels(surfels).ok());
        EXPECT_LT(distanceToBody(surfels.means, {{}, expression}), 1e-5f);
        float largest = 0.0f;
        for (std::size_t i = 0; i < surfels.count(); ++i) {
            const float moved = glm::distance(surfels.means[i], made->surfels().means[i]);
            largest = std::max(largest, moved);
            const auto& moving = made->movingSurfels();
            if (std::binary_search(moving.begin(), moving.end(), static_cast<std::uint32_t>(i))) {
                EXPECT_GT(made->surfels().means[i].y, throatM) << "surfel " << i;
            } else {
                EXPECT_EQ(surfels.means[i], made->surfels().means[i]);
                EXPECT_EQ(frameOf(surfels, i), frameOf(made->surfels(), i));
            }
        }
        EXPECT_GT(largest, 0.005f);
    }
}

TEST_F(RestBody, NoExpressionGivesTheSurfelsThemselves) {
    const auto made = avatar({1.0f}, onTheSurface(2000));
    ASSERT_TRUE(made);
    Pose none = restPose(kSmplxJointCount), zero = none, bent = none, smiling = none;
    zero.expression.assign(10, 0.0f);
    bent.rotations[18] = quatFromAxisAngle({0.0f, 1.0f, 0.0f});
    smiling.expression = {0.0f, 1.0f};
    for (const Pose& pose : {none, zero, bent}) {
        Surfels surfels;
        ASSERT_TRUE(made->evaluate(pose, nullptr, surfels).ok());
        EXPECT_EQ(surfels.means, made->surfels().means);
        EXPECT_TRUE(made->sameSurfels(none, pose));
    }
    EXPECT_FALSE(made->sameSurfels(none, smiling));
    const auto mesh = created(sphereTemplate(), onTheSurface(500));
    EXPECT_FALSE(mesh->dependsOnPose());
    EXPECT_TRUE(mesh->sameSurfels(none, smiling));
    EXPECT_TRUE(mesh->shapeNames().empty());
}

TEST_F(RestBody, InsetAndTurnFollowTheExpressionOnBothSides) {
    RestAvatarOptions options;
    options.maxSurfels = 8000;
    options.twoSided = true;
    const auto made = avatar({}, options);
    ASSERT_TRUE(made);
    Pose pose = restPose(kSmplxJointCount);
    pose.expression = {1.0f};
    Surfels surfels;
    ASSERT_TRUE(made->evaluate(pose, nullptr, surfels).ok());
    const std::size_t half = surfels.count() / 2;
    for (const std::uint32_t i : made->movingSurfels()) {
        EXPECT_EQ(surfels.means[i], surfels.means[half + i]);
        EXPECT_LT(glm::dot(frameOf(surfels, i)[2], frameOf(surfels, half + i)[2]), -0.999f);
    }
    EXPECT_LT(distanceToBody(surfels.means, {{}, pose.expression}), options.insetM + 1e-4f);
}

TEST_F(RestBody, CoefficientsThatAreNoneAreRefused) {
    const float nan = std::numeric_limits<float>::quiet_NaN();
    for (const float bad : {nan, 2.0f * kMaxShapeCoefficient}) {
        const auto shaped = RestAvatar::create(body(), {0.0f, bad}, onTheSurface(500));
        ASSERT_FALSE(shaped.ok());
        EXPECT_NE(shaped.error().describe().find("shape coefficient 1"), std::string::npos);
    }
    const auto made = avatar({}, onTheSurface(500));
    Pose pose = restPose(kSmplxJointCount);
    pose.expression = {nan};
    Surfels surfels;
    EXPECT_EQ(made->evaluate(pose, nullptr, surfels).error().code, ErrorCode::InvalidArgument);
    const auto mesh = created(sphereTemplate(), onTheSurface(500));
    EXPECT_EQ(mesh->withShape({1.0f}).error().code, ErrorCode::Unsupported);
    EXPECT_EQ(avatar({0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 5.0f}, onTheSurface(500))->surfels().means, made->surfels().means)
        << "coefficients that the body does not have are ignored";
}

} // namespace
} // namespace ars
