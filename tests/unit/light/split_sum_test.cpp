#include "tests/support/devices.h"
#include "tests/unit/light/light_support.h"

#include <numbers>

namespace ars {
namespace {

/// The definition (Karis 2013): GGX sampling of half vectors, A = mean (1 - Fc) G VoH / (NoH NoV), B the same with Fc;
/// G is the height-correlated Smith term. Another estimator than the one that fills the table.
glm::dvec2 bySamplingHalfVectors(double nov, double roughness, int perAxis) {
    const double alpha2 = std::pow(roughness, 4.0);
    const double vx = std::sqrt(1.0 - nov * nov);
    const auto lambda = [&](double c) { return 0.5 * (std::sqrt(1.0 + alpha2 * (1.0 / (c * c) - 1.0)) - 1.0); };
    glm::dvec2 sum(0.0);
    for (int i = 0; i < perAxis; ++i) {
        const double u = (i + 0.5) / perAxis, noh = std::sqrt((1.0 - u) / (1.0 + (alpha2 - 1.0) * u));
        for (int j = 0; j < perAxis; ++j) {
            const double phi = 2.0 * std::numbers::pi * (j + 0.5) / perAxis;
            const double voh = vx * std::sqrt(1.0 - noh * noh) * std::cos(phi) + nov * noh;
            const double nol = 2.0 * voh * noh - nov;
            if (nol <= 0.0 || voh <= 0.0) continue;
            const double g = 1.0 / (1.0 + lambda(nov) + lambda(nol));
            const double weight = g * voh / (noh * nov), fresnel = std::pow(1.0 - voh, 5.0);
            sum += glm::dvec2(1.0 - fresnel, fresnel) * weight;
        }
    }
    return sum / double(perAxis * perAxis);
}

// L4: values that were measured on the table of nvdiffrec (four digits, itself a sum of random samples).
TEST(SplitSum, HasTheValuesOfTheReferenceTable) {
    const double known[][4] = {{1, .5, .9158, 0},     {.5, .5, .8350, .0224}, {.1, .5, .7521, .1397},
                               {.5, 1, .4494, .0030}, {.1, .1, .4158, .5784}, {1, 1, .3093, 0}};
    for (const auto& k : known) {
        double a = 0.0, b = 0.0;
        splitSumEntry(k[0], k[1], 256, a, b);
        // The reference table holds texel centres; at its border (1, 1) it stands for 0.998.
        EXPECT_NEAR(a, k[2], 3e-3) << k[0] << " " << k[1];
        EXPECT_NEAR(b, k[3], 3e-3) << k[0] << " " << k[1];
    }
}

TEST(SplitSum, AgreesWithSamplingHalfVectors) {
    for (const double nov : {0.15, 0.5, 0.9}) {
        for (const double roughness : {0.2, 0.5, 0.8, 1.0}) {
            double a = 0.0, b = 0.0;
            splitSumEntry(nov, roughness, 256, a, b);
            const glm::dvec2 expected = bySamplingHalfVectors(nov, roughness, 1500);
            EXPECT_NEAR(a, expected.x, 1e-3) << nov << " " << roughness;
            EXPECT_NEAR(b, expected.y, 1e-3) << nov << " " << roughness;
        }
    }
}

TEST(SplitSum, TheTableIsConvergedOnEveryDevice) {
    for (const Device& device : test::devicesUnderTest()) {
        const auto table = splitSumLut(device);
        ASSERT_TRUE(table.ok());
        EXPECT_EQ(table->get(), splitSumLut(device)->get()) << "made once";
        const std::vector<float> values = test::download(**table);
        double worst = 0.0;
        for (int row = 0; row < 256; row += 15) {
            for (int column = 0; column < 256; column += 15) {
                double a = 0.0, b = 0.0;
                splitSumEntry((column + 0.5) / 256, (row + 0.5) / 256, 200, a, b);
                const std::size_t i = 2 * static_cast<std::size_t>(row * 256 + column);
                worst = std::max({worst, std::fabs(a - double(values[i])), std::fabs(b - double(values[i + 1]))});
                EXPECT_LE(values[i] + values[i + 1], 1.0f + 1e-5f);
                EXPECT_GE(values[i], 0.0f);
            }
        }
        EXPECT_LT(worst, 2e-3);
    }
}

TEST(SplitSum, LookupInterpolatesBetweenTexelCentresAndClamps) {
    const std::vector<double> table = {0, 1, 2, 3, 4, 5, 6, 7}; // 2 x 2 x 2
    const auto at = [&](double nov, double roughness) { return lookupSplitSum(table.data(), 2, nov, roughness); };
    EXPECT_NEAR(at(0.25, 0.25).x, 0.0, 1e-12);
    EXPECT_NEAR(at(0.75, 0.25).x, 2.0, 1e-12);
    EXPECT_NEAR(at(0.5, 0.5).x, 3.0, 1e-12);
    EXPECT_NEAR(at(0.5, 0.5).y, 4.0, 1e-12);
    EXPECT_NEAR(at(-3.0, 9.0).x, 4.0, 1e-12);
    EXPECT_NEAR(at(std::nan(""), 0.25).x, 0.0, 1e-12);
}

} // namespace
} // namespace ars
