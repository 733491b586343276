#pragma once

#include "engine/core/error.h"
#include "engine/scene/session.h"
#include "ui/settings.h"

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

namespace ars::ui {

struct Studio;

struct WindowStart {
    std::vector<std::filesystem::path> open; ///< files to open at the start
    Settings settings;
    std::filesystem::path stateFolder;
    Device device;
    float scale = 0.0f;                ///< 0: the display's
    bool sizeGiven = false;            ///< settings' size came from the command line: not maximised
    std::filesystem::path timings;     ///< JSON of the frame times, written at the end; empty: none
    std::filesystem::path probe;       ///< folder of the script probe; empty: none
    std::optional<Document> document;  ///< to begin with; none: a new one
    int lightBase = kDefaultLightBase; ///< see SessionOptions
    std::function<bool()> interrupted; ///< true once Ctrl+C was pressed on the terminal; may be null
};

/// The studio in a window until the person leaves it. Unavailable without a display.
Status runStudio(const WindowStart& start);

/// The studio without a display: the same panels drawn into a picture through EGL, driven by Dear ImGui's test engine.
/// For tests and for documentation pictures.
class HeadlessStudio {
public:
    /// Unavailable without EGL or OpenGL 4.5.
    static Result<std::unique_ptr<HeadlessStudio>> create(int width, int height, const WindowStart& start);
    ~HeadlessStudio();

    /// One window frame: events of the test engine, widgets. Real time passes. It is drawn when its pixels are asked
    /// for: without a display nobody waits for a picture, and a driver that draws on the processor would have to make
    /// every one of them some time.
    void step();
    /// Frames until the session is settled, or the timeout; false then.
    bool settle(double seconds);
    Session& session();
    Studio& studio();
    Settings& settings(); ///< as the person has changed them so far
    /// (height, width, 4) bytes of the window as it is now, row 0 on top.
    std::vector<std::uint8_t> pixels();
    Status writePicture(const std::filesystem::path& png);
    void* testEngine(); ///< ImGuiTestEngine*, null in builds without it

private:
    HeadlessStudio() = default;
    struct State;
    std::unique_ptr<State> state_;
};

} // namespace ars::ui
