#include "ui/window.h"

#include "engine/core/log.h"
#include "engine/gl/window.h"
#include "ui/script_probe.h"
#include "ui/studio.h"
#include "ui/window_imgui.h"
#include "ui/window_timings.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>

#include <imgui_internal.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <thread>

#include <sys/resource.h>
#include <unistd.h>

namespace ars::ui {
namespace {

using Clock = std::chrono::steady_clock;

double secondsBetween(Clock::time_point a, Clock::time_point b) { return std::chrono::duration<double>(b - a).count(); }
float millisecondsBetween(Clock::time_point a, Clock::time_point b) {
    return static_cast<float>(1e3 * secondsBetween(a, b));
}

/// A ball under a lamp, RGBA.
std::vector<unsigned char> iconPixels(int size) {
    std::vector<unsigned char> pixels(static_cast<std::size_t>(size) * size * 4);
    for (int y = 0; y < size; ++y) {
        for (int x = 0; x < size; ++x) {
            const float u = (2.0f * x + 1.0f) / size - 1.0f, v = (2.0f * y + 1.0f) / size - 1.0f;
            const float r = std::sqrt(u * u + v * v);
            const float z = std::sqrt(std::max(0.0f, 1.0f - r * r));
            const float light = 0.12f + 0.88f * std::max(0.0f, (-0.55f * u - 0.6f * v + 0.58f * z));
            const std::array<float, 3> color{0.93f, 0.62f, 0.31f};
            unsigned char* pixel = &pixels[(static_cast<std::size_t>(y) * size + x) * 4];
            for (int c = 0; c < 3; ++c)
                pixel[c] = static_cast<unsigned char>(255.0f * std::min(1.0f, color[c] * light));
            pixel[3] = static_cast<unsigned char>(255.0f * std::clamp((1.0f - r) * size * 0.5f, 0.0f, 1.0f));
        }
    }
    return pixels;
}

void setIcon(GLFWwindow* window) {
    std::vector<unsigned char> small = iconPixels(16), middle = iconPixels(32), large = iconPixels(64);
    const GLFWimage images[] = {{16, 16, small.data()}, {32, 32, middle.data()}, {64, 64, large.data()}};
    glfwSetWindowIcon(window, 3, images);
}

/// Pixels per design pixel in the coordinates that Dear ImGui draws in.
float displayScale(GLFWwindow* window) {
    float contentX = 1.0f, contentY = 1.0f;
    glfwGetWindowContentScale(window, &contentX, &contentY);
    int width = 0, height = 0, pixelWidth = 0, pixelHeight = 0;
    glfwGetWindowSize(window, &width, &height);
    glfwGetFramebufferSize(window, &pixelWidth, &pixelHeight);
    if (width <= 0 || pixelWidth <= 0 || !(contentX > 0.0f)) return 1.0f;
    return contentX * static_cast<float>(width) / static_cast<float>(pixelWidth);
}

double refreshInterval(GLFWwindow* window, bool software) {
    // Drawing by the processor takes time from the avatar's frames: half the rate is enough to see them all.
    if (software) return 1.0 / 30.0;
    GLFWmonitor* monitor = glfwGetWindowMonitor(window);
    if (!monitor) monitor = glfwGetPrimaryMonitor();
    const GLFWvidmode* mode = monitor ? glfwGetVideoMode(monitor) : nullptr;
    const int rate = mode && mode->refreshRate > 0 ? mode->refreshRate : 60;
    return 1.0 / std::clamp(rate, 30, 240);
}

/// The window with everything in it. Members are destroyed from the last to the first: the session, whose threads wake
/// the window, before the window.
class StudioWindow {
public:
    StudioWindow(const WindowStart& start, std::unique_ptr<WindowContext> window, std::unique_ptr<ImGuiHost> host)
        : start_(start), settings_(start.settings), window_(std::move(window)), host_(std::move(host)),
          keeper_(start.stateFolder, readSettings(start.stateFolder)), ownedSession_(patientSession(start)),
          session_(*ownedSession_), studio_(session_, settings_),
          interval_(refreshInterval(window_->handle(), window_->info().software)) {
        GLFWwindow* handle = window_->handle();
        if (!start.probe.empty()) probe_ = std::make_unique<ScriptProbe>(start.probe, host_->testEngine());
        setIcon(handle);
        glfwSwapInterval(1);
        glfwSetWindowUserPointer(handle, this);
        glfwSetDropCallback(handle, [](GLFWwindow* at, int count, const char** paths) {
            static_cast<StudioWindow*>(glfwGetWindowUserPointer(at))->dropped(count, paths);
        });
        glfwSetWindowSizeLimits(handle, 640, 400, GLFW_DONT_CARE, GLFW_DONT_CARE);
    }

