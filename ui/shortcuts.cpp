#include "ui/shortcuts.h"

#include "ui/studio.h"
#include "ui/widgets.h"

#include <imgui_internal.h>
#include <imgui_stdlib.h>

#include <algorithm>
#include <array>
#include <cctype>

namespace ars::ui {
namespace {

struct KeyWord {
    std::string_view word;
    int key;
};

constexpr std::array kKeyWords = {
    KeyWord{"Space", ImGuiKey_Space},
    KeyWord{"Enter", ImGuiKey_Enter},
    KeyWord{"Escape", ImGuiKey_Escape},
    KeyWord{"Tab", ImGuiKey_Tab},
    KeyWord{"Backspace", ImGuiKey_Backspace},
    KeyWord{"Delete", ImGuiKey_Delete},
    KeyWord{"Insert", ImGuiKey_Insert},
    KeyWord{"Home", ImGuiKey_Home},
    KeyWord{"End", ImGuiKey_End},
    KeyWord{"PageUp", ImGuiKey_PageUp},
    KeyWord{"PageDown", ImGuiKey_PageDown},
    KeyWord{"Left", ImGuiKey_LeftArrow},
    KeyWord{"Right", ImGuiKey_RightArrow},
    KeyWord{"Up", ImGuiKey_UpArrow},
    KeyWord{"Down", ImGuiKey_DownArrow},
    KeyWord{",", ImGuiKey_Comma},
    KeyWord{".", ImGuiKey_Period},
    KeyWord{"/", ImGuiKey_Slash},
    KeyWord{"-", ImGuiKey_Minus},
    KeyWord{"=", ImGuiKey_Equal},
    KeyWord{";", ImGuiKey_Semicolon},
    KeyWord{"'", ImGuiKey_Apostrophe},
    KeyWord{"[", ImGuiKey_LeftBracket},
    KeyWord{"]", ImGuiKey_RightBracket},
    KeyWord{"\\", ImGuiKey_Backslash},
    KeyWord{"`", ImGuiKey_GraveAccent},
    KeyWord{"Num0", ImGuiKey_Keypad0},
    KeyWord{"Num1", ImGuiKey_Keypad1},
    KeyWord{"Num2", ImGuiKey_Keypad2},
    KeyWord{"Num3", ImGuiKey_Keypad3},
    KeyWord{"Num4", ImGuiKey_Keypad4},
    KeyWord{"Num5", ImGuiKey_Keypad5},
    KeyWord{"Num6", ImGuiKey_Keypad6},
    KeyWord{"Num7", ImGuiKey_Keypad7},
    KeyWord{"Num8", ImGuiKey_Keypad8},
    KeyWord{"Num9", ImGuiKey_Keypad9},
    KeyWord{"Num.", ImGuiKey_KeypadDecimal},
};

bool sameLetters(std::string_view a, std::string_view b) {
    return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](char x, char y) {
        return std::tolower(static_cast<unsigned char>(x)) == std::tolower(static_cast<unsigned char>(y));
    });
}

std::optional<int> parseKey(std::string_view word) {
    if (word == "?") return ImGuiMod_Shift | ImGuiKey_Slash;
    if (word == "+") return ImGuiMod_Shift | ImGuiKey_Equal;
    if (word.size() == 1) {
        const int letter = std::toupper(static_cast<unsigned char>(word[0]));
        if (letter >= 'A' && letter <= 'Z') return ImGuiKey_A + (letter - 'A');
        if (letter >= '0' && letter <= '9') return ImGuiKey_0 + (letter - '0');
    }
    if (word.size() >= 2 && word.size() <= 3 && (word[0] == 'F' || word[0] == 'f')) {
        int number = 0;
        for (char c : word.substr(1)) {
            if (c < '0' || c > '9') return std::nullopt;
            number = number * 10 + (c - '0');
        }
        if (number >= 1 && number <= 24) return ImGuiKey_F1 + (number - 1);
    }
    for (const KeyWord& known : kKeyWords) {
        if (sameLetters(known.word, word)) return known.key;
    }
    return std::nullopt;
}

std::string keyText(int key) {
    if (key >= ImGuiKey_A && key <= ImGuiKey_Z) return std::string(1, static_cast<char>('A' + (key - ImGuiKey_A)));
    if (key >= ImGuiKey_0 && key <= ImGuiKey_9) return std::string(1, static_cast<char>('0' + (key - ImGuiKey_0)));
    if (key >= ImGuiKey_F1 && key <= ImGuiKey_F24) return fmt::format("F{}", key - ImGuiKey_F1 + 1);
    for (const KeyWord& known : kKeyWords) {
        if (known.key == key) return std::string(known.word);
    }
    return {};
}

bool isModifier(int key) { return key >= ImGuiKey_LeftCtrl && key <= ImGuiKey_RightSuper; }

