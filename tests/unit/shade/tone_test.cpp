#include "engine/shade/tone.h"

#include "engine/io/image.h"
#include "engine/shade/tone_math.h"
#include "tests/support/devices.h"
#include "tests/unit/light/light_support.h"

#include <limits>

namespace ars {
namespace {

template <typename T>
class ToneMath : public ::testing::Test {};
using Scalars = ::testing::Types<float, double>;
TYPED_TEST_SUITE(ToneMath, Scalars);

TYPED_TEST(ToneMath, TransferFunctionIsTheOneOfTheFiles) {
    using T = TypeParam;
    for (int i = 0; i <= 1000; ++i) {
        const double x = i / 1000.0;
        EXPECT_NEAR(double(encodeSrgb(T(x))), double(linearToSrgb(static_cast<float>(x))), 1e-6);
        EXPECT_NEAR(double(srgbToLinear(static_cast<float>(encodeSrgb(T(x))))), x, 1e-6);
    }
}

TYPED_TEST(ToneMath, CurvesRiseFromBlackToWhiteAndKeepGreyGrey) {
    using T = TypeParam;
    for (const int curve : {0, 1, 2}) {
        T before(-1);
        for (int i = 0; i <= 400; ++i) {
            const T x = std::pow(T(2), T(-12) + T(0.05) * T(i)) - std::pow(T(2), T(-12));
            const glm::vec<3, T> y = toneCurve(curve, glm::vec<3, T>(x));
            EXPECT_GE(y.y, before - T(1e-5)) << curve << " " << x;
            EXPECT_NEAR(double(y.x), double(y.y), 2e-3) << curve;
            EXPECT_NEAR(double(y.z), double(y.y), 2e-3) << curve;
            before = y.y;
        }
        EXPECT_LT(toneCurve(curve, glm::vec<3, T>(T(0))).y, T(1e-3)) << curve;
        EXPECT_GT(toneCurve(curve, glm::vec<3, T>(T(1000))).y, T(0.95)) << curve;
    }
}

// Grey through the sources' own formulas, written out once more.
TYPED_TEST(ToneMath, CurvesHaveTheValuesOfTheirSources) {
    using T = TypeParam;
    // Hill: rows of both matrices sum to 1 within 1e-5, so that grey goes through the rational function alone.
    const auto hill = [](double v) {
        return (v * (v + 0.0245786) - 0.000090537) / (v * (0.983729 * v + 0.4329510) + 0.238081);
    };
    for (const double x : {0.05, 0.18, 1.0, 4.0}) {
        EXPECT_NEAR(double(acesCurve(glm::vec<3, T>(T(x))).y), std::min(hill(x), 1.0), 3e-4) << x;
    }
    // AgX: 0.18 lies at (log2 0.18 + 12.47393) / 16.499999 = 0.606061 of the range; the polynomial there, to the 2.2.
    const double t = (std::log2(0.18) + 12.47393) / 16.5;
    const double p = 15.5 * std::pow(t, 6) - 40.14 * std::pow(t, 5) + 31.96 * std::pow(t, 4) - 6.868 * std::pow(t, 3) +
                     0.4298 * t * t + 0.1191 * t - 0.00232;
    EXPECT_NEAR(t, 0.606061, 1e-3);
    EXPECT_NEAR(double(agxCurve(glm::vec<3, T>(T(0.18))).y), std::pow(p, 2.2), 1e-3);
    // AgX puts middle grey at half of the display's code values.
    EXPECT_NEAR(std::pow(double(agxCurve(glm::vec<3, T>(T(0.18))).y), 1.0 / 2.2), 0.5, 0.01);
}

TYPED_TEST(ToneMath, AgxBleedsBrightPrimariesToWhite) {
    using T = TypeParam;
    const glm::vec<3, T> dim = agxCurve(glm::vec<3, T>(T(0), T(0), T(0.5))),
                         bright = agxCurve(glm::vec<3, T>(T(0), T(0), T(200)));
    EXPECT_GT(bright.x, dim.x + T(0.2));
    EXPECT_LT(dim.x, dim.z);
}

std::vector<float> toned(const Device& device, const ToneParams& params, const std::vector<float>& pixels) {
    const int count = static_cast<int>(pixels.size() / 4);
    const PixelBuffer in = test::upload(device, pixels, count, 1, 4);
    auto out = PixelBuffer::allocate(device, count, 1, 4, "test");
    const Status status = toneMap(device, params, in.view(), out->view());
    EXPECT_TRUE(status.ok()) << status.error().describe();
    return test::download(*out);
}

TEST(ToneMap, WithoutCurveComposesInLinearLight) {
    ToneParams params;
    params.backgroundRed = 0.2f;
    params.backgroundGreen = 0.4f;
    params.backgroundBlue = 1.0f;
    for (const Device& device : test::devicesUnderTest()) {
        const std::vector<float> out =
            toned(device, params, {0.3f, 0.1f, 0.0f, 0.5f, 0, 0, 0, 0, 0.25f, 9.0f, 0.0f, 1.0f});
        EXPECT_NEAR(out[0], linearToSrgb(0.3f + 0.5f * 0.2f), 1e-6f);
        EXPECT_NEAR(out[1], linearToSrgb(0.1f + 0.5f * 0.4f), 1e-6f);
        EXPECT_NEAR(out[2], linearToSrgb(0.5f), 1e-6f);
        EXPECT_NEAR(out[4], linearToSrgb(0.2f), 1e-6f);
        EXPECT_NEAR(out[8], linearToSrgb(0.25f), 1e-6f);
        EXPECT_NEAR(out[9], 1.0f, 1e-6f);
        for (const std::size_t i : {3u, 7u, 11u}) EXPECT_EQ(out[i], 1.0f);
    }
}

TEST(ToneMap, ExposureCountsStopsAndLeavesTheBackgroundAlone) {
    ToneParams params;
    params.exposureEv = 1.0f;
    params.backgroundGreen = 0.3f;
    const std::vector<float> out = toned({}, params, {0.1f, 0.1f, 0.1f, 1.0f, 0, 0, 0, 0});
    EXPECT_NEAR(out[0], linearToSrgb(0.2f), 1e-6f);
    EXPECT_NEAR(out[5], linearToSrgb(0.3f), 1e-6f);
}

TEST(ToneMap, TransparentKeepsStraightColourAndAlpha) {
    ToneParams params;
    params.transparent = true;
    const std::vector<float> out = toned({}, params, {0.1f, 0.2f, 0.0f, 0.25f, 0, 0, 0, 0});
    EXPECT_NEAR(out[0], linearToSrgb(0.4f), 1e-6f);
    EXPECT_NEAR(out[1], linearToSrgb(0.8f), 1e-6f);
    EXPECT_EQ(out[3], 0.25f);
    for (std::size_t i = 4; i < 8; ++i) EXPECT_EQ(out[i], 0.0f);
}

TEST(ToneMap, BytesAreTheRoundedNumbers) {
    std::mt19937 random(1);
    std::uniform_real_distribution<float> unit(0.0f, 1.0f);
    std::vector<float> pixels(4 * 1000);
    for (float& v : pixels) v = unit(random);
    for (const Device& device : test::devicesUnderTest()) {
        for (const ToneCurve curve : {ToneCurve::None, ToneCurve::Aces, ToneCurve::Agx}) {
            ToneParams params;
            params.curve = curve;
            const std::vector<float> display = toned(device, params, pixels);
            const PixelBuffer in = test::upload(device, pixels, 1000, 1, 4);
            auto bytes = Buffer::allocate(device, 4000, "test");
            ASSERT_TRUE(bytes.ok());
            const ImageView<std::uint8_t> out{static_cast<std::uint8_t*>(bytes->data()), 1000, 1, 4};
            ASSERT_TRUE(toneMap(device, params, in.view(), out).ok());
            std::vector<std::uint8_t> values(4000);
            ASSERT_TRUE(downloadBuffer(std::as_writable_bytes(std::span<std::uint8_t>(values)), *bytes).ok());
            for (std::size_t i = 0; i < values.size(); ++i) {
                EXPECT_NEAR(values[i], display[i] * 255.0f, 0.5f + 1e-3f);
                // The same in double.
                if (i % 4 == 0) {
                    ToneSettings<double> tone;
                    tone.curve = static_cast<int>(curve);
                    const glm::dvec4 p(pixels[i], pixels[i + 1], pixels[i + 2], pixels[i + 3]);
                    const glm::dvec4 exact = tonePixel(tone, p);
                    for (int c = 0; c < 4; ++c) EXPECT_NEAR(exact[c], display[i + static_cast<std::size_t>(c)], 2e-5);
                }
            }
        }
    }
}

TEST(ToneMap, NumbersThatAreNoneBecomeBlackAndInfiniteOnesWhite) {
    const float nan = std::numeric_limits<float>::quiet_NaN(), inf = std::numeric_limits<float>::infinity();
    for (const ToneCurve curve : {ToneCurve::None, ToneCurve::Aces, ToneCurve::Agx}) {
        ToneParams params;
        params.curve = curve;
        const std::vector<float> out =
            toned({}, params, {nan, 0.5f, 0.5f, 1.0f, inf, inf, inf, 1.0f, 1, 1, 1, nan, -1, -1, -1, 1});
        for (const float v : out) EXPECT_TRUE(v >= 0.0f && v <= 1.0f);
        EXPECT_GT(out[4], 0.95f);
        EXPECT_LT(out[12], 0.05f);
    }
}

TEST(ToneMap, WrongPicturesAndSettingsAreNamed) {
    std::vector<float> memory(64, 0.5f), target(64);
    const ImageView<const float> in{memory.data(), 4, 2, 4};
    const ImageView<float> out{target.data(), 4, 2, 4};
    EXPECT_TRUE(toneMap({}, {}, in, out).ok());
    EXPECT_TRUE(toneMap({}, {}, ImageView<const float>{memory.data(), 4, 2, 3}, out).ok());
    EXPECT_FALSE(toneMap({}, {}, ImageView<const float>{memory.data(), 4, 2, 1}, out).ok());
    EXPECT_FALSE(toneMap({}, {}, in, ImageView<float>{target.data(), 2, 4, 4}).ok());
    EXPECT_FALSE(toneMap({}, {}, ImageView<const float>{}, out).ok());
    ToneParams params;
    params.exposureEv = std::numeric_limits<float>::quiet_NaN();
    const Status status = toneMap({}, params, in, out);
    ASSERT_FALSE(status.ok());
    EXPECT_NE(status.error().describe().find("exposure"), std::string::npos) << status.error().describe();
}

} // namespace
} // namespace ars
