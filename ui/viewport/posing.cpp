#include "ui/viewport/posing.h"

#include "engine/gl/presenter.h"
#include "engine/scene/evaluate.h"
#include "ui/widgets.h"

#include <algorithm>
#include <cmath>

namespace ars::ui {

namespace {

constexpr float kClickPixels = 4.0f; ///< a press that moves less is a click
constexpr int kMaxMarks = 9000;      ///< more dots say nothing new

const Skeleton* skeletonOf(const ViewportInput& input) {
    const auto& avatar = input.frame ? input.frame->avatar : nullptr;
    return avatar && avatar->evaluator ? &avatar->evaluator->rig().skeleton : nullptr;
}

} // namespace

void LimbDragging::hover(const ViewportInput& input, bool allowed) {
    if (held_) return;
    if (!allowed || !input.hovered || !input.frame) {
        hit_.reset();
        marks_.reset();
        marksJoint_ = -1;
        return;
    }
    if (hitFrame_ != input.frame || hitAt_.x != input.mouse.x || hitAt_.y != input.mouse.y) {
        const glm::ivec2 pixel = framePixel(input);
        hit_ = bodyAt(*input.frame, pixel.x, pixel.y);
        hitFrame_ = input.frame;
        hitAt_ = input.mouse;
    }
    const Skeleton* skeleton = skeletonOf(input);
    if (hit_ && skeleton) makeMarks(input, draggedJoint(*skeleton, hit_->joint));
    if (!hit_) {
        marks_.reset();
        marksJoint_ = -1;
    }
}

void LimbDragging::makeMarks(const ViewportInput& input, int dragged) {
    const Frame& frame = *input.frame;
    if (!frame.surfelMeans || (marksMeans_ == frame.surfelMeans.get() && marksJoint_ == dragged)) return;
    const std::vector<int> surfels = surfelsDraggedBy(frame.avatar->evaluator->rig(), dragged);
    const std::vector<glm::vec3>& means = *frame.surfelMeans;
    auto marks = std::make_shared<std::vector<OverlayLine>>();
    const std::size_t step = surfels.size() / kMaxMarks + 1;
    // Dots as wide as three gaps between surfels (60,000 on 2 m^2 are 6 mm apart) close the surface; the mask has half
    // the picture's size.
    const double metres = 0.02 * std::sqrt(60000.0 / std::max<double>(static_cast<double>(means.size()), 1.0));
    const auto width =
        static_cast<float>(std::clamp(0.5 * metres / input.view.metresPerPixel(hit_->depthM), 2.0, 40.0));
    for (std::size_t i = 0; i < surfels.size(); i += step) {
        const auto index = static_cast<std::size_t>(surfels[i]);
        if (index < means.size()) marks->push_back({means[index], means[index], glm::vec4(1.0f), width});
    }
    marks_ = std::move(marks);
    marksMeans_ = frame.surfelMeans.get();
    marksJoint_ = dragged;
}

void LimbDragging::begin(const ViewportInput& input) {
    const Skeleton* skeleton = skeletonOf(input);
    if (!hit_ || !skeleton) return;
    grabbed_ = *hit_;
    joint_ = draggedJoint(*skeleton, grabbed_.joint);
    // Ctrl on the torso takes the whole body along.
    if (ImGui::GetIO().KeyCtrl) {
        while (skeleton->parents[static_cast<std::size_t>(joint_)] >= 0) {
            joint_ = skeleton->parents[static_cast<std::size_t>(joint_)];
        }
    }
    const auto& joints = input.frame->jointWorld;
    if (joint_ < 0 || static_cast<std::size_t>(joint_) >= joints.size()) return;
    offset_ = glm::dvec3(joints[static_cast<std::size_t>(joint_)][3]) - grabbed_.world;
    held_ = true;
    moved_ = false;
    pressedAt_ = input.mouse;
}

void LimbDragging::update(const ViewportInput& input) {
    if (!held_) return;
    Session& session = input.context.session;
    const Skeleton* skeleton = skeletonOf(input);
    const ImVec2 way(input.mouse.x - pressedAt_.x, input.mouse.y - pressedAt_.y);
    if (!moved_ && std::hypot(way.x, way.y) > kClickPixels * input.scale) {
        moved_ = true;
        marks_.reset();
        marksJoint_ = -1;
        gesture_.begin(session, "limb");
    }
    const ImVec2 delta = ImGui::GetIO().MouseDelta;
    if (moved_ && skeleton && (delta.x != 0.0f || delta.y != 0.0f || !gesture_.active())) {
        const glm::dvec3 target = input.view.pointAt(input.mouse, grabbed_.depthM) + offset_;
        gesture_.run(input.context, "pose.drag_joint",
                     {{"joint", skeleton->names[static_cast<std::size_t>(joint_)]},
                      {"x", target.x},
                      {"y", target.y},
                      {"z", target.z}});
    }
    if (ImGui::IsMouseDown(ImGuiMouseButton_Left)) return;
    if (!moved_ && skeleton && grabbed_.joint >= 0) {
        const Document& document = input.context.document();
        const std::string& name = skeleton->names[static_cast<std::size_t>(grabbed_.joint)];
        if (document.view.parts && input.frame->avatar) {
            const BodyPart part = input.frame->avatar->evaluator->rig().parts[static_cast<std::size_t>(grabbed_.joint)];
            gesture_.run(input.context, "view.select_part", {{"part", bodyPartName(part)}});
        } else {
            gesture_.run(input.context, "view.select_joint", {{"joint", name}});
        }
    }
    gesture_.end(session);
    held_ = moved_ = false;
}

void LimbDragging::cancel(Session& session) {
    gesture_.cancel(session);
    held_ = moved_ = false;
}

/// The joint that is dragged, and a thread to the hand where it cannot follow.
void LimbDragging::drawDrag(const ViewportInput& input) const {
    if (!dragging() || !input.frame || static_cast<std::size_t>(joint_) >= input.frame->jointWorld.size()) return;
    const glm::dvec3 joint(input.frame->jointWorld[static_cast<std::size_t>(joint_)][3]);
    const auto at = input.view.toScreen(joint);
    const auto wanted = input.view.toScreen(input.view.pointAt(input.mouse, grabbed_.depthM) + offset_);
    if (!at || !wanted) return;
    ImDrawList* list = ImGui::GetWindowDrawList();
    const ImU32 color = ImGui::GetColorU32(inkColor(Ink::Accent));
    list->AddLine(*at, *wanted, (color & ~IM_COL32_A_MASK) | (120u << IM_COL32_A_SHIFT), 1.5f * input.scale);
    list->AddCircle(*at, 6.0f * input.scale, color, 24, 2.0f * input.scale);
    list->AddCircleFilled(*wanted, 2.5f * input.scale, color);
}

void LimbDragging::drawName(const ViewportInput& input) const {
    const Skeleton* skeleton = skeletonOf(input);
    const BodyHit* hit = held_ ? &grabbed_ : hit_ ? &*hit_ : nullptr;
    if (!hit || !skeleton || hit->joint < 0) return;
    std::string text = segmentName(*skeleton, hit->joint);
    const Document& document = input.context.document();
    if (document.view.parts && input.frame->avatar) {
        const BodyPart part = input.frame->avatar->evaluator->rig().parts[static_cast<std::size_t>(hit->joint)];
        text = "Part: " + readableName(std::string(bodyPartName(part)));
    }
    drawPlate(ImGui::GetWindowDrawList(),
              ImVec2(input.mouse.x + 16.0f * input.scale, input.mouse.y + 18.0f * input.scale), ImVec2(0, 0),
              text.c_str(), Ink::Text, input.scale);
}

} // namespace ars::ui
