#pragma once

#include "engine/core/error.h"

#include <memory>

struct GLFWwindow;
struct ImGuiContext;
struct ImPlotContext;

namespace ars::ui {

/// Dear ImGui and ImPlot with the OpenGL backend, for a window or for none, from creation to the end. An OpenGL context
/// must be current throughout.
class ImGuiHost {
public:
    /// @param window  null: input comes from the test engine, the size from setSize
    /// @param tests   runs the test engine, where the build has it
    static Result<std::unique_ptr<ImGuiHost>> create(GLFWwindow* window, bool tests);
    ~ImGuiHost();
    ImGuiHost(const ImGuiHost&) = delete;
    ImGuiHost& operator=(const ImGuiHost&) = delete;

    /// Makes it the one that widgets are drawn with; false: it was already. Several may live in one process (tests).
    bool use();
    void setSize(int width, int height); ///< without a window
    void beginFrame(double secondsSinceLast);
    /// Nothing more is said in this frame.
    void endFrame();
    /// Draws what the last frame's widgets said: into the window, without one into the frame buffer that is bound.
    void draw(int width, int height);
    void afterSwap();
    void* testEngine() const { return engine_; }

private:
    ImGuiHost() = default;
    GLFWwindow* window_ = nullptr;
    void* engine_ = nullptr;
    bool backend_ = false;
    ImGuiContext* context_ = nullptr;
    ImPlotContext* plots_ = nullptr;
};

} // namespace ars::ui
