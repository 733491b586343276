#include "ui/viewport/spheres.h"

#include "engine/scene/evaluate.h"
#include "ui/viewport/picking.h"
#include "ui/widgets.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace ars::ui {

namespace {

constexpr float kNearPixels = 6.0f;

ImU32 partColor(BodyPart part, float alpha) {
    const glm::vec3& c = bodyPartColors()[static_cast<std::size_t>(part)];
    return ImGui::GetColorU32(ImVec4(c.r, c.g, c.b, alpha));
}

/// Pixels of the outline of a sphere, seen in perspective, near the axis.
float outlinePixels(double radiusM, double depthM, double focal) {
    const double square = depthM * depthM - radiusM * radiusM;
    return square > 1e-6 ? static_cast<float>(focal * radiusM / std::sqrt(square)) : 0.0f;
}

} // namespace

std::vector<RadiusSpheres::Rim> RadiusSpheres::rims(const ViewportInput& input) const {
    std::vector<Rim> result;
    const Document& document = input.context.document();
    if (!document.view.radiusSpheres || !input.frame || !input.frame->avatar) return result;
    const AvatarRig& rig = input.frame->avatar->evaluator->rig();
    const PartRadii radii = radiiAt(document, input.context.session.timeS());
    const auto& joints = input.frame->jointWorld;
    for (std::size_t j = 0; j < joints.size() && j < rig.parts.size(); ++j) {
        const BodyPart part = rig.parts[j];
        const bool selected = static_cast<int>(part) == document.view.selectedPart;
        // Thirty finger joints would hide the hands that they belong to.
        if (part == BodyPart::Hand && !selected) continue;
        const glm::dvec3 place(joints[j][3]);
        const auto at = input.view.toScreen(place);
        if (!at) continue;
        const double depth = input.view.depthOf(place);
        const float pixels = outlinePixels(radii[static_cast<std::size_t>(part)], depth, input.view.camera.fy);
        if (pixels > 2.0f) result.push_back({part, *at, pixels, depth});
    }
    return result;
}

void RadiusSpheres::update(const ViewportInput& input, bool allowed) {
    const std::vector<Rim> all = rims(input);
    if (held_ >= 0) drag(input);
    if (all.empty() || held_ >= static_cast<int>(all.size())) {
        hot_ = -1;
        if (all.empty()) return;
    }
    if (held_ < 0) {
        hot_ = -1;
        float least = kNearPixels * input.scale;
        const int chosen = input.context.document().view.selectedPart;
        for (std::size_t i = 0; i < all.size() && allowed && input.hovered; ++i) {
            // While a part is selected only its spheres can be taken: the others are there to compare with.
            if (chosen >= 0 && static_cast<int>(all[i].part) != chosen) continue;
            const float distance =
                std::abs(std::hypot(input.mouse.x - all[i].center.x, input.mouse.y - all[i].center.y) - all[i].pixels);
            if (distance < least) {
                least = distance;
                hot_ = static_cast<int>(i);
            }
        }
    }
    draw(input, all);
}

void RadiusSpheres::begin(const ViewportInput& input) {
    const std::vector<Rim> all = rims(input);
    if (hot_ < 0 || hot_ >= static_cast<int>(all.size())) return;
    held_ = hot_;
    grabbed_ = all[static_cast<std::size_t>(hot_)];
    grabbedOffset_ = std::hypot(input.mouse.x - grabbed_.center.x, input.mouse.y - grabbed_.center.y) - grabbed_.pixels;
    gesture_.begin(input.context.session, "radius");
}

void RadiusSpheres::cancel(Session& session) {
    gesture_.cancel(session);
    held_ = -1;
}

void RadiusSpheres::drag(const ViewportInput& input) {
    const ImVec2 delta = ImGui::GetIO().MouseDelta;
    if (delta.x != 0.0f || delta.y != 0.0f) {
        const double pixels =
            std::hypot(input.mouse.x - grabbed_.center.x, input.mouse.y - grabbed_.center.y) - grabbedOffset_;
        // The outline is that of the sphere's tangent cone: its half angle has this tangent.
        const double tangent = std::max(pixels, 1.0) / input.view.camera.fy;
        const double radius = grabbed_.depthM * tangent / std::sqrt(1.0 + tangent * tangent);
        const double initial = bodyPartInitialRadiusM(grabbed_.part);
        gesture_.run(input.context, "occlusion.radius",
                     {{"part", bodyPartName(grabbed_.part)},
                      {"metres", std::clamp(radius, kMinRadiusFactor * initial, kMaxRadiusFactor * initial)}});
    }
    if (ImGui::IsMouseDown(ImGuiMouseButton_Left)) return;
    gesture_.end(input.context.session);
    held_ = -1;
}

void RadiusSpheres::draw(const ViewportInput& input, const std::vector<Rim>& all) const {
    ImDrawList* list = ImGui::GetWindowDrawList();
    const Document& document = input.context.document();
    const int chosen = document.view.selectedPart;
    const int marked = held_ >= 0 ? held_ : hot_;
    for (std::size_t i = 0; i < all.size(); ++i) {
        const Rim& rim = all[i];
        const bool strong = static_cast<int>(rim.part) == chosen || static_cast<int>(i) == marked;
        const float alpha = strong ? 0.95f : chosen >= 0 ? 0.14f : 0.42f;
        const float width = (static_cast<int>(i) == marked ? 2.6f : strong ? 1.8f : 1.2f) * input.scale;
        if (strong) list->AddCircleFilled(rim.center, rim.pixels, partColor(rim.part, 0.10f), 64);
        list->AddCircle(rim.center, rim.pixels, partColor(rim.part, alpha), 64, width);
    }
    if (marked < 0 || marked >= static_cast<int>(all.size())) return;
    const Rim& rim = all[static_cast<std::size_t>(marked)];
    const auto part = static_cast<std::size_t>(rim.part);
    const std::string text =
        fmt::format("{}  r_g {:.3f} m   initial {:.3f} m{}", readableName(std::string(bodyPartName(rim.part))),
                    radiiAt(document, input.context.session.timeS())[part], document.occlusion.initial[part],
                    document.occlusion.locked[part] ? "   locked" : "");
    drawPlate(list, ImVec2(rim.center.x, rim.center.y - rim.pixels - 8.0f * input.scale), ImVec2(0.5f, 1.0f),
              text.c_str(), Ink::Text, input.scale);
}

} // namespace ars::ui
