// The shell of the studio, driven by a person of clay: menus, keys, palette, dialogs, file chooser, layout.
#include "tests/unit/ui/studio_driver.h"

#include "ui/shortcuts.h"
#include "ui/theme.h"
#include "ui/widgets.h"

#include <imgui_internal.h>

#include <algorithm>
#include <fstream>

namespace ars::ui {
namespace {

using ars::test::TemporaryFolder;
using test::StudioDriver;

/// Opening a studio takes longer than most tests: they share one. Each begins with a new, small document and no dialog.
class StudioShell : public ::testing::Test {
protected:
    void SetUp() override {
        if (!folder()) folder() = std::make_unique<TemporaryFolder>();
        if (!shared()) shared() = std::make_unique<StudioDriver>(1280, 720, folder()->path() / "state");
        studio_ = shared().get();
        studio_->session().replaceDocument(test::smallDocument(), {}, true);
        studio_->act([](ImGuiTestContext* person) { person->MouseMoveToPos({640, 4}); });
    }
    static void TearDownTestSuite() {
        shared().reset();
        folder().reset();
    }
    static std::unique_ptr<StudioDriver>& shared() {
        static std::unique_ptr<StudioDriver> driver;
        return driver;
    }
    static std::unique_ptr<TemporaryFolder>& folder() {
        static std::unique_ptr<TemporaryFolder> made;
        return made;
    }
    StudioDriver* studio_ = nullptr;
};

std::string labelOf(const char* command) { return findCommand(command)->label; }

bool isShown(const char* window) {
    const ImGuiWindow* found = ImGui::FindWindowByName(window);
    return found && found->WasActive && !found->Hidden;
}

/// Windows of panels, popups and their children that reach beyond the studio's own window or carry two widgets of one
/// name; widgets that are cut off at the right although their window cannot be scrolled there.
std::vector<std::string> layoutFaults(const ImVec2& size) {
    std::vector<std::string> faults;
    if (GImGui->DebugDrawIdConflictsCount > 0) faults.push_back("two widgets have one name");
    for (const ImGuiWindow* window : GImGui->Windows) {
        if (!window->WasActive || window->Hidden || window->IsFallbackWindow) continue;
        const ImRect rect = window->Rect();
        if (!(window->Flags & ImGuiWindowFlags_ChildWindow) &&
            (rect.Min.x < -1 || rect.Min.y < -1 || rect.Max.x > size.x + 1 || rect.Max.y > size.y + 1)) {
            faults.push_back(std::string(window->Name) + " reaches beyond the window");
        }
        const bool scrolls = window->Flags & ImGuiWindowFlags_HorizontalScrollbar;
        if (!scrolls && window->ContentSize.x > 1 && window->ScrollMax.x == 0.0f &&
            window->ContentSize.x > window->InnerRect.GetWidth() + 1) {
            faults.push_back(std::string(window->Name) + " is too narrow for what it holds");
        }
    }
    return faults;
}

void expectPanelsFit(StudioDriver& studio, const ImVec2& size) {
    for (const char* id : {"pose", "light", "occlusion", "camera", "buffers", "compare", "timeline", "output",
                           "history", "performance", "jobs"}) {
        studio.studio().setOpen(id, true);
        for (int i = 0; i < 4; ++i) studio.window().step();
        const char* title = studio.studio().panel(id)->title();
        EXPECT_TRUE(isShown(title)) << title;
        for (const std::string& fault : layoutFaults(size)) ADD_FAILURE() << id << ": " << fault;
        if (const ImGuiWindow* window = ImGui::FindWindowByName(title)) {
            EXPECT_LE(window->ContentSize.x, window->InnerRect.GetWidth() + 1) << title << " is cut off at the right";
        }
    }
}

TEST_F(StudioShell, EveryPanelFitsAt1280x720) { expectPanelsFit(*studio_, {1280, 720}); }

TEST_F(StudioShell, TheViewportHasTheLargestPartOfTheWindow) {
    const ImGuiWindow* viewport = ImGui::FindWindowByName("Viewport");
    ASSERT_NE(viewport, nullptr);
    EXPECT_GT(viewport->Size.x / 1280, 0.5f);
    EXPECT_GT(viewport->Size.y / 720, 0.5f);
}

TEST_F(StudioShell, AMenuEntryRunsItsCommand) {
    ASSERT_FALSE(studio_->document().view.skeleton);
    const std::string entry = "View/" + labelOf("view.skeleton");
    studio_->act([&](ImGuiTestContext* person) {
        person->SetRef("##MainMenuBar");
        person->MenuClick(entry.c_str());
    });
    EXPECT_TRUE(studio_->document().view.skeleton);
}

TEST_F(StudioShell, UndoAndRedoKeysGoBackAndForth) {
    const Document before = studio_->document();
    ASSERT_TRUE(studio_->session().run("light.rotate", {{"degrees", 90.0}}).ok());
    const Document after = studio_->document();
    studio_->act([](ImGuiTestContext* person) { person->KeyPress(ImGuiMod_Ctrl | ImGuiKey_Z); });
    EXPECT_TRUE(studio_->document() == before);
    studio_->act([](ImGuiTestContext* person) { person->KeyPress(ImGuiMod_Ctrl | ImGuiMod_Shift | ImGuiKey_Z); });
    EXPECT_TRUE(studio_->document() == after);
    studio_->act([](ImGuiTestContext* person) { person->KeyPress(ImGuiMod_Ctrl | ImGuiKey_Z); });
    studio_->act([](ImGuiTestContext* person) { person->KeyPress(ImGuiMod_Ctrl | ImGuiKey_Y); });
    EXPECT_TRUE(studio_->document() == after);
}

TEST_F(StudioShell, ThePaletteAsksForWhatACommandMustKnow) {
    const std::string label = labelOf("timeline.speed");
    ASSERT_EQ(studio_->document().timeline.speed, 1.0);
    studio_->act([&](ImGuiTestContext* person) {
        person->KeyPress(ImGuiMod_Ctrl | ImGuiKey_K);
        person->Yield(3);
        person->KeyChars(label.c_str());
        person->Yield(2);
        person->KeyPress(ImGuiKey_Enter);
        person->Yield(3);
        EXPECT_EQ(studio_->document().timeline.speed, 1.0) << "not before the question is answered";
        person->KeyChars("2.5");
        person->Yield(2);
        person->KeyPress(ImGuiKey_Enter);
        person->Yield(2);
    });
    EXPECT_EQ(studio_->document().timeline.speed, 2.5);
    EXPECT_FALSE(isShown("###Palette"));
}

TEST_F(StudioShell, EscapeLeavesThePaletteWithoutDoingAnything) {
    const std::size_t edits = studio_->session().editor().history().size();
    studio_->act([](ImGuiTestContext* person) {
        person->KeyPress(ImGuiMod_Ctrl | ImGuiMod_Shift | ImGuiKey_P);
        person->Yield(3);
        EXPECT_TRUE(isShown("###Palette"));
        person->KeyPress(ImGuiKey_Escape);
        person->Yield(2);
    });
    EXPECT_FALSE(isShown("###Palette"));
    EXPECT_EQ(studio_->session().editor().history().size(), edits);
}

TEST_F(StudioShell, KeysAreNoShortcutsWhileTextIsTyped) {
    studio_->act([](ImGuiTestContext* person) {
        person->KeyPress(ImGuiKey_F1);
        person->Yield(3);
        person->ItemClick("//Shortcuts/Search");
        person->KeyPress(ImGuiKey_Space); // plays the timeline otherwise
        person->Yield(2);
    });
    EXPECT_FALSE(studio_->session().transport().playing);
    studio_->act([](ImGuiTestContext* person) {
        person->KeyPress(ImGuiKey_Escape);
        person->Yield(2);
    });
    EXPECT_FALSE(isShown("Shortcuts"));
}

TEST_F(StudioShell, TheThemeSwitchesBetweenDarkAndLight) {
    const auto brightness = [&] {
        const std::vector<std::uint8_t> pixels = studio_->window().pixels();
        double sum = 0;
        for (std::size_t x = 0; x < 1280 * 4; ++x) sum += pixels[1280 * 4 * 2 + x]; // a line of the menu bar
        return sum / (1280 * 4);
    };
    const double dark = brightness();
    studio_->studio().invoke("window.theme");
    studio_->window().step();
    studio_->window().step();
    EXPECT_GT(brightness(), dark + 60);
    EXPECT_EQ(studio_->window().settings().theme, Theme::Light);
    studio_->studio().invoke("window.theme");
    studio_->window().step();
    studio_->window().step();
    EXPECT_NEAR(brightness(), dark, 1.0);
}

TEST_F(StudioShell, AProjectIsSavedAndOpenedWithTheFileChooser) {
    const std::filesystem::path file = folder()->path() / "one.ars";
    ASSERT_TRUE(studio_->session().run("light.rotate", {{"degrees", 33.0}}).ok());
    studio_->act([&](ImGuiTestContext* person) {
        person->KeyPress(ImGuiMod_Ctrl | ImGuiMod_Shift | ImGuiKey_S);
        person->Yield(3);
        person->ItemInputValue("//###FileChooser/Name", (folder()->path() / "one").c_str());
        person->Yield(2);
    });
    ASSERT_TRUE(studio_->waitFor([&] { return !studio_->session().editor().modified(); }));
    EXPECT_TRUE(std::filesystem::exists(file)) << "the ending is added";
    EXPECT_EQ(studio_->session().projectPath(), file);

    studio_->session().newProject();
    studio_->act([&](ImGuiTestContext* person) {
        person->KeyPress(ImGuiMod_Ctrl | ImGuiKey_O);
        person->Yield(3);
        person->ItemInputValue("//###FileChooser/Name", file.c_str());
        person->Yield(2);
    });
    EXPECT_TRUE(studio_->waitFor([&] { return studio_->document().light.rotationDeg == 33.0f; }));
}

TEST_F(StudioShell, AnExistingFileIsReplacedOnlyWhenAskedTwice) {
    const std::filesystem::path file = folder()->path() / "there.ars";
    std::ofstream(file) << "mine";
    ASSERT_TRUE(studio_->session().run("light.rotate", {{"degrees", 12.0}}).ok());
    studio_->act([&](ImGuiTestContext* person) {
        person->KeyPress(ImGuiMod_Ctrl | ImGuiMod_Shift | ImGuiKey_S);
        person->Yield(3);
        person->ItemInputValue("//###FileChooser/Name", file.c_str());
        person->Yield(3);
        std::string text;
        std::getline(std::ifstream(file), text);
        EXPECT_EQ(text, "mine");
        person->ItemClick("//###FileChooser/###Accept"); // says "Replace" now
        person->Yield(2);
    });
    EXPECT_TRUE(studio_->waitFor([&] { return !studio_->session().editor().modified(); }));
    EXPECT_GT(std::filesystem::file_size(file), 100u);
}

TEST_F(StudioShell, ABrokenFileGivesADialogAndChangesNothing) {
    const std::filesystem::path file = folder()->path() / "broken.exr";
    std::ofstream(file, std::ios::binary) << "\x76\x2f\x31\x01 and nothing of what must follow";
    const Document before = studio_->document();
    studio_->studio().drop({file});
    ASSERT_TRUE(studio_->waitFor([] { return isShown("###Error") || GImGui->OpenPopupStack.Size > 0; }));
    bool said = false;
    for (const Notice& notice : studio_->studio().notices()) {
        said = said || (notice.kind == Notice::Kind::Error && notice.text.find("broken.exr") != std::string::npos);
    }
    EXPECT_TRUE(said) << "the message names the file";
    studio_->act([](ImGuiTestContext* person) { person->ItemClick("//###Error/OK"); });
    EXPECT_EQ(GImGui->OpenPopupStack.Size, 0);
    EXPECT_TRUE(studio_->document() == before);
}

TEST_F(StudioShell, ADragOfASliderIsOneUndoEntry) {
    StudioContext context{studio_->session(), studio_->window().settings(), studio_->studio(), 1.0f};
    const auto widgets = [&] {
        ImGui::SetNextWindowPos({400, 200});
        ImGui::SetNextWindowSize({300, 120});
        ImGui::Begin("Slider", nullptr, ImGuiWindowFlags_NoDocking | ImGuiWindowFlags_NoSavedSettings);
        float degrees = context.document().light.rotationDeg;
        if (ImGui::SliderFloat("Turn", &degrees, -180, 180)) {
            runFromWidget(context, "light.rotate", {{"degrees", degrees}});
        }
        ImGui::End();
    };
    const std::size_t before = studio_->session().editor().history().size();
    const auto drag = [](ImGuiTestContext* person) {
        person->MouseMove("//Slider/Turn");
        person->MouseDown();
        for (int i = 0; i < 6; ++i) {
            person->MouseMoveToPos({480.0f + 12.0f * static_cast<float>(i), person->GetMainMonitorWorkPos().y + 235});
            person->Yield();
        }
        person->MouseUp();
        person->Yield(2);
    };
    studio_->act(drag, widgets);
    EXPECT_NE(studio_->document().light.rotationDeg, 0.0f);
    EXPECT_EQ(studio_->session().editor().history().size(), before + 1);
    studio_->act(drag, widgets);
    EXPECT_EQ(studio_->session().editor().history().size(), before + 2) << "another drag is another entry";
}

TEST_F(StudioShell, NoKeyCallsTwoThings) {
    std::map<int, std::string> taken;
    for (const ShortcutLine& line : shortcutLines(studio_->studio().actions(), Settings{})) {
        for (int keys : parseAllKeys(line.keys)) {
            const auto [place, fresh] = taken.emplace(keys, line.id);
            EXPECT_TRUE(fresh) << line.keys << " calls " << place->second << " and " << line.id;
        }
        EXPECT_TRUE(line.keys.empty() || !parseAllKeys(line.keys).empty()) << line.id << ": " << line.keys;
    }
    EXPECT_GT(taken.size(), 10u);
}

TEST_F(StudioShell, EveryActionSaysWhatItDoes) {
    for (const Action& action : studio_->studio().actions()) {
        EXPECT_FALSE(action.label.empty()) << action.id;
        EXPECT_FALSE(action.help.empty()) << action.id;
        EXPECT_TRUE(action.run) << action.id;
        EXPECT_EQ(findCommand(action.id), nullptr) << action.id << " is a command, too";
    }
}

TEST(StudioOfItsOwn, SettingsSurviveAndUnsavedWorkIsAskedFor) {
    const TemporaryFolder folder;
    {
        StudioDriver studio(800, 600, folder.path());
        studio.studio().invoke("window.theme");
        studio.studio().invoke("window.larger_text");
        studio.studio().setOpen("history", false);
        studio.window().step();
        ASSERT_TRUE(studio.session().run("light.rotate", {{"degrees", 5.0}}).ok());
        studio.studio().requestQuit();
        studio.act([](ImGuiTestContext* person) { person->ItemClick("//###Unsaved/Cancel"); });
        EXPECT_FALSE(studio.studio().quit());
        studio.studio().requestQuit();
        studio.act([](ImGuiTestContext* person) { person->ItemClick("//###Unsaved/Discard"); });
        EXPECT_TRUE(studio.studio().quit());
    }
    const Settings settings = readSettings(folder.path());
    EXPECT_EQ(settings.theme, Theme::Light);
    EXPECT_FLOAT_EQ(settings.textScale, 1.1f);
    EXPECT_FALSE(settings.layout.empty());
    StudioDriver again(800, 600, folder.path());
    EXPECT_FALSE(again.studio().isOpen("history"));
    EXPECT_TRUE(again.studio().isOpen("pose"));
    again.studio().requestQuit();
    EXPECT_TRUE(again.studio().quit()) << "nothing is unsaved";
}

TEST(StudioOfItsOwn, At3840x2160EverythingFitsAndThePictureIsAsSharpAsTheScreen) {
    const TemporaryFolder folder;
    StudioDriver studio(3840, 2160, folder.path(), 2.0f, [](WindowStart& start) {
        // Fewer directions make it faster and no less sharp.
        start.document->occlusion.settings.screenSpace.adaptive = OcclusionAdaptive::Off;
        start.document->occlusion.settings.screenSpace.delta = 0.25f;
    });
    ASSERT_TRUE(studio.window().settle(120.0)) << "it does not come to rest";
    const std::shared_ptr<const Frame> frame = studio.session().frame();
    ASSERT_NE(frame, nullptr);
    EXPECT_EQ(frame->quality, FrameQuality::Full);
    ImRect picture;
    studio.act([&](ImGuiTestContext* person) { picture = person->ItemInfo("//Viewport/Picture").RectFull; });
    EXPECT_GT(picture.GetWidth(), 2000.0f);
    EXPECT_GT(picture.GetHeight(), 1000.0f);
    EXPECT_EQ(frame->inputs.camera.width, static_cast<int>(picture.GetWidth())) << "one pixel for each of the screen";
    EXPECT_EQ(frame->inputs.camera.height, static_cast<int>(picture.GetHeight()));
    EXPECT_FLOAT_EQ(ImGui::GetStyle().FontSizeBase * ImGui::GetStyle().FontScaleMain, 2.0f * kTextSize);
    // The body is there: a column through its middle has light and dark pixels, and all of them are no copies of their
    // neighbours, as those of an enlarged picture would be.
    const std::vector<std::uint8_t> pixels = studio.window().pixels();
    int changes = 0, lit = 0;
    const auto column = static_cast<std::size_t>(picture.GetCenter().x) - 40;
    for (auto row = static_cast<std::size_t>(picture.Min.y); row + 1 < static_cast<std::size_t>(picture.Max.y); ++row) {
        const std::uint8_t *here = &pixels[4 * (row * 3840 + column)], *below = here + 4 * 3840;
        if (here[0] < 90) continue;
        ++lit;
        changes += here[0] != below[0] || here[1] != below[1] || here[2] != below[2];
    }
    EXPECT_GT(lit, 300);
    EXPECT_GT(changes, lit / 4);
    expectPanelsFit(studio, {3840, 2160});
}

} // namespace
} // namespace ars::ui
