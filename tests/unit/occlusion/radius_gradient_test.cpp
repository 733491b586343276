// The paper's finite-difference path: occlusion to radius.
#include "engine/occlusion/radius_gradient.h"

#include "engine/occlusion/radius_gradient_math.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

namespace ars {
namespace {

/// O = exp(-k R): a smooth stand-in for the march, whose slope is known.
TEST(RadiusGradient, IsTheSlopeOfASmoothOcclusion) {
    for (const double radius : {0.04, 0.1, 0.25}) {
        const double k = 3.0, step = 1e-5;
        const double slope = occlusionSlope(std::exp(-k * (radius + step)), std::exp(-k * (radius - step)),
                                            radius + step, radius - step, 1e-6);
        EXPECT_NEAR(slope, -k * std::exp(-k * radius), 1e-8);
    }
}

TEST(RadiusGradient, BlendedPartsOfEitherSignDivideByTheirOwnStep) {
    // R+ below R-: the quotient keeps its sign.
    EXPECT_DOUBLE_EQ(occlusionSlope(0.4, 0.6, 0.09, 0.11, 1e-6), 10.0);
}

TEST(RadiusGradient, EveryPixelIsWrittenAndEmptyOnesPassNothing) {
    constexpr int kWidth = 5;
    const std::vector<float> gradOcclusion{2.0f, 2.0f, 2.0f, 2.0f, 2.0f}, plus{0.5f, 0.5f, 0.5f, 0.5f, 0.5f},
        minus{0.6f, 0.6f, 0.6f, 0.6f, 0.6f};
    const std::vector<float> radiusPlus{0.11f, 0.11f, 0.1f, std::numeric_limits<float>::quiet_NaN(), 0.1000004f};
    const std::vector<float> radiusMinus{0.09f, 0.09f, 0.1f, 0.09f, 0.1f};
    const std::vector<float> opacity{1.0f, 5e-4f, 1.0f, 1.0f, 1.0f};
    std::vector<float> gradRadius(kWidth, 7.0f);
    const auto view = [](const std::vector<float>& v) { return ImageView<const float>{v.data(), kWidth, 1, 1}; };
    ASSERT_TRUE(backwardRadius({}, view(gradOcclusion), view(plus), view(minus), view(radiusPlus), view(radiusMinus),
                               view(opacity), {gradRadius.data(), kWidth, 1, 1})
                    .ok());
    EXPECT_NEAR(gradRadius[0], 2.0f * -0.1f / 0.02f, 1e-4f);
    for (std::size_t p = 1; p < kWidth; ++p) EXPECT_EQ(gradRadius[p], 0.0f) << "pixel " << p;

    const Status status = backwardRadius({}, view(gradOcclusion), view(plus), {minus.data(), 4, 1, 1}, view(radiusPlus),
                                         view(radiusMinus), view(opacity), {gradRadius.data(), kWidth, 1, 1});
    ASSERT_FALSE(status.ok());
    EXPECT_NE(status.error().describe().find("O- is 4x1 with 1 channels, expected 5x1"), std::string::npos);
}

} // namespace
} // namespace ars
