#include "tests/unit/occlusion/captured_view.h"

#include "engine/occlusion/ambient_occlusion.h"

#include <gtest/gtest.h>

// Against path tracing, from the path tracer's own depth and normals: what the method can reach at best.

namespace ars {
namespace {

TEST(OcclusionCapture, TrueBuffersGiveThePathTracedOcclusionAsFarAsOneLayerCan) {
    ARS_TEST_DATA_FILE(folder, "capture/casual_val/heldout_views");
    const std::vector<test::CapturedView> views = test::readCapturedViews(folder.parent_path(), 0.25f, 2);
    struct Row {
        const char* name;
        OcclusionParams params;
        double error, correlation; ///< at most, at least; measured .026/.832, .029/.728, .027/.830, .017/.902
    };
    OcclusionParams interactive = bodyOcclusion(), thick = bodyOcclusion();
    interactive.quality = OcclusionQuality::Interactive;
    thick.thicknessM = 0.25f;
    const Row rows[] = {{"body", bodyOcclusion(), 0.020, 0.87},
                        {"reference", referenceOcclusion(), 0.033, 0.69},
                        {"body, interactive", interactive, 0.022, 0.86},
                        {"body, thickness 0.25 m", thick, 0.030, 0.80}};
    for (const Row& row : rows) {
        for (const Device& device : test::devicesUnderTest()) {
            test::OcclusionAgreement agreement;
            for (const test::CapturedView& view : views) {
                agreement.add(test::occlusionOf(row.params, view.scene, device), view);
            }
            std::printf("%-22s mean error %.4f (O = 1: %.4f), correlation %.3f, bias %+.4f over %.0f pixels\n",
                        row.name, agreement.meanError(), agreement.errorOfOne(), agreement.correlation(),
                        agreement.bias(), agreement.pixels());
            EXPECT_LT(agreement.meanError(), row.error) << row.name;
            EXPECT_LT(agreement.meanError(), 0.6 * agreement.errorOfOne()) << row.name;
            EXPECT_GT(agreement.correlation(), row.correlation) << row.name;
        }
    }
}

} // namespace
} // namespace ars
