#include "engine/core/parallel.h"
#include "tests/unit/metrics/metrics_answers.h"

#include <cmath>
#include <limits>
#include <random>

namespace ars {
namespace {

using test::Channel1;
using test::complaintOf;
using test::MetricsAnswers;
using test::valueOf;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

TEST(ImageMetrics, AgreeWithNumpy) {
    const MetricsAnswers answers;
    const Picture a = answers.picture("a"), b = answers.picture("b"), mask = answers.picture("mask");
    const Channel1 redA(a, 0), redB(b, 0);
    // Both sides sum in double from the same floats.
    constexpr double kTolerance = 1e-12;
    EXPECT_NEAR(valueOf(meanAbsoluteError(a, b)), answers.number("mae"), kTolerance);
    EXPECT_NEAR(valueOf(meanAbsoluteError(a, b, mask)), answers.number("mae_masked"), kTolerance);
    EXPECT_NEAR(valueOf(rootMeanSquareError(a, b)), answers.number("rmse"), kTolerance);
    EXPECT_NEAR(valueOf(rootMeanSquareError(a, b, mask)), answers.number("rmse_masked"), kTolerance);
    EXPECT_NEAR(valueOf(peakSignalToNoise(a, b)), answers.number("psnr"), 1e-10);
    EXPECT_NEAR(valueOf(peakSignalToNoise(a, b, mask)), answers.number("psnr_masked"), 1e-10);
    EXPECT_NEAR(valueOf(peakSignalToNoise(a, b, {}, 255)), answers.number("psnr") + 20 * std::log10(255.0), 1e-10);
    EXPECT_NEAR(valueOf(pearsonCorrelation(a, b)), answers.number("correlation"), kTolerance);
    EXPECT_NEAR(valueOf(pearsonCorrelation(a, b, mask)), answers.number("correlation_masked"), kTolerance);
    EXPECT_NEAR(valueOf(medianAbsoluteError(redA.view(), redB.view())), answers.number("median_red"), kTolerance);
    EXPECT_NEAR(valueOf(medianAbsoluteError(redA.view(), redB.view(), mask)), answers.number("median_red_masked"),
                kTolerance);
    EXPECT_NEAR(valueOf(maskIntersectionOverUnion(mask, answers.picture("other_mask"))), answers.number("iou"),
                kTolerance);
    const Picture u = answers.picture("normals_a"), v = answers.picture("normals_b");
    const auto angle = angularError(u, v), masked = angularError(u, v, mask);
    ASSERT_TRUE(angle.ok() && masked.ok());
    EXPECT_NEAR(angle->meanDeg, answers.number("angle_mean"), 1e-9);
    EXPECT_NEAR(angle->medianDeg, answers.number("angle_median"), 1e-9);
    EXPECT_EQ(angle->pixels, 45u * 61u);
    EXPECT_NEAR(masked->meanDeg, answers.number("angle_mean_masked"), 1e-9);
}

TEST(ImageMetrics, FourPixelsByHand) {
    const std::vector<float> a{0, 0.5f, 1, 0.25f}, b{0, 0.25f, 0, 0.25f}, three{1, 0.6f, 0.5f, 0.51f};
    const Picture pa{a.data(), 2, 2, 1}, pb{b.data(), 2, 2, 1}, mask{three.data(), 2, 2, 1};
    EXPECT_DOUBLE_EQ(valueOf(meanAbsoluteError(pa, pb)), 1.25 / 4);
    EXPECT_DOUBLE_EQ(valueOf(meanAbsoluteError(pa, pb, mask)), 0.25 / 3); // 0.5 itself does not count
    EXPECT_DOUBLE_EQ(valueOf(medianAbsoluteError(pa, pb)), 0.125);        // of 0, 0, 0.25, 1
    EXPECT_DOUBLE_EQ(valueOf(medianAbsoluteError(pa, pb, mask)), 0);      // of 0, 0, 0.25
    EXPECT_DOUBLE_EQ(valueOf(rootMeanSquareError(pa, pb)), std::sqrt(1.0625 / 4));
    EXPECT_EQ(valueOf(peakSignalToNoise(pa, pa)), std::numeric_limits<double>::infinity());
    EXPECT_DOUBLE_EQ(valueOf(maskIntersectionOverUnion(pa, mask)), 0); // pixel 2 alone, and all but pixel 2
    const std::vector<float> other{1, 0, 1, 1};
    EXPECT_DOUBLE_EQ(valueOf(maskIntersectionOverUnion({other.data(), 2, 2, 1}, mask)), 0.5);
}

TEST(ImageMetrics, TinyAnglesAreTold) {
    const std::vector<float> a{0, 0, 2, 1, 0, 0, 0, 0, 1, 0, 0, 0}, b{1e-6f, 0, 1, -1, 0, 0, 0, 1, 0, 0, 0, 1};
    const auto error = angularError({a.data(), 4, 1, 3}, {b.data(), 4, 1, 3});
    ASSERT_TRUE(error.ok());
    EXPECT_EQ(error->pixels, 3u); // the last has no first normal
    EXPECT_NEAR(error->meanDeg, (180 + 90 + 5.7295780e-5) / 3, 1e-9);
    EXPECT_NEAR(error->medianDeg, 90, 1e-9);
    const auto tiny = angularError({a.data(), 1, 1, 3}, {b.data(), 1, 1, 3});
    EXPECT_NEAR(tiny->meanDeg, 5.7295780e-5, 1e-11);
}

TEST(ImageMetrics, CorrelationSurvivesALargeOffset) {
    std::mt19937 random(1);
    std::vector<float> a, b;
    for (int i = 0; i < 1000; ++i) {
        a.push_back(1e4f + static_cast<float>(random() % 1000) / 128);
        b.push_back(2e4f - 2 * a.back());
    }
    EXPECT_NEAR(valueOf(pearsonCorrelation({a.data(), 100, 10, 1}, {b.data(), 100, 10, 1})), -1, 1e-12);
}

TEST(ImageMetrics, ThreadsDoNotChangeTheNumbers) {
    std::mt19937 random(2);
    std::vector<float> a(300 * 200 * 3), b(a.size());
    for (float& v : a) v = static_cast<float>(random()) / 4.3e9f;
    for (float& v : b) v = static_cast<float>(random()) / 4.3e9f;
    const Picture pa{a.data(), 300, 200, 3}, pb{b.data(), 300, 200, 3};
    const int before = threadCount();
    setThreadCount(1);
    const double error = valueOf(meanAbsoluteError(pa, pb)), correlation = valueOf(pearsonCorrelation(pa, pb));
    setThreadCount(4);
    EXPECT_EQ(valueOf(meanAbsoluteError(pa, pb)), error);
    EXPECT_EQ(valueOf(pearsonCorrelation(pa, pb)), correlation);
    setThreadCount(before);
}

TEST(ImageMetrics, NothingToCompareIsAnErrorAndNotANumber) {
    const std::vector<float> values(27, 0.5f), zeros(27, 0.0f);
    const Picture a{values.data(), 3, 3, 3}, narrow{values.data(), 2, 3, 3}, grey{values.data(), 3, 3, 1};
    const Picture none{zeros.data(), 3, 3, 1}, thin{values.data(), 1, 3, 1};
    using Measure = Result<double> (*)(Picture, Picture, Picture);
    const Measure psnr = [](Picture x, Picture y, Picture m) { return peakSignalToNoise(x, y, m); };
    for (const Measure measure :
         {Measure(meanAbsoluteError), Measure(rootMeanSquareError), psnr, Measure(pearsonCorrelation)}) {
        EXPECT_NE(complaintOf(measure(a, narrow, {})).find("pictures of 3x3 with 3 channels and 2x3 with 3"),
                  std::string::npos);
        EXPECT_FALSE(measure(a, grey, {}).ok());
        EXPECT_FALSE(measure({}, {}, {}).ok());
        EXPECT_FALSE(measure(a, {}, {}).ok());
        EXPECT_NE(complaintOf(measure(a, a, none)).find("the mask is empty"), std::string::npos);
        EXPECT_NE(complaintOf(measure(a, a, thin)).find("a mask of 1x3"), std::string::npos);
        EXPECT_FALSE(measure(a, a, a).ok()) << "a mask of three channels";
    }
    EXPECT_FALSE(medianAbsoluteError(a, a).ok()) << "three channels";
    EXPECT_FALSE(medianAbsoluteError(grey, grey, none).ok());
    EXPECT_FALSE(angularError(grey, grey).ok());
    EXPECT_FALSE(angularError(a, a, none).ok());
    const Picture noNormals{zeros.data(), 3, 3, 3};
    EXPECT_FALSE(angularError(a, noNormals).ok());
    EXPECT_EQ(complaintOf(maskIntersectionOverUnion(none, none)), "mask IoU: both masks are empty");
    EXPECT_NE(complaintOf(pearsonCorrelation(a, a)).find("constant"), std::string::npos);
    for (const double peak : {0.0, -1.0, std::nan(""), HUGE_VAL}) EXPECT_FALSE(peakSignalToNoise(a, a, {}, peak).ok());
}

TEST(ImageMetrics, PixelThatIsNotFiniteIsNamedOnlyWhereItCounts) {
    std::vector<float> values(27, 0.5f), some(9, 1.0f);
    values[3] = 0.25f;
    const std::vector<float> good = values;
    values[5 * 3 + 1] = kNan;
    some[5] = 0;
    const Picture a{good.data(), 3, 3, 3}, b{values.data(), 3, 3, 3}, mask{some.data(), 3, 3, 1};
    EXPECT_EQ(complaintOf(meanAbsoluteError(a, b)), "mean absolute error: the pixel in row 1, column 2 is not finite");
    EXPECT_EQ(valueOf(meanAbsoluteError(a, b, mask)), 0.0);
    EXPECT_FALSE(pearsonCorrelation(b, a).ok());
    EXPECT_EQ(valueOf(pearsonCorrelation(b, a, mask)), 1.0);
    EXPECT_FALSE(angularError(a, b).ok());
    EXPECT_TRUE(angularError(a, b, mask).ok());
    const Channel1 green(b, 1), before(a, 1);
    EXPECT_FALSE(medianAbsoluteError(before.view(), green.view()).ok());
    EXPECT_EQ(valueOf(medianAbsoluteError(before.view(), green.view(), mask)), 0.0);
    EXPECT_FALSE(maskIntersectionOverUnion(before.view(), green.view()).ok());
}

} // namespace
} // namespace ars
