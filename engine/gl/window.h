#pragma once

#include "engine/gl/context.h"

#include <memory>
#include <string>

struct GLFWwindow;

namespace ars {

struct WindowOptions {
    std::string title = "ARS Studio";
    int width = 1280; ///< screen coordinates
    int height = 800;
    bool visible = true;
    bool maximized = false;
};

/// A window with an OpenGL 4.5 core context (GLFW). The main thread only.
class WindowContext : public GlContext {
public:
    /// Unavailable without a display or where it refuses OpenGL 4.5, in GLFW's words.
    static Result<std::unique_ptr<WindowContext>> create(const WindowOptions& options);
    ~WindowContext() override;
    WindowContext(const WindowContext&) = delete;
    WindowContext& operator=(const WindowContext&) = delete;

    Status makeCurrent() override;
    /// For event callbacks and Dear ImGui's backend.
    GLFWwindow* handle() const { return window_; }
    bool closing() const;
    void swapBuffers();
    /// Pixels of the frame buffer; 0 while the window is minimised.
    void framebufferSize(int& width, int& height) const;

private:
    WindowContext() = default;
    GLFWwindow* window_ = nullptr;
};

} // namespace ars
