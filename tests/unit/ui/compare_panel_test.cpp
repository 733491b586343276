#include "engine/io/png.h"

#include "tests/unit/ui/look_support.h"

namespace ars::ui {
namespace {

class ComparePanelTest : public test::PanelTest {
protected:
    void SetUp() override { open("compare", "Compare"); }
};

TEST_F(ComparePanelTest, LayoutAndMeasureAreButtons) {
    click("Layout/Blink");
    EXPECT_EQ(document().view.layout, ViewLayout::Blink);
    click("Layout/Off");
    EXPECT_EQ(document().view.layout, ViewLayout::Single);
    click("Measure/FLIP");
    EXPECT_EQ(document().view.compare.measure, ErrorMeasure::Flip);
    click("Measure/Squared");
    EXPECT_EQ(document().view.compare.measure, ErrorMeasure::Squared);
}

TEST_F(ComparePanelTest, TheOtherBufferIsChosenFromTheCatalogue) {
    act([](ImGuiTestContext* context) { context->ComboClick("Other buffer/Specular light"); });
    EXPECT_EQ(document().view.compare.kind, CompareKind::Buffer);
    EXPECT_EQ(document().view.compare.buffer, BufferId::Specular);
}

TEST_F(ComparePanelTest, AHeldLookStaysWhileTheLightChanges) {
    click("Kind/Held look");
    EXPECT_EQ(document().view.compare.kind, CompareKind::Held);
    ASSERT_NE(document().view.compare.held, nullptr);
    const LightSection light = document().light;
    ASSERT_TRUE(session().run("light.kind", {{"kind", "sky"}}).ok());
    EXPECT_EQ(document().view.compare.held->light, light);
    click("Hold again");
    EXPECT_EQ(document().view.compare.held->light.kind, LightKind::Sky);
    click("Release");
    EXPECT_EQ(document().view.compare.kind, CompareKind::Buffer);
}

TEST_F(ComparePanelTest, APictureFileStandsOnTheOtherSide) {
    Image image;
    image.width = 8;
    image.height = 6;
    image.channels = 3;
    image.space = ColorSpace::Srgb;
    image.pixels.assign(8 * 6 * 3, 0.5f);
    const auto file = studio_.folder() / "truth.png";
    ASSERT_TRUE(writePng(file, image).ok());
    session().openAs(file, FileRole::ComparePicture);
    ASSERT_TRUE(studio_.waitFor([&] { return document().view.compare.kind == CompareKind::Picture; }));
    EXPECT_EQ(document().view.compare.file, file.string());
    ASSERT_TRUE(studio_.waitFor([&] { return session().assets().picture != nullptr; }));
    act([](ImGuiTestContext* context) { EXPECT_TRUE(context->ItemExists("Choose picture")); });
}

} // namespace
} // namespace ars::ui
