#include "engine/core/process.h"
#include "engine/io/exr.h"
#include "engine/io/png.h"
#include "engine/scene/project.h"
#include "ui/look/output_jobs.h"

#include "tests/unit/ui/look_support.h"

#include <fstream>

namespace ars::ui {
namespace {

TEST(ShellWords, MeanTheSameToAShell) {
    for (const std::string text : {"plain/file.png", "with space.png", "it's.png", "a\"b$c`d\\e;f|g&h*.png", ""}) {
        const auto said = runProcess({"sh", "-c", "printf %s " + shellWord(text)});
        ASSERT_TRUE(said.ok());
        EXPECT_EQ(said->output, text);
    }
}

TEST(FreeNames, NeverNameWhatIsThere) {
    const ars::test::TemporaryFolder folder;
    EXPECT_EQ(freeName(folder / "picture.png"), folder / "picture.png");
    std::ofstream(folder / "picture.png") << "x";
    EXPECT_EQ(freeName(folder / "picture.png"), folder / "picture-2.png");
    std::ofstream(folder / "picture-2.png") << "x";
    EXPECT_EQ(freeName(folder / "picture.png"), folder / "picture-3.png");
    EXPECT_EQ(freeName(folder / "picture-2.png"), folder / "picture-3.png");
    std::filesystem::create_directory(folder / "frames");
    EXPECT_EQ(freeName(folder / "frames"), folder / "frames-2");
}

TEST(CommandLines, SayEverythingThatWasChosen) {
    VideoOptions film;
    film.file = "/tmp/a film.mp4";
    film.width = 640;
    film.height = 360;
    film.framesPerSecond = 24;
    film.startS = 1;
    film.endS = 2.5;
    const std::string command = filmCommand("/home/me/one.ars", film);
    for (const char* part : {"ars render --project /home/me/one.ars", "--size 640x360", "24", "'/tmp/a film.mp4'"}) {
        EXPECT_NE(command.find(part), std::string::npos) << part << " in " << command;
    }
}

class OutputPanelTest : public test::PanelTest {
protected:
    void SetUp() override { open("output", "Output"); }
    void type(const std::string& item, const std::string& text) {
        act([&](ImGuiTestContext* context) { context->ItemInputValue(item.c_str(), text.c_str()); });
    }
    /// In a narrow panel, where both halves stand below each other. The two numbers have no label of their own.
    void size(const char* scope, int width, int height) {
        type(std::string(scope) + "/##Pixels/$$0", std::to_string(width));
        type(std::string(scope) + "/##Pixels/$$1", std::to_string(height));
    }
};

TEST_F(OutputPanelTest, AScreenshotHasTheSizeThatWasTypedAndCarriesTheDocument) {
    const auto file = studio_.folder() / "shot.png";
    size("Picture", 96, 72);
    type("**/Picture/File", file.string());
    click("**/Save picture");
    ASSERT_TRUE(studio_.waitFor([&] { return std::filesystem::exists(file) && session().jobs().empty(); }));
    const auto png = readPng(file);
    ASSERT_TRUE(png.ok());
    EXPECT_EQ(png->image.width, 96);
    EXPECT_EQ(png->image.height, 72);
    const auto document = documentFromPicture(file);
    ASSERT_TRUE(document.ok());
    EXPECT_EQ(document->light, session().document().light);
}

TEST_F(OutputPanelTest, AnExrHoldsTheBuffersAsLayers) {
    click("**/Picture/Format/EXR layers");
    const auto file = studio_.folder() / "layers.exr";
    size("Picture", 64, 48);
    type("**/Picture/File", file.string());
    click("**/Save picture");
    ASSERT_TRUE(studio_.waitFor([&] { return std::filesystem::exists(file) && session().jobs().empty(); }));
    const auto info = listExr(file);
    ASSERT_TRUE(info.ok());
    for (const char* layer : {"", "albedo", "ao", "radius", "depth"}) {
        EXPECT_NE(std::find(info->layers.begin(), info->layers.end(), layer), info->layers.end()) << layer;
    }
    click("**/Picture/Format/PNG picture");
}

TEST_F(OutputPanelTest, AFilmIsCancelledAndLeavesNothing) {
    click("**/Movie/Format/PNG frames");
    const auto folder = studio_.folder() / "frames";
    type("**/Movie/Folder", folder.string());
    click("**/Save film");
    ASSERT_TRUE(studio_.waitFor([&] { return !session().jobs().empty(); }));
    click("**/Cancel");
    ASSERT_TRUE(studio_.waitFor([&] { return session().jobs().empty(); }));
    EXPECT_FALSE(std::filesystem::exists(folder));
    click("**/Movie/Format/MP4 film");
}

} // namespace
} // namespace ars::ui
