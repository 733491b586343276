#include "tests/unit/metrics/metrics_answers.h"

#include <cmath>
#include <limits>

namespace ars {
namespace {

using test::Channel1;
using test::complaintOf;
using test::MetricsAnswers;
using test::valueOf;

TEST(StructuralSimilarity, AgreesWithScikitImage) {
    const MetricsAnswers answers;
    const Picture a = answers.picture("a"), b = answers.picture("b");
    EXPECT_NEAR(valueOf(structuralSimilarity(a, b)), answers.number("ssim"), 1e-10);
    EXPECT_NEAR(valueOf(structuralSimilarity(a, b, answers.picture("mask"))), answers.number("ssim_masked"), 1e-7);
    const Channel1 greenA(a, 1), greenB(b, 1);
    EXPECT_NEAR(valueOf(structuralSimilarity(greenA.view(), greenB.view())), answers.number("ssim_grey"), 1e-10);
}

TEST(StructuralSimilarity, MapAgreesWithScikitImageUpToTheBorder) {
    const MetricsAnswers answers;
    const Picture a = answers.picture("a"), expected = answers.picture("ssim_map");
    std::vector<float> map(a.valueCount());
    ASSERT_TRUE(structuralSimilarityMap(a, answers.picture("b"), {map.data(), a.width, a.height, 3}).ok());
    for (std::size_t i = 0; i < map.size(); ++i) ASSERT_NEAR(map[i], expected[i], 1e-6f) << i;
}

TEST(StructuralSimilarity, ConstantPicturesCompareByTheirMeansAlone) {
    const std::vector<float> a(400, 0.2f), b(400, 0.6f);
    const Picture pa{a.data(), 20, 20, 1}, pb{b.data(), 20, 20, 1};
    EXPECT_NEAR(valueOf(structuralSimilarity(pa, pb)), (2 * 0.12 + 1e-4) / (0.04 + 0.36 + 1e-4), 1e-6);
    EXPECT_NEAR(valueOf(structuralSimilarity(pa, pa)), 1, 1e-12);
    // The constants scale with the peak: nothing changes when everything is 255 times as large.
    std::vector<float> bytesA(400, 51.0f), bytesB(400, 153.0f);
    EXPECT_NEAR(
        valueOf(structuralSimilarity({bytesA.data(), 20, 20, 1}, {bytesB.data(), 20, 20, 1}, {}, {.peak = 255})),
        valueOf(structuralSimilarity(pa, pb)), 1e-6);
}

TEST(StructuralSimilarity, WhatCannotBeComparedIsAnError) {
    std::vector<float> values(400, 0.5f), border(400, 0.0f);
    const Picture a{values.data(), 20, 20, 1}, small{values.data(), 20, 10, 1};
    EXPECT_NE(complaintOf(structuralSimilarity(small, small)).find("smaller than the window"), std::string::npos);
    EXPECT_FALSE(structuralSimilarity(a, {values.data(), 10, 20, 2}).ok());
    EXPECT_FALSE(structuralSimilarity(a, a, {}, {.peak = 0}).ok());
    border[3] = 1; // counts only a pixel whose window leaves the picture
    EXPECT_NE(complaintOf(structuralSimilarity(a, a, {border.data(), 20, 20, 1})).find("no pixel"), std::string::npos);
    std::vector<float> map(400);
    EXPECT_FALSE(structuralSimilarityMap(a, a, {map.data(), 10, 20, 1}).ok());
    const std::vector<float> good = values;
    values[210] = std::numeric_limits<float>::infinity();
    EXPECT_EQ(complaintOf(structuralSimilarity({good.data(), 20, 20, 1}, a)),
              "SSIM: the pixel in row 10, column 10 is not finite");
}

} // namespace
} // namespace ars