    void run() {
        studio_.drop(start_.open);
        Clock::time_point last = Clock::now();
        for (int i = 0; i < kStartUpFrames; ++i) {
            frame(secondsBetween(last, Clock::now()));
            last = Clock::now();
        }
        glfwShowWindow(window_->handle());
        shown_ = true;
        while (!studio_.quit()) {
            wait();
            const Clock::time_point now = Clock::now();
            if (studio_.quit()) break;
            frame(secondsBetween(last, now));
            last = now;
        }
        rememberWindow();
        studio_.rememberLayout();
        keeper_.flush(settings_);
        const WindowTimings& timings = studio_.timings();
        logInfo("window: start-up of {} frames, longest {:.1f} ms; then {} frames, 99 % within {:.1f} ms, longest "
                "{:.1f} ms ({:.1f} ms of processor)",
                timings.startUpFrames(), timings.longestStartUp().totalMs(), timings.frames(),
                timings.percentileMs(0.99), timings.longest().totalMs(), timings.longest().processorMs);
        writeTimings();
    }

private:
    /// Docks are laid out by the first frame and filled by the second; fonts, shaders and tables are made by both.
    static constexpr int kStartUpFrames = 3;
    static constexpr double kLongestPauseS = 0.4;

    /// A session whose pictures are computed by threads that let the window's own go first: on few cores a full picture
    /// would else hold up every frame of the window. Threads inherit the priority of the one that starts them, and a
    /// thread may not take it back: hence one for this alone.
    static std::unique_ptr<Session> patientSession(const WindowStart& start) {
        std::unique_ptr<Session> session;
        std::thread([&] {
            constexpr int kNice = 5;
            // Refused: the window is less smooth, and all else is as it was.
            (void)setpriority(PRIO_PROCESS, static_cast<id_t>(gettid()), getpriority(PRIO_PROCESS, 0) + kNice);
            session = std::make_unique<Session>(sessionOptions(start));
        }).join();
        return session;
    }

    static SessionOptions sessionOptions(const WindowStart& start) {
        SessionOptions options;
        options.device = start.device;
        options.stateFolder = start.stateFolder;
        options.autosave = start.settings.autosave;
        if (start.document) options.document = *start.document;
        options.lightBase = start.lightBase;
        options.wake = [] { glfwPostEmptyEvent(); };
        return options;
    }

    void writeTimings() {
        if (start_.timings.empty()) return;
        const Status written = studio_.timings().write(start_.timings);
        if (!written) logError("window: {}", written.error().describe());
    }

    void dropped(int count, const char** paths) {
        for (int i = 0; i < count; ++i) drops_.emplace_back(paths[i]);
    }

    /// Whether the next frame is due at the display's rate.
    bool busy() const {
        const ImGuiIO& io = ImGui::GetIO();
        return settling_ > 0 || (probe_ && probe_->busy()) || session_.document().view.layout == ViewLayout::Blink ||
               session_.transport().playing || io.MouseDown[0] || io.MouseDown[1] || io.MouseDown[2];
    }

    /// Sleeps until something happens, never shorter than the display's interval since the last frame.
    void wait() {
        const Clock::time_point begun = Clock::now();
        double longest = probe_ ? 0.05 : 0.5;
        if (busy())
            longest = interval_;
        else if (studio_.animating() || ImGui::GetIO().WantTextInput || secondsBetween(activity_, begun) < 2.0)
            longest = std::min(longest, 0.1);
        const bool woken = waitFor(longest);
        if (woken) activity_ = Clock::now();
        bool touched = touchedSince();
        for (double rest = restOfInterval(); rest > 5e-4; rest = restOfInterval()) glfwWaitEventsTimeout(rest);
        touched = touched || touchedSince();
        // Where the processor draws, the window leaves half of the time to the pictures that it is to show.
        while (!touched && window_->info().software && !session_.worker().idle() && !session_.transport().playing) {
            const double rest = std::min(drawnFor_, kLongestPauseS) - secondsBetween(shownAt_, Clock::now());
            if (rest < 5e-4) break;
            glfwWaitEventsTimeout(rest);
            touched = touchedSince();
        }
        if (touched)
            settling_ = 3; // widgets need some frames to come to rest
        else if (woken)
            settling_ = std::max(settling_ - 1, 1); // a picture or a job came
        else if (settling_ > 0)
            --settling_;
        if (start_.interrupted && start_.interrupted() && !interrupted_) {
            interrupted_ = true;
            studio_.requestQuit();
        }
        if (window_->closing()) {
            glfwSetWindowShouldClose(window_->handle(), GLFW_FALSE);
            studio_.requestQuit();
        }
    }

