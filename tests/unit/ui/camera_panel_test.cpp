#include "tests/unit/ui/look_support.h"

#include <cmath>

namespace ars::ui {
namespace {

class CameraPanelTest : public test::PanelTest {
protected:
    void SetUp() override { open("camera", "Camera"); }
};

TEST_F(CameraPanelTest, PresetsLookFromWhereTheySay) {
    click("View/Left");
    const SceneCamera left = document().camera.camera;
    // +x is the body's left.
    EXPECT_GT(left.eye.x - left.target.x, 0.5);
    EXPECT_NEAR(left.eye.z - left.target.z, 0.0, 0.05);
    click("View/Back");
    EXPECT_LT(document().camera.camera.eye.z, document().camera.camera.target.z - 0.5);
    click("Reset camera");
    EXPECT_EQ(document().camera.camera, newDocument().camera.camera);
}

TEST_F(CameraPanelTest, NumbersAreTakenAsTyped) {
    act([](ImGuiTestContext* context) {
        context->ItemInputValue("##Eye/$$0", "1.25");
        context->ItemInputValue("Field of view", "50");
        context->ItemInputValue("Roll", "12");
    });
    EXPECT_NEAR(document().camera.camera.eye.x, 1.25, 1e-6);
    EXPECT_NEAR(document().camera.camera.verticalFieldDeg, 50.0, 1e-3);
    EXPECT_NEAR(document().camera.camera.rollDeg, 12.0, 1e-3);
    EXPECT_EQ(document().camera.camera.target, newDocument().camera.camera.target);
}

TEST_F(CameraPanelTest, ToneAndOverlaysBelongToTheView) {
    click("Tone curve/None");
    EXPECT_EQ(document().view.tone.curve, ToneCurve::None);
    act([](ImGuiTestContext* context) { context->ItemInputValue("Exposure", "1.5"); });
    EXPECT_NEAR(document().view.tone.exposureEv, 1.5f, 1e-4f);
    const bool grid = document().view.grid;
    click("Floor grid");
    EXPECT_NE(document().view.grid, grid);
    click("Skeleton");
    EXPECT_TRUE(document().view.skeleton);
    click("Surfel discs");
    EXPECT_TRUE(document().view.surfelDiscs);
}

TEST_F(CameraPanelTest, ACaptureIsSteppedThroughAndCompared) {
    ARS_TEST_DATA_FILE(calibration, "capture/casual/calibration_full.json");
    session().openAs(calibration, FileRole::Capture);
    ASSERT_TRUE(studio_.waitFor([&] { return session().assets().capture != nullptr; }));
    const auto capture = session().assets().capture;
    ASSERT_GE(capture->cameras.size(), 2u);
    click("Next");
    const std::string first = document().camera.datasetCamera;
    EXPECT_FALSE(first.empty());
    click("Next");
    EXPECT_NE(document().camera.datasetCamera, first);
    click("Previous");
    EXPECT_EQ(document().camera.datasetCamera, first);
    click("Next photograph");
    EXPECT_EQ(document().camera.photograph, 1);
    click("Compare with photograph");
    EXPECT_EQ(document().view.compare.kind, CompareKind::Photograph);
    EXPECT_EQ(document().view.layout, ViewLayout::Split);
    act([&](ImGuiTestContext* context) {
        context->ItemInputValue("##Search cameras", capture->cameras[1].name.c_str());
        context->ItemClick(("**/" + capture->cameras[1].name).c_str());
    });
    EXPECT_EQ(document().camera.datasetCamera, capture->cameras[1].name);
    click("Leave");
    EXPECT_TRUE(document().camera.datasetCamera.empty());
    click("Close");
    EXPECT_TRUE(document().camera.capture.empty());
}

} // namespace
} // namespace ars::ui
