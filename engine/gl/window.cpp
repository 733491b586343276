#include "engine/gl/window.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>

#include <fmt/format.h>

namespace ars {

namespace {

int gOpenWindows = 0; ///< GLFW is a global of the main thread; the last window shuts it down

std::string glfwWords() {
    const char* text = nullptr;
    const int code = glfwGetError(&text);
    return code == GLFW_NO_ERROR || !text ? std::string("no reason given") : std::string(text);
}

} // namespace

Result<std::unique_ptr<WindowContext>> WindowContext::create(const WindowOptions& options) {
    if (!glfwInit()) {
        return makeError(ErrorCode::Unavailable, "window", fmt::format("no display: {}", glfwWords()));
    }
    glfwDefaultWindowHints();
    glfwWindowHint(GLFW_CONTEXT_VERSION_MAJOR, 4);
    glfwWindowHint(GLFW_CONTEXT_VERSION_MINOR, 5);
    glfwWindowHint(GLFW_OPENGL_PROFILE, GLFW_OPENGL_CORE_PROFILE);
    glfwWindowHint(GLFW_VISIBLE, options.visible ? GLFW_TRUE : GLFW_FALSE);
    glfwWindowHint(GLFW_MAXIMIZED, options.maximized ? GLFW_TRUE : GLFW_FALSE);
    glfwWindowHint(GLFW_SCALE_TO_MONITOR, GLFW_TRUE);
    GLFWwindow* window = glfwCreateWindow(options.width, options.height, options.title.c_str(), nullptr, nullptr);
    if (!window) {
        Error error =
            makeError(ErrorCode::Unavailable, "window", fmt::format("no window with OpenGL 4.5 core: {}", glfwWords()));
        if (gOpenWindows == 0) glfwTerminate();
        return error;
    }
    ++gOpenWindows;
    std::unique_ptr<WindowContext> result(new WindowContext);
    result->window_ = window;
    glfwMakeContextCurrent(window);
    result->describe(fmt::format("GLFW {}", glfwGetVersionString()));
    result->info_.chosen = fmt::format("a window of {}x{} ({})", options.width, options.height, result->info_.renderer);
    return result;
}

WindowContext::~WindowContext() {
    glfwDestroyWindow(window_);
    if (--gOpenWindows == 0) glfwTerminate();
}

Status WindowContext::makeCurrent() {
    glfwMakeContextCurrent(window_);
    if (glfwGetCurrentContext() == window_) return {};
    return makeError(ErrorCode::Unavailable, "window", fmt::format("its context cannot be used: {}", glfwWords()));
}

bool WindowContext::closing() const { return glfwWindowShouldClose(window_) != 0; }

void WindowContext::swapBuffers() { glfwSwapBuffers(window_); }

void WindowContext::framebufferSize(int& width, int& height) const { glfwGetFramebufferSize(window_, &width, &height); }

} // namespace ars
