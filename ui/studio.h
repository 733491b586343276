#pragma once

#include "ui/panel.h"

#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

struct ImFont;

namespace ars::ui {

class WindowTimings;

/// What the person can call that edits no document: open a dialog, play, undo. Listed in menus, palette and shortcuts
/// beside the commands.
struct Action {
    std::string id; ///< "file.open"
    std::string label;
    std::string menu; ///< "File", "Edit", "View", "Window", "Help"
    std::string help;
    std::string shortcut; ///< "Ctrl+O"
    std::function<void(StudioContext&)> run;
    std::function<bool(StudioContext&)> enabled; ///< null: always
};

/// A question for files; answered on a later frame.
struct FileQuestion {
    std::string title{};
    bool saving = false;
    std::string suggestedName{};
    std::vector<std::string> endings{}; ///< ".exr", ".hdr"; empty: all. Saving adds the first where none was typed
    std::string folderKey{};            ///< where settings remember the folder
    std::function<void(const std::filesystem::path&)> chosen{};
    bool folder = false; ///< a folder is wanted, not a file
};

/// The whole window's contents, drawn with Dear ImGui into whatever context is current. The loop around it (a GLFW
/// window, or a picture without display) lives in window.h.
struct Studio {
    /// With a Dear ImGui context current that has not drawn a frame yet: loads fonts and the layout of the settings.
    explicit Studio(Session& session, Settings& settings);
    ~Studio();

    /// One frame of widgets: menu bar, dock space, panels, dialogs, palette. Between ImGui::NewFrame and Render.
    void draw(float scale);
    /// Files dropped on the window (absolute paths).
    void drop(const std::vector<std::filesystem::path>& files);
    /// Asks for files: the desktop's own chooser where there is one, else one of ours inside the window.
    void ask(FileQuestion question);
    void showError(const std::string& title, const std::string& text, const std::string& hint = {});
    /// A line at the bottom for a few seconds.
    void toast(const std::string& text);
    void openPalette();
    /// Runs a command or action by id with its defaults, as menus, palette and shortcuts do; errors become dialogs.
    void invoke(const std::string& id);
    const std::vector<Action>& actions() const;
    Panel* panel(const std::string& id);
    bool isOpen(const std::string& panelId) const;
    void setOpen(const std::string& panelId, bool open);
    void resetLayout();
    /// Puts the layout as it is into the settings: at the end. While it runs, changes get there within seconds.
    void rememberLayout();
    /// The person asked to leave and nothing is unsaved (or may be lost).
    bool quit() const;
    /// The window's close button: asks when something is unsaved.
    void requestQuit();

    /// Everything that the session had to say since the start, oldest first; the newest 200.
    const std::vector<Notice>& notices() const;
    /// How long frames of the window took; the loop around fills it.
    WindowTimings& timings();
    /// Widgets move by themselves (a message fades, a job goes on): the loop should not sleep long.
    bool animating() const;

    ImFont* monospaced() const; ///< for numbers
    ImFont* icons() const;      ///< merged into the main font; null where the font is missing

    struct State; ///< ui/studio_state.h

private:
    std::unique_ptr<State> state_;
};

} // namespace ars::ui
