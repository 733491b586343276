#include "ui/palette.h"

#include "ui/shortcuts.h"
#include "ui/studio.h"
#include "ui/widgets.h"

#include <imcmd_fuzzy_search.h>
#include <imgui_internal.h>
#include <imgui_stdlib.h>

#include <algorithm>

namespace ars::ui {
namespace {

constexpr const char* kWindow = "###Palette";

/// Arguments that name a file: they are answered with the file chooser.
bool namesFile(const Command& command, const CommandArgument& argument) {
    if (argument.info.typeName() != "text") return false;
    return argument.info.name == "file" || (argument.info.name == "source" && command.group == CommandGroup::Avatar);
}

bool picksWithEnter() {
    return ImGui::IsKeyPressed(ImGuiKey_Enter, false) || ImGui::IsKeyPressed(ImGuiKey_KeypadEnter, false);
}

nlohmann::json jsonOf(const ParameterValue& value) {
    if (const bool* flag = std::get_if<bool>(&value)) return *flag;
    if (const auto* integer = std::get_if<std::int64_t>(&value)) return *integer;
    if (const double* number = std::get_if<double>(&value)) return *number;
    return std::get<std::string>(value);
}

} // namespace

void CommandPalette::open() {
    close();
    open_ = appearing_ = true;
}

void CommandPalette::openFor(const Command& command) {
    open();
    begin(command);
}

void CommandPalette::close() {
    open_ = false;
    text_.clear();
    complaint_.clear();
    selected_ = 0;
    command_ = nullptr;
    argument_ = 0;
    given_ = Arguments::object();
}

const CommandArgument* CommandPalette::question() const {
    if (!command_ || argument_ >= command_->arguments.size()) return nullptr;
    return &command_->arguments[argument_];
}

void CommandPalette::begin(const Command& command) {
    command_ = &command;
    argument_ = 0;
    given_ = Arguments::object();
    text_.clear();
    selected_ = 0;
    appearing_ = true;
    // What has a default is left at it: the palette asks for what must be known.
    while (question() && !question()->required) ++argument_;
}

void CommandPalette::answer(StudioContext& context, nlohmann::json value) {
    given_[question()->info.name] = std::move(value);
    complaint_.clear();
    text_.clear();
    selected_ = 0;
    appearing_ = true;
    do ++argument_;
    while (question() && !question()->required);
    if (question()) return;
    const std::string label = command_->label;
    const Status status = context.session.run(command_->id, given_);
    close();
    if (!status) context.studio.showError(fmt::format("{} is not possible", label), status.error().describe());
}

void CommandPalette::call(StudioContext& context, const std::string& id) {
    const Command* command = findCommand(id);
    const bool asks = command && std::any_of(command->arguments.begin(), command->arguments.end(),
                                             [](const CommandArgument& argument) { return argument.required; });
    if (asks) {
        begin(*command);
        return;
    }
    close();
    context.studio.invoke(id);
}

std::vector<CommandPalette::Entry> CommandPalette::findEntries(StudioContext& context) const {
    std::vector<Entry> entries;
    for (const ShortcutLine& line : shortcutLines(context.studio.actions(), context.settings)) {
        Entry entry{line.id, fmt::format("{}: {}", line.group, line.label), line.help, line.keys};
        if (!text_.empty() && !ImCmd::FuzzySearch(text_.c_str(), entry.text.c_str(), entry.score)) continue;
        entries.push_back(std::move(entry));
    }
    std::stable_sort(entries.begin(), entries.end(), [](const Entry& a, const Entry& b) { return a.score > b.score; });
    for (Entry& entry : entries) {
        if (const Command* command = findCommand(entry.id.substr(0, entry.id.find('/'))))
            entry.enabled = context.session.commandEnabled(*command).ok();
        for (const Action& action : context.studio.actions()) {
            if (action.id == entry.id && action.enabled) entry.enabled = action.enabled(context);
        }
    }
    return entries;
}

/// Up and Down; true when the selection moved.
bool CommandPalette::moveSelection(int count) {
    const int before = selected_;
    if (ImGui::IsKeyPressed(ImGuiKey_DownArrow)) ++selected_;
    if (ImGui::IsKeyPressed(ImGuiKey_UpArrow)) --selected_;
    if (ImGui::IsKeyPressed(ImGuiKey_PageDown)) selected_ += 10;
    if (ImGui::IsKeyPressed(ImGuiKey_PageUp)) selected_ -= 10;
    selected_ = std::clamp(selected_, 0, std::max(count - 1, 0));
    return selected_ != before;
}

void CommandPalette::drawList(StudioContext& context) {
    ImGui::SetNextItemWidth(-FLT_MIN);
    if (appearing_) ImGui::SetKeyboardFocusHere();
    if (ImGui::InputTextWithHint("###Find", "Type what you want to do", &text_)) selected_ = 0;
    const std::vector<Entry> entries = findEntries(context);
    const bool moved = moveSelection(static_cast<int>(entries.size()));
    ImGui::BeginChild("Entries", ImVec2(0, ImGui::GetFontSize() * 20));
    const float right = ImGui::GetContentRegionMax().x;
    for (std::size_t i = 0; i < entries.size(); ++i) {
        const Entry& entry = entries[i];
        const bool selected = static_cast<int>(i) == selected_;
        ImGui::BeginDisabled(!entry.enabled);
        const bool clicked = ImGui::Selectable(fmt::format("{}###{}", entry.text, entry.id).c_str(), selected);
        if (selected && moved) ImGui::SetScrollHereY();
        help(context, entry.help.c_str());
        if (!entry.keys.empty()) {
            ImGui::SameLine(right - ImGui::CalcTextSize(entry.keys.c_str()).x);
            ImGui::TextColored(mutedColor(), "%s", entry.keys.c_str());
        }
        ImGui::EndDisabled();
        if (clicked || (selected && entry.enabled && picksWithEnter())) {
            call(context, entry.id);
            break;
        }
    }
    if (entries.empty()) ImGui::TextColored(mutedColor(), "Nothing is called like that.");
    ImGui::EndChild();
}

bool CommandPalette::chooseFrom(const std::vector<std::string>& words, std::string& word) {
    ImGui::SetNextItemWidth(-FLT_MIN);
    if (appearing_) ImGui::SetKeyboardFocusHere();
    if (ImGui::InputTextWithHint("###Answer", "Type to search", &text_)) selected_ = 0;
    std::vector<std::pair<int, const std::string*>> found;
    for (const std::string& choice : words) {
        int score = 0;
        if (text_.empty() || ImCmd::FuzzySearch(text_.c_str(), choice.c_str(), score))
            found.push_back({score, &choice});
    }
    std::stable_sort(found.begin(), found.end(), [](const auto& a, const auto& b) { return a.first > b.first; });
    const bool moved = moveSelection(static_cast<int>(found.size()));
    bool chosen = false;
    ImGui::BeginChild("Entries", ImVec2(0, ImGui::GetFontSize() * 16));
    for (std::size_t i = 0; i < found.size() && !chosen; ++i) {
        const bool selected = static_cast<int>(i) == selected_;
        chosen = ImGui::Selectable(found[i].second->c_str(), selected) || (selected && picksWithEnter());
        if (selected && moved) ImGui::SetScrollHereY();
        if (chosen) word = *found[i].second;
    }
    ImGui::EndChild();
    return chosen;
}

void CommandPalette::drawQuestion(StudioContext& context) {
    const Command& command = *command_;
    const CommandArgument& argument = *question();
    ImGui::TextUnformatted(command.label.c_str());
    ImGui::SameLine();
    ImGui::TextColored(mutedColor(), "%s", parameterLabel(argument.info).c_str());
    ImGui::PushStyleColor(ImGuiCol_Text, mutedColor());
    ImGui::TextWrapped("%s", argument.info.help.c_str());
    ImGui::PopStyleColor();
    std::vector<std::string> words = argument.info.choices;
    if (argument.choices) {
        Clipboard none;
        words = argument.choices(context.document(), {context.session.assets(), none, context.session.timeS()});
    }
    if (argument.info.typeName() == "bool") words = {"yes", "no"};
    std::string word;
    if (!words.empty()) {
        if (chooseFrom(words, word)) {
            const bool flag = argument.info.typeName() == "bool";
            answer(context, flag ? nlohmann::json(word == "yes") : nlohmann::json(word));
        }
        return;
    }
    ImGui::SetNextItemWidth(-FLT_MIN);
    if (appearing_) ImGui::SetKeyboardFocusHere();
    const std::string hint = argument.info.unit.empty() ? std::string("Value") : argument.info.unit;
    const bool entered =
        ImGui::InputTextWithHint("###Answer", hint.c_str(), &text_, ImGuiInputTextFlags_EnterReturnsTrue);
    if (namesFile(command, argument) && iconButton(icon::kFolder, "Browse")) {
        const Command* asked = command_;
        const std::string name = argument.info.name;
        context.studio.ask({.title = command.label,
                            .folderKey = command.id,
                            .chosen = [&context, asked, name](const std::filesystem::path& file) {
                                const Status status = context.session.run(asked->id, {{name, file.string()}});
                                if (!status) context.studio.showError(asked->label, status.error().describe());
                            }});
        close();
        return;
    }
    if (!complaint_.empty()) ImGui::TextColored(badColor(), "%s", complaint_.c_str());
    if (!entered) return;
    const Result<ParameterValue> value = parseParameter(argument.info, text_);
    if (value)
        answer(context, jsonOf(*value));
    else
        complaint_ = value.error().message;
}

void CommandPalette::draw(StudioContext& context) {
    if (!open_) return;
    const ImGuiViewport* viewport = ImGui::GetMainViewport();
    const float width = std::min(ImGui::GetFontSize() * 36, viewport->WorkSize.x * 0.9f);
    ImGui::SetNextWindowPos({viewport->GetCenter().x, viewport->WorkPos.y + viewport->WorkSize.y * 0.08f}, 0,
                            {0.5f, 0});
    ImGui::SetNextWindowSize({width, 0});
    if (appearing_) ImGui::SetNextWindowFocus();
    constexpr ImGuiWindowFlags kFlags = ImGuiWindowFlags_NoTitleBar | ImGuiWindowFlags_NoResize |
                                        ImGuiWindowFlags_NoMove | ImGuiWindowFlags_NoDocking |
                                        ImGuiWindowFlags_NoSavedSettings | ImGuiWindowFlags_AlwaysAutoResize;
    ImGui::PushStyleColor(ImGuiCol_WindowBg, ImGui::GetStyleColorVec4(ImGuiCol_PopupBg));
    ImGui::PushStyleVar(ImGuiStyleVar_WindowBorderSize, 1.0f);
    const bool fresh = appearing_;
    ImGui::Begin(kWindow, nullptr, kFlags);
    if (question())
        drawQuestion(context);
    else
        drawList(context);
    const bool focused = ImGui::IsWindowFocused(ImGuiFocusedFlags_RootAndChildWindows);
    // Nothing keeps the keyboard but this window: a click elsewhere or Escape leaves it.
    if (open_ && (ImGui::IsKeyPressed(ImGuiKey_Escape, false) || (!focused && !fresh && !appearing_))) close();
    if (fresh && ImGui::IsWindowAppearing() == false) appearing_ = false;
    ImGui::End();
    ImGui::PopStyleVar();
    ImGui::PopStyleColor();
}

} // namespace ars::ui
