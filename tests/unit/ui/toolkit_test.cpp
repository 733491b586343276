// The libraries under the window, each made to do its work once without a display: drawing through EGL, clicking
// through the test engine.
#include "engine/core/process.h"
#include "engine/gl/context.h"

#include "tests/support/test_data.h"

// OpenGL before GLFW, Dear ImGui before what builds on it.
#define GL_GLEXT_PROTOTYPES
#include <GL/glcorearb.h>

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>

#include <imgui.h>

#include <ImGuizmo.h>
#include <imcmd_command_palette.h>
#include <imgui_impl_opengl3.h>
#include <imgui_te_context.h>
#include <imgui_te_engine.h>
#include <implot.h>
#include <portable_file_dialogs.h>

#include <gtest/gtest.h>

#include <cstring>
#include <vector>

namespace ars {
namespace {

constexpr int kWidth = 640;
constexpr int kHeight = 480;

/// A picture to draw into, 8 bits a channel.
class Target {
public:
    Target() {
        glGenFramebuffers(1, &framebuffer_);
        glGenRenderbuffers(1, &color_);
        glBindRenderbuffer(GL_RENDERBUFFER, color_);
        glRenderbufferStorage(GL_RENDERBUFFER, GL_RGBA8, kWidth, kHeight);
        glBindFramebuffer(GL_FRAMEBUFFER, framebuffer_);
        glFramebufferRenderbuffer(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_RENDERBUFFER, color_);
    }
    ~Target() {
        glDeleteFramebuffers(1, &framebuffer_);
        glDeleteRenderbuffers(1, &color_);
    }
    std::vector<unsigned char> read() const {
        std::vector<unsigned char> pixels(kWidth * kHeight * 4);
        glReadPixels(0, 0, kWidth, kHeight, GL_RGBA, GL_UNSIGNED_BYTE, pixels.data());
        return pixels;
    }

private:
    GLuint framebuffer_ = 0, color_ = 0;
};

class Toolkit : public ::testing::Test {
protected:
    void SetUp() override {
        auto context = HeadlessContext::create();
        ASSERT_TRUE(context.ok()) << context.error().describe();
        context_ = std::move(*context);
        std::printf("OpenGL: %s, %s\n", context_->info().renderer.c_str(), context_->info().platform.c_str());
        // Studios of other tests may live on: a new context is not the current one by itself then.
        ImGui::SetCurrentContext(ImGui::CreateContext());
        ImPlot::SetCurrentContext(ImPlot::CreateContext());
        ImCmd::CreateContext();
        ImGuiIO& io = ImGui::GetIO();
        io.IniFilename = nullptr;
        io.DisplaySize = ImVec2(kWidth, kHeight);
        io.ConfigFlags |= ImGuiConfigFlags_DockingEnable;
        ASSERT_TRUE(ImGui_ImplOpenGL3_Init("#version 450 core"));
    }
    void TearDown() override {
        if (!context_) return;
        ImGui_ImplOpenGL3_Shutdown();
        ImCmd::DestroyContext();
        ImPlot::DestroyContext();
        ImGui::DestroyContext();
    }

    std::unique_ptr<HeadlessContext> context_;
};

/// What a frame holds: a docked button, a curve, a gizmo and the command palette's window.
struct Frame {
    int clicks = 0;
    bool docked = false;
    float matrix[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};

