#include "ui/window_imgui.h"

#include "engine/gl/opengl.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>

#include <imgui.h>
#include <imgui_impl_glfw.h>
#include <imgui_impl_opengl3.h>
#include <implot.h>

#ifdef ARS_UI_TESTS
#include <imgui_te_context.h>
#include <imgui_te_engine.h>
#endif

#include <algorithm>

namespace ars::ui {

Result<std::unique_ptr<ImGuiHost>> ImGuiHost::create(GLFWwindow* window, [[maybe_unused]] bool tests) {
    std::unique_ptr<ImGuiHost> host(new ImGuiHost);
    host->context_ = ImGui::CreateContext();
    host->plots_ = ImPlot::CreateContext();
    host->use();
    ImGuiIO& io = ImGui::GetIO();
    io.IniFilename = nullptr; // the layout lives in the settings
    io.LogFilename = nullptr;
    io.ConfigFlags |= ImGuiConfigFlags_DockingEnable;
    io.ConfigWindowsMoveFromTitleBarOnly = true;
    io.ConfigDragClickToInputText = false;
    io.ConfigDebugHighlightIdConflicts = tests;
    host->window_ = window;
    if (window && !ImGui_ImplGlfw_InitForOpenGL(window, true)) {
        return makeError(ErrorCode::Unavailable, "window", "Dear ImGui cannot use it");
    }
    host->backend_ = ImGui_ImplOpenGL3_Init("#version 450 core");
    if (!host->backend_) return makeError(ErrorCode::Unavailable, "OpenGL", "Dear ImGui cannot draw with it");
#ifdef ARS_UI_TESTS
    if (tests) {
        ImGuiTestEngine* engine = ImGuiTestEngine_CreateContext();
        host->engine_ = engine;
        ImGuiTestEngineIO& settings = ImGuiTestEngine_GetIO(engine);
        settings.ConfigSavedSettings = false;
        settings.ConfigRunSpeed = ImGuiTestRunSpeed_Fast;
        settings.ConfigNoThrottle = true;
        settings.ConfigLogToTTY = false;
        settings.ConfigVerboseLevel = ImGuiTestVerboseLevel_Warning;
        settings.ConfigVerboseLevelOnError = ImGuiTestVerboseLevel_Info;
        settings.ConfigRestoreFocusAfterTests = false;
        ImGuiTestEngine_Start(engine, host->context_);
    }
#endif
    return host;
}

ImGuiHost::~ImGuiHost() {
    use();
#ifdef ARS_UI_TESTS
    if (engine_) ImGuiTestEngine_Stop(static_cast<ImGuiTestEngine*>(engine_));
#endif
    if (backend_) ImGui_ImplOpenGL3_Shutdown();
    if (window_) ImGui_ImplGlfw_Shutdown();
    ImPlot::DestroyContext(plots_);
    ImGui::DestroyContext(context_);
#ifdef ARS_UI_TESTS
    if (engine_) ImGuiTestEngine_DestroyContext(static_cast<ImGuiTestEngine*>(engine_));
#endif
}

bool ImGuiHost::use() {
    if (ImGui::GetCurrentContext() == context_) return false;
    ImGui::SetCurrentContext(context_);
    ImPlot::SetCurrentContext(plots_);
    return true;
}

void ImGuiHost::setSize(int width, int height) {
    ImGui::GetIO().DisplaySize = {static_cast<float>(width), static_cast<float>(height)};
}

void ImGuiHost::beginFrame(double secondsSinceLast) {
    ImGui_ImplOpenGL3_NewFrame();
    if (window_)
        ImGui_ImplGlfw_NewFrame();
    else
        ImGui::GetIO().DeltaTime = std::clamp(static_cast<float>(secondsSinceLast), 1e-4f, 0.5f);
    ImGui::NewFrame();
}

void ImGuiHost::endFrame() {
    ImGui::Render();
    // Letters that are new in this frame: also when nobody will draw it.
    for (ImTextureData* texture : ImGui::GetPlatformIO().Textures) {
        if (texture->Status != ImTextureStatus_OK) ImGui_ImplOpenGL3_UpdateTexture(texture);
    }
}

void ImGuiHost::draw(int width, int height) {
    // Panels draw pictures of their own: the frame buffer is not where it was.
    if (window_) glBindFramebuffer(GL_FRAMEBUFFER, 0);
    glViewport(0, 0, width, height);
    glDisable(GL_SCISSOR_TEST);
    glClearColor(0.08f, 0.08f, 0.08f, 1.0f);
    glClear(GL_COLOR_BUFFER_BIT);
    ImGui_ImplOpenGL3_RenderDrawData(ImGui::GetDrawData());
}

void ImGuiHost::afterSwap() {
#ifdef ARS_UI_TESTS
    if (engine_) ImGuiTestEngine_PostSwap(static_cast<ImGuiTestEngine*>(engine_));
#endif
}

} // namespace ars::ui
