// What the shell is made of and needs no window: keys, settings, frame times, folders.
#include "tests/support/test_data.h"
#include "ui/file_chooser.h"
#include "ui/settings.h"
#include "ui/shortcuts.h"
#include "ui/window_timings.h"

#include <gtest/gtest.h>

#include <imgui.h>

#include <fstream>

namespace ars::ui {
namespace {

using ars::test::TemporaryFolder;

TEST(ShortcutKeys, ReadBackAsTheyWereWritten) {
    for (const char* text :
         {"Ctrl+Z", "Ctrl+Shift+P", "F12", "Space", "Ctrl+,", "Alt+Left", "Ctrl+=", "Ctrl+-", "Num7", "Delete", "0"}) {
        const std::optional<int> keys = parseKeys(text);
        ASSERT_TRUE(keys.has_value()) << text;
        EXPECT_EQ(keysText(*keys), text);
    }
    EXPECT_EQ(parseKeys("ctrl+shift+p"), ImGuiMod_Ctrl | ImGuiMod_Shift | ImGuiKey_P);
    EXPECT_EQ(parseKeys("?"), ImGuiMod_Shift | ImGuiKey_Slash);
    EXPECT_EQ(parseAllKeys("F1 or ?"), (std::vector<int>{ImGuiKey_F1, ImGuiMod_Shift | ImGuiKey_Slash}));
}

TEST(ShortcutKeys, WordsThatAreNoKeysAreRefused) {
    for (const char* text : {"", "Ctrl", "Ctrl+", "F25", "Hyper+A", "Ctrl+A+B", "Fx"}) {
        EXPECT_FALSE(parseKeys(text).has_value()) << text;
    }
}

TEST(StudioSettings, SurviveWritingAndReading) {
    const TemporaryFolder folder;
    Settings settings;
    settings.theme = Theme::Light;
    settings.textScale = 1.4f;
    settings.invertZoom = true;
    settings.flySpeed = 3.25f;
    settings.tooltips = false;
    settings.layout = "[Window][Pose]\nPos=1,2\n";
    settings.panels = {{"pose", false}, {"jobs", true}};
    settings.shortcuts = {{"edit.undo", "Ctrl+U"}};
    settings.folders = {{"open", "/somewhere/else"}};
    settings.windowWidth = 1234;
    settings.layoutScale = 2.0f;
    ASSERT_TRUE(writeSettings(folder.path(), settings).ok());
    const Settings read = readSettings(folder.path());
    EXPECT_EQ(read.theme, Theme::Light);
    EXPECT_EQ(read.textScale, 1.4f);
    EXPECT_TRUE(read.invertZoom);
    EXPECT_EQ(read.flySpeed, 3.25f);
    EXPECT_FALSE(read.tooltips);
    EXPECT_EQ(read.layout, settings.layout);
    EXPECT_EQ(read.panels, settings.panels);
    EXPECT_EQ(read.shortcuts, settings.shortcuts);
    EXPECT_EQ(read.folders, settings.folders);
    EXPECT_EQ(read.windowWidth, 1234);
    EXPECT_EQ(read.layoutScale, 2.0f);
}

TEST(StudioSettings, ABrokenFileIsKeptAsideAndTheDefaultsHold) {
    const TemporaryFolder folder;
    std::ofstream(folder / "settings.json") << "{ \"theme\": ";
    EXPECT_EQ(readSettings(folder.path()).theme, Theme::Dark);
    EXPECT_TRUE(std::filesystem::exists(folder / "settings.broken.json"));
    EXPECT_FALSE(std::filesystem::exists(folder / "settings.json"));
}

TEST(StudioSettings, OneBrokenValueDoesNotTakeTheOthersWithIt) {
    const TemporaryFolder folder;
    std::ofstream(folder / "settings.json") << R"({"theme": "light", "tooltips": 3, "text_scale": 99, "panels": []})";
    const Settings settings = readSettings(folder.path());
    EXPECT_EQ(settings.theme, Theme::Light);
    EXPECT_TRUE(settings.tooltips);
    EXPECT_EQ(settings.textScale, 3.0f);
    EXPECT_TRUE(settings.panels.empty());
}

TEST(StudioSettings, AreWrittenBesideTheWindow) {
    const TemporaryFolder folder;
    Settings settings;
    SettingsKeeper keeper(folder.path(), settings);
    keeper.update(settings);
    keeper.flush(settings);
    EXPECT_FALSE(std::filesystem::exists(folder / "settings.json")) << "nothing has changed";
    settings.flySpeed = 2.0f;
    keeper.update(settings);
    settings.flySpeed = 4.0f;
    keeper.flush(settings);
    EXPECT_EQ(readSettings(folder.path()).flySpeed, 4.0f);
}

TEST(FrameTimes, PercentilesAndLongestAreThoseOfTheFrames) {
    WindowTimings timings;
    for (int i = 1; i <= 100; ++i) timings.add({0.0f, static_cast<float>(i), 0.0f});
    EXPECT_EQ(timings.frames(), 100u);
    EXPECT_EQ(timings.percentileMs(0.5), 50.0f);
    EXPECT_EQ(timings.percentileMs(0.99), 99.0f);
    EXPECT_EQ(timings.longest().totalMs(), 100.0f);
    EXPECT_EQ(timings.longest().widgetsMs, 100.0f);
    std::uint64_t counted = 0;
    for (std::uint64_t bin : timings.histogram()) counted += bin;
    EXPECT_EQ(counted, 100u);
    EXPECT_EQ(timings.histogram()[9], 50u) << "51 to 100 ms: more than 50 and at most 100";
    EXPECT_EQ(timings.recentMs().back(), 100.0f);
    ASSERT_EQ(timings.slowest().size(), 10u);
    EXPECT_EQ(timings.slowest().front().frame, 100u);
    EXPECT_EQ(timings.slowest().back().parts.totalMs(), 91.0f);
}

TEST(FrameTimes, StartUpIsCountedApart) {
    WindowTimings timings;
    timings.addStartUp({1.0f, 150.0f, 20.0f, 90.0f});
    timings.addStartUp({1.0f, 10.0f, 20.0f, 12.0f});
    timings.add({1.0f, 2.0f, 3.0f, 4.0f});
    EXPECT_EQ(timings.startUpFrames(), 2u);
    EXPECT_EQ(timings.longestStartUp().totalMs(), 171.0f);
    EXPECT_EQ(timings.frames(), 1u);
    EXPECT_EQ(timings.longest().totalMs(), 6.0f);
    EXPECT_GT(threadProcessorMs(), 0.0);
}

TEST(FolderLists, PutFoldersFirstAndLeaveOutHiddenOnes) {
    const TemporaryFolder folder;
    for (const char* name : {"b.exr", "A.hdr", ".secret"}) std::ofstream(folder / name) << "12345";
    std::filesystem::create_directory(folder / "zebra");
    const FolderListing listing = listFolder(folder.path());
    ASSERT_EQ(listing.entries.size(), 3u);
    EXPECT_EQ(listing.entries[0].name, "zebra");
    EXPECT_TRUE(listing.entries[0].folder);
    EXPECT_EQ(listing.entries[1].name, "A.hdr");
    EXPECT_EQ(listing.entries[2].name, "b.exr");
    EXPECT_EQ(listing.entries[2].bytes, 5u);
}

TEST(FolderLists, SayWhyTheyAreEmpty) { EXPECT_FALSE(listFolder("/there/is/no/such/folder").error.empty()); }

} // namespace
} // namespace ars::ui
