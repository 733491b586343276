#pragma once

#include "tests/support/test_data.h"
#include "tests/unit/ui/small_document.h"
#include "ui/studio.h"
#include "ui/window.h"

#include <gtest/gtest.h>

#include <imgui.h>
#include <imgui_te_context.h>
#include <imgui_te_engine.h>

#include <chrono>
#include <cstdlib>
#include <functional>
#include <memory>
#include <string>

namespace ars::ui::test {

/// A studio without a display, and a person who clicks and types in it.
class StudioDriver {
public:
    /// @param state  folder of settings and autosaves; the settings are those that lie in it
    StudioDriver(int width, int height, const std::filesystem::path& state, float scale = 1.0f,
                 const std::function<void(WindowStart&)>& change = {}) {
        ::setenv("ARS_FILE_CHOOSER", "internal", 1);
        WindowStart start;
        start.stateFolder = state;
        start.settings = readSettings(state);
        start.settings.showHints = false;
        start.scale = scale;
        start.document = smallDocument();
        start.lightBase = kSmallLightBase;
        if (change) change(start);
        auto made = HeadlessStudio::create(width, height, start);
        if (!made) {
            ADD_FAILURE() << made.error().describe();
            std::abort(); // nothing of these tests is possible without OpenGL, and that is no state to go on in
        }
        window_ = std::move(*made);
        for (int i = 0; i < 4; ++i) window_->step(); // docks are laid out
    }

    HeadlessStudio& window() { return *window_; }
    Session& session() { return window_->session(); }
    Studio& studio() { return window_->studio(); }
    const Document& document() { return session().document(); }

    /// What a person does, step by step, with frames of the window between; a widget that is not there fails the test.
    void act(const std::function<void(ImGuiTestContext*)>& person, const std::function<void()>& widgets = {}) {
        auto* engine = static_cast<ImGuiTestEngine*>(window_->testEngine());
        ASSERT_NE(engine, nullptr);
        person_ = person;
        widgets_ = widgets;
        ImGuiTest* test = IM_REGISTER_TEST(engine, "studio", "act");
        test->UserData = this;
        test->TestFunc = [](ImGuiTestContext* context) {
            static_cast<StudioDriver*>(context->Test->UserData)->person_(context);
        };
        if (widgets) {
            test->GuiFunc = [](ImGuiTestContext* context) {
                static_cast<StudioDriver*>(context->Test->UserData)->widgets_();
            };
        }
        ImGuiTestEngine_QueueTest(engine, test);
        for (int i = 0; i < 3000 && !ImGuiTestEngine_IsTestQueueEmpty(engine); ++i) window_->step();
        EXPECT_EQ(test->Output.Status, ImGuiTestStatus_Success);
        ImGuiTestEngine_UnregisterTest(engine, test);
        window_->step();
    }

    /// Window frames until something holds; false when it does not within some seconds.
    bool waitFor(const std::function<bool()>& holds, double seconds = 20.0) {
        const auto begun = std::chrono::steady_clock::now();
        while (!holds()) {
            if (std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count() > seconds) return false;
            window_->step();
        }
        return true;
    }

private:
    std::unique_ptr<HeadlessStudio> window_;
    std::function<void(ImGuiTestContext*)> person_;
    std::function<void()> widgets_;
};

} // namespace ars::ui::test
