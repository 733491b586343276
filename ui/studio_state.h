#pragma once

#include "ui/file_chooser.h"
#include "ui/palette.h"
#include "ui/shortcuts.h"
#include "ui/studio.h"
#include "ui/theme.h"
#include "ui/widgets.h"
#include "ui/window_timings.h"

#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace ars::ui {

/// What the studio_*.cpp files share.
struct Studio::State {
    State(Studio& owner, Session& s, Settings& given);

    // studio.cpp
    void draw(float scale);
    void setScale(float scale);
    void drawPanels();
    void takeNotices();
    Panel* find(const std::string& id);
    void invoke(const std::string& id);

    // studio_layout.cpp
    void drawDockSpace();
    void buildLayout(unsigned dock);
    void keepLayout();
    /// Panels keep their size in letters when letters become larger.
    void scaleLayout(float factor);

    // studio_menu.cpp
    void drawMenuBar();
    void drawActions(const std::string& menu);
    void drawAction(const Action& action);
    void drawCommands(CommandGroup group);
    void drawCommand(const Command& command);
    void drawRecentFiles();
    void drawPanelMenu();

    // studio_status.cpp
    void drawStatusBar();
    void drawToasts();
    void drawHint();

    // studio_dialogs.cpp
    void drawDialogs();
    void drawErrors();
    void drawUnsaved();
    void drawRecovery();
    void drawPreferences();
    void drawAbout();
    /// Runs `then` at once, or after the person has saved or given up what is unsaved.
    void guardUnsaved(const std::string& before, std::function<void()> then);
    bool dialogOpen() const;

    // studio_files.cpp
    void open(const std::filesystem::path& file);
    void openAs(const std::filesystem::path& file, FileRole role);
    void askOpen();
    void askOpenAs(FileRole role);
    void save(std::function<void()> then);
    void saveAs(std::function<void()> then);
    void waitForSave(std::function<void()> then);
    void checkSaved();
    void exportPose();
    void exportClip(const std::string& ending);
    void exportGltf();
    void screenshot();
    void film();

    Studio& studio;
    Session& session;
    Settings& settings;
    StudioContext context;
    Fonts fonts;
    std::vector<std::unique_ptr<Panel>> panels;
    std::vector<Action> actions;
    CommandPalette palette;
    ShortcutWindow shortcuts;
    FileChooser chooser;
    WindowTimings timings;

    float appliedScale = 0.0f;
    Theme appliedTheme = Theme::Dark;
    bool layoutWanted = false; ///< the default one is to be built
    std::string frontPanel;    ///< comes to the front in the next frame

    struct Toast {
        std::string text;
        Notice::Kind kind = Notice::Kind::Note;
        double until = 0.0;
    };
    std::vector<Toast> toasts;
    std::deque<Notice> errors; ///< shown one after the other
    std::vector<Notice> notices;

    std::optional<std::string> unsavedBefore; ///< what the person wanted when something was unsaved: "Quit"
    std::function<void()> afterUnsaved;
    std::function<void()> afterSave;
    std::vector<Recovery> recoveries;
    float editedTextScale = 0.0f; ///< while its slider is held
    bool preferencesOpen = false;
    bool aboutOpen = false;
    bool quit = false;
};

/// The table of everything that is called by menus, palette and keys and edits no document (studio_actions.cpp).
std::vector<Action> makeActions(Studio::State& state);

/// The panels, in the order of the Window menu (studio_panels.cpp).
std::vector<std::unique_ptr<Panel>> makePanels();

} // namespace ars::ui