/// Keys that were pressed in this frame with the modifiers that are down; 0: none.
int pressedChord() {
    for (int key = ImGuiKey_NamedKey_BEGIN; key < ImGuiKey_GamepadStart; ++key) {
        if (isModifier(key) || keyText(key).empty()) continue;
        if (ImGui::IsKeyPressed(static_cast<ImGuiKey>(key), false)) return ImGui::GetIO().KeyMods | key;
    }
    return 0;
}

bool contains(std::string_view text, std::string_view part) {
    return std::search(text.begin(), text.end(), part.begin(), part.end(), [](char x, char y) {
               return std::tolower(static_cast<unsigned char>(x)) == std::tolower(static_cast<unsigned char>(y));
           }) != text.end();
}

} // namespace

std::optional<int> parseKeys(std::string_view text) {
    int chord = 0;
    while (!text.empty()) {
        const std::size_t plus = text.find('+', 1); // "+" itself is a key
        const std::string_view word = text.substr(0, plus);
        text = plus == std::string_view::npos ? std::string_view() : text.substr(plus + 1);
        if (sameLetters(word, "Ctrl"))
            chord |= ImGuiMod_Ctrl;
        else if (sameLetters(word, "Shift"))
            chord |= ImGuiMod_Shift;
        else if (sameLetters(word, "Alt"))
            chord |= ImGuiMod_Alt;
        else {
            const std::optional<int> key = parseKey(word);
            if (!key || !text.empty()) return std::nullopt;
            return chord | *key;
        }
    }
    return std::nullopt;
}

std::vector<int> parseAllKeys(std::string_view text) {
    constexpr std::string_view kOr = " or ";
    std::vector<int> chords;
    while (!text.empty()) {
        const std::size_t end = text.find(kOr);
        if (const std::optional<int> chord = parseKeys(text.substr(0, end))) chords.push_back(*chord);
        text = end == std::string_view::npos ? std::string_view() : text.substr(end + kOr.size());
    }
    return chords;
}

std::string keysText(int chord) {
    const std::string key = keyText(chord & ~ImGuiMod_Mask_);
    if (key.empty()) return {};
    std::string text;
    if (chord & ImGuiMod_Ctrl) text += "Ctrl+";
    if (chord & ImGuiMod_Shift) text += "Shift+";
    if (chord & ImGuiMod_Alt) text += "Alt+";
    return text + key;
}

std::string keysOf(const Settings& settings, const std::string& id, const std::string& standard) {
    const auto changed = settings.shortcuts.find(id);
    return changed == settings.shortcuts.end() ? standard : changed->second;
}

std::string groupTitle(CommandGroup group) {
    switch (group) {
    case CommandGroup::Avatar:
        return "Avatar";
    case CommandGroup::Pose:
        return "Pose";
    case CommandGroup::Timeline:
        return "Motion";
    case CommandGroup::Viewpoint:
        return "Camera";
    case CommandGroup::Light:
        return "Light";
    case CommandGroup::Occlusion:
        return "Occlusion";
    case CommandGroup::View:
        return "View";
    case CommandGroup::Compare:
        return "Compare";
    }
    return {};
}

std::string variantId(const Command& command, const CommandVariant& variant) {
    return command.id + "/" + variant.label;
}

const CommandVariant* findVariant(std::string_view id) {
    const std::size_t slash = id.find('/');
    const Command* command = slash == std::string_view::npos ? nullptr : findCommand(id.substr(0, slash));
    if (!command) return nullptr;
    for (const CommandVariant& variant : command->variants) {
        if (variant.label == id.substr(slash + 1)) return &variant;
    }
    return nullptr;
}

std::vector<ShortcutLine> shortcutLines(const std::vector<Action>& actions, const Settings& settings) {
    std::vector<ShortcutLine> lines;
    for (const Action& action : actions) {
        lines.push_back({action.id, action.label, action.menu, action.help,
                         keysOf(settings, action.id, action.shortcut), action.shortcut});
    }
    for (const Command& command : commands()) {
        lines.push_back({command.id, command.label, groupTitle(command.group), command.help,
                         keysOf(settings, command.id, command.shortcut), command.shortcut});
        for (const CommandVariant& variant : command.variants) {
            const std::string id = variantId(command, variant);
            lines.push_back({id, variant.label, groupTitle(command.group), command.help,
                             keysOf(settings, id, variant.shortcut), variant.shortcut});
        }
    }
    return lines;
}

std::string pressedShortcut(const std::vector<Action>& actions, const Settings& settings) {
    const ImGuiIO& io = ImGui::GetIO();
    if (io.WantTextInput || ImGui::GetTopMostPopupModal() || ImGui::IsAnyMouseDown()) return {};
    const int pressed = pressedChord();
    if (pressed == 0) return {};
    for (const ShortcutLine& line : shortcutLines(actions, settings)) {
        if (line.keys.empty()) continue;
        const std::vector<int> keys = parseAllKeys(line.keys);
        if (std::find(keys.begin(), keys.end(), pressed) != keys.end()) return line.id;
    }
    return {};
}

