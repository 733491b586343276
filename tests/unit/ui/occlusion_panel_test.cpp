#include "engine/rig/body_parts.h"

#include "tests/unit/ui/look_support.h"

#include <algorithm>

namespace ars::ui {
namespace {

class OcclusionPanelTest : public test::PanelTest {
protected:
    void SetUp() override { open("occlusion", "Occlusion"); }
    float radius(BodyPart part) { return document().occlusion.radii[static_cast<std::size_t>(part)]; }
    bool locked(BodyPart part) { return document().occlusion.locked[static_cast<std::size_t>(part)]; }
    void type(const std::string& item, const char* text) {
        act([&](ImGuiTestContext* context) { context->ItemInputValue(item.c_str(), text); });
    }
};

TEST_F(OcclusionPanelTest, ASliderSetsTheRadiusOfItsPartAlone) {
    type("**/##Head radius", "0.3");
    EXPECT_NEAR(radius(BodyPart::Head), 0.3f, 1e-4f);
    PartRadii expected = initialPartRadii();
    expected[static_cast<std::size_t>(BodyPart::Head)] = radius(BodyPart::Head);
    EXPECT_EQ(document().occlusion.radii, expected);
}

TEST_F(OcclusionPanelTest, ASliderStaysWithinTheBoundsOfThePart) {
    type("**/##Hand radius", "5");
    EXPECT_NEAR(radius(BodyPart::Hand), 3.0f * 0.04f, 1e-5f);
    type("**/##Hand radius", "0.0001");
    EXPECT_NEAR(radius(BodyPart::Hand), 0.2f * 0.04f, 1e-5f);
}

TEST_F(OcclusionPanelTest, ALockedRadiusStaysUntilItIsUnlocked) {
    click("**/Knee/Lock");
    ASSERT_TRUE(locked(BodyPart::Knee));
    click("+10 %");
    EXPECT_FLOAT_EQ(radius(BodyPart::Knee), 0.12f);
    EXPECT_NEAR(radius(BodyPart::Torso), 1.1f * 0.25f, 1e-5f);
    click("**/Knee/Unlock");
    EXPECT_FALSE(locked(BodyPart::Knee));
    click("Reset all");
    EXPECT_EQ(document().occlusion.radii, initialPartRadii());
}

TEST_F(OcclusionPanelTest, ResetBringsOnePartBack) {
    click("-10 %");
    click("**/Foot/Reset");
    EXPECT_FLOAT_EQ(radius(BodyPart::Foot), 0.10f);
    EXPECT_NEAR(radius(BodyPart::Elbow), 0.9f * 0.10f, 1e-5f);
}

TEST_F(OcclusionPanelTest, SelectionGoesBothWays) {
    click("**/Wrist");
    EXPECT_EQ(document().view.selectedPart, static_cast<int>(BodyPart::Wrist));
    // As a click on the body does it.
    ASSERT_TRUE(session().run("view.select_part", {{"part", "torso"}}).ok());
    click("**/Torso");
    EXPECT_EQ(document().view.selectedPart, -1) << "a click on what is selected selects nothing";
}

TEST_F(OcclusionPanelTest, MethodsPresetsAndMapsAreOneClickAway) {
    click("Method/Mesh rays");
    EXPECT_EQ(document().occlusion.settings.method, OcclusionMethod::MeshRays);
    click("Method/GS-IR");
    EXPECT_EQ(document().occlusion.settings.method, OcclusionMethod::Baked);
    click("Method/RAGA");
    EXPECT_EQ(document().occlusion.settings.method, OcclusionMethod::Rasterised);
    click("Method/Off");
    EXPECT_EQ(document().occlusion.settings.method, OcclusionMethod::Off);
    click("Method/Screen space");
    EXPECT_EQ(document().occlusion.settings.method, OcclusionMethod::ScreenSpace);
    click("Reference");
    EXPECT_EQ(document().occlusion.settings.screenSpace, referenceOcclusion());
    click("Body");
    EXPECT_EQ(document().occlusion.settings.screenSpace, bodyOcclusion());
    click("Show/AO");
    EXPECT_EQ(document().view.buffer, BufferId::AmbientOcclusion);
    click("Show/Importance");
    EXPECT_EQ(document().view.buffer, BufferId::Importance);
    click("Parts");
    click("Spheres");
    EXPECT_TRUE(document().view.parts);
    EXPECT_TRUE(document().view.radiusSpheres);
}

TEST_F(OcclusionPanelTest, StrengthOfTheScreenSpaceMethodIsARow) {
    type("occlusion/Strength", "0.5");
    EXPECT_NEAR(document().occlusion.settings.screenSpace.strength, 0.5f, 1e-5f);
    click("shading/Occlude specular");
    EXPECT_FALSE(document().occlusion.shading.occludeSpecular);
}

} // namespace
} // namespace ars::ui
