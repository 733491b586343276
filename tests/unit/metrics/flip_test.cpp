#include "engine/metrics/flip.h"

#include "tests/unit/metrics/metrics_answers.h"

#include <algorithm>
#include <cmath>

namespace ars {
namespace {

using test::complaintOf;
using test::MetricsAnswers;
using test::valueOf;

void expectMap(const MetricsAnswers& answers, const FlipParams& params, const std::string& name) {
    const Picture a = answers.picture("a"), b = answers.picture("b"), expected = answers.picture("flip_map" + name);
    std::vector<float> map(a.pixelCount());
    ASSERT_TRUE(flipMap(a, b, {map.data(), a.width, a.height, 1}, params).ok());
    float worst = 0;
    for (std::size_t p = 0; p < map.size(); ++p) worst = std::max(worst, std::abs(map[p] - expected[p]));
    // The other side computes in float, through powers of 0.7 and 0.5 that are steep near 0.
    EXPECT_LT(worst, 2e-4f) << name;
    EXPECT_NEAR(valueOf(meanFlip(a, b, {}, params)), answers.number("flip" + name), 1e-5);
    EXPECT_NEAR(valueOf(meanFlip(a, b, answers.picture("mask"), params)), answers.number("flip_masked" + name), 1e-5);
}

TEST(Flip, AgreesWithItsAuthorsProgram) { expectMap(MetricsAnswers(), {}, ""); }

TEST(Flip, AgreesWithItsAuthorsProgramNearTheScreen) { expectMap(MetricsAnswers(), {.pixelsPerDegree = 40}, "_40"); }

TEST(Flip, EqualPicturesDoNotDiffer) {
    const MetricsAnswers answers;
    EXPECT_EQ(valueOf(meanFlip(answers.picture("a"), answers.picture("a"))), 0.0);
}

TEST(Flip, GreenAgainstBlueIsTheLargestColorDifference) {
    std::vector<float> green, blue;
    for (int p = 0; p < 400; ++p) {
        green.insert(green.end(), {0, 1, 0});
        blue.insert(blue.end(), {0, 0, 2}); // beyond 1 is 1
    }
    const Picture a{green.data(), 20, 20, 3}, b{blue.data(), 20, 20, 3};
    EXPECT_NEAR(valueOf(meanFlip(a, b)), 1, 1e-9);
}

TEST(Flip, WhatCannotBeComparedIsAnError) {
    std::vector<float> values(300, 0.5f), map(100), zeros(100, 0.0f);
    const Picture a{values.data(), 10, 10, 3};
    EXPECT_FALSE(meanFlip(a, {values.data(), 10, 9, 3}).ok());
    EXPECT_NE(complaintOf(meanFlip({values.data(), 10, 10, 1}, {values.data(), 10, 10, 1})).find("expected 3"),
              std::string::npos);
    EXPECT_FALSE(meanFlip(a, a, {zeros.data(), 10, 10, 1}).ok());
    for (const double ppd : {0.0, -3.0, 1e9, std::nan("")})
        EXPECT_FALSE(meanFlip(a, a, {}, {.pixelsPerDegree = ppd}).ok());
    EXPECT_FALSE(flipMap(a, a, {map.data(), 10, 9, 1}).ok());
    EXPECT_TRUE(flipMap(a, a, {map.data(), 10, 10, 1}).ok());
    EXPECT_TRUE(meanFlip({values.data(), 1, 1, 3}, {values.data(), 1, 1, 3}).ok()) << "smaller than the filters";
    const std::vector<float> good = values;
    values[34 * 3] = std::nanf("");
    EXPECT_EQ(complaintOf(meanFlip({good.data(), 10, 10, 3}, a)), "FLIP: the pixel in row 3, column 4 is not finite");
}

} // namespace
} // namespace ars
