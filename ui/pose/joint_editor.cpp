#include "ui/pose/joint_editor.h"

#include "ui/pose/rotation_numbers.h"
#include "ui/widgets.h"

#include <imgui.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace ars::ui {
namespace {

/// Among the panels' settings, which are kept.
constexpr const char* kEulerSetting = "pose.euler";

constexpr std::array<const char*, 3> kAxes{"X", "Y", "Z"};
const std::array<ImVec4, 3> kAxisColors{ImVec4(0.78f, 0.36f, 0.36f, 1.0f), ImVec4(0.45f, 0.66f, 0.38f, 1.0f),
                                        ImVec4(0.37f, 0.52f, 0.80f, 1.0f)};

void rotateTo(StudioContext& context, const std::string& joint, const glm::quat& rotation) {
    const glm::vec3 degrees = rotationVectorDeg(rotation);
    runFromWidget(context, "pose.rotate_joint",
                  {{"joint", joint}, {"x", degrees.x}, {"y", degrees.y}, {"z", degrees.z}});
}

/// Three number fields in a row, each with a line in its axis' colour. True when one changed.
bool axisFields(StudioContext& context, const char* name, glm::vec3& values, float speed, const char* format,
                bool& active) {
    const float gap = ImGui::GetStyle().ItemInnerSpacing.x;
    const float width = std::floor((ImGui::GetContentRegionAvail().x - 2.0f * gap) / 3.0f);
    bool changed = false;
    active = false;
    for (int axis = 0; axis < 3; ++axis) {
        if (axis > 0) ImGui::SameLine(0.0f, gap);
        const std::string label = fmt::format("###{} {}", name, kAxes[static_cast<std::size_t>(axis)]);
        ImGui::SetNextItemWidth(width);
        changed |= ImGui::DragFloat(label.c_str(), &values[axis], speed, 0.0f, 0.0f, format);
        active |= ImGui::IsItemActive();
        const ImVec2 low = ImGui::GetItemRectMin();
        const ImVec2 high = ImGui::GetItemRectMax();
        ImGui::GetWindowDrawList()->AddRectFilled(low, ImVec2(low.x + 2.0f * context.scale, high.y),
                                                  ImGui::GetColorU32(kAxisColors[static_cast<std::size_t>(axis)]),
                                                  ImGui::GetStyle().FrameRounding, ImDrawFlags_RoundCornersLeft);
    }
    return changed;
}

std::string limitLabel(const JointLimit& limit, int axis) {
    return fmt::format("{} {}", axis == limit.twistAxis ? "Twist" : "Swing", kAxes[static_cast<std::size_t>(axis)]);
}

/// What a bar is drawn over: both bounds, rest and the value itself, with a little air.
std::pair<float, float> barRange(const LimitReading& reading, int axis) {
    const float low = std::min({reading.minimumDeg[axis], reading.coordinateDeg[axis], 0.0f});
    const float high = std::max({reading.maximumDeg[axis], reading.coordinateDeg[axis], 0.0f});
    const float air = 0.06f * std::max(high - low, 1.0f);
    return {low - air, high + air};
}

void drawBar(StudioContext& context, const LimitReading& reading, int axis, const ImVec2& low, const ImVec2& high) {
    const auto [first, last] = barRange(reading, axis);
    const auto x = [&, from = first, to = last](float degrees) {
        return low.x + (high.x - low.x) * (degrees - from) / (to - from);
    };
    ImDrawList* draw = ImGui::GetWindowDrawList();
    const float s = context.scale;
    const float middle = 0.5f * (low.y + high.y);
    const bool hovered = ImGui::IsItemHovered() || ImGui::IsItemActive();
    draw->AddRectFilled(ImVec2(low.x, middle - 2.0f * s), ImVec2(high.x, middle + 2.0f * s),
                        ImGui::GetColorU32(ImGuiCol_FrameBg), 2.0f * s);
    draw->AddRectFilled(ImVec2(x(reading.minimumDeg[axis]), middle - 2.0f * s),
                        ImVec2(x(reading.maximumDeg[axis]), middle + 2.0f * s),
                        ImGui::GetColorU32(hovered ? ImGuiCol_SliderGrab : ImGuiCol_FrameBgActive), 2.0f * s);
    draw->AddLine(ImVec2(x(0.0f), middle - 4.0f * s), ImVec2(x(0.0f), middle + 4.0f * s),
                  ImGui::GetColorU32(mutedColor()));
    const ImVec4 color = reading.atLimit(axis) ? badColor() : accentColor();
    draw->AddCircleFilled(ImVec2(x(reading.coordinateDeg[axis]), middle), 4.5f * s, ImGui::GetColorU32(color));
}

} // namespace

void JointEditor::draw(StudioContext& context, const PoseReading& reading) {
    const int joint = reading.selected;
    if (joint < 0) {
        ImGui::PushStyleColor(ImGuiCol_Text, mutedColor());
        ImGui::TextWrapped("Choose a joint in the list, or click a limb in the picture.");
        ImGui::PopStyleColor();
        drawRoot(context, reading);
        return;
    }
    drawHeader(context, reading, joint);
    drawRotation(context, reading, joint);
    drawLimits(context, reading, joint);
    drawRoot(context, reading);
}

