#pragma once

#include "ui/panel.h"
#include "ui/theme.h" // icons

#include <imgui.h>

#include <string>
#include <string_view>

namespace ars::ui {

/// Runs a command from a widget: while the widget is held down all calls are one undo entry, and frames may be drafts.
/// Call right after the widget that changed. Errors become a toast.
/// "Held down" is Dear ImGui's active item, else a mouse button (gizmos).
void runFromWidget(StudioContext& context, std::string_view command, const Arguments& arguments);

/// For what is no widget (mouse wheel, flying with keys): drafts are welcome for so long from now on. 0: this frame.
void keepInteracting(double seconds);

// Ids for tests: a row's widget is "###LABEL" and a button "ICON###LABEL", which hash as LABEL alone: "Light/Rotation"
// addresses it.

/// What a parameter's row is called: "min_opacity" -> "Min opacity".
std::string parameterLabel(const ParameterInfo& info);

/// A row "label | widget" for one parameter of a table: slider or number box with its unit, check box or choice; the
/// tooltip gives help, unit, range and default; a right click offers "reset". Numbers can be typed (Ctrl+click).
/// @return true when the value changed
bool parameterRow(StudioContext& context, const ParameterInfo& info, ParameterValue& value);

/// All rows of a table up to a tier, the rest folded under "More"; changes run settings.set with this group.
template <typename Struct>
void parameterRows(StudioContext& context, std::string_view group, const ParameterTable<Struct>& table,
                   const Struct& object, ParameterTier tier = ParameterTier::Basic);
void parameterRows(StudioContext& context, std::string_view group, const std::vector<ParameterInfo>& infos,
                   const std::vector<ParameterValue>& values, ParameterTier tier);

/// Label column of the rows above, for widgets that a table does not describe. Call, then draw the widget; it fills the
/// row.
void rowLabel(const char* label, const char* tooltip = nullptr);

/// A tooltip for the last widget, after a short rest of the mouse; wrapped. `symbol`: the paper's, or null.
void help(const StudioContext& context, const char* text, const char* symbol = nullptr, const char* unit = nullptr);

/// A button with an icon before its label, and one with the icon alone: its tooltip is its name, up to the first period
/// or bracket ("Play (Space). Starts the timeline" is "Play" for tests and where the icon font is missing).
bool iconButton(const char* icon, const char* label);
bool toolButton(const char* icon, const char* tooltip, bool active = false);

/// Text in the monospaced font, for numbers that change.
void numberText(StudioContext& context, const char* text);
/// A small heading with some air above.
void heading(const char* text);

/// The shell calls it once before the panels of a frame and once after them.
void beginWidgets(StudioContext& context);
void endWidgets(StudioContext& context);

/// The one accent colour, and those of text that is less important, good and bad, of the theme in use.
ImVec4 accentColor();
ImVec4 mutedColor();
ImVec4 goodColor();
ImVec4 badColor();

template <typename Struct>
void parameterRows(StudioContext& context, std::string_view group, const ParameterTable<Struct>& table,
                   const Struct& object, ParameterTier tier) {
    std::vector<ParameterValue> values;
    for (const ParameterInfo& info : table.infos()) values.push_back(table.get(object, info.name).value());
    parameterRows(context, group, table.infos(), values, tier);
}

} // namespace ars::ui
