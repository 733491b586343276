#include "engine/shade/shading.h"

#include "engine/shade/shading_math.h"
#include "engine/surfel/gbuffer.h"
#include "tests/support/devices.h"
#include "tests/unit/light/light_support.h"

#include <limits>
#include <numbers>

namespace ars {
namespace {

using test::Direction;

/// One picture's worth of inputs in host memory, changed by tests, shaded on any device.
struct Scene {
    int width = 24, height = 16;
    std::vector<float> albedo, roughness, normal, opacity, occlusion, position;
    Camera camera;
    ShadingParams params;
    EnvironmentPlacement placement;

    Scene() {
        camera = lookAtCamera({0.4, 1.2, 3.0}, {0.0, 1.0, 0.0}, 40.0, width, height);
        const std::size_t n = count();
        albedo.assign(3 * n, 0.5f);
        roughness.assign(n, 0.5f);
        normal.assign(3 * n, 0.0f);
        for (std::size_t i = 0; i < n; ++i) normal[3 * i + 2] = -1.0f;
        opacity.assign(n, 1.0f);
    }
    std::size_t count() const { return static_cast<std::size_t>(width) * static_cast<std::size_t>(height); }

    void randomise(unsigned seed) {
        std::mt19937 random(seed);
        std::uniform_real_distribution<float> unit(0.0f, 1.0f);
        std::normal_distribution<float> bell;
        for (float& v : albedo) v = unit(random);
        for (float& v : roughness) v = 0.02f + 1.1f * unit(random);
        for (float& v : opacity) v = unit(random);
        occlusion.resize(count());
        for (float& v : occlusion) v = unit(random);
        for (std::size_t i = 0; i < count(); ++i) {
            const glm::vec3 n = glm::normalize(glm::vec3(bell(random), bell(random), -1.0f - std::fabs(bell(random))));
            for (int c = 0; c < 3; ++c) normal[3 * i + static_cast<std::size_t>(c)] = n[c];
        }
    }
};

struct Shaded {
    std::vector<float> beauty, diffuse, specular, unoccluded;
};

Result<Shaded> run(const Device& device, const Scene& scene, const PrefilteredLight& light) {
    const int w = scene.width, h = scene.height;
    ShadingInputs inputs;
    std::vector<PixelBuffer> kept;
    const auto in = [&](const std::vector<float>& values, int channels) {
        if (values.empty()) return ImageView<const float>{};
        kept.push_back(test::upload(device, values, w, h, channels));
        return std::as_const(kept.back()).view();
    };
    inputs.albedo = in(scene.albedo, 3);
    inputs.roughness = in(scene.roughness, 1);
    inputs.normal = in(scene.normal, 3);
    inputs.opacity = in(scene.opacity, 1);
    inputs.occlusion = in(scene.occlusion, 1);
    inputs.position = in(scene.position, 3);
    inputs.camera = scene.camera;
    inputs.light = light.view(scene.placement);
    ARS_TRY(PixelBuffer beauty, PixelBuffer::allocate(device, w, h, 4, "test"));
    ARS_TRY(PixelBuffer diffuse, PixelBuffer::allocate(device, w, h, 3, "test"));
    ARS_TRY(PixelBuffer specular, PixelBuffer::allocate(device, w, h, 3, "test"));
    ARS_TRY(PixelBuffer unoccluded, PixelBuffer::allocate(device, w, h, 3, "test"));
    ARS_TRY_STATUS(
        shade(device, scene.params, inputs, {beauty.view(), diffuse.view(), specular.view(), unoccluded.view()}));
    return Shaded{test::download(beauty), test::download(diffuse), test::download(specular),
                  test::download(unoccluded)};
}

CubeMap whiteCube() {
    return test::cubeOf(64, [](const Direction&) { return glm::dvec3(1.0); });
}

/// The camera ray of a pixel, towards the camera, in camera space.
glm::dvec3 toCamera(const Scene& scene, std::size_t i) {
    const double u = static_cast<double>(i % static_cast<std::size_t>(scene.width)) + 0.5;
    const double v = static_cast<double>(i / static_cast<std::size_t>(scene.width)) + 0.5;
    return -glm::normalize(scene.camera.ray(u, v));
}

// L1: under light of 1 from everywhere the colour is a + F0 A + B.
TEST(Shading, WhiteFurnaceIsAlbedoPlusSplitSum) {
    for (const Device& device : test::devicesUnderTest()) {
        const PrefilteredLight light = test::filtered(device, whiteCube());
        Scene scene;
        scene.randomise(1);
        scene.occlusion.clear();
        const auto shaded = run(device, scene, light);
        ASSERT_TRUE(shaded.ok()) << shaded.error().describe();
        for (std::size_t i = 0; i < scene.count(); ++i) {
            if (scene.opacity[i] < kMinOpacity) continue;
            const glm::dvec3 n(scene.normal[3 * i], scene.normal[3 * i + 1], scene.normal[3 * i + 2]);
            const double nov = std::max(glm::dot(n, toCamera(scene, i)), 1e-4);
            if (nov < 0.05) continue; // the table is too coarse at its grazing edge for this tolerance
            double a = 0.0, b = 0.0;
            splitSumEntry(nov, std::clamp(double(scene.roughness[i]), 0.08, 1.0), 96, a, b);
            for (std::size_t c = 0; c < 3; ++c) {
                EXPECT_NEAR(shaded->diffuse[3 * i + c], scene.albedo[3 * i + c], 3e-4f);
                EXPECT_NEAR(shaded->specular[3 * i + c], 0.04 * a + b, 5e-3);
            }
        }
    }
}

TEST(Shading, WithoutAlbedoAndReflectanceTheFurnaceGivesB) {
    Scene scene;
    scene.albedo.assign(scene.albedo.size(), 0.0f);
    scene.roughness.assign(scene.count(), 1.0f);
    for (const float f0 : {0.0f, 1.0f}) {
        scene.params.f0 = f0;
        const auto shaded = run({}, scene, test::filtered({}, whiteCube()));
        ASSERT_TRUE(shaded.ok());
        const std::size_t middle = scene.count() / 2 + 12;
        // n.v is 1 here; the reference's A + B is 0.309.
        EXPECT_NEAR(shaded->beauty[4 * middle], f0 == 0.0f ? 0.0 : 0.309, 4e-3);
    }
}

// L8.
TEST(Shading, AMirrorThatLooksAtTheLitFaceShowsItsLight) {
    const CubeMap base = test::cubeOf(
        64, [](const Direction& d) { return glm::dvec3(d.z > std::max(std::fabs(d.x), std::fabs(d.y)) ? 3.0 : 0.0); });
    for (const Device& device : test::devicesUnderTest()) {
        const PrefilteredLight light = test::filtered(device, base);
        Scene scene;
        // A camera on +x that looks along -x; normals half-way between +x and +z mirror it to +z.
        scene.camera = lookAtCamera({3.0, 0.0, 0.0}, {0.0, 0.0, 0.0}, 5.0, scene.width, scene.height);
        const glm::dvec3 n = scene.camera.rotation * glm::normalize(glm::dvec3(1.0, 0.0, 1.0));
        scene.albedo.assign(scene.albedo.size(), 0.0f);
        scene.roughness.assign(scene.count(), 0.0f); // clamped to 0.08
        for (std::size_t i = 0; i < scene.normal.size(); ++i)
            scene.normal[i] = static_cast<float>(n[static_cast<int>(i % 3)]);
        const auto shaded = run(device, scene, light);
        ASSERT_TRUE(shaded.ok());
        const std::size_t middle = scene.count() / 2 + 12;
        double a = 0.0, b = 0.0;
        splitSumEntry(std::sqrt(0.5), 0.08, 96, a, b);
        EXPECT_NEAR(shaded->specular[3 * middle], 3.0 * (0.04 * a + b), 2e-3);
        // The light turned away by half a turn: black.
        scene.placement.rotationDeg = 180.0f;
        EXPECT_NEAR(run(device, scene, light)->specular[3 * middle], 0.0, 1e-6);
    }
}

TEST(Shading, ALightInFrontTurnedByNinetyLightsTheBodysLeft) {
    const CubeMap base = test::cubeOf(64, [](const Direction& d) { return glm::dvec3(d.z > 0.9 ? 10.0 : 0.0); });
    const PrefilteredLight light = test::filtered({}, base);
    Scene scene;
    scene.camera = lookAtCamera({0.0, 0.0, 3.0}, {0.0, 0.0, 0.0}, 30.0, scene.width, scene.height);
    for (std::size_t i = 0; i < scene.count(); ++i) {
        // Left half: normals to world +x; right half: to -x; both lean towards the camera a little.
        const bool left = i % 2 == 0;
        const glm::dvec3 n = scene.camera.rotation * glm::normalize(glm::dvec3(left ? 1.0 : -1.0, 0.0, 0.2));
        for (int c = 0; c < 3; ++c) scene.normal[3 * i + static_cast<std::size_t>(c)] = static_cast<float>(n[c]);
    }
    scene.placement.rotationDeg = 90.0f;
    const auto shaded = run({}, scene, light);
    ASSERT_TRUE(shaded.ok());
    EXPECT_GT(shaded->diffuse[0], 0.1f);
    EXPECT_NEAR(shaded->diffuse[3], 0.0f, 1e-6f);
}

/// The whole formula once more in double, written with other tools: explicit mirror, clamps and lookups.
TEST(Shading, EqualsTheFormulaInDoubleOnEveryDevice) {
    const CubeMap base = test::randomCube(64, 17);
    for (const Device& device : test::devicesUnderTest()) {
        const PrefilteredLight light = test::filtered(device, base);
        const test::HostLight<double> host(light);
        Scene scene;
        scene.randomise(5);
        scene.placement.rotationDeg = 37.0f;
        scene.placement.scale = 1.7f;
        for (const bool occludeSpecular : {true, false}) {
            scene.params.occludeSpecular = occludeSpecular;
            const auto shaded = run(device, scene, light);
            ASSERT_TRUE(shaded.ok());
            const double angle = 37.0 * std::numbers::pi / 180.0;
            const auto toEnvironment = [&](const glm::dvec3& camera) {
                const glm::dvec3 w = glm::inverse(scene.camera.rotation) * camera;
                return glm::dvec3(std::cos(angle) * w.x - std::sin(angle) * w.z, w.y,
                                  std::sin(angle) * w.x + std::cos(angle) * w.z);
            };
            double worst = 0.0;
            for (std::size_t i = 0; i < scene.count(); ++i) {
                if (scene.opacity[i] < kMinOpacity) continue;
                const glm::dvec3 n =
                    glm::normalize(glm::dvec3(scene.normal[3 * i], scene.normal[3 * i + 1], scene.normal[3 * i + 2]));
                const glm::dvec3 v = toCamera(scene, i);
                const double cosine = std::max(glm::dot(n, v), 0.0);
                const glm::dvec3 mirror =
                    glm::reflect(-v, n) + (cosine > 0.0 ? glm::dvec3(0.0) : 2.0 * glm::dot(n, v) * -n);
                const double roughness = std::clamp(double(scene.roughness[i]), 0.08, 1.0);
                const glm::dvec2 ab = lookupSplitSum(host.view.lut, 256, std::clamp(cosine, 1e-4, 1.0), roughness);
                const glm::dvec3 specular =
                    1.7 * (0.04 * ab.x + ab.y) * lookupSpecular(host.view, toEnvironment(mirror), roughness);
                const glm::dvec3 albedo(scene.albedo[3 * i], scene.albedo[3 * i + 1], scene.albedo[3 * i + 2]);
                const glm::dvec3 diffuse = 1.7 * albedo * lookupIrradiance(host.view, toEnvironment(n));
                const double o = scene.occlusion[i], os = occludeSpecular ? o : 1.0, alpha = scene.opacity[i];
                for (std::size_t c = 0; c < 3; ++c) {
                    const double d = diffuse[static_cast<int>(c)], s = specular[static_cast<int>(c)];
                    const double scale = 1.0 + d + s;
                    worst = std::max(worst, std::fabs(shaded->diffuse[3 * i + c] - o * d) / scale);
                    worst = std::max(worst, std::fabs(shaded->specular[3 * i + c] - os * s) / scale);
                    worst = std::max(worst, std::fabs(shaded->unoccluded[3 * i + c] - (d + s)) / scale);
                    worst = std::max(worst, std::fabs(shaded->beauty[4 * i + c] - alpha * (o * d + os * s)) / scale);
                }
                EXPECT_EQ(shaded->beauty[4 * i + 3], scene.opacity[i]);
            }
            // Float directions are off by 1e-7, and this random light changes by its own size within 1/32.
            EXPECT_LT(worst, 3e-4);
        }
    }
}

TEST(Shading, PositionsOnThePixelsRayGiveTheSamePicture) {
    const PrefilteredLight light = test::filtered({}, test::randomCube(64, 18));
    Scene scene;
    scene.randomise(6);
    const auto byRay = run({}, scene, light);
    scene.position.resize(3 * scene.count());
    for (std::size_t i = 0; i < scene.count(); ++i) {
        const glm::dvec3 p = scene.camera.toWorld(-toCamera(scene, i) * (1.0 + 0.01 * static_cast<double>(i)));
        for (int c = 0; c < 3; ++c) scene.position[3 * i + static_cast<std::size_t>(c)] = static_cast<float>(p[c]);
    }
    const auto byPosition = run({}, scene, light);
    ASSERT_TRUE(byRay.ok() && byPosition.ok());
    for (std::size_t i = 0; i < byRay->beauty.size(); ++i) {
        EXPECT_NEAR(byRay->beauty[i], byPosition->beauty[i], 1e-3f * (1.0f + byRay->beauty[i]));
    }
}

TEST(ShadePoint, FloatAndDoubleAgree) {
    const PrefilteredLight light = test::filtered({}, test::randomCube(64, 19));
    const test::HostLight<double> exact(light);
    const test::HostLight<float> single(light);
    std::mt19937 random(2);
    std::normal_distribution<double> bell;
    for (int i = 0; i < 500; ++i) {
        ShadingPoint<double> p{
            {0.3, 0.5, 0.7}, 0.1 + 0.0018 * i, {bell(random), bell(random), -2.0}, {bell(random), 0.2, -1.5}};
        const ShadingPoint<float> q{glm::vec3(p.albedo), float(p.roughness), glm::vec3(p.normal),
                                    glm::vec3(p.toCamera)};
        const auto a = shadePoint(p, exact.view, glm::dmat3(1.0), 0.04);
        const auto b = shadePoint(q, single.view, glm::mat3(1.0f), 0.04f);
        EXPECT_LT(glm::length(a.diffuse - glm::dvec3(b.diffuse)), 1e-4 * (1.0 + glm::length(a.diffuse)));
        EXPECT_LT(glm::length(a.specular - glm::dvec3(b.specular)), 1e-4 * (1.0 + glm::length(a.specular)));
    }
}

TEST(Shading, EmptyAndBrokenPixelsAreBlack) {
    const float nan = std::numeric_limits<float>::quiet_NaN(), inf = std::numeric_limits<float>::infinity();
    for (const Device& device : test::devicesUnderTest()) {
        Scene scene;
        scene.occlusion.assign(scene.count(), 1.0f);
        scene.opacity[0] = 0.0f;
        scene.opacity[1] = nan;
        scene.opacity[2] = inf;
        scene.normal[3 * 3 + 2] = 0.0f;
        scene.normal[3 * 4] = nan;
        scene.normal[3 * 5] = inf;
        scene.albedo[3 * 6] = nan;
        scene.roughness[7] = inf;
        scene.occlusion[8] = nan;
        const auto shaded = run(device, scene, test::filtered(device, whiteCube()));
        ASSERT_TRUE(shaded.ok());
        for (std::size_t i = 0; i < 9; ++i) {
            for (std::size_t c = 0; c < 3; ++c) {
                EXPECT_EQ(shaded->beauty[4 * i + c], 0.0f) << i;
                EXPECT_EQ(shaded->diffuse[3 * i + c], 0.0f) << i;
                EXPECT_EQ(shaded->specular[3 * i + c], 0.0f) << i;
                EXPECT_EQ(shaded->unoccluded[3 * i + c], 0.0f) << i;
            }
            EXPECT_EQ(shaded->beauty[4 * i + 3], i < 3 ? 0.0f : 1.0f) << i;
        }
        EXPECT_GT(shaded->beauty[4 * 9], 0.4f);
    }
}

TEST(Shading, WrongPicturesAreNamed) {
    const PrefilteredLight light = test::filtered({}, whiteCube());
    std::vector<float> memory(64 * 64 * 4, 0.5f);
    const auto view = [&](int w, int h, int c) { return ImageView<const float>{memory.data(), w, h, c}; };
    ShadingInputs inputs;
    inputs.camera = lookAtCamera({0, 0, 3}, {0, 0, 0}, 40.0, 8, 4);
    inputs.albedo = view(8, 4, 3);
    inputs.roughness = view(8, 4, 1);
    inputs.normal = view(8, 4, 3);
    inputs.opacity = view(8, 4, 1);
    inputs.light = light.view();
    std::vector<float> out(8 * 4 * 4);
    ShadingOutputs outputs;
    outputs.beauty = {out.data(), 8, 4, 4};
    EXPECT_TRUE(shade({}, {}, inputs, outputs).ok());
    const auto expectError = [&](const ShadingInputs& bad, const std::string& word) {
        const Status status = shade({}, {}, bad, outputs);
        ASSERT_FALSE(status.ok()) << word;
        EXPECT_EQ(status.error().code, ErrorCode::InvalidArgument);
        EXPECT_NE(status.error().describe().find(word), std::string::npos) << status.error().describe();
    };
    ShadingInputs bad = inputs;
    bad.roughness = view(4, 8, 1);
    expectError(bad, "roughness is 4x8");
    bad = inputs;
    bad.albedo = {};
    expectError(bad, "albedo is missing");
    bad = inputs;
    bad.occlusion = view(8, 4, 3);
    expectError(bad, "occlusion");
    bad = inputs;
    bad.light = {};
    expectError(bad, "light");
    bad = inputs;
    bad.light.scale = std::numeric_limits<float>::quiet_NaN();
    expectError(bad, "scale");
    bad = inputs;
    bad.camera.fx = 0.0;
    expectError(bad, "camera");
    outputs.beauty.channels = 3;
    expectError(inputs, "beauty");
}

} // namespace
} // namespace ars
