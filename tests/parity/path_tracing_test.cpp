// The whole forward renderer against Cycles: cameras, poses, materials and light of the validation capture.
#include "tests/parity/path_tracing.h"

#include "tests/support/test_data.h"

#include <gtest/gtest.h>

#include <cstdio>

namespace ars::test {
namespace {

TEST(PathTracing, RestAvatarAgreesWithCycles) {
    ARS_TEST_DATA_FILE(capture, "capture/casual_val");
    ComparisonOptions options;
    options.methods = {"body"};
    const auto compared = compareWithPathTracing(capture.parent_path(), options);
    ASSERT_TRUE(compared.ok()) << compared.error().describe();
    std::printf("%s", comparisonTable(*compared).c_str());
    EXPECT_LE(compared->surfels, 300000u);
    EXPECT_GE(compared->maskIou, 0.97);
    EXPECT_LT(compared->depthMedianM, 0.006);
    EXPECT_LT(compared->normalMeanDeg, 15.0);
    const OcclusionScore& body = compared->methods.at("body");
    EXPECT_LT(body.meanAbsoluteError, 0.035);
    EXPECT_LT(body.meanAbsoluteError, 0.7 * compared->unoccludedMae);
    EXPECT_GE(body.correlation, 0.75);
    EXPECT_GE(body.psnr, 24.0);
    // Occlusion must help, and nothing can be better than the true buffers.
    EXPECT_GT(body.psnr, compared->unoccludedPsnr);
    EXPECT_LT(body.psnr, compared->ceilingPsnr);
}

} // namespace
} // namespace ars::test
