#include "ui/pose/joint_tree_view.h"

#include "engine/scene/evaluate.h"
#include "ui/pose/rotation_numbers.h"
#include "ui/widgets.h"

#include <imgui.h>
#include <misc/cpp/imgui_stdlib.h>

#include <algorithm>

namespace ars::ui {
namespace {

constexpr float kChangedDeg = 0.05f;

const Skeleton& skeletonOf(const Session& session) {
    static const Skeleton none = smplxSkeleton(std::vector<glm::vec3>(kSmplxJointCount));
    const auto& avatar = session.assets().avatar;
    return avatar && avatar->evaluator ? avatar->evaluator->rig().skeleton : none;
}

bool isKeyed(const Document& document, int joint) {
    const auto& tracks = document.timeline.joints;
    return std::any_of(tracks.begin(), tracks.end(),
                       [joint](const JointTrack& track) { return track.joint == joint && !track.keys.empty(); });
}

void select(StudioContext& context, const PoseReading& reading, int joint) {
    Arguments arguments = Arguments::object();
    if (joint >= 0) arguments["joint"] = reading.name(joint);
    runFromWidget(context, "view.select_joint", arguments);
}

void contextMenu(StudioContext& context, const std::string& name) {
    if (!ImGui::BeginPopupContextItem("joint menu")) return;
    const auto item = [&](const char* label, const char* command, const Arguments& arguments) {
        if (ImGui::MenuItem(label)) runFromWidget(context, command, arguments);
    };
    item("Reset", "pose.reset", {{"joint", name}, {"subtree", false}});
    item("Reset with children", "pose.reset", {{"joint", name}, {"subtree", true}});
    item("Copy with children", "pose.copy", {{"joint", name}});
    ImGui::Separator();
    item("Key this joint", "timeline.key", {{"track", "joint:" + name}});
    item("Look at it", "camera.focus", {{"joint", name}});
    ImGui::EndPopup();
}

} // namespace

glm::quat PoseReading::rotation(int joint) const {
    const auto index = static_cast<std::size_t>(joint);
    return index < pose.rotations.size() ? pose.rotations[index] : glm::quat(1, 0, 0, 0);
}

bool PoseReading::changed(int joint) const {
    return angleBetweenDeg(rotation(joint), glm::quat(1, 0, 0, 0)) > kChangedDeg;
}

PoseReading readPose(const StudioContext& context) {
    PoseReading reading;
    reading.skeleton = &skeletonOf(context.session);
    reading.pose = poseAt(context.document(), context.session.assets(), context.session.timeS());
    reading.selected = context.document().view.selectedJoint;
    if (reading.selected >= reading.skeleton->jointCount()) reading.selected = -1;
    return reading;
}

void JointTreeView::draw(StudioContext& context, const PoseReading& reading, float height) {
    if (names_ != reading.skeleton->names) {
        names_ = reading.skeleton->names;
        tree_ = jointTree(*reading.skeleton);
    }
    if (shown_ != reading.selected) reveal_ = reading.selected >= 0;

    ImGui::SetNextItemWidth(-FLT_MIN);
    ImGui::InputTextWithHint("###Search", "Search joints", &search_, ImGuiInputTextFlags_EscapeClearsAll);
    help(context, "Parts of a name are enough: \"lwri\" finds the left wrist.");

    ImGui::PushStyleVar(ImGuiStyleVar_IndentSpacing, 11.0f * context.scale);
    ImGui::PushStyleVar(ImGuiStyleVar_ItemSpacing, ImVec2(ImGui::GetStyle().ItemSpacing.x, 0.0f));
    if (ImGui::BeginChild("joints", ImVec2(0.0f, height), ImGuiChildFlags_FrameStyle | ImGuiChildFlags_ResizeY)) {
        if (!search_.empty()) {
            drawFound(context, reading);
        } else {
            for (int group = 0; group < kJointGroupCount; ++group) {
                drawGroup(context, reading, static_cast<JointGroup>(group));
            }
        }
    }
    ImGui::EndChild();
    ImGui::PopStyleVar(2);
    shown_ = reading.selected;
    reveal_ = false;
}

void JointTreeView::drawGroup(StudioContext& context, const PoseReading& reading, JointGroup group) {
    const std::vector<int>& beginners = tree_.beginners[static_cast<std::size_t>(group)];
    if (beginners.empty()) return;
    const bool holdsSelected =
        reading.selected >= 0 && tree_.nodes[static_cast<std::size_t>(reading.selected)].group == group;
    if (reveal_ && holdsSelected) ImGui::SetNextItemOpen(true);
    ImGui::SetNextItemOpen(group == JointGroup::Body, ImGuiCond_FirstUseEver);
    ImGui::PushStyleColor(ImGuiCol_Text, mutedColor());
    const bool open = ImGui::TreeNodeEx(jointGroupLabel(group), ImGuiTreeNodeFlags_SpanAvailWidth);
    ImGui::PopStyleColor();
    if (!open) return;
    // The group's own level needs no indentation: the list is narrow.
    ImGui::Unindent();
    for (int joint : beginners) drawJoint(context, reading, joint);
    ImGui::Indent();
    ImGui::TreePop();
}

bool JointTreeView::isAbove(const PoseReading& reading, int joint) const {
    for (int j = reading.selected; j >= 0; j = reading.skeleton->parents[static_cast<std::size_t>(j)]) {
        if (j == joint) return true;
    }
    return false;
}

void JointTreeView::drawJoint(StudioContext& context, const PoseReading& reading, int joint) {
    const JointNode& node = tree_.nodes[static_cast<std::size_t>(joint)];
    ImGuiTreeNodeFlags flags =
        ImGuiTreeNodeFlags_SpanAvailWidth | ImGuiTreeNodeFlags_OpenOnArrow | ImGuiTreeNodeFlags_DefaultOpen;
    if (node.children.empty()) flags |= ImGuiTreeNodeFlags_Leaf | ImGuiTreeNodeFlags_NoTreePushOnOpen;
    if (joint == reading.selected) flags |= ImGuiTreeNodeFlags_Selected;
    if (reveal_ && !node.children.empty() && isAbove(reading, joint)) ImGui::SetNextItemOpen(true);
    const bool open = ImGui::TreeNodeEx(reading.name(joint).c_str(), flags, "%s", node.label.c_str());
    actOnRow(context, reading, joint);
    if (!open || node.children.empty()) return;
    for (int child : node.children) drawJoint(context, reading, child);
    ImGui::TreePop();
}

void JointTreeView::drawFound(StudioContext& context, const PoseReading& reading) {
    int count = 0;
    for (int joint = 0; joint < reading.skeleton->jointCount(); ++joint) {
        const std::string& name = reading.name(joint);
        const JointNode& node = tree_.nodes[static_cast<std::size_t>(joint)];
        if (!matchesSearch(name, search_) && !matchesSearch(node.label, search_)) continue;
        ++count;
        const std::string label = node.label + "###" + name;
        ImGui::Selectable(label.c_str(), joint == reading.selected);
        actOnRow(context, reading, joint);
    }
    if (count == 0) ImGui::TextDisabled("No joint of this name");
}

void JointTreeView::actOnRow(StudioContext& context, const PoseReading& reading, int joint) {
    const bool hovered = ImGui::IsItemHovered();
    if (ImGui::IsItemClicked() && !ImGui::IsItemToggledOpen() && joint != reading.selected) {
        select(context, reading, joint);
    }
    if (hovered && ImGui::IsMouseDoubleClicked(ImGuiMouseButton_Left)) {
        runFromWidget(context, "camera.focus", {{"joint", reading.name(joint)}});
    }
    if (reveal_ && joint == reading.selected && !ImGui::IsItemVisible()) ImGui::SetScrollHereY(0.4f);
    drawRowMarks(context, reading, joint);
    ImGui::PushID(joint);
    contextMenu(context, reading.name(joint));
    ImGui::PopID();
}

void JointTreeView::drawRowMarks(const StudioContext& context, const PoseReading& reading, int joint) {
    const ImVec2 low = ImGui::GetItemRectMin();
    const ImVec2 high = ImGui::GetItemRectMax();
    ImDrawList* draw = ImGui::GetWindowDrawList();
    const float right = ImGui::GetWindowPos().x + ImGui::GetWindowContentRegionMax().x;
    const ImVec2 center(right - 8.0f * context.scale, 0.5f * (low.y + high.y));
    if (reading.changed(joint)) {
        draw->AddCircleFilled(center, 2.5f * context.scale, ImGui::GetColorU32(accentColor()));
    }
    if (isKeyed(context.document(), joint)) {
        const float r = 3.5f * context.scale;
        const ImVec2 c(center.x - 11.0f * context.scale, center.y);
        draw->AddQuadFilled(ImVec2(c.x - r, c.y), ImVec2(c.x, c.y - r), ImVec2(c.x + r, c.y), ImVec2(c.x, c.y + r),
                            ImGui::GetColorU32(mutedColor()));
    }
}

} // namespace ars::ui
