#include "ui/pose/joint_editor.h"
#include "ui/pose/joint_tree_view.h"
#include "ui/pose/pose_grid.h"
#include "ui/widgets.h"

#include <imgui.h>

#include <algorithm>

namespace ars::ui {
namespace {

constexpr float kCoefficientLimit = 3.0f; ///< standard deviations: what the models were made of

/// Joints, numbers, copies, library, shape and expression.
class PosePanel : public Panel {
public:
    const char* id() const override { return "pose"; }
    const char* title() const override { return "Pose"; }
    const char* help() const override { return "Joints, mirror and copy, pose library, shape and expression."; }
    void draw(StudioContext& context) override;

private:
    void drawTools(StudioContext& context);
    void drawSwitches(StudioContext& context);
    void drawShape(StudioContext& context);
    void drawExpression(StudioContext& context, const PoseReading& reading);

    JointTreeView tree_;
    JointEditor editor_;
    PoseGrid grid_;
    float blend_ = 1.0f;
};

bool section(const char* label, bool open, const char* id = nullptr) {
    const std::string text = id ? fmt::format("{}###{}", label, id) : label;
    return ImGui::CollapsingHeader(text.c_str(), open ? ImGuiTreeNodeFlags_DefaultOpen : ImGuiTreeNodeFlags_None);
}

/// Buttons of equal width, `columns` in a row.
class ButtonGrid {
public:
    ButtonGrid(StudioContext& context, int columns) : context_(context), columns_(columns) {
        gap_ = ImGui::GetStyle().ItemInnerSpacing.x;
        width_ = std::floor((ImGui::GetContentRegionAvail().x - gap_ * static_cast<float>(columns - 1)) /
                            static_cast<float>(columns));
    }
    bool button(const char* label, const char* tooltip, bool enabled = true) {
        if (count_++ % columns_ != 0) ImGui::SameLine(0.0f, gap_);
        ImGui::BeginDisabled(!enabled);
        ImGui::PushStyleVar(ImGuiStyleVar_FramePadding, ImVec2(2.0f, ImGui::GetStyle().FramePadding.y));
        const bool pressed = ImGui::Button(label, ImVec2(width_, 0.0f));
        ImGui::PopStyleVar();
        ImGui::EndDisabled();
        ars::ui::help(context_, tooltip);
        return pressed;
    }

private:
    StudioContext& context_;
    int columns_ = 1;
    int count_ = 0;
    float gap_ = 0.0f;
    float width_ = 0.0f;
};

bool can(StudioContext& context, const char* command) {
    const Command* found = findCommand(command);
    return found && context.session.commandEnabled(*found).ok();
}

/// One slider of a coefficient; a right click resets it.
void coefficientRow(StudioContext& context, const std::string& label, const char* command, int index, float value) {
    rowLabel(label.c_str());
    float edited = value;
    const bool changed = ImGui::SliderFloat(("###" + label).c_str(), &edited, -kCoefficientLimit, kCoefficientLimit,
                                            "%.2f", ImGuiSliderFlags_None);
    ars::ui::help(context, (label + ": standard deviations from the mean. Right click: back to 0.").c_str());
    if (changed) runFromWidget(context, command, {{"index", index}, {"value", edited}});
    if (ImGui::IsItemClicked(ImGuiMouseButton_Right)) {
        runFromWidget(context, command, {{"index", index}, {"value", 0.0f}});
    }
}

float coefficient(const std::vector<float>& values, int index) {
    return index < static_cast<int>(values.size()) ? values[static_cast<std::size_t>(index)] : 0.0f;
}

void PosePanel::draw(StudioContext& context) {
    const PoseReading reading = readPose(context);
    drawTools(context);
    if (section("Joints", true)) {
        tree_.draw(context, reading, 176.0f * context.scale);
        ImGui::Spacing();
        editor_.draw(context, reading);
        drawSwitches(context);
        ImGui::Spacing();
    }
    if (section("Library", true)) {
        grid_.draw(context, reading, blend_);
        ImGui::Spacing();
    }
    if (section("Shape", false)) drawShape(context);
    if (section("Expression", false)) drawExpression(context, reading);
}

void PosePanel::drawTools(StudioContext& context) {
    ButtonGrid grid(context, 3);
    if (grid.button("Mirror", "Exchanges left and right")) {
        runFromWidget(context, "pose.mirror", Arguments::object());
    }
    if (grid.button("Left to right", "The right side takes over the left side's pose")) {
        runFromWidget(context, "pose.mirror_side", {{"from", "left"}});
    }
    if (grid.button("Right to left", "The left side takes over the right side's pose")) {
        runFromWidget(context, "pose.mirror_side", {{"from", "right"}});
    }
    if (grid.button("Copy", "Copies the whole pose; single limbs by a right click on a joint")) {
        runFromWidget(context, "pose.copy", Arguments::object());
    }
    const bool copied = can(context, "pose.paste");
    if (grid.button("Paste", "Takes the copied pose over, as far as the amount says", copied)) {
        runFromWidget(context, "pose.paste", {{"flipped", false}, {"blend", blend_}});
    }
    if (grid.button("Paste flipped", "The copied pose with left and right exchanged", copied)) {
        runFromWidget(context, "pose.paste", {{"flipped", true}, {"blend", blend_}});
    }
    if (grid.button("Reset all", "Every joint back to the rest pose")) {
        runFromWidget(context, "pose.reset", Arguments::object());
    }
    if (grid.button("To floor", "Moves the body so that its lowest point stands on the floor")) {
        runFromWidget(context, "pose.place_on_floor", Arguments::object());
    }
    if (grid.button("Key pose", "Keeps the whole pose as keys at the current time")) {
        runFromWidget(context, "timeline.key", {{"track", "pose"}});
    }
    rowLabel("Amount", "How far poses from the library and the clipboard are taken over");
    float percent = blend_ * 100.0f;
    if (ImGui::SliderFloat("###Amount", &percent, 0.0f, 100.0f, "%.0f %%", ImGuiSliderFlags_AlwaysClamp)) {
        blend_ = percent / 100.0f;
    }
    ars::ui::help(context, "How far poses from the library and the clipboard are taken over");
}

void PosePanel::drawSwitches(StudioContext& context) {
    bool limits = context.document().pose.useLimits;
    if (ImGui::Checkbox("Joint limits", &limits)) runFromWidget(context, "pose.limits", {{"enabled", limits}});
    ars::ui::help(context, "Dragged limbs stay within the range of motion of a healthy body");
    const float next = ImGui::CalcTextSize("Keep orientation").x + 2.0f * ImGui::GetFrameHeight();
    ImGui::SameLine();
    if (ImGui::GetContentRegionAvail().x < next) ImGui::NewLine();
    bool keep = context.document().pose.keepOrientation;
    if (ImGui::Checkbox("Keep orientation", &keep)) {
        runFromWidget(context, "pose.keep_orientation", {{"enabled", keep}});
    }
    ars::ui::help(context, "A dragged hand or foot keeps its orientation in the world");
}

void PosePanel::drawShape(StudioContext& context) {
    const auto& avatar = context.session.assets().avatar;
    if (!avatar || avatar->shapeNames.empty()) {
        ImGui::PushStyleColor(ImGuiCol_Text, mutedColor());
        ImGui::TextWrapped(avatar ? "This avatar has one shape only." : "The avatar is being loaded.");
        ImGui::PopStyleColor();
        return;
    }
    ImGui::PushID("Shape");
    for (int i = 0; i < static_cast<int>(avatar->shapeNames.size()); ++i) {
        coefficientRow(context, friendlyName(avatar->shapeNames[static_cast<std::size_t>(i)]), "avatar.shape", i,
                       coefficient(context.document().avatar.betas, i));
    }
    if (ImGui::Button("Reset shape")) runFromWidget(context, "avatar.reset_shape", Arguments::object());
    ImGui::PopID();
    ImGui::Spacing();
}

void PosePanel::drawExpression(StudioContext& context, const PoseReading& reading) {
    const auto& avatar = context.session.assets().avatar;
    if (!avatar || avatar->expressionNames.empty()) {
        ImGui::PushStyleColor(ImGuiCol_Text, mutedColor());
        ImGui::TextWrapped(avatar ? "This avatar's face moves by its joints only." : "The avatar is being loaded.");
        ImGui::PopStyleColor();
        return;
    }
    ImGui::PushID("Expression");
    for (int i = 0; i < static_cast<int>(avatar->expressionNames.size()); ++i) {
        coefficientRow(context, friendlyName(avatar->expressionNames[static_cast<std::size_t>(i)]), "pose.expression",
                       i, coefficient(reading.pose.expression, i));
    }
    if (ImGui::Button("Reset expression")) runFromWidget(context, "pose.reset_expression", Arguments::object());
    ImGui::PopID();
    ImGui::Spacing();
}

} // namespace

std::unique_ptr<Panel> makePosePanel() { return std::make_unique<PosePanel>(); }

} // namespace ars::ui
