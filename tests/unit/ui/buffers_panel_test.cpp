#include "ui/look/buffer_pictures.h"

#include "tests/unit/ui/look_support.h"

#include <algorithm>

namespace ars::ui {
namespace {

Image picture(int width, int height, int channels, float value) {
    Image image;
    image.width = width;
    image.height = height;
    image.channels = channels;
    image.space = ColorSpace::Data;
    image.pixels.assign(static_cast<std::size_t>(width * height * channels), value);
    return image;
}

TEST(BufferHistograms, CountCoveredPixelsInTheirBins) {
    // Four rows with 0.125, 0.375, 0.625, 0.875; the last column is empty.
    Image values = picture(5, 4, 1, 0.0f), opacity = picture(5, 4, 1, 1.0f);
    for (int row = 0; row < 4; ++row) {
        for (int column = 0; column < 5; ++column) values.at(row, column, 0) = 0.125f + 0.25f * static_cast<float>(row);
        opacity.at(row, 4, 0) = 0.0f;
    }
    const BufferHistogram histogram = histogramOf(values, opacity, {0.0f, 1.0f}, 4);
    EXPECT_EQ(histogram.counted, 16u);
    EXPECT_EQ(histogram.channels, 1);
    ASSERT_EQ(histogram.shares[0].size(), 4u);
    for (const float share : histogram.shares[0]) EXPECT_NEAR(share, 0.25f, 1e-5f);
}

TEST(BufferHistograms, ReachOverTheRangeWhereTheDataDoes) {
    Image values = picture(100, 1, 1, 0.0f);
    for (int column = 0; column < 100; ++column) values.at(0, column, 0) = static_cast<float>(column) * 0.1f;
    const BufferHistogram histogram = histogramOf(values, picture(100, 1, 1, 1.0f), {2.0f, 3.0f}, 10);
    EXPECT_LT(histogram.low, 0.2f);
    EXPECT_GT(histogram.high, 9.6f);
    EXPECT_NEAR(histogram.percentile99, 9.8f, 0.11f);
    float sum = 0;
    for (const float share : histogram.shares[0]) sum += share;
    EXPECT_NEAR(sum, 1.0f, 1e-4f);
}

TEST(BufferHistograms, OfNothingAreEmpty) {
    const BufferHistogram histogram = histogramOf(picture(4, 4, 3, 0.5f), picture(4, 4, 1, 0.0f), {0.0f, 1.0f}, 8);
    EXPECT_EQ(histogram.counted, 0u);
    EXPECT_TRUE(histogram.shares[0].empty());
}

TEST(ThinnedPictures, KeepShapeAndPixels) {
    Image image = picture(100, 60, 1, 0.0f);
    for (int row = 0; row < 60; ++row) {
        for (int column = 0; column < 100; ++column) image.at(row, column, 0) = static_cast<float>(row * 100 + column);
    }
    const Image thin = thinnedPicture(image, 25, 100);
    EXPECT_EQ(thin.width, 25);
    EXPECT_EQ(thin.height, 15);
    EXPECT_EQ(thin.at(2, 3, 0), image.at(8, 12, 0));
    EXPECT_EQ(thinnedPicture(image, 100, 60).pixels, image.pixels);
}

class BuffersPanelTest : public test::PanelTest {
protected:
    void SetUp() override { open("buffers", "Buffers"); }
};

TEST_F(BuffersPanelTest, EveryBufferOfTheCatalogueHasARowAndIsOneClickAway) {
    act([&](ImGuiTestContext* context) {
        for (const BufferInfo& info : bufferCatalogue()) {
            EXPECT_TRUE(context->ItemExists(std::string(info.label).c_str())) << info.label;
        }
        for (const BufferId id : {BufferId::Normal, BufferId::AmbientOcclusion, BufferId::Specular}) {
            context->ItemClick(std::string(bufferInfo(id).label).c_str());
            EXPECT_EQ(document().view.buffer, id);
        }
    });
}

TEST_F(BuffersPanelTest, LayoutsAreButtons) {
    click("Layout/Side by side");
    EXPECT_EQ(document().view.layout, ViewLayout::SideBySide);
    click("Layout/Grid");
    EXPECT_EQ(document().view.layout, ViewLayout::Grid);
    click("Layout/Single");
    EXPECT_EQ(document().view.layout, ViewLayout::Single);
}

TEST_F(BuffersPanelTest, TicksSayWhatStandsInTheStrip) {
    const std::vector<BufferId> before = document().view.strip;
    ASSERT_EQ(std::count(before.begin(), before.end(), BufferId::Bone), 0);
    click("Strip Bone direction");
    const std::vector<BufferId> with = document().view.strip;
    EXPECT_EQ(std::count(with.begin(), with.end(), BufferId::Bone), 1);
    EXPECT_EQ(with.size(), before.size() + 1);
    click("Strip Bone direction");
    EXPECT_EQ(document().view.strip, before);
}

TEST_F(BuffersPanelTest, RangeAndColoursBelongToTheShownBuffer) {
    click("Depth");
    act([](ImGuiTestContext* context) {
        context->ItemInputValue("##Range/$$0", "2");
        context->ItemInputValue("##Range/$$1", "6");
        context->ItemClick("Colour map/magma");
    });
    const BufferDisplay display = document().view.buffers[static_cast<std::size_t>(BufferId::Depth)];
    ASSERT_TRUE(display.range.has_value());
    EXPECT_NEAR(display.range->first, 2.0f, 1e-4f);
    EXPECT_NEAR(display.range->second, 6.0f, 1e-4f);
    EXPECT_EQ(display.colorMap, ColorMap::Magma);
    EXPECT_EQ(document().view.buffers[static_cast<std::size_t>(BufferId::Radius)], BufferDisplay{});
    click("Default range");
    EXPECT_FALSE(document().view.buffers[static_cast<std::size_t>(BufferId::Depth)].range.has_value());
}

TEST_F(BuffersPanelTest, FittingTakesTheRangeOfWhatIsSeen) {
    click("Depth");
    ASSERT_TRUE(studio_.waitFor([&] {
        const auto frame = session().frame();
        return session().settled() && frame && frame->picture(BufferId::Depth);
    }));
    act([](ImGuiTestContext* context) {
        context->SleepNoSkip(0.5f, 0.05f);
        context->ItemClick("Fit to picture");
    });
    const auto range = document().view.buffers[static_cast<std::size_t>(BufferId::Depth)].range;
    ASSERT_TRUE(range.has_value());
    const SceneCamera camera = document().camera.camera;
    const auto distance = static_cast<float>(glm::length(camera.eye - camera.target));
    EXPECT_GT(range->first, distance - 1.0f);
    EXPECT_LT(range->second, distance + 1.0f);
    EXPECT_LT(range->first, range->second);
}

} // namespace
} // namespace ars::ui
