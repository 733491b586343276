// The filters are linear; their backward must be their exact transpose.
#include "engine/light/prefilter_gradient.h"

#include "engine/light/prefilter_gradient_kernels.h"
#include "tests/support/devices.h"
#include "tests/unit/light/light_support.h"

#include <cmath>
#include <random>
#include <tuple>
#include <utility>
#include <vector>

namespace ars {
namespace {

std::vector<float> randomNumbers(std::size_t count, unsigned seed) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<float> unit(0.0f, 1.0f);
    std::vector<float> values(count);
    for (float& v : values) v = unit(random);
    return values;
}

double dot(const float* a, const std::vector<float>& b) {
    double sum = 0.0;
    for (std::size_t i = 0; i < b.size(); ++i) sum += static_cast<double>(a[i]) * b[i];
    return sum;
}

/// dL/dBase from levels in host memory, on any device.
std::vector<float> backwardOn(const Device& device, int side, const PrefilterParams& params,
                              const LightLevelGradients& levels) {
    std::vector<PixelBuffer> kept;
    LightLevelViews<const float> views;
    views.levels = levels.levels;
    const auto cube = [&](const std::vector<float>& values, int width) {
        kept.push_back(test::upload(device, values, width, 6 * width, 3));
        return std::as_const(kept.back()).view();
    };
    for (int l = 0; l < levels.levels; ++l) {
        const auto level = static_cast<std::size_t>(l);
        views.specular[level] = cube(levels.specular[level], side >> l);
    }
    views.diffuse = cube(levels.diffuse, kSmallestLightLevel);
    const std::size_t count = static_cast<std::size_t>(18 * side * side);
    PixelBuffer base = test::upload(device, std::vector<float>(count, 7.0f), side, 6 * side, 3);
    PrefilterGradientWorkspace workspace;
    const Status status = prefilterLightBackward(device, side, params, views, base.view(), workspace);
    EXPECT_TRUE(status.ok()) << status.error().describe();
    return test::download(base);
}

class PrefilterGradient : public ::testing::TestWithParam<std::pair<int, TexelArea>> {};

/// <A x, y> = <x, A^T y> for random x and y, each level by itself and all together.
TEST_P(PrefilterGradient, IsTheTranspose) {
    const int side = GetParam().first;
    const PrefilterParams params{.area = GetParam().second};
    CubeMap base;
    base.size = side;
    base.texels = randomNumbers(static_cast<std::size_t>(18 * side * side), 1);
    PrefilteredLight light;
    ASSERT_TRUE(prefilterLight({}, base, params, light).ok());
    const LightView<float> view = light.view();
    const std::vector<Device> devices = test::devicesUnderTest();
    for (int only = -1; only <= light.levels; ++only) { // -1: all; `levels`: the diffuse cube
        LightLevelGradients y;
        y.reset(view);
        double forward = 0.0;
        for (int l = 0; l < light.levels; ++l) {
            if (only >= 0 && only != l) continue;
            auto& level = y.specular[static_cast<std::size_t>(l)];
            level = randomNumbers(level.size(), static_cast<unsigned>(7 + l));
            forward += dot(view.specular[l].texels, level);
        }
        if (only < 0 || only == light.levels) {
            y.diffuse = randomNumbers(y.diffuse.size(), 99);
            forward += dot(view.diffuse.texels, y.diffuse);
        }
        for (const Device& device : devices) {
            const double backward = dot(base.texels.data(), backwardOn(device, side, params, y));
            // Float sums over thousands of texels, and cones whose edge rounding decides.
            EXPECT_NEAR(backward / forward, 1.0, 2e-5) << "level " << only << " on " << deviceName(device);
        }
    }
}

INSTANTIATE_TEST_SUITE_P(Bases, PrefilterGradient,
                         ::testing::Values(std::pair{64, TexelArea::Exact}, std::pair{64, TexelArea::Nvdiffrec},
                                           std::pair{128, TexelArea::Exact}));

/// One texel at a time against differences: the transpose of single rows, not of sums alone.
TEST(PrefilterGradient, SingleTexelsEqualDifferences) {
    constexpr int kSide = 64;
    CubeMap base;
    base.size = kSide;
    base.texels = randomNumbers(18 * kSide * kSide, 3);
    PrefilteredLight light;
    ASSERT_TRUE(prefilterLight({}, base, {}, light).ok());
    LightLevelGradients y;
    y.reset(light.view());
    y.specular[1] = randomNumbers(y.specular[1].size(), 5);
    y.diffuse = randomNumbers(y.diffuse.size(), 6);
    const std::vector<float> gradient = backwardOn({}, kSide, {}, y);
    const auto loss = [&] {
        EXPECT_TRUE(prefilterLight({}, base, {}, light).ok());
        return dot(light.view().specular[1].texels, y.specular[1]) + dot(light.view().diffuse.texels, y.diffuse);
    };
    const double before = loss();
    for (const std::size_t texel : {0u, 1234u, 40000u, 73727u}) {
        const float kept = base.texels[texel];
        base.texels[texel] = kept + 100.0f; // linear: a large step drowns the rounding
        EXPECT_NEAR(gradient[texel], (loss() - before) / 100.0, 2e-4 * std::abs(gradient[texel]) + 1e-5);
        base.texels[texel] = kept;
    }
}

/// One level of random numbers and what its adjoint needs, as CUDA is given it.
struct Level {
    int side, lanes;
    std::vector<float> source, areas, scales, target;
    AdjointArguments arguments;