void ShortcutWindow::record(StudioContext& context, const std::vector<ShortcutLine>& lines) {
    if (ImGui::IsKeyPressed(ImGuiKey_Escape, false)) {
        recording_.clear();
        return;
    }
    const int chord = pressedChord();
    if (chord == 0) return;
    const std::string keys = keysText(chord);
    taken_.clear();
    for (const ShortcutLine& line : lines) {
        const std::vector<int> others = parseAllKeys(line.keys);
        if (line.id == recording_ || std::find(others.begin(), others.end(), chord) == others.end()) continue;
        taken_ = fmt::format("{} no longer calls \"{}\".", keys, line.label);
        context.settings.shortcuts[line.id] = "";
    }
    context.settings.shortcuts[recording_] = keys;
    recording_.clear();
}

void ShortcutWindow::drawLine(StudioContext& context, const std::vector<ShortcutLine>& lines,
                              const ShortcutLine& line) {
    ImGui::PushID(line.id.c_str());
    ImGui::TableNextRow();
    ImGui::TableNextColumn();
    ImGui::AlignTextToFramePadding();
    ImGui::TextColored(mutedColor(), "%s", line.group.c_str());
    ImGui::TableNextColumn();
    ImGui::AlignTextToFramePadding();
    ImGui::TextUnformatted(line.label.c_str());
    help(context, line.help.c_str());
    ImGui::TableNextColumn();
    const bool now = recording_ == line.id;
    const std::string shown = now ? "press keys ..." : line.keys.empty() ? "none" : line.keys;
    if (now)
        ImGui::PushStyleColor(ImGuiCol_Text, accentColor());
    else if (line.keys.empty())
        ImGui::PushStyleColor(ImGuiCol_Text, mutedColor());
    const bool colored = now || line.keys.empty();
    if (ImGui::Button((shown + "###Keys").c_str(), ImVec2(-FLT_MIN, 0))) recording_ = now ? "" : line.id;
    if (colored) ImGui::PopStyleColor();
    help(context, "Click, then press the keys; Escape leaves it as it was.");
    ImGui::TableNextColumn();
    if (line.keys != line.standard) {
        if (toolButton(icon::kReset,
                       fmt::format("Reset. Back to {}", line.standard.empty() ? "no keys" : line.standard).c_str())) {
            context.settings.shortcuts.erase(line.id);
        }
    }
    if (now) record(context, lines);
    ImGui::PopID();
}

void ShortcutWindow::draw(StudioContext& context) {
    if (!open_) {
        focusSearch_ = true;
        return;
    }
    const float size = ImGui::GetFontSize();
    const ImGuiViewport* viewport = ImGui::GetMainViewport();
    ImGui::SetNextWindowPos(viewport->GetCenter(), ImGuiCond_Appearing, {0.5f, 0.5f});
    ImGui::SetNextWindowSize(
        {std::min(size * 42, viewport->Size.x * 0.9f), std::min(size * 40, viewport->Size.y * 0.85f)},
        ImGuiCond_Appearing);
    if (ImGui::Begin("Shortcuts", &open_, ImGuiWindowFlags_NoDocking | ImGuiWindowFlags_NoCollapse)) {
        if (focusSearch_) ImGui::SetKeyboardFocusHere();
        focusSearch_ = false;
        ImGui::SetNextItemWidth(-FLT_MIN);
        ImGui::InputTextWithHint("###Search", "Search by name, key or menu", &search_);
        if (!taken_.empty()) ImGui::TextColored(mutedColor(), "%s", taken_.c_str());
        const std::vector<ShortcutLine> lines = shortcutLines(context.studio.actions(), context.settings);
        constexpr ImGuiTableFlags kFlags = ImGuiTableFlags_ScrollY | ImGuiTableFlags_RowBg;
        if (ImGui::BeginTable("Lines", 4, kFlags)) {
            ImGui::TableSetupColumn("Menu", ImGuiTableColumnFlags_WidthFixed, size * 5.5f);
            ImGui::TableSetupColumn("Does", ImGuiTableColumnFlags_WidthStretch);
            ImGui::TableSetupColumn("Keys", ImGuiTableColumnFlags_WidthFixed, size * 9.0f);
            ImGui::TableSetupColumn("", ImGuiTableColumnFlags_WidthFixed, size * 2.0f);
            for (const ShortcutLine& line : lines) {
                if (contains(line.label, search_) || contains(line.keys, search_) || contains(line.group, search_)) {
                    drawLine(context, lines, line);
                }
            }
            ImGui::EndTable();
        }
    }
    if (ImGui::IsWindowFocused(ImGuiFocusedFlags_RootAndChildWindows) && recording_.empty() &&
        ImGui::IsKeyPressed(ImGuiKey_Escape, false)) {
        open_ = false;
    }
    ImGui::End();
}

} // namespace ars::ui
