#pragma once

#include "engine/core/error.h"
#include "engine/core/parameters.h"

#include <filesystem>
#include <future>
#include <map>
#include <string>
#include <vector>

namespace ars::ui {

enum class Theme { Dark, Light };

/// What belongs to the person and not to the project; kept in the state folder.
struct Settings {
    Theme theme = Theme::Dark;
    float textScale = 1.0f;  ///< on top of the display's own, [0.5, 3]
    bool invertZoom = false; ///< of the wheel
    float flySpeed = 1.5f;   ///< metres per second
    float orbitSpeed = 1.0f; ///< [0.1, 5]
    bool tooltips = true;
    bool showHints = true; ///< "drag a hand" until it was done once
    bool autosave = true;
    std::string layout;                           ///< Dear ImGui's docking layout; empty: the default
    std::map<std::string, bool> panels;           ///< open or closed, by panel id
    std::map<std::string, std::string> shortcuts; ///< changed ones, by command or action id
    std::map<std::string, std::string> folders;   ///< the folder last used in each file dialog
    int windowWidth = 1600;
    int windowHeight = 960;
    bool maximized = false;
    float layoutScale = 1.0f; ///< pixels per design pixel that the layout's sizes were made for
};

/// Missing or broken files give the defaults, with a note in the log; a broken one is kept aside.
Settings readSettings(const std::filesystem::path& folder);
Status writeSettings(const std::filesystem::path& folder, const Settings& settings);

/// Writes settings when they have changed, beside the window.
class SettingsKeeper {
public:
    SettingsKeeper(std::filesystem::path folder, const Settings& current);
    ~SettingsKeeper();
    SettingsKeeper(const SettingsKeeper&) = delete;
    SettingsKeeper& operator=(const SettingsKeeper&) = delete;
    void update(const Settings& settings); ///< never waits for the disk; failures go to the log
    void flush(const Settings& settings);  ///< waits: at the end

private:
    std::filesystem::path folder_;
    std::string written_;
    std::future<void> writing_;
};

} // namespace ars::ui