    Level(int side_, double roughness, int lanes_)
        : side(side_), lanes(lanes_), source(randomNumbers(static_cast<std::size_t>(18 * side * side), 11)),
          areas(texelSolidAngles(side)), scales(static_cast<std::size_t>(6 * side * side)),
          target(source.size(), 7.0f) {
        arguments.source = source.data();
        arguments.target = target.data();
        arguments.areas = areas.data();
        arguments.size = side;
        arguments.alphaSquared = static_cast<float>(roughness * roughness * roughness * roughness);
        arguments.cutoffCosine = static_cast<float>(specularCutoffCosine(roughness));
        for (std::size_t i = 0; i < arguments.texels(); ++i) {
            float sum = 0.0f;
            for (int lane = 0; lane < lanes; ++lane) sum += specularWeightsPart(arguments, i, lane, lanes);
            scales[i] = 1.0f / sum;
        }
        arguments.scales = scales.data();
    }
    template <typename Part>
    void run(const Part& part) {
        for (std::size_t i = 0; i < arguments.texels(); ++i) {
            glm::vec3 sum(0.0f);
            for (int lane = 0; lane < lanes; ++lane) sum += part(arguments, i, lane, lanes);
            writeAdjoint(arguments, i, sum);
        }
    }
    FilterArguments filter(std::vector<float>& result) const {
        result.resize(source.size());
        return {{source.data(), side, 6 * side, 3},
                {result.data(), side, 6 * side, 3},
                arguments.alphaSquared,
                arguments.cutoffCosine,
                TexelArea::Exact,
                nullptr};
    }
};

/// What the lanes of the CUDA form sum, in a loop on the host, against the processor's form: all but the shuffles.
TEST(PrefilterGradientThreads, LanesGiveTheProcessorsSpecularAdjoint) {
    // A cone within faces, one across edges, and the widest; one lane and a warp's.
    const std::tuple<int, double, int> cases[]{{32, 0.08, 1}, {32, 0.29, 32}, {16, 0.5, 32}, {16, 1.0, 1}};
    for (const auto& [side, roughness, lanes] : cases) {
        Level level(side, roughness, lanes);
        level.run(specularAdjointPart);
        std::vector<float> expected;
        cpu::filterSpecularAdjoint(level.filter(expected));
        for (std::size_t i = 0; i < expected.size(); ++i) {
            // Texels on the cone's border may fall to either side by rounding; each is a thousandth at most.
            ASSERT_NEAR(level.target[i], expected[i], 1e-3f * expected[i] + 1e-7f) << side << " " << roughness;
        }
    }
}

TEST(PrefilterGradientThreads, LanesAddTheProcessorsDiffuseAdjoint) {
    Level level(kSmallestLightLevel, 1.0, 32);
    level.arguments.add = true;
    level.run(diffuseAdjointPart);
    std::vector<float> expected;
    cpu::filterDiffuseAdjoint(level.filter(expected));
    for (std::size_t i = 0; i < expected.size(); ++i) {
        ASSERT_NEAR(level.target[i] - 7.0f, expected[i], 2e-4f * expected[i] + 2e-6f);
    }
}

TEST(PrefilterGradientThreads, AveragesPassAQuarterToEachOfFour) {
    const std::vector<float> smaller = randomNumbers(18 * 2 * 2, 3);
    std::vector<float> larger(18 * 4 * 4, 1.0f);
    for (std::size_t row = 0; row < 24; ++row) {
        for (std::size_t column = 0; column < 4; ++column)
            addAverageBackward(smaller.data(), larger.data(), 4, row, column);
    }
    for (std::size_t face = 0; face < 6; ++face) {
        for (std::size_t k = 0; k < 16; ++k) {
            const std::size_t to = 3 * (16 * face + k), from = 3 * (4 * face + k / 8 * 2 + k % 4 / 2);
            for (std::size_t c = 0; c < 3; ++c) EXPECT_EQ(larger[to + c], 1.0f + 0.25f * smaller[from + c]);
        }
    }
}

TEST(PrefilterGradient, WrongSizesAreNamed) {
    LightLevelGradients levels;
    std::vector<float> gradient(18 * 64 * 64);
    PrefilterGradientWorkspace workspace;
    const auto message = [&](int side) {
        const Status status =
            prefilterLightBackward({}, side, {}, levels.view(), {gradient.data(), side, 6 * side, 3}, workspace);
        return status.ok() ? std::string("no error") : status.error().describe();
    };
    EXPECT_EQ(message(64), "light gradient: 0 levels and a 64x384x3 base, expected those of a base of side 64");
    levels.levels = 3;
    levels.specular = {std::vector<float>(18 * 64 * 64), std::vector<float>(18 * 32 * 32), std::vector<float>(17)};
    EXPECT_EQ(message(64), "light gradient: the specular 2 level is 0x0 with 1 channels, expected 16x96 with 3");
    levels.specular[2].resize(18 * 16 * 16);
    EXPECT_EQ(message(64), "light gradient: the diffuse level is 0x0 with 1 channels, expected 16x96 with 3");
    levels.diffuse.resize(18 * 16 * 16);
    EXPECT_EQ(message(64), "no error");
    const Status refused =
        prefilterLightBackward({DeviceKind::Cuda, 99}, 64, {}, levels.view(), {gradient.data(), 64, 384, 3}, workspace);
    ASSERT_FALSE(refused.ok());
    EXPECT_EQ(refused.error().code, ErrorCode::Unavailable) << refused.error().describe();
    EXPECT_EQ(message(48), "light gradient: 3 levels and a 48x288x3 base, expected those of a base of side 48");
}

} // namespace
} // namespace ars
