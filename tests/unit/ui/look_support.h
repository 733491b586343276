#pragma once

#include "engine/gl/context.h"
#include "tests/support/test_data.h"
#include "tests/unit/ui/small_document.h"
#include "ui/studio.h"
#include "ui/window.h"

#include <gtest/gtest.h>

#include <imgui.h>
#include <imgui_te_context.h>
#include <imgui_te_engine.h>

#include <chrono>
#include <functional>
#include <memory>
#include <string>

namespace ars::ui::test {

/// One studio without a display for all tests of the panels of the look: opening it takes longer than most of them.
/// Every test begins with a new, small document.
class LookStudio {
public:
    static LookStudio& shared() {
        static LookStudio studio;
        return studio;
    }
    HeadlessStudio& window() { return *window_; }
    Session& session() { return window_->session(); }
    const Document& document() { return session().document(); }
    const std::string& failure() const { return failure_; }
    const std::filesystem::path& folder() const { return folder_.path(); }

    /// Runs what a person does in the window, step by step, until it is done. Fails the running test where an item was
    /// not found.
    void act(const std::function<void(ImGuiTestContext*)>& person) {
        auto* engine = static_cast<ImGuiTestEngine*>(window_->testEngine());
        ASSERT_NE(engine, nullptr);
        ImGuiTestEngine_GetIO(engine).ConfigRunSpeed = ImGuiTestRunSpeed_Fast;
        person_ = person;
        ImGuiTest* test = IM_REGISTER_TEST(engine, "look", "act");
        test->UserData = this;
        test->TestFunc = [](ImGuiTestContext* context) {
            static_cast<LookStudio*>(context->Test->UserData)->person_(context);
        };
        ImGuiTestEngine_QueueTest(engine, test);
        const auto begun = std::chrono::steady_clock::now();
        while (!ImGuiTestEngine_IsTestQueueEmpty(engine) &&
               std::chrono::steady_clock::now() - begun < std::chrono::seconds(60)) {
            window_->step();
        }
        EXPECT_EQ(test->Output.Status, ImGuiTestStatus_Success);
        ImGuiTestEngine_UnregisterTest(engine, test);
    }
    /// Window frames until something holds, at most some seconds.
    bool waitFor(const std::function<bool()>& holds, double seconds = 20.0) {
        const auto begun = std::chrono::steady_clock::now();
        while (!holds()) {
            if (std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count() > seconds) return false;
            window_->step();
        }
        return true;
    }

private:
    LookStudio() {
        WindowStart start;
        start.stateFolder = folder_.path() / "state";
        start.settings.autosave = false;
        start.scale = 1.0f;
        start.document = smallDocument();
        start.lightBase = kSmallLightBase;
        auto made = HeadlessStudio::create(1100, 800, start);
        if (!made) {
            failure_ = made.error().describe();
            return;
        }
        window_ = std::move(*made);
        if (!window_->settle(60.0)) failure_ = "the studio did not come to rest";
    }

    ars::test::TemporaryFolder folder_;
    std::unique_ptr<HeadlessStudio> window_;
    std::function<void(ImGuiTestContext*)> person_;
    std::string failure_;
};

/// A panel in front, with its window as the reference of names.
class PanelTest : public ::testing::Test {
protected:
    void open(const char* panel, const char* title) {
        ASSERT_EQ(studio_.failure(), "");
        studio_.session().replaceDocument(smallDocument(), {}, true);
        studio_.window().studio().setOpen(panel, true);
        studio_.window().step();
        title_ = title;
        studio_.act([&](ImGuiTestContext* context) { context->WindowFocus((std::string("//") + title_).c_str()); });
    }
    /// In the panel's window.
    void act(const std::function<void(ImGuiTestContext*)>& person) {
        studio_.act([&](ImGuiTestContext* context) {
            context->SetRef((std::string("//") + title_).c_str());
            person(context);
        });
    }
    void click(const std::string& item) {
        act([&](ImGuiTestContext* context) { context->ItemClick(item.c_str()); });
    }
    const Document& document() { return studio_.document(); }
    Session& session() { return studio_.session(); }
    std::size_t entries() { return session().editor().history().size(); }

    LookStudio& studio_ = LookStudio::shared();
    std::string title_;
};

} // namespace ars::ui::test