void JointEditor::drawHeader(StudioContext& context, const PoseReading& reading, int joint) {
    ImGui::AlignTextToFramePadding();
    ImGui::TextUnformatted(friendlyName(reading.name(joint)).c_str());
    const float button = ImGui::GetFrameHeight();
    const float gap = ImGui::GetStyle().ItemInnerSpacing.x;
    ImGui::SameLine(std::max(ImGui::GetCursorPosX(), ImGui::GetContentRegionMax().x - 5.0f * button - 4.0f * gap));
    bool& euler = context.settings.panels[kEulerSetting];
    if (toolButton(icon::kCube, "Euler XYZ. Shows turns about x, then y, then z instead of the rotation vector",
                   euler)) {
        euler = !euler;
    }
    ImGui::SameLine(0.0f, gap);
    if (toolButton(icon::kKeyAdd, "Key joint. Keeps this joint's rotation at the current time")) {
        runFromWidget(context, "timeline.key", {{"track", "joint:" + reading.name(joint)}});
    }
    ImGui::SameLine(0.0f, gap);
    if (toolButton(icon::kFocus, "Look at joint. Turns the camera about it")) {
        runFromWidget(context, "camera.focus", {{"joint", reading.name(joint)}});
    }
    ImGui::SameLine(0.0f, gap);
    if (toolButton(icon::kReset, "Reset joint. Back to the rest pose, this joint alone")) {
        runFromWidget(context, "pose.reset", {{"joint", reading.name(joint)}, {"subtree", false}});
    }
    ImGui::SameLine(0.0f, gap);
    if (toolButton(icon::kRefresh, "Reset with children. Back to the rest pose, with everything that hangs on it")) {
        runFromWidget(context, "pose.reset", {{"joint", reading.name(joint)}, {"subtree", true}});
    }
}

void JointEditor::drawRotation(StudioContext& context, const PoseReading& reading, int joint) {
    const bool euler = context.settings.panels[kEulerSetting];
    const glm::quat rotation = reading.rotation(joint);
    glm::vec3 values = euler ? eulerDeg(rotation) : rotationVectorDeg(rotation);
    if (draggedJoint_ == joint) values = dragged_;
    for (int axis = 0; axis < 3; ++axis) {
        if (std::abs(values[axis]) < 0.005f) values[axis] = 0.0f; // no "-0.0"
    }

    rowLabel("Rotation", euler
                             ? "Degrees, turned about x first, then y, then z; fixed axes of the parent (R = Rz Ry Rx)."
                             : "Rotation vector in degrees: its direction is the axis, its length the angle.");
    bool active = false;
    const bool changed = axisFields(context, "Rotation", values, 0.5f, "%.1f\xc2\xb0", active);
    if (changed) {
        dragged_ = values;
        draggedJoint_ = joint;
        rotateTo(context, reading.name(joint), euler ? fromEulerDeg(values) : fromRotationVectorDeg(values));
    }
    if (!active && !changed) draggedJoint_ = -1;
}

void JointEditor::drawLimits(StudioContext& context, const PoseReading& reading, int joint) {
    const JointLimit* limit = limitOf(reading.name(joint));
    if (!limit) return;
    const glm::quat rotation = reading.rotation(joint);
    const LimitReading now = readLimits(*limit, rotation);
    for (int axis = 0; axis < 3; ++axis) {
        const bool stiff = now.maximumDeg[axis] - now.minimumDeg[axis] < 1.0f;
        if (stiff && std::abs(now.coordinateDeg[axis]) < 1.0f) continue;
        const std::string label = limitLabel(*limit, axis);
        rowLabel(label.c_str());
        const ImVec2 low = ImGui::GetCursorScreenPos();
        const std::string number = fmt::format("{:+.0f}\xc2\xb0", now.coordinateDeg[axis]);
        const float numberWidth = ImGui::CalcTextSize("+000\xc2\xb0").x;
        const float width = std::max(20.0f, ImGui::GetContentRegionAvail().x - numberWidth - 8.0f * context.scale);
        ImGui::InvisibleButton(label.c_str(), ImVec2(width, ImGui::GetFrameHeight()));
        const ImVec2 high(low.x + width, low.y + ImGui::GetFrameHeight());
        drawBar(context, now, axis, low, high);
        if (ImGui::IsItemActive() && ImGui::IsMouseDragging(ImGuiMouseButton_Left, 0.0f)) {
            const auto [first, last] = barRange(now, axis);
            const float moved = ImGui::GetIO().MouseDelta.x / width * (last - first);
            const float wanted =
                std::clamp(now.coordinateDeg[axis] + moved, std::min(now.minimumDeg[axis], now.coordinateDeg[axis]),
                           std::max(now.maximumDeg[axis], now.coordinateDeg[axis]));
            if (moved != 0.0f) rotateTo(context, reading.name(joint), withCoordinate(*limit, rotation, axis, wanted));
        }
        const std::string text =
            fmt::format("{:.1f} of {:.0f} to {:.0f} degrees{}. Drag to turn within the range.", now.coordinateDeg[axis],
                        now.minimumDeg[axis], now.maximumDeg[axis], now.atLimit(axis) ? ": at the limit" : "");
        help(context, text.c_str());
        ImGui::SameLine();
        ImGui::AlignTextToFramePadding();
        ImGui::TextColored(now.atLimit(axis) ? badColor() : mutedColor(), "%s", number.c_str());
    }
}

void JointEditor::drawRoot(StudioContext& context, const PoseReading& reading) {
    if (reading.selected >= 0 && reading.skeleton->parents[static_cast<std::size_t>(reading.selected)] >= 0) return;
    glm::vec3 position = reading.pose.translation;
    for (int axis = 0; axis < 3; ++axis) {
        if (std::abs(position[axis]) < 0.0005f) position[axis] = 0.0f;
    }
    rowLabel("Position", "How far the body has been moved from its rest place, metres; y is up.");
    bool active = false;
    if (axisFields(context, "Position", position, 0.005f, "%.2f m", active)) {
        runFromWidget(context, "pose.move_root", {{"x", position.x}, {"y", position.y}, {"z", position.z}});
    }
}

} // namespace ars::ui