    void draw() {
        ImGui::GetIO().DeltaTime = 1.0f / 60.0f;
        ImGui_ImplOpenGL3_NewFrame();
        ImGui::NewFrame();
        ImGuizmo::BeginFrame();
        const ImGuiID dock = ImGui::DockSpaceOverViewport();
        ImGui::SetNextWindowDockID(dock, ImGuiCond_Always);
        ImGui::Begin("Panel");
        docked = ImGui::IsWindowDocked();
        if (ImGui::Button("Relight")) ++clicks;
        if (ImPlot::BeginPlot("Loss", ImVec2(300, 200))) {
            const float values[] = {3, 2, 1.5f, 1.2f, 1.1f};
            ImPlot::PlotLine("total", values, 5);
            ImPlot::EndPlot();
        }
        ImGuizmo::SetDrawlist();
        ImGuizmo::SetRect(0, 0, kWidth, kHeight);
        const float view[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, -5, 1};
        const float projection[16] = {1.3f, 0, 0, 0, 0, 1.7f, 0, 0, 0, 0, -1.02f, -1, 0, 0, -0.2f, 0};
        ImGuizmo::Manipulate(view, projection, ImGuizmo::ROTATE, ImGuizmo::LOCAL, matrix);
        ImGui::End();
        ImGui::Render();
    }
};

TEST_F(Toolkit, DrawsAFrameWithoutADisplay) {
    const Target target;
    Frame frame;
    for (int i = 0; i < 3; ++i) frame.draw();
    glViewport(0, 0, kWidth, kHeight);
    glClearColor(1, 0, 1, 1);
    glClear(GL_COLOR_BUFFER_BIT);
    ImGui_ImplOpenGL3_RenderDrawData(ImGui::GetDrawData());
    const std::vector<unsigned char> pixels = target.read();
    std::size_t drawn = 0;
    for (std::size_t i = 0; i < pixels.size(); i += 4) drawn += pixels[i + 1] != 0 || pixels[i] != 255;
    EXPECT_GT(drawn, pixels.size() / 4 / 2) << "the docked panel covers the window";
    EXPECT_TRUE(frame.docked);
}

TEST_F(Toolkit, TheTestEngineClicks) {
    const Target target;
    Frame frame;
    ImGuiTestEngine* engine = ImGuiTestEngine_CreateContext();
    ImGuiTestEngineIO& io = ImGuiTestEngine_GetIO(engine);
    io.ConfigRunSpeed = ImGuiTestRunSpeed_Fast;
    io.ConfigLogToTTY = false;
    ImGuiTest* test = IM_REGISTER_TEST(engine, "toolkit", "click");
    test->TestFunc = [](ImGuiTestContext* context) {
        context->SetRef("Panel");
        context->ItemClick("Relight");
        context->ItemClick("Relight");
    };
    ImGuiTestEngine_Start(engine, ImGui::GetCurrentContext());
    ImGuiTestEngine_QueueTest(engine, test);
    for (int i = 0; i < 1000 && !ImGuiTestEngine_IsTestQueueEmpty(engine); ++i) {
        frame.draw();
        ImGuiTestEngine_PostSwap(engine);
    }
    EXPECT_EQ(test->Output.Status, ImGuiTestStatus_Success);
    EXPECT_EQ(frame.clicks, 2);
    ImGuiTestEngine_Stop(engine);
    ImGui_ImplOpenGL3_Shutdown();
    ImCmd::DestroyContext();
    ImPlot::DestroyContext();
    ImGui::DestroyContext();
    ImGuiTestEngine_DestroyContext(engine);
    context_.reset(); // TearDown must not take it all down again
}

TEST(Glfw, IsThereAndOpensAWindowWhereThereIsADisplay) {
    int major = 0, minor = 0, revision = 0;
    glfwGetVersion(&major, &minor, &revision);
    EXPECT_EQ(major, 3);
    EXPECT_GE(minor, 3);
    if (!glfwInit()) {
        test::notRun("opening a window needs a display");
        return;
    }
    glfwWindowHint(GLFW_CONTEXT_VERSION_MAJOR, 4);
    glfwWindowHint(GLFW_CONTEXT_VERSION_MINOR, 5);
    glfwWindowHint(GLFW_OPENGL_PROFILE, GLFW_OPENGL_CORE_PROFILE);
    GLFWwindow* window = glfwCreateWindow(320, 240, "ars", nullptr, nullptr);
    EXPECT_NE(window, nullptr);
    if (window) glfwDestroyWindow(window);
    glfwTerminate();
}

TEST(FileDialogs, AreAvailableExactlyWhereADesktopToolIs) {
    bool tool = false;
    for (const char* name : {"zenity", "matedialog", "qarma", "kdialog"}) {
        tool = tool || runProcess({"sh", "-c", std::string("command -v ") + name})->exitCode == 0;
    }
    EXPECT_EQ(pfd::settings::available(), tool);
}

} // namespace
} // namespace ars
