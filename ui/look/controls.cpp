#include "ui/look/controls.h"

#include "ui/studio.h"

#include <algorithm>
#include <cctype>
#include <vector>

namespace ars::ui {

std::string wordsOf(std::string_view name) {
    std::string words(name);
    std::replace(words.begin(), words.end(), '_', ' ');
    if (!words.empty()) words[0] = static_cast<char>(std::toupper(static_cast<unsigned char>(words[0])));
    return words;
}

float buttonWidth(const char* label) {
    return ImGui::CalcTextSize(label, nullptr, true).x + 2.0f * ImGui::GetStyle().FramePadding.x;
}

namespace {

/// Numbers of buttons in each of `lines` lines of about equal length.
std::vector<std::size_t> balanced(std::size_t count, std::size_t lines) {
    std::vector<std::size_t> counts;
    for (std::size_t i = 0; i < lines; ++i) counts.push_back(count * (i + 1) / lines - count * i / lines);
    std::sort(counts.rbegin(), counts.rend());
    return counts;
}

bool fits(std::span<const float> widths, const std::vector<std::size_t>& counts, float gap, float available) {
    std::size_t begin = 0;
    for (const std::size_t count : counts) {
        float used = gap * static_cast<float>(count - 1);
        for (std::size_t i = begin; i < begin + count; ++i) used += widths[i];
        if (used > available && count > 1) return false;
        begin += count;
    }
    return true;
}

/// The fewest lines into which all go.
std::vector<std::size_t> linesOf(std::span<const float> widths, float gap, float available) {
    for (std::size_t lines = 1; lines < widths.size(); ++lines) {
        const std::vector<std::size_t> counts = balanced(widths.size(), lines);
        if (fits(widths, counts, gap, available)) return counts;
    }
    return std::vector<std::size_t>(widths.size(), 1);
}

bool choiceButton(const Choice& choice, bool active, float width) {
    if (active) {
        const ImVec4 accent = accentColor();
        ImGui::PushStyleColor(ImGuiCol_Button, ImVec4(accent.x, accent.y, accent.z, 0.30f));
        ImGui::PushStyleColor(ImGuiCol_ButtonHovered, ImVec4(accent.x, accent.y, accent.z, 0.38f));
    }
    const bool clicked = ImGui::Button(choice.label, ImVec2(width, 0.0f));
    if (active) ImGui::PopStyleColor(2);
    return clicked;
}

} // namespace

std::optional<int> choiceButtons(const StudioContext& context, const char* id, std::span<const Choice> choices,
                                 int current) {
    std::optional<int> clicked;
    const ImVec2 spacing = ImGui::GetStyle().ItemSpacing;
    const float gap = std::max(1.0f, 2.0f * context.scale), available = ImGui::GetContentRegionAvail().x;
    const float left = ImGui::GetCursorScreenPos().x;
    std::vector<float> widths;
    for (const Choice& choice : choices) widths.push_back(buttonWidth(choice.label));
    const std::vector<std::size_t> counts = linesOf(widths, gap, available);
    ImGui::PushID(id);
    std::size_t begin = 0;
    for (std::size_t line = 0; line < counts.size(); ++line) {
        const std::size_t count = counts[line], end = begin + count;
        const float gaps = gap * static_cast<float>(count - 1);
        const float equal = (available - gaps) / static_cast<float>(count);
        float natural = gaps, widest = 0.0f;
        for (std::size_t i = begin; i < end; ++i) {
            natural += widths[i];
            widest = std::max(widest, widths[i]);
        }
        const float extra = std::max(0.0f, available - natural) / static_cast<float>(count);
        // The lines belong together; what follows keeps its distance.
        ImGui::PushStyleVar(ImGuiStyleVar_ItemSpacing, ImVec2(gap, line + 1 < counts.size() ? gap : spacing.y));
        ImGui::SetCursorScreenPos(ImVec2(left, ImGui::GetCursorScreenPos().y));
        for (std::size_t i = begin; i < end; ++i) {
            if (i > begin) ImGui::SameLine();
            const bool active = static_cast<int>(i) == current;
            const float width = widest <= equal ? equal : widths[i] + extra;
            if (choiceButton(choices[i], active, width) && !active) clicked = static_cast<int>(i);
            if (choices[i].tooltip) help(context, choices[i].tooltip);
        }
        ImGui::PopStyleVar();
        begin = end;
    }
    ImGui::PopID();
    return clicked;
}

Arguments argumentOf(const ParameterValue& value) {
    return std::visit([](const auto& held) { return Arguments(held); }, value);
}

bool commandRow(StudioContext& context, std::string_view command, std::string_view argument, const char* label,
                ParameterValue value, std::optional<ParameterRange> comfortable) {
    const Command* found = findCommand(command);
    if (!found) return false;
    const auto row = std::find_if(found->arguments.begin(), found->arguments.end(),
                                  [&](const CommandArgument& a) { return a.info.name == argument; });
    if (row == found->arguments.end()) return false;
    ParameterInfo info = row->info;
    info.name = label;
    if (comfortable) info.range = *comfortable;
    if (!parameterRow(context, info, value)) return false;
    Arguments arguments = Arguments::object();
    arguments[std::string(argument)] = argumentOf(value);
    runFromWidget(context, command, arguments);
    return true;
}

void toggle(StudioContext& context, const char* label, std::string_view command, bool value, const char* tooltip) {
    if (ImGui::Checkbox(label, &value)) runFromWidget(context, command, {{"enabled", value}});
    if (tooltip) help(context, tooltip);
}

bool runTogether(StudioContext& context, std::string_view gesture, std::span<const CommandCall> calls) {
    context.session.endGesture();
    bool ok = true;
    for (const CommandCall& call : calls) {
        const Status status = context.session.run(call.id, call.arguments, gesture);
        if (status) continue;
        context.studio.toast(status.error().describe());
        ok = false;
        break;
    }
    context.session.endGesture();
    return ok;
}

bool commandButton(StudioContext& context, const char* label, std::string_view command, const char* tooltip,
                   const Arguments& arguments, float width) {
    const Command* found = findCommand(command);
    const Status enabled = found ? context.session.commandEnabled(*found)
                                 : Status(makeError(ErrorCode::NotFound, "", "there is no such command"));
    ImGui::BeginDisabled(!enabled.ok());
    const bool clicked = ImGui::Button(label, ImVec2(width, 0.0f));
    ImGui::EndDisabled();
    if (!enabled) {
        help(context, enabled.error().describe().c_str());
    } else if (tooltip) {
        help(context, tooltip);
    }
    if (clicked) runFromWidget(context, command, arguments);
    return clicked;
}

void hint(const char* text) {
    ImGui::PushStyleColor(ImGuiCol_Text, mutedColor());
    ImGui::PushTextWrapPos(0.0f);
    ImGui::TextUnformatted(text);
    ImGui::PopTextWrapPos();
    ImGui::PopStyleColor();
}

namespace {

/// UTF-8 continues: never cut before such a byte.
bool continues(char c) { return (static_cast<unsigned char>(c) & 0xC0) == 0x80; }

} // namespace

std::string fitted(std::string_view text, float width, bool keepEnd) {
    const auto widthOf = [](const std::string& s) { return ImGui::CalcTextSize(s.c_str()).x; };
    std::string whole(text);
    if (widthOf(whole) <= width) return whole;
    std::size_t keep = text.size();
    while (keep > 0) {
        --keep;
        while (keep > 0 && continues(text[keep])) --keep;
        std::string cut;
        if (keepEnd) {
            std::size_t front = keep / 2, back = text.size() - (keep - front);
            while (front > 0 && continues(text[front])) --front;
            while (back < text.size() && continues(text[back])) ++back;
            cut = std::string(text.substr(0, front)) + "..." + std::string(text.substr(back));
        } else {
            cut = std::string(text.substr(0, keep)) + "...";
        }
        if (widthOf(cut) <= width) return cut;
    }
    return "...";
}

float shareOfRow(int count) {
    const float gap = ImGui::GetStyle().ItemSpacing.x;
    return std::max(1.0f, (ImGui::GetContentRegionAvail().x - gap * static_cast<float>(count - 1)) /
                              static_cast<float>(count));
}

void sameLineIfFits(float width) {
    const float next = ImGui::GetItemRectMax().x + ImGui::GetStyle().ItemSpacing.x;
    const float right = ImGui::GetCursorScreenPos().x + ImGui::GetContentRegionAvail().x;
    if (next + width <= right + 0.5f) ImGui::SameLine();
}

} // namespace ars::ui
