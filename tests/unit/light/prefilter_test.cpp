#include "engine/light/environment.h"
#include "engine/light/prefilter_kernels.h"
#include "tests/support/devices.h"
#include "tests/unit/light/light_support.h"

#include <numbers>

namespace ars {
namespace {

using test::Direction;
constexpr double kPi = std::numbers::pi;

CubeMap averaged(const CubeMap& cube) {
    CubeMap half(cube.size / 2);
    for (int face = 0; face < 6; ++face) {
        for (int row = 0; row < half.size; ++row) {
            for (int column = 0; column < half.size; ++column) {
                for (int c = 0; c < 3; ++c) {
                    float sum = 0.0f;
                    for (int k = 0; k < 4; ++k) sum += cube.texel(face, 2 * row + k / 2, 2 * column + k % 2)[c];
                    half.texel(face, row, column)[c] = 0.25f * sum;
                }
            }
        }
    }
    return half;
}

CubeMap averagedTo(CubeMap cube, int side) {
    while (cube.size > side) cube = averaged(cube);
    return cube;
}

/// The definition in double: D_GGX of the half vector times n.w dw / 4 inside the cone, divided by its sum.
glm::dvec3 bruteForceSpecular(const CubeMap& source, const Direction& n, double roughness, double cutoff) {
    const std::vector<float> areas = texelSolidAngles(source.size);
    const double alpha2 = std::pow(roughness, 4.0);
    glm::dvec3 sum(0.0);
    double weights = 0.0;
    for (int face = 0; face < 6; ++face) {
        for (int i = 0; i < source.size * source.size; ++i) {
            const Direction w = test::texelDirection(face, i / source.size, i % source.size, source.size);
            const double cosine = glm::dot(n, w);
            if (cosine < cutoff) continue;
            const double noh = glm::dot(n, glm::normalize(n + w));
            const double d = (noh * alpha2 - noh) * noh + 1.0;
            const double weight = cosine * alpha2 / (kPi * d * d) * double(areas[static_cast<std::size_t>(i)]) / 4.0;
            const float* texel = source.texel(face, i / source.size, i % source.size);
            sum += weight * glm::dvec3(texel[0], texel[1], texel[2]);
            weights += weight;
        }
    }
    return sum / weights;
}

glm::dvec3 bruteForceDiffuse(const CubeMap& source, const Direction& n) {
    const std::vector<float> areas = texelSolidAngles(source.size);
    glm::dvec3 sum(0.0);
    for (int face = 0; face < 6; ++face) {
        for (int i = 0; i < source.size * source.size; ++i) {
            const Direction w = test::texelDirection(face, i / source.size, i % source.size, source.size);
            const float* texel = source.texel(face, i / source.size, i % source.size);
            sum += glm::dvec3(texel[0], texel[1], texel[2]) * std::clamp(glm::dot(n, w), 0.0, 0.999) *
                   double(areas[static_cast<std::size_t>(i)]) / kPi;
        }
    }
    return sum;
}

glm::dvec3 texelOf(const std::vector<float>& level, int side, int face, int row, int column) {
    const std::size_t i = 3 * static_cast<std::size_t>((face * side + row) * side + column);
    return {level[i], level[i + 1], level[i + 2]};
}

TEST(Prefilter, CutoffsAreThoseOfTheReference) {
    const double known[][2] = {{.08, .999767},  {.185, .993212}, {.29, .955017},
                               {.395, .805819}, {.5, .446214},   {1, .015706}};
    for (const auto& k : known) EXPECT_NEAR(specularCutoffCosine(k[0]), k[1], 2e-6) << k[0];
}

TEST(Prefilter, EveryLevelEqualsTheDefinitionInDouble) {
    const CubeMap base = test::randomCube(64, 7);
    for (const Device& device : test::devicesUnderTest()) {
        for (const LightQuality quality : {LightQuality::Exact, LightQuality::Draft}) {
            PrefilterParams params;
            params.quality = quality;
            const PrefilteredLight light = test::filtered(device, base, params);
            ASSERT_EQ(light.levels, 3);
            std::mt19937 random(5);
            for (int l = 0; l < light.levels; ++l) {
                const PixelBuffer& picture = light.specular[static_cast<std::size_t>(l)];
                const int side = picture.width();
                const CubeMap source = averagedTo(base, side);
                const std::vector<float> level = test::download(picture);
                const double roughness = levelRoughness<double>(l, light.levels);
                std::uniform_int_distribution<int> place(0, side - 1);
                for (int k = 0; k < 60; ++k) {
                    const int row = place(random), column = place(random), face = k % 6;
                    const glm::dvec3 expected =
                        bruteForceSpecular(source, test::texelDirection(face, row, column, side), roughness,
                                           specularCutoffCosine(roughness));
                    const glm::dvec3 found = texelOf(level, side, face, row, column);
                    // Texels on the cone's border may fall to either side by rounding; each is a thousandth at most.
                    EXPECT_LT(glm::length(found - expected) / glm::length(expected), 1e-3) << "level " << l;
                }
            }
            const CubeMap source = averagedTo(base, 16);
            const std::vector<float> diffuse = test::download(light.diffuse);
            for (int k = 0; k < 60; ++k) {
                const glm::dvec3 expected = bruteForceDiffuse(source, test::texelDirection(k % 6, k / 4, k % 16, 16));
                EXPECT_LT(glm::length(texelOf(diffuse, 16, k % 6, k / 4, k % 16) - expected),
                          2e-6 * glm::length(expected));
            }
        }
    }
}

TEST(Prefilter, ADraftIsWithinAFewPercentOfTheExactLight) {
    // A sky-like picture: a smooth dome, an edge at the horizon and a disc of five degrees, 300 times brighter.
    const CubeMap base = test::cubeOf(256, [](const Direction& d) {
        const double sky = d.y > 0.0 ? 0.5 + 0.5 * d.y : 0.2;
        return glm::dvec3(glm::dot(d, glm::normalize(Direction(1, 2, 2))) > std::cos(0.0436) ? 300.0 : sky);
    });
    PrefilterParams params;
    const PrefilteredLight exact = test::filtered({}, base, params);
    params.quality = LightQuality::Draft;
    const PrefilteredLight draft = test::filtered({}, base, params);
    const LightView<float> a = exact.view(), b = draft.view();
    std::mt19937 random(3);
    std::normal_distribution<float> bell;
    for (const float roughness : {0.2f, 0.4f, 0.6f, 1.0f}) {
        double difference = 0.0, sum = 0.0;
        for (int i = 0; i < 5000; ++i) {
            const glm::vec3 d(bell(random), bell(random), bell(random));
            const double x = double(lookupSpecular(a, d, roughness).x), y = double(lookupSpecular(b, d, roughness).x);
            difference += (x - y) * (x - y);
            sum += x * x;
        }
        EXPECT_LT(std::sqrt(difference / sum), 0.05) << roughness;
    }
}

TEST(Prefilter, SaysWhatQualityItHolds) {
    const CubeMap base = test::randomCube(128, 8);
    PrefilterParams params;
    EXPECT_EQ(test::filtered({}, base, params).quality, LightQuality::Exact);
    params.quality = LightQuality::Draft;
    const PrefilteredLight draft = test::filtered({}, base, params);
    EXPECT_EQ(draft.quality, LightQuality::Draft);
    const int sides[4] = {64, 32, 16, 16};
    for (std::size_t l = 0; l < 4; ++l) EXPECT_EQ(draft.specular[l].width(), sides[l]);
    EXPECT_EQ(lightQualityName(draft.quality), "draft");
}

// L1.
TEST(Prefilter, WhiteFurnaceIsWhite) {
    const CubeMap base = test::cubeOf(64, [](const Direction&) { return glm::dvec3(1.0); });
    for (const Device& device : test::devicesUnderTest()) {
        const PrefilteredLight light = test::filtered(device, base);
        for (int l = 0; l < light.levels; ++l) {
            for (const float v : test::download(light.specular[static_cast<std::size_t>(l)]))
                EXPECT_NEAR(v, 1.0f, 1e-5f);
        }
        for (const float v : test::download(light.diffuse)) EXPECT_NEAR(v, 1.0f, 2e-4f);
    }
}

// L1 with the areas of nvdiffrec: 1.047 to 1.116, mean 1.080.
TEST(Prefilter, TheParityAreasGiveTheirMeasuredExcess) {
    const CubeMap base = test::cubeOf(64, [](const Direction&) { return glm::dvec3(1.0); });
    PrefilterParams params;
    params.area = TexelArea::Nvdiffrec;
    for (const Device& device : test::devicesUnderTest()) {
        const PrefilteredLight light = test::filtered(device, base, params);
        const std::vector<float> diffuse = test::download(light.diffuse);
        double mean = 0.0;
        float low = 9.0f, high = 0.0f;
        for (const float v : diffuse) {
            mean += double(v) / double(diffuse.size());
            low = std::min(low, v);
            high = std::max(high, v);
        }
        EXPECT_NEAR(mean, 1.080, 3e-3);
        EXPECT_NEAR(low, 1.047f, 3e-3f);
        EXPECT_NEAR(high, 1.116f, 3e-3f);
        for (const float v : test::download(light.specular[0])) EXPECT_NEAR(v, 1.0f, 1e-5f);
    }
}

// L2.
TEST(Prefilter, OneTexelOfLightGivesLambertsCosine) {
    CubeMap base(64);
    // A block of 4 x 4 texels of the base is one texel of the 16 x 16 map that irradiance is computed from.
    for (int i = 0; i < 16; ++i) base.texel(4, 20 + i / 4, 36 + i % 4)[0] = 10.0f;
    const Direction w = test::texelDirection(4, 5, 9, 16);
    const double solidAngle = double(texelSolidAngles(16)[5 * 16 + 9]);
    for (const Device& device : test::devicesUnderTest()) {
        const std::vector<float> diffuse = test::download(test::filtered(device, base).diffuse);
        for (int i = 0; i < 6 * 256; ++i) {
            const Direction n = test::texelDirection(i / 256, i / 16 % 16, i % 16, 16);
            const double expected = 10.0 * std::clamp(glm::dot(n, w), 0.0, 0.999) * solidAngle / kPi;
            EXPECT_NEAR(diffuse[3 * static_cast<std::size_t>(i)], expected, 1e-6 * 10.0 * solidAngle);
        }
    }
}

// L3: E(n) = 1 + 2/3 n_y. The map of 16 x 16 integrates it to a few parts in a thousand.
TEST(Prefilter, LinearLightGivesTwoThirdsOfItsSlope) {
    const CubeMap base = test::cubeOf(64, [](const Direction& d) { return glm::dvec3(1.0 + d.y); });
    for (const Device& device : test::devicesUnderTest()) {
        const std::vector<float> diffuse = test::download(test::filtered(device, base).diffuse);
        for (int i = 0; i < 6 * 256; ++i) {
            const Direction n = test::texelDirection(i / 256, i / 16 % 16, i % 16, 16);
            EXPECT_NEAR(diffuse[3 * static_cast<std::size_t>(i)], 1.0 + 2.0 / 3.0 * n.y, 3e-3);
        }
    }
}

TEST(Prefilter, IsLinearInTheLight) {
    const CubeMap x = test::randomCube(64, 1), y = test::randomCube(64, 2);
    CubeMap both(64);
    for (std::size_t i = 0; i < both.texels.size(); ++i) both.texels[i] = 2.0f * x.texels[i] + 0.25f * y.texels[i];
    for (const Device& device : test::devicesUnderTest()) {
        const PrefilteredLight a = test::filtered(device, x), b = test::filtered(device, y),
                               c = test::filtered(device, both);
        const auto check = [](const PixelBuffer& pa, const PixelBuffer& pb, const PixelBuffer& pc) {
            const std::vector<float> va = test::download(pa), vb = test::download(pb), vc = test::download(pc);
            for (std::size_t i = 0; i < va.size(); ++i) {
                const float expected = 2.0f * va[i] + 0.25f * vb[i];
                ASSERT_NEAR(vc[i], expected, 1e-5f * expected);
            }
        };
        for (std::size_t l = 0; l < 3; ++l) check(a.specular[l], b.specular[l], c.specular[l]);
        check(a.diffuse, b.diffuse, c.diffuse);
    }
}

TEST(Prefilter, InstructionSetsAgree) {
    using Set = cpu::FilterInstructions;
    const CubeMap base = test::randomCube(64, 9);
    ASSERT_TRUE(cpu::useFilterInstructions(Set::Portable));
    const PrefilteredLight portable = test::filtered({}, base);
    for (const Set set : {Set::Avx2, Set::Avx512}) {
        if (!cpu::useFilterInstructions(set)) {
            std::printf("NOT RUN: instruction set %d: this machine has not got it\n", static_cast<int>(set));
            continue;
        }
        const PrefilteredLight light = test::filtered({}, base);
        const auto check = [](const PixelBuffer& a, const PixelBuffer& b, float tolerance) {
            const std::vector<float> x = test::download(a), y = test::download(b);
            for (std::size_t i = 0; i < x.size(); ++i) ASSERT_NEAR(x[i], y[i], tolerance * x[i]);
        };
        // Fused multiply-add moves texels across the cone's border.
        for (std::size_t l = 0; l < 3; ++l) check(portable.specular[l], light.specular[l], 1e-3f);
        check(portable.diffuse, light.diffuse, 1e-5f);
    }
    EXPECT_TRUE(cpu::useFilterInstructions(Set::Best));
}

TEST(Prefilter, BlackLightIsBlackAndARefilteredLightKeepsItsMemory) {
    PrefilteredLight light;
    ASSERT_TRUE(prefilterLight({}, CubeMap(64), {}, light).ok());
    for (const float v : test::download(light.specular[1])) EXPECT_EQ(v, 0.0f);
    for (const float v : test::download(light.diffuse)) EXPECT_EQ(v, 0.0f);
    const float* before = std::as_const(light.specular[0]).view().data;
    ASSERT_TRUE(prefilterLight({}, test::randomCube(64, 4), {}, light).ok());
    EXPECT_EQ(std::as_const(light.specular[0]).view().data, before);
}

TEST(Prefilter, RefusesBasesThatAreNoCubes) {
    PrefilteredLight light;
    for (const int side : {0, 1, 32, 96}) {
        const Status status = prefilterLight({}, CubeMap(side), {}, light);
        ASSERT_FALSE(status.ok()) << side;
        EXPECT_EQ(status.error().code, ErrorCode::InvalidArgument);
    }
    const CubeMap good(64);
    EXPECT_FALSE(prefilterLight({}, ImageView<const float>{good.texels.data(), 64, 64, 3}, {}, light).ok());
    EXPECT_FALSE(prefilterLight({}, ImageView<const float>{good.texels.data(), 64, 384, 4}, {}, light).ok());
}

// L8: a sharp mirror that looks into the +z face sees its light alone.
TEST(Prefilter, TheSharpestLevelKeepsAFaceWhite) {
    const CubeMap base = test::cubeOf(
        64, [](const Direction& d) { return glm::dvec3(d.z > std::max(std::fabs(d.x), std::fabs(d.y)) ? 3.0 : 0.0); });
    for (const Device& device : test::devicesUnderTest()) {
        const test::HostLight<double> light(test::filtered(device, base));
        for (const double x : {-0.7, 0.0, 0.5}) {
            const glm::dvec3 found = lookupSpecular(light.view, glm::dvec3(x, 0.1, 1.0), 0.08);
            EXPECT_NEAR(found.x, 3.0, 1e-4);
        }
        EXPECT_NEAR(lookupSpecular(light.view, glm::dvec3(0.0, 1.0, 0.2), 0.08).x, 0.0, 1e-6);
    }
}

// The placement turns the light, not the filter: the same lookup as in a light whose picture was turned.
TEST(Prefilter, PlacementTurnsAndScalesTheLight) {
    const auto sun = [](const Direction& towards) {
        return
            [towards](const Direction& d) { return glm::dvec3(std::pow(std::max(glm::dot(d, towards), 0.0), 20.0)); };
    };
    const PrefilteredLight front = test::filtered({}, test::cubeOf(64, sun({0, 0, 1})));
    const PrefilteredLight left = test::filtered({}, test::cubeOf(64, sun({1, 0, 0})));
    EnvironmentPlacement placement;
    placement.rotationDeg = 90.0f;
    placement.scale = 2.0f;
    const LightView<float> turned = front.view(placement), expected = left.view();
    EXPECT_EQ(turned.scale, 2.0f);
    for (const glm::vec3& d : {glm::vec3(1, 0, 0), glm::vec3(1, 0.2f, -0.3f), glm::vec3(0.5f, -0.5f, 0.5f)}) {
        EXPECT_NEAR(lookupSpecular(turned, turned.worldToEnvironment * d, 0.3f).x,
                    lookupSpecular(expected, expected.worldToEnvironment * d, 0.3f).x, 1e-4f);
        EXPECT_NEAR(lookupIrradiance(turned, turned.worldToEnvironment * d).x,
                    lookupIrradiance(expected, expected.worldToEnvironment * d).x, 1e-4f);
    }
}

} // namespace
} // namespace ars
