// The filters are linear; their backward must be their exact transpose.
#include "engine/light/prefilter_gradient.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
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
        std::vector<float> gradient(base.texels.size());
        ASSERT_TRUE(prefilterLightBackward(side, params, y, {gradient.data(), side, 6 * side, 3}).ok());
        const double backward = dot(base.texels.data(), gradient);
        // Float sums over thousands of texels, and cones whose edge rounding decides.
        EXPECT_NEAR(backward / forward, 1.0, 2e-5) << "level " << only;
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
    std::vector<float> gradient(base.texels.size());
    ASSERT_TRUE(prefilterLightBackward(kSide, {}, y, {gradient.data(), kSide, 6 * kSide, 3}).ok());
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

TEST(PrefilterGradient, WrongSizesAreNamed) {
    LightLevelGradients levels;
    std::vector<float> gradient(18 * 64 * 64);
    const Status status = prefilterLightBackward(64, {}, levels, {gradient.data(), 64, 384, 3});
    ASSERT_FALSE(status.ok());
    EXPECT_NE(status.error().describe().find("0 levels"), std::string::npos) << status.error().describe();
}

} // namespace
} // namespace ars
