#include "ui/panel.h"
#include "ui/studio.h"
#include "ui/widgets.h"

#include <fmt/format.h>

namespace ars::ui {
namespace {

/// Every edit in a list; a click goes back or forth to it.
class HistoryPanel : public Panel {
public:
    const char* id() const override { return "history"; }
    const char* title() const override { return "History"; }
    const char* help() const override { return "All edits; a click goes back or forth to one"; }

    void draw(StudioContext& context) override {
        const std::vector<Editor::HistoryLine> lines = context.session.editor().history();
        std::size_t done = 0;
        for (const Editor::HistoryLine& line : lines) done += line.done;
        buttons(context);
        ImGui::SameLine();
        ImGui::AlignTextToFramePadding();
        ImGui::TextColored(mutedColor(), "%zu of %zu edits done", done, lines.size());
        ImGui::BeginChild("Lines");
        std::optional<std::size_t> wanted;
        if (row(context, "As opened", "", 0, done)) wanted = 0;
        ImGuiListClipper clipper;
        clipper.Begin(static_cast<int>(lines.size()));
        while (clipper.Step()) {
            for (int i = clipper.DisplayStart; i < clipper.DisplayEnd; ++i) {
                const auto entry = static_cast<std::size_t>(i);
                if (row(context, lines[entry].label, lines[entry].commandId, entry + 1, done)) wanted = entry + 1;
            }
        }
        if (shown_ != done)
            ImGui::SetScrollY(ImGui::GetTextLineHeightWithSpacing() * static_cast<float>(done) -
                              ImGui::GetWindowHeight() * 0.5f);
        shown_ = done;
        ImGui::EndChild();
        if (wanted) context.session.travel(*wanted);
    }

private:
    static void buttons(StudioContext& context) {
        const Editor& editor = context.session.editor();
        ImGui::BeginDisabled(!editor.canUndo());
        if (toolButton(icon::kUndo, "Undo. Ctrl+Z")) context.session.undo();
        ImGui::EndDisabled();
        ImGui::SameLine(0, 2);
        ImGui::BeginDisabled(!editor.canRedo());
        if (toolButton(icon::kRedo, "Redo. Ctrl+Shift+Z")) context.session.redo();
        ImGui::EndDisabled();
    }

    /// @param count  entries that are done when this line is the last of them
    static bool row(StudioContext& context, const std::string& label, const std::string& command, std::size_t count,
                    std::size_t done) {
        const bool undone = count > done;
        if (undone) ImGui::PushStyleColor(ImGuiCol_Text, mutedColor());
        const bool pressed = ImGui::Selectable(fmt::format("{}###Entry {}", label, count).c_str(), count == done);
        if (undone) ImGui::PopStyleColor();
        ars::ui::help(context, command.c_str());
        return pressed && count != done;
    }

    std::size_t shown_ = 0; ///< what was scrolled to last
};

} // namespace

std::unique_ptr<Panel> makeHistoryPanel() { return std::make_unique<HistoryPanel>(); }

} // namespace ars::ui
