#pragma once

#include "ui/panel.h"

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace ars::ui {

struct Action;

/// Keys in words, as menus show them: "Ctrl+Shift+P", "F12", "Space", "?", "Ctrl+,". The value is Dear ImGui's key
/// chord; nothing when a word is unknown.
std::optional<int> parseKeys(std::string_view text);
/// The words of a key chord; parseKeys reads them back.
std::string keysText(int chord);
/// Several of them with "or" between: "F1 or ?". Words that are no keys are left out.
std::vector<int> parseAllKeys(std::string_view text);

/// One line of the list of shortcuts: everything that can be called, with keys or without.
struct ShortcutLine {
    std::string id;
    std::string label;
    std::string group; ///< menu
    std::string help;
    std::string keys;     ///< in force: the person's, else the default
    std::string standard; ///< default
};

/// The keys of an action or command as they are in force: settings first.
std::string keysOf(const Settings& settings, const std::string& id, const std::string& standard);
/// A command with fixed arguments is called by the command's id and its own label: "camera.preset/Front view".
std::string variantId(const Command& command, const CommandVariant& variant);
/// Null when the id is none of a variant.
const CommandVariant* findVariant(std::string_view id);
/// Actions first, then commands, each followed by its variants.
std::vector<ShortcutLine> shortcutLines(const std::vector<Action>& actions, const Settings& settings);
/// Title of a command group in menus and lists: "Camera".
std::string groupTitle(CommandGroup group);

/// The keys pressed in this frame as the id of what they call; empty: none. Nothing while text is typed, a mouse button
/// is held or a dialog is open.
std::string pressedShortcut(const std::vector<Action>& actions, const Settings& settings);

/// A window with all shortcuts: search, change, reset. A key that is taken says by whom and moves on confirmation.
class ShortcutWindow {
public:
    void open() { open_ = true; }
    bool isOpen() const { return open_; }
    bool recording() const { return !recording_.empty(); } ///< keys pressed now are no shortcuts
    void draw(StudioContext& context);

private:
    void drawLine(StudioContext& context, const std::vector<ShortcutLine>& lines, const ShortcutLine& line);
    void record(StudioContext& context, const std::vector<ShortcutLine>& lines);

    bool open_ = false;
    bool focusSearch_ = false;
    std::string search_;
    std::string recording_; ///< id whose keys are being pressed
    std::string taken_;     ///< what already has the keys just pressed
};

} // namespace ars::ui
