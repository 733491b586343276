#include "ui/widgets.h"

#include "ui/studio.h"

#include <imgui_internal.h>
#include <imgui_stdlib.h>

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>

namespace ars::ui {
namespace {

/// What goes from one frame to the next: which press of which widget the running undo entry belongs to.
struct HoldState {
    ImGuiID active = 0;
    std::uint64_t press = 0;
    bool gestureOpen = false;
    double keepUntil = 0.0;
    bool tooltips = true;
};

/// One window, one thread.
HoldState& holdState() {
    static HoldState state;
    return state;
}

bool anyMouseDown() {
    const ImGuiIO& io = ImGui::GetIO();
    return io.MouseDown[0] || io.MouseDown[1] || io.MouseDown[2];
}

bool held() { return GImGui->ActiveId != 0 || anyMouseDown(); }

bool typing() { return GImGui->ActiveId != 0 && GImGui->ActiveId == GImGui->InputTextState.ID; }

/// "Play (Space). Starts it" -> "Play".
std::string nameOf(std::string_view tooltip) {
    std::string_view name = tooltip.substr(0, tooltip.find_first_of(".(:\n"));
    while (!name.empty() && name.back() == ' ') name.remove_suffix(1);
    return std::string(name);
}

std::string printfSafe(std::string_view text) {
    std::string safe;
    for (char c : text) safe += c == '%' ? "%%" : std::string(1, c);
    return safe;
}

bool bounded(const ParameterRange& range) { return range.maximum > range.minimum; }

/// printf format with the unit; as many digits as the range needs.
std::string numberFormat(const ParameterInfo& info, bool logarithmic) {
    const double span =
        bounded(info.range) ? info.range.maximum - info.range.minimum : std::abs(std::get<double>(info.defaultValue));
    const char* digits = logarithmic     ? "%.3g"
                         : span >= 100.0 ? "%.1f"
                         : span >= 10.0  ? "%.2f"
                         : span >= 0.1   ? "%.3f"
                                         : "%.4f";
    return info.unit.empty() ? digits : digits + std::string(" ") + printfSafe(info.unit);
}

bool numberWidget(const char* id, const ParameterInfo& info, double& value) {
    const ParameterRange& range = info.range;
    const bool logarithmic = bounded(range) && range.minimum > 0.0 && range.maximum / range.minimum >= 500.0;
    const std::string format = numberFormat(info, logarithmic);
    if (!bounded(range)) {
        const float speed = static_cast<float>(std::max(std::abs(value), 0.1) * 0.01);
        return ImGui::DragScalar(id, ImGuiDataType_Double, &value, speed, nullptr, nullptr, format.c_str());
    }
    ImGuiSliderFlags flags = ImGuiSliderFlags_AlwaysClamp;
    if (logarithmic) flags |= ImGuiSliderFlags_Logarithmic;
    return ImGui::SliderScalar(id, ImGuiDataType_Double, &value, &range.minimum, &range.maximum, format.c_str(), flags);
}

bool integerWidget(const char* id, const ParameterInfo& info, std::int64_t& value) {
    const auto minimum = static_cast<ImS64>(info.range.minimum);
    const auto maximum = static_cast<ImS64>(info.range.maximum);
    const std::string format = info.unit.empty() ? "%lld" : "%lld " + printfSafe(info.unit);
    ImS64 edited = value;
    bool changed = false;
    if (bounded(info.range) && maximum - minimum <= 512) {
        changed = ImGui::SliderScalar(id, ImGuiDataType_S64, &edited, &minimum, &maximum, format.c_str(),
                                      ImGuiSliderFlags_AlwaysClamp);
    } else {
        const float speed = static_cast<float>(std::max<std::int64_t>(std::abs(value), 10)) * 0.01f;
        changed =
            ImGui::DragScalar(id, ImGuiDataType_S64, &edited, speed, bounded(info.range) ? &minimum : nullptr,
                              bounded(info.range) ? &maximum : nullptr, format.c_str(), ImGuiSliderFlags_AlwaysClamp);
    }
    value = edited;
    return changed;
}

bool choiceWidget(const char* id, const ParameterInfo& info, std::string& value) {
    bool changed = false;
    if (!ImGui::BeginCombo(id, value.c_str())) return false;
    for (const std::string& word : info.choices) {
        if (ImGui::Selectable(word.c_str(), word == value) && word != value) {
            value = word;
            changed = true;
        }
    }
    ImGui::EndCombo();
    return changed;
}

bool valueWidget(const char* id, const ParameterInfo& info, ParameterValue& value) {
    if (bool* flag = std::get_if<bool>(&value)) return ImGui::Checkbox(id, flag);
    if (auto* integer = std::get_if<std::int64_t>(&value)) return integerWidget(id, info, *integer);
    if (double* number = std::get_if<double>(&value)) return numberWidget(id, info, *number);
    std::string& text = std::get<std::string>(value);
    if (!info.choices.empty()) return choiceWidget(id, info, text);
    return ImGui::InputText(id, &text, ImGuiInputTextFlags_EnterReturnsTrue);
}

std::string withUnit(const ParameterInfo& info, const std::string& number) {
    return info.unit.empty() ? number : number + " " + info.unit;
}

std::string rangeText(const ParameterInfo& info) {
    std::string text;
    if (bounded(info.range)) text = fmt::format("{:g} .. {:g}", info.range.minimum, info.range.maximum);
    const std::string standard = formatParameter(info.defaultValue);
    return fmt::format("{}{}default {}", withUnit(info, text), text.empty() ? "" : ", ",
                       standard.empty() ? "empty" : withUnit(info, standard));
}

nlohmann::json jsonValue(const ParameterValue& value) {
    if (const bool* flag = std::get_if<bool>(&value)) return *flag;
    if (const auto* integer = std::get_if<std::int64_t>(&value)) return *integer;
    if (const double* number = std::get_if<double>(&value)) return *number;
    return std::get<std::string>(value);
}

/// After a table's row; true: the person asked for the default.
bool resetMenu(const char* id, const ParameterInfo& info) {
    bool reset = false;
    const std::string popup = fmt::format("reset {}", id);
    if (ImGui::IsItemHovered(ImGuiHoveredFlags_AllowWhenBlockedByActiveItem) &&
        ImGui::IsMouseReleased(ImGuiMouseButton_Right)) {
        ImGui::OpenPopup(popup.c_str());
    }
    if (ImGui::BeginPopup(popup.c_str())) {
        const std::string standard = withUnit(info, formatParameter(info.defaultValue));
        reset = ImGui::MenuItem(fmt::format("Reset to {}###Reset", standard).c_str());
        ImGui::EndPopup();
    }
    return reset;
}

void tooltip(const char* text, const char* symbol, const char* unit) {
    if (!ImGui::BeginTooltip()) return;
    ImGui::PushTextWrapPos(ImGui::GetFontSize() * 24.0f);
    ImGui::TextUnformatted(text);
    if (symbol && *symbol) ImGui::TextColored(mutedColor(), "In the paper: %s", symbol);
    if (unit && *unit) ImGui::TextColored(mutedColor(), "%s", unit);
    ImGui::PopTextWrapPos();
    ImGui::EndTooltip();
}

bool tooltipWanted() {
    return ImGui::IsItemHovered(ImGuiHoveredFlags_ForTooltip | ImGuiHoveredFlags_DelayNormal |
                                ImGuiHoveredFlags_AllowWhenDisabled);
}

} // namespace

void beginWidgets(StudioContext& context) {
    HoldState& state = holdState();
    state.tooltips = context.settings.tooltips;
    if (!held()) state.active = 0;
}

void endWidgets(StudioContext& context) {
    HoldState& state = holdState();
    if (state.gestureOpen && held() && !typing() && ImGui::IsKeyPressed(ImGuiKey_Escape, false)) {
        context.session.cancelGesture();
        ImGui::ClearActiveID();
        state.gestureOpen = false;
    }
    if (state.gestureOpen && !held()) {
        context.session.endGesture();
        state.gestureOpen = false;
        ++state.press;
    }
    const bool dragging = state.gestureOpen && !typing();
    context.session.setInteracting(dragging || ImGui::GetTime() < state.keepUntil);
}

void keepInteracting(double seconds) {
    HoldState& state = holdState();
    state.keepUntil = std::max(state.keepUntil, ImGui::GetTime() + std::max(seconds, 1e-6));
}

void runFromWidget(StudioContext& context, std::string_view command, const Arguments& arguments) {
    HoldState& state = holdState();
    std::string gesture;
    if (held()) {
        const ImGuiID active = GImGui->ActiveId;
        if (active != state.active) {
            state.active = active;
            ++state.press;
        }
        gesture = fmt::format("widget {:08x} {}", active, state.press);
        state.gestureOpen = true;
    }
    const Status status = context.session.run(command, arguments, gesture);
    if (!status) context.studio.toast(status.error().describe());
}

std::string parameterLabel(const ParameterInfo& info) {
    std::string label = info.name;
    std::replace(label.begin(), label.end(), '_', ' ');
    if (!label.empty()) label[0] = static_cast<char>(std::toupper(static_cast<unsigned char>(label[0])));
    return label;
}

void rowLabel(const char* label, const char* text) {
    const float available = ImGui::GetContentRegionAvail().x;
    const float size = ImGui::GetFontSize();
    const float column = std::clamp(available * 0.40f, std::min(size * 5.0f, available * 0.5f), size * 10.0f);
    const float start = ImGui::GetCursorPosX();
    ImGui::AlignTextToFramePadding();
    const ImVec2 position = ImGui::GetCursorScreenPos();
    const float lineHeight = ImGui::GetFrameHeight();
    const char* end = ImGui::FindRenderedTextEnd(label);
    const ImVec2 wanted = ImGui::CalcTextSize(label, end);
    const float room = column - ImGui::GetStyle().ItemInnerSpacing.x;
    ImGui::Dummy({std::min(wanted.x, room), lineHeight});
    const ImVec2 from{position.x, position.y + ImGui::GetStyle().FramePadding.y};
    ImGui::RenderTextEllipsis(ImGui::GetWindowDrawList(), from, {position.x + room, position.y + lineHeight},
                              position.x + room, label, end, &wanted);
    const bool cut = wanted.x > room;
    if ((cut || (text && *text)) && holdState().tooltips && tooltipWanted()) {
        const std::string full = cut ? std::string(label, end) + (text && *text ? ". " : "") : std::string();
        tooltip((full + (text ? text : "")).c_str(), nullptr, nullptr);
    }
    ImGui::SameLine(start + column);
    ImGui::SetNextItemWidth(-FLT_MIN);
}

bool parameterRow(StudioContext& context, const ParameterInfo& info, ParameterValue& value) {
    const std::string label = parameterLabel(info);
    const std::string id = "###" + label;
    const std::string numbers = rangeText(info);
    rowLabel(label.c_str(), fmt::format("{}\n{}", info.help, numbers).c_str());
    ParameterValue edited = value;
    bool changed = valueWidget(id.c_str(), info, edited);
    help(context, info.help.c_str(), nullptr, numbers.c_str());
    if (resetMenu(label.c_str(), info)) {
        edited = info.defaultValue;
        changed = edited != value;
    }
    if (changed) value = edited;
    return changed;
}

void parameterRows(StudioContext& context, std::string_view group, const std::vector<ParameterInfo>& infos,
                   const std::vector<ParameterValue>& values, ParameterTier tier) {
    ImGui::PushID(group.data(), group.data() + group.size());
    const auto row = [&](std::size_t i) {
        ParameterValue value = values[i];
        if (!parameterRow(context, infos[i], value)) return;
        runFromWidget(context, "settings.set",
                      {{"group", std::string(group)}, {"name", infos[i].name}, {"value", jsonValue(value)}});
    };
    bool more = false;
    for (std::size_t i = 0; i < infos.size(); ++i) {
        if (infos[i].tier <= tier)
            row(i);
        else
            more = true;
    }
    if (more && ImGui::TreeNodeEx("More", ImGuiTreeNodeFlags_SpanAvailWidth)) {
        for (std::size_t i = 0; i < infos.size(); ++i) {
            if (infos[i].tier > tier) row(i);
        }
        ImGui::TreePop();
    }
    ImGui::PopID();
}

void help(const StudioContext& context, const char* text, const char* symbol, const char* unit) {
    if (context.settings.tooltips && text && *text && tooltipWanted()) tooltip(text, symbol, unit);
}

bool iconButton(const char* icon, const char* label) {
    const char* end = ImGui::FindRenderedTextEnd(label);
    const std::string shown(label, end);
    const std::string name = haveIcons() && icon && *icon ? fmt::format("{}  {}", icon, shown) : shown;
    return ImGui::Button(fmt::format("{}###{}", name, label).c_str());
}

bool toolButton(const char* icon, const char* text, bool active) {
    const std::string name = nameOf(text);
    const bool icons = haveIcons() && icon && *icon;
    if (active) ImGui::PushStyleColor(ImGuiCol_Text, accentColor());
    if (!active) ImGui::PushStyleColor(ImGuiCol_Button, ImVec4(0, 0, 0, 0));
    bool pressed = false;
    if (icons) {
        const float side = ImGui::GetFrameHeight();
        ImGui::PushStyleVar(ImGuiStyleVar_FramePadding, ImVec2(0.0f, ImGui::GetStyle().FramePadding.y));
        pressed = ImGui::Button(fmt::format("{}###{}", icon, name).c_str(), ImVec2(side, side));
        ImGui::PopStyleVar();
    } else {
        pressed = ImGui::Button(fmt::format("{}###{}", name, name).c_str());
    }
    ImGui::PopStyleColor();
    if (holdState().tooltips && tooltipWanted()) tooltip(text, nullptr, nullptr);
    return pressed;
}

void numberText(StudioContext& context, const char* text) {
    ImGui::PushFont(context.studio.monospaced(), 0.0f);
    ImGui::TextUnformatted(text);
    ImGui::PopFont();
}

void heading(const char* text) {
    ImGui::Dummy({0, ImGui::GetStyle().ItemSpacing.y * 0.5f});
    ImGui::PushStyleColor(ImGuiCol_Text, mutedColor());
    ImGui::SeparatorText(text);
    ImGui::PopStyleColor();
}

} // namespace ars::ui
