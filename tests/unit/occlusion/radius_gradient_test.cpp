// The paper's finite-difference path: occlusion to radius.
#include "engine/occlusion/radius_gradient.h"

#include "engine/occlusion/radius_gradient_math.h"
#include "tests/support/devices.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <span>
#include <utility>
#include <vector>

namespace ars {
namespace {

PixelBuffer upload(const Device& device, const std::vector<float>& values) {
    auto picture = PixelBuffer::allocate(device, static_cast<int>(values.size()), 1, 1, "test");
    EXPECT_TRUE(picture.ok());
    EXPECT_TRUE(uploadBuffer(picture->memory(), std::as_bytes(std::span(values))).ok());
    return std::move(*picture);
}

std::vector<float> download(const PixelBuffer& picture) {
    std::vector<float> values(picture.view().valueCount());
    EXPECT_TRUE(downloadBuffer(std::as_writable_bytes(std::span(values)), picture.memory()).ok());
    return values;
}

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
    for (const Device& device : test::devicesUnderTest()) {
        PixelBuffer gradRadius = upload(device, std::vector<float>(kWidth, 7.0f));
        std::vector<PixelBuffer> kept;
        const auto on = [&](const std::vector<float>& values) {
            kept.push_back(upload(device, values));
            return std::as_const(kept.back()).view();
        };
        const Status status = backwardRadius(device, {}, on(gradOcclusion), on(plus), on(minus), on(radiusPlus),
                                             on(radiusMinus), on(opacity), gradRadius.view());
        ASSERT_TRUE(status.ok()) << status.error().describe();
        const std::vector<float> result = download(gradRadius);
        EXPECT_NEAR(result[0], 2.0f * -0.1f / 0.02f, 1e-4f);
        for (std::size_t p = 1; p < kWidth; ++p) EXPECT_EQ(result[p], 0.0f) << "pixel " << p;
    }
}

TEST(RadiusGradient, WrongSizesAreNamed) {
    const std::vector<float> five(5, 1.0f);
    std::vector<float> gradRadius(5);
    const ImageView<const float> view{five.data(), 5, 1, 1};
    const Status status =
        backwardRadius({}, {}, view, view, {five.data(), 4, 1, 1}, view, view, view, {gradRadius.data(), 5, 1, 1});
    ASSERT_FALSE(status.ok());
    EXPECT_NE(status.error().describe().find("O- is 4x1 with 1 channels, expected 5x1"), std::string::npos);
    const Device absent{DeviceKind::Cuda, 99};
    const Status refused = backwardRadius(absent, {}, view, view, view, view, view, view, {gradRadius.data(), 5, 1, 1});
    ASSERT_FALSE(refused.ok());
    EXPECT_EQ(refused.error().code, ErrorCode::Unavailable) << refused.error().describe();
}

} // namespace
} // namespace ars
