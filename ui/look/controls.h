#pragma once

#include "ui/widgets.h"

#include <imgui.h>

#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace ars::ui {

/// Widgets that several panels of the look share.

/// "golden_hour" -> "Golden hour".
std::string wordsOf(std::string_view name);

struct Choice {
    const char* label;
    const char* tooltip = nullptr;
};
/// One of a few, as buttons beside each other that fill the width and break into lines where they must.
/// @param id       scope of the buttons' ids: tests say "Light/Kind/Sky"
/// @param current  index of the one that holds; -1: none
/// @return the one that was clicked and did not hold
std::optional<int> choiceButtons(const StudioContext& context, const char* id, std::span<const Choice> choices,
                                 int current);

/// The row of one argument of a command, with the range, unit and help that the command states; runs the command when
/// the person changes it. Nothing is drawn where there is no such command or argument.
/// @param label        replaces the argument's name ("Exposure" for "ev")
/// @param comfortable  a part of the range in which a slider is easier to hit
bool commandRow(StudioContext& context, std::string_view command, std::string_view argument, const char* label,
                ParameterValue value, std::optional<ParameterRange> comfortable = std::nullopt);

/// A check box that runs a command with {"enabled": ...}.
void toggle(StudioContext& context, const char* label, std::string_view command, bool value, const char* tooltip);

/// Runs commands as one undo entry.
struct CommandCall {
    std::string_view id;
    Arguments arguments = Arguments::object();
};
/// Errors become a toast; the ones after it are not run. @return whether all went well
bool runTogether(StudioContext& context, std::string_view gesture, std::span<const CommandCall> calls);

/// A button that runs a command. Greyed out, with the reason as tooltip, while the command can do nothing.
bool commandButton(StudioContext& context, const char* label, std::string_view command, const char* tooltip,
                   const Arguments& arguments = Arguments::object(), float width = 0.0f);

/// Text of less importance, wrapped.
void hint(const char* text);

/// The part of the text that fits into the width, with "..." where it was cut; in the middle where `keepEnd`.
std::string fitted(std::string_view text, float width, bool keepEnd = false);

/// Width of each of `count` equal widgets in a row.
float shareOfRow(int count);
/// ImGui::SameLine, unless a widget of this width would not fit beside the last one.
void sameLineIfFits(float width);
/// Width of a button with this label.
float buttonWidth(const char* label);

/// Name and value of an argument or parameter as commands take them.
Arguments argumentOf(const ParameterValue& value);

} // namespace ars::ui