    /// Whether the person did something since the last frame.
    bool touchedSince() {
        int width = 0, height = 0;
        window_->framebufferSize(width, height);
        const bool resized = width != width_ || height != height_;
        width_ = width;
        height_ = height;
        return resized || !drops_.empty() || ImGui::GetCurrentContext()->InputEventsQueue.Size > 0;
    }

    /// True when something happened before the time was over.
    static bool waitFor(double seconds) {
        const Clock::time_point begun = Clock::now();
        glfwWaitEventsTimeout(seconds);
        return secondsBetween(begun, Clock::now()) < seconds * 0.97;
    }

    double restOfInterval() const { return interval_ - secondsBetween(drawn_, Clock::now()); }

    void frame(double seconds) {
        if (probe_) probe_->update(session_); // no part of what a person's window does: not measured
        drawn_ = Clock::now();
        const Clock::time_point begun = drawn_;
        const double processor = threadProcessorMs();
        if (!drops_.empty()) studio_.drop(std::exchange(drops_, {}));
        session_.update(seconds);
        const Clock::time_point updated = Clock::now();
        int width = 0, height = 0;
        window_->framebufferSize(width, height);
        if (width == 0 || height == 0) return; // minimised
        host_->beginFrame(seconds);
        studio_.draw(start_.scale > 0.0f ? start_.scale : displayScale(window_->handle()));
        const Clock::time_point said = Clock::now();
        host_->endFrame();
        host_->draw(width, height);
        window_->swapBuffers();
        host_->afterSwap();
        const Clock::time_point shown = Clock::now();
        drawnFor_ = secondsBetween(begun, shown);
        shownAt_ = shown;
        const WindowTimings::Parts parts{millisecondsBetween(begun, updated), millisecondsBetween(updated, said),
                                         millisecondsBetween(said, shown),
                                         static_cast<float>(threadProcessorMs() - processor)};
        if (shown_)
            studio_.timings().add(parts);
        else
            studio_.timings().addStartUp(parts);
        nameWindow();
        if (secondsBetween(kept_, shown) > 2.0) {
            kept_ = shown;
            rememberWindow();
            keeper_.update(settings_);
            writeTimings(); // a program that is killed leaves them, too
        }
    }

    void nameWindow() {
        const std::filesystem::path& path = session_.projectPath();
        std::string title = path.empty() ? "Untitled" : path.stem().string();
        if (session_.editor().modified()) title += " *";
        title += " - ARS Studio";
        if (title == title_) return;
        title_ = title;
        glfwSetWindowTitle(window_->handle(), title.c_str());
    }

    void rememberWindow() {
        GLFWwindow* handle = window_->handle();
        settings_.maximized = glfwGetWindowAttrib(handle, GLFW_MAXIMIZED) == GLFW_TRUE;
        if (settings_.maximized || start_.sizeGiven) return;
        int width = 0, height = 0;
        glfwGetWindowSize(handle, &width, &height);
        const float scale = std::max(displayScale(handle), 0.1f); // GLFW enlarges by it when a window is made
        settings_.windowWidth = static_cast<int>(std::lround(static_cast<float>(width) / scale));
        settings_.windowHeight = static_cast<int>(std::lround(static_cast<float>(height) / scale));
    }

    const WindowStart& start_;
    Settings settings_;
    std::unique_ptr<WindowContext> window_;
    std::unique_ptr<ImGuiHost> host_;
    SettingsKeeper keeper_;
    std::unique_ptr<Session> ownedSession_;
    Session& session_;
    Studio studio_;
    std::unique_ptr<ScriptProbe> probe_;
    double interval_;
    std::vector<std::filesystem::path> drops_;
    std::string title_;
    int settling_ = 3;
    int width_ = 0, height_ = 0; ///< of the frame buffer
    bool shown_ = false;
    bool interrupted_ = false;
    Clock::time_point activity_ = Clock::now();
    Clock::time_point drawn_{}, shownAt_{};
    double drawnFor_ = 0.0; ///< seconds that the last frame took
    Clock::time_point kept_ = Clock::now();
};

} // namespace

Status runStudio(const WindowStart& start) {
    WindowOptions options;
    options.width = start.settings.windowWidth;
    options.height = start.settings.windowHeight;
    options.maximized = start.settings.maximized && !start.sizeGiven;
    options.visible = false; // until it has something to show
    ARS_TRY(std::unique_ptr<WindowContext> window, WindowContext::create(options));
    logInfo("window: {}", window->info().chosen);
    ARS_TRY(std::unique_ptr<ImGuiHost> host, ImGuiHost::create(window->handle(), !start.probe.empty()));
    StudioWindow(start, std::move(window), std::move(host)).run();
    return {};
}

} // namespace ars::ui
