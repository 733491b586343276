#pragma once

#include "engine/scene/session.h"

#include <filesystem>
#include <functional>
#include <memory>

namespace ars::ui {

/// Tells scripts that drive the window from outside, with a real mouse and keyboard, where things are. A script writes
/// FOLDER/ask.json:
/// ```
/// {"number": 7, "items": ["//Light/Rotation", ...], "document": true, "windows": true}
/// ```
/// and reads FOLDER/answer.json with the same number: rectangles [x, y, width, height] of the widgets that are on the
/// screen (null: not there), in pixels of the window; of Dear ImGui's windows; the viewport's picture with the joints
/// and parts in it; the document as it is; what the program is doing, and how much of the input it has not taken in
/// yet. It only looks: nothing can be done through it. Builds without the test engine answer without items.
class ScriptProbe {
public:
    /// @param testEngine  ImGuiTestEngine* of the current context, or null
    ScriptProbe(std::filesystem::path folder, void* testEngine);
    ~ScriptProbe();
    ScriptProbe(const ScriptProbe&) = delete;
    ScriptProbe& operator=(const ScriptProbe&) = delete;

    /// Once per frame, between two frames of widgets.
    void update(Session& session);
    /// A question waits: the loop must go on drawing until it is answered.
    bool busy() const;

private:
    struct State;
    std::unique_ptr<State> state_;
};

} // namespace ars::ui
