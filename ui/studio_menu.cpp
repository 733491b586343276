#include "ui/studio_state.h"

#include <algorithm>
#include <array>

namespace ars::ui {
namespace {

/// Switches of the view whose state a menu shows.
struct Toggle {
    std::string_view command;
    bool ViewSection::* member;
};
constexpr std::array kToggles = {
    Toggle{"view.grid", &ViewSection::grid},
    Toggle{"view.skeleton", &ViewSection::skeleton},
    Toggle{"view.parts", &ViewSection::parts},
    Toggle{"view.radius_spheres", &ViewSection::radiusSpheres},
    Toggle{"view.surfel_discs", &ViewSection::surfelDiscs},
    Toggle{"view.legend", &ViewSection::legend},
};

/// Sets `state` where the command is a switch, here or elsewhere in the document.
void switchState(const Document& document, std::string_view command, bool& state) {
    for (const Toggle& toggle : kToggles) {
        if (toggle.command == command) state = document.view.*toggle.member;
    }
    const bool* value = command == "pose.limits"             ? &document.pose.useLimits
                        : command == "pose.keep_orientation" ? &document.pose.keepOrientation
                        : command == "timeline.loop"         ? &document.timeline.loop
                        : command == "timeline.auto_key"     ? &document.timeline.autoKey
                                                             : nullptr;
    if (value) state = *value;
}

std::vector<const CommandArgument*> requiredArguments(const Command& command) {
    std::vector<const CommandArgument*> required;
    for (const CommandArgument& argument : command.arguments) {
        if (argument.required) required.push_back(&argument);
    }
    return required;
}

/// "three_quarter" -> "Three quarter"
std::string spoken(std::string word) {
    std::replace(word.begin(), word.end(), '_', ' ');
    if (!word.empty()) word[0] = static_cast<char>(std::toupper(static_cast<unsigned char>(word[0])));
    return word;
}

} // namespace

void Studio::State::drawAction(const Action& action) {
    const bool enabled = !action.enabled || action.enabled(context);
    const std::string keys = keysOf(settings, action.id, action.shortcut);
    if (ImGui::MenuItem(action.label.c_str(), keys.c_str(), false, enabled)) action.run(context);
    help(context, action.help.c_str());
}

void Studio::State::drawActions(const std::string& menu) {
    std::string family; // "file.export" of the line above: families are divided by lines
    for (const Action& action : actions) {
        if (action.menu != menu) continue;
        if (menu == "Window" && find(action.id.substr(7))) continue; // drawPanelMenu has them with check marks
        const std::string now = action.id.substr(0, action.id.find_first_of("_", action.id.find('.')));
        const bool divided = now == "file.open" || now == "file.save" || now == "file.export" ||
                             now == "file.screenshot" || now == "file.quit" || now == "edit.palette" ||
                             now == "window.theme" || now == "help.about";
        if (divided && now != family && !family.empty()) ImGui::Separator();
        family = now;
        drawAction(action);
        if (action.id == "file.open") drawRecentFiles();
    }
}

void Studio::State::drawRecentFiles() {
    const std::vector<std::filesystem::path>& files = session.recentFiles().files();
    if (!ImGui::BeginMenu("Open recent", !files.empty())) return;
    std::filesystem::path chosen;
    for (const std::filesystem::path& file : files) {
        const std::string label = fmt::format("{}###{}", file.filename().string(), file.string());
        if (ImGui::MenuItem(label.c_str())) chosen = file;
        help(context, file.c_str());
    }
    ImGui::Separator();
    if (ImGui::MenuItem("Clear the list")) session.recentFiles().clear();
    ImGui::EndMenu();
    if (!chosen.empty()) open(chosen);
}

void Studio::State::drawCommand(const Command& command) {
    const std::vector<const CommandArgument*> required = requiredArguments(command);
    const bool one = required.size() == 1;
    const Status possible = session.commandEnabled(command);
    const std::string keys = keysOf(settings, command.id, command.shortcut);
    const auto call = [&](const Arguments& arguments) {
        const Status status = session.run(command.id, arguments);
        if (!status) studio.showError(fmt::format("{} is not possible", command.label), status.error().describe());
    };
    bool state = false;
    const std::string reason = possible ? command.help : possible.error().message;
    if (required.empty()) {
        switchState(session.document(), command.id, state); // switches: called with nothing, they change over
        if (ImGui::MenuItem(command.label.c_str(), keys.c_str(), state, possible.ok())) call(Arguments::object());
        help(context, reason.c_str());
    } else if (one && !required[0]->info.choices.empty()) {
        if (!ImGui::BeginMenu(command.label.c_str(), possible.ok())) return;
        for (const std::string& word : required[0]->info.choices) {
            const Arguments arguments{{required[0]->info.name, word}};
            std::string own;
            for (const CommandVariant& variant : command.variants) {
                if (variant.arguments == arguments)
                    own = keysOf(settings, variantId(command, variant), variant.shortcut);
            }
            if (ImGui::MenuItem(fmt::format("{}###{}", spoken(word), word).c_str(), own.c_str())) call(arguments);
        }
        ImGui::EndMenu();
    }
    // What must be told more is in its panel and in the palette.
    if (one && !required[0]->info.choices.empty()) return;
    for (const CommandVariant& variant : command.variants) {
        const std::string own = keysOf(settings, variantId(command, variant), variant.shortcut);
        if (ImGui::MenuItem(variant.label.c_str(), own.c_str(), false, possible.ok())) call(variant.arguments);
        help(context, reason.c_str());
    }
}

void Studio::State::drawCommands(CommandGroup group) {
    for (const Command& command : commands()) {
        if (command.group == group) drawCommand(command);
    }
}

void Studio::State::drawPanelMenu() {
    for (const auto& panel : panels) {
        const bool open = studio.isOpen(panel->id());
        if (ImGui::MenuItem(panel->title(), nullptr, open)) studio.setOpen(panel->id(), !open);
        help(context, panel->help());
    }
    ImGui::Separator();
}

void Studio::State::drawMenuBar() {
    if (!ImGui::BeginMainMenuBar()) return;
    const auto menu = [&](const char* title, std::initializer_list<CommandGroup> groups) {
        if (!ImGui::BeginMenu(title)) return;
        if (std::string_view(title) == "Window") drawPanelMenu();
        drawActions(title);
        bool first = true;
        for (CommandGroup group : groups) {
            if (!first) ImGui::SeparatorText(groupTitle(group).c_str());
            first = false;
            drawCommands(group);
        }
        ImGui::EndMenu();
    };
    menu("File", {});
    menu("Edit", {});
    menu("Pose", {CommandGroup::Pose, CommandGroup::Avatar});
    menu("Motion", {CommandGroup::Timeline});
    menu("Camera", {CommandGroup::Viewpoint});
    menu("Light", {CommandGroup::Light, CommandGroup::Occlusion});
    menu("View", {CommandGroup::View, CommandGroup::Compare});
    menu("Window", {});
    menu("Help", {});
    const std::filesystem::path& path = session.projectPath();
    const std::string name = path.empty() ? "Untitled" : path.filename().string();
    const std::string title = session.editor().modified() ? name + " *" : name;
    const float width = ImGui::CalcTextSize(title.c_str()).x + 2.0f * ImGui::GetStyle().WindowPadding.x;
    ImGui::SameLine(std::max(ImGui::GetCursorPosX(), ImGui::GetWindowWidth() - width));
    ImGui::TextColored(mutedColor(), "%s", title.c_str());
    help(context, path.empty() ? "The project has not been saved yet." : path.c_str());
    ImGui::EndMainMenuBar();
}

} // namespace ars::ui
