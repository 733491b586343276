// Backward of the tone curves against central differences in double, and the picture path against that maths.
#include "engine/shade/tone_gradient.h"
#include "engine/shade/tone_gradient_math.h"
#include "tests/support/devices.h"
#include "tests/unit/light/light_support.h"

#include <cmath>
#include <random>
#include <vector>

namespace ars {
namespace {

ToneSettings<double> settings(int curve, bool transparent) {
    return {1.3, curve, transparent, glm::dvec3(0.2, 0.4, 0.6)};
}

TEST(ToneGradient, EqualsCentralDifferencesInDouble) {
    std::mt19937 random(1);
    std::uniform_real_distribution<double> unit(0.0, 1.0);
    for (int curve = 0; curve < 3; ++curve) {
        for (const bool transparent : {false, true}) {
            const ToneSettings<double> tone = settings(curve, transparent);
            int passing = 0;
            for (int trial = 0; trial < 400; ++trial) {
                const double alpha = 0.1 + 0.85 * unit(random);
                glm::dvec4 pixel(alpha * glm::dvec3(unit(random), unit(random), unit(random)) * 1.2, alpha);
                const glm::dvec4 g(unit(random) - 0.5, unit(random) - 0.5, unit(random) - 0.5, unit(random) - 0.5);
                const glm::dvec4 expected = tonePixelBackward(tone, pixel, g);
                for (int c = 0; c < 4; ++c) {
                    constexpr double kStep = 1e-7;
                    glm::dvec4 up = pixel, down = pixel;
                    up[c] += kStep;
                    down[c] -= kStep;
                    const double slope =
                        (glm::dot(g, tonePixel(tone, up)) - glm::dot(g, tonePixel(tone, down))) / (2.0 * kStep);
                    EXPECT_NEAR(expected[c], slope, 1e-6 * (1.0 + std::abs(slope)))
                        << "curve " << curve << ", transparent " << transparent << ", channel " << c;
                    passing += expected[c] != 0.0;
                }
            }
            EXPECT_GT(passing, 1000) << "the test must not live off clipped pixels";
        }
    }
}

TEST(ToneGradient, NothingPassesWhereTheCurveIsHeld) {
    for (int curve = 0; curve < 2; ++curve) {
        const glm::dvec4 g =
            tonePixelBackward(settings(curve, true), glm::dvec4(50.0, 60.0, 70.0, 1.0), glm::dvec4(1.0, 1.0, 1.0, 0.0));
        for (int c = 0; c < 3; ++c) EXPECT_EQ(g[c], 0.0) << "curve " << curve;
    }
    const glm::dvec4 dark =
        tonePixelBackward(settings(0, true), glm::dvec4(-1.0, -1.0, -1.0, 1.0), glm::dvec4(1.0, 1.0, 1.0, 0.0));
    for (int c = 0; c < 3; ++c) EXPECT_EQ(dark[c], 0.0);
}

TEST(ToneGradient, PicturePathIsTheMaths) {
    constexpr int kWidth = 37, kHeight = 5;
    std::mt19937 random(2);
    std::uniform_real_distribution<float> unit(0.0f, 1.0f);
    std::vector<float> linear(4 * kWidth * kHeight), g(linear.size());
    for (float& v : linear) v = unit(random);
    for (float& v : g) v = unit(random) - 0.5f;
    const std::vector<Device> devices = test::devicesUnderTest();
    for (std::size_t i = 0; i < 3 * devices.size(); ++i) {
        const Device& device = devices[i / 3];
        const auto curve = static_cast<ToneCurve>(i % 3);
        const ToneParams params{.exposureEv = 0.5f, .curve = curve, .backgroundRed = 0.3f};
        const PixelBuffer from = test::upload(device, linear, kWidth, kHeight, 4);
        const PixelBuffer upper = test::upload(device, g, kWidth, kHeight, 4);
        PixelBuffer lower = test::upload(device, std::vector<float>(linear.size(), 7.0f), kWidth, kHeight, 4);
        const Status status = toneMapBackward(device, params, from.view(), upper.view(), lower.view());
        ASSERT_TRUE(status.ok()) << status.error().describe();
        const std::vector<float> got = test::download(lower);
        const ToneSettings<double> tone{std::exp2(0.5), static_cast<int>(curve), false, glm::dvec3(0.3f, 0.0, 0.0)};
        for (std::size_t p = 0; p < kWidth * kHeight; ++p) {
            const auto at = [p](const std::vector<float>& v) {
                return glm::dvec4(v[4 * p], v[4 * p + 1], v[4 * p + 2], v[4 * p + 3]);
            };
            const glm::dvec4 expected = tonePixelBackward(tone, at(linear), at(g));
            for (int c = 0; c < 4; ++c) EXPECT_NEAR(at(got)[c], expected[c], 1e-3 * (1.0 + std::abs(expected[c])));
        }
    }
}

TEST(ToneGradient, WrongPicturesAreNamed) {
    std::vector<float> four(16);
    const Status status =
        toneMapBackward({}, {}, {four.data(), 2, 2, 4}, {four.data(), 3, 1, 4}, {four.data(), 2, 2, 4});
    ASSERT_FALSE(status.ok());
    EXPECT_NE(status.error().describe().find("dL/ddisplay is 3x1 with 4 channels, expected 2x2 with 4"),
              std::string::npos)
        << status.error().describe();
    EXPECT_FALSE(toneMapBackward({}, {}, {four.data(), 2, 2, 4}, {nullptr, 2, 2, 4}, {four.data(), 2, 2, 4}).ok());
    const Device absent{DeviceKind::Cuda, 99};
    const Status refused =
        toneMapBackward(absent, {}, {four.data(), 2, 2, 4}, {four.data(), 2, 2, 4}, {four.data(), 2, 2, 4});
    ASSERT_FALSE(refused.ok());
    EXPECT_EQ(refused.error().code, ErrorCode::Unavailable) << refused.error().describe();
}

} // namespace
} // namespace ars
