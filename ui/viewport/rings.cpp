#include "ui/viewport/rings.h"

#include "ui/widgets.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace ars::ui {

namespace {

constexpr float kRadiusPixels = 58.0f;
constexpr float kSightFactor = 1.18f; ///< the ring about the line of sight is larger
constexpr float kArrowFactor = 1.55f;
constexpr float kNearPixels = 7.0f;
constexpr double kSnapDeg = 5.0;
constexpr int kSegments = 72;
constexpr double kDeg = 180.0 / std::numbers::pi;
constexpr ImU32 kColors[4] = {IM_COL32(216, 98, 92, 255), IM_COL32(128, 184, 96, 255), IM_COL32(92, 142, 216, 255),
                              IM_COL32(200, 202, 206, 255)};

/// Any two unit vectors that span the plane of an axis.
void planeOf(const glm::dvec3& axis, glm::dvec3& u, glm::dvec3& v) {
    const glm::dvec3 other = std::abs(axis.x) < 0.8 ? glm::dvec3(1, 0, 0) : glm::dvec3(0, 1, 0);
    u = glm::normalize(glm::cross(axis, other));
    v = glm::cross(axis, u);
}

ImU32 withAlpha(ImU32 color, float alpha) {
    return (color & ~IM_COL32_A_MASK) | (static_cast<ImU32>(alpha * 255.0f + 0.5f) << IM_COL32_A_SHIFT);
}

float distanceToSegment(const ImVec2& p, const ImVec2& a, const ImVec2& b) {
    const ImVec2 d(b.x - a.x, b.y - a.y), q(p.x - a.x, p.y - a.y);
    const float square = d.x * d.x + d.y * d.y;
    const float t = square > 0 ? std::clamp((q.x * d.x + q.y * d.y) / square, 0.0f, 1.0f) : 0.0f;
    return std::hypot(q.x - t * d.x, q.y - t * d.y);
}

/// Angle of the mouse around a ring: where its ray meets the ring's plane, or, where that is seen from the side, along
/// the ring's tangent on the screen.
double angleOf(const ViewportInput& input, const glm::dvec3& center, const glm::dvec3& axis, double radiusM) {
    const glm::dvec3 eye = input.view.camera.centerWorld();
    const glm::dvec3 ray = input.view.rayTo(input.mouse);
    glm::dvec3 u, v;
    planeOf(axis, u, v);
    const double facing = glm::dot(axis, ray);
    if (std::abs(facing) > 0.15) {
        const double t = glm::dot(center - eye, axis) / facing;
        const glm::dvec3 d = eye + t * ray - center;
        return std::atan2(glm::dot(d, v), glm::dot(d, u));
    }
    const glm::dvec3 across = glm::normalize(glm::cross(axis, center - eye));
    const glm::dvec3 p = input.view.pointAt(input.mouse, input.view.depthOf(center));
    return glm::dot(p - center, across) / std::max(radiusM, 1e-6);
}

/// Metres along an axis through the centre that are nearest to the mouse's ray.
double alongAxis(const ViewportInput& input, const glm::dvec3& center, const glm::dvec3& axis) {
    const glm::dvec3 eye = input.view.camera.centerWorld();
    const glm::dvec3 ray = input.view.rayTo(input.mouse);
    const double b = glm::dot(axis, ray), denominator = 1.0 - b * b;
    if (denominator < 1e-4) return 0.0;
    const glm::dvec3 w = center - eye;
    return (b * glm::dot(ray, w) - glm::dot(axis, w)) / denominator;
}

} // namespace

std::optional<JointRings::Shape> JointRings::shape(const ViewportInput& input) const {
    const Document& document = input.context.document();
    const int joint = document.view.selectedJoint;
    if (!input.frame || !input.frame->avatar || joint < 0) return std::nullopt;
    if (static_cast<std::size_t>(joint) >= input.frame->jointWorld.size()) return std::nullopt;
    const Skeleton& skeleton = input.frame->avatar->evaluator->rig().skeleton;
    if (joint >= skeleton.jointCount()) return std::nullopt;
    const glm::dmat4 world(input.frame->jointWorld[static_cast<std::size_t>(joint)]);
    Shape result;
    result.center = glm::dvec3(world[3]);
    const double depth = input.view.depthOf(result.center);
    if (!(depth > 0.05)) return std::nullopt;
    for (int axis = 0; axis < 3; ++axis) {
        result.axes[static_cast<std::size_t>(axis)] = glm::normalize(glm::dvec3(world[axis]));
    }
    result.axes[3] = glm::normalize(input.view.camera.centerWorld() - result.center);
    result.radiusM = static_cast<double>(kRadiusPixels * input.scale) * input.view.metresPerPixel(depth);
    result.root = skeleton.parents[static_cast<std::size_t>(joint)] < 0;
    return result;
}

int JointRings::handleAt(const ViewportInput& input, const Shape& shape) const {
    int best = -1;
    float least = kNearPixels * input.scale;
    const glm::dvec3 eye = input.view.camera.centerWorld();
    if (shape.root) {
        for (int arrow = 0; arrow < 3; ++arrow) {
            glm::dvec3 axis(0.0);
            axis[arrow] = 1.0;
            const auto a = input.view.toScreen(shape.center + 0.35 * shape.radiusM * axis);
            const auto b = input.view.toScreen(shape.center + static_cast<double>(kArrowFactor) * shape.radiusM * axis);
            if (!a || !b) continue;
            const float distance = distanceToSegment(input.mouse, *a, *b);
            if (distance < least) {
                least = distance;
                best = kMoveX + arrow;
            }
        }
        if (best >= 0) return best;
    }
    for (int ring = 0; ring < 4; ++ring) {
        glm::dvec3 u, v;
        planeOf(shape.axes[static_cast<std::size_t>(ring)], u, v);
        const double radius = shape.radiusM * (ring == kSight ? static_cast<double>(kSightFactor) : 1.0);
        std::optional<ImVec2> before;
        for (int i = 0; i <= kSegments; ++i) {
            const double t = 2.0 * std::numbers::pi * i / kSegments;
            const glm::dvec3 p = shape.center + radius * (std::cos(t) * u + std::sin(t) * v);
            // The far half of a ring lies behind the joint: it is not what a person means to take.
            const bool far = ring != kSight && glm::dot(p - shape.center, eye - shape.center) <
                                                   -0.05 * radius * glm::length(eye - shape.center);
            const auto at = far ? std::nullopt : input.view.toScreen(p);
            if (at && before) {
                const float distance = distanceToSegment(input.mouse, *before, *at);
                if (distance < least) {
                    least = distance;
                    best = ring;
                }
            }
            before = at;
        }
    }
    return best;
}

void JointRings::begin(const ViewportInput& input) {
    const auto now = shape(input);
    if (!now || hot_ < 0) return;
    start_ = *now;
    held_ = hot_;
    angle_ = sent_ = 0.0;
    if (held_ < kMoveX) {
        lastAngle_ = angleOf(input, start_.center, start_.axes[static_cast<std::size_t>(held_)], start_.radiusM);
    } else {
        glm::dvec3 axis(0.0);
        axis[held_ - kMoveX] = 1.0;
        along_ = alongAxis(input, start_.center, axis);
    }
    gesture_.begin(input.context.session, held_ < kMoveX ? "turn" : "move");
}

void JointRings::cancel(Session& session) {
    gesture_.cancel(session);
    held_ = -1;
}

void JointRings::turn(const ViewportInput& input) {
    const glm::dvec3& axis = start_.axes[static_cast<std::size_t>(held_)];
    const double at = angleOf(input, start_.center, axis, start_.radiusM);
    angle_ += std::remainder(at - lastAngle_, 2.0 * std::numbers::pi);
    lastAngle_ = at;
    double wanted = angle_;
    if (ImGui::GetIO().KeyCtrl) wanted = std::round(angle_ * kDeg / kSnapDeg) * kSnapDeg / kDeg;
    const double step = (wanted - sent_) * kDeg;
    if (std::abs(step) < 1e-4) return;
    sent_ = wanted;
    const Skeleton& skeleton = input.frame->avatar->evaluator->rig().skeleton;
    const int joint = input.context.document().view.selectedJoint;
    gesture_.run(input.context, "pose.turn_joint",
                 {{"joint", skeleton.names[static_cast<std::size_t>(joint)]},
                  {"x", step * axis.x},
                  {"y", step * axis.y},
                  {"z", step * axis.z}});
}

void JointRings::drag(const ViewportInput& input) {
    const ImVec2 delta = ImGui::GetIO().MouseDelta;
    if (delta.x != 0.0f || delta.y != 0.0f) {
        if (held_ < kMoveX) {
            turn(input);
        } else {
            glm::dvec3 axis(0.0);
            axis[held_ - kMoveX] = 1.0;
            const glm::dvec3 target = start_.center + (alongAxis(input, start_.center, axis) - along_) * axis;
            const Skeleton& skeleton = input.frame->avatar->evaluator->rig().skeleton;
            const int joint = input.context.document().view.selectedJoint;
            gesture_.run(input.context, "pose.drag_joint",
                         {{"joint", skeleton.names[static_cast<std::size_t>(joint)]},
                          {"x", target.x},
                          {"y", target.y},
                          {"z", target.z}});
        }
    }
    if (ImGui::IsMouseDown(ImGuiMouseButton_Left)) return;
    gesture_.end(input.context.session);
    held_ = -1;
}

void JointRings::update(const ViewportInput& input, bool allowed) {
    const auto now = shape(input);
    if (!now) {
        if (held_ >= 0) gesture_.end(input.context.session);
        hot_ = held_ = -1;
        return;
    }
    if (held_ >= 0) drag(input);
    hot_ = held_ >= 0 ? held_ : allowed && input.hovered ? handleAt(input, *now) : -1;
    draw(input, *now);
}

void JointRings::drawRing(const ViewportInput& input, const Shape& shape, int ring) const {
    ImDrawList* list = ImGui::GetWindowDrawList();
    const bool marked = hot_ == ring;
    const bool faded = held_ >= 0 && held_ != ring;
    const double radius = shape.radiusM * (ring == kSight ? static_cast<double>(kSightFactor) : 1.0);
    const glm::dvec3& axis =
        held_ == ring ? start_.axes[static_cast<std::size_t>(ring)] : shape.axes[static_cast<std::size_t>(ring)];
    glm::dvec3 u, v;
    planeOf(axis, u, v);
    const glm::dvec3 towards = shape.axes[3];
    const float width = (marked ? 3.2f : ring == kSight ? 1.2f : 2.0f) * input.scale;
    std::optional<ImVec2> before;
    for (int i = 0; i <= kSegments; ++i) {
        const double t = 2.0 * std::numbers::pi * i / kSegments;
        const glm::dvec3 d = std::cos(t) * u + std::sin(t) * v;
        const auto at = input.view.toScreen(shape.center + radius * d);
        const bool far = ring != kSight && glm::dot(d, towards) < -0.05;
        const float alpha = (faded ? 0.15f : 1.0f) * (far ? 0.22f : ring == kSight && !marked ? 0.45f : 0.95f);
        if (at && before) list->AddLine(*before, *at, withAlpha(kColors[ring], alpha), width);
        before = at;
    }
}

void JointRings::drawArrow(const ViewportInput& input, const Shape& shape, int arrow) const {
    glm::dvec3 axis(0.0);
    axis[arrow] = 1.0;
    const auto a = input.view.toScreen(shape.center + 0.35 * shape.radiusM * axis);
    const auto b = input.view.toScreen(shape.center + static_cast<double>(kArrowFactor) * shape.radiusM * axis);
    if (!a || !b) return;
    const ImVec2 d(b->x - a->x, b->y - a->y);
    const float length = std::hypot(d.x, d.y);
    if (length < 6.0f) return; // towards the eye: nothing to take hold of
    const bool marked = hot_ == kMoveX + arrow;
    const float alpha = held_ >= 0 && held_ != kMoveX + arrow ? 0.15f : marked ? 1.0f : 0.85f;
    const ImU32 color = withAlpha(kColors[arrow], alpha);
    ImDrawList* list = ImGui::GetWindowDrawList();
    const float head = 11.0f * input.scale;
    const ImVec2 e(d.x / length, d.y / length), n(-e.y, e.x);
    const ImVec2 neck(b->x - head * e.x, b->y - head * e.y);
    list->AddLine(*a, neck, color, (marked ? 3.2f : 2.0f) * input.scale);
    list->AddTriangleFilled(*b, ImVec2(neck.x + 0.42f * head * n.x, neck.y + 0.42f * head * n.y),
                            ImVec2(neck.x - 0.42f * head * n.x, neck.y - 0.42f * head * n.y), color);
}

void JointRings::draw(const ViewportInput& input, const Shape& shape) const {
    for (int ring = 3; ring >= 0; --ring) drawRing(input, shape, ring);
    if (shape.root) {
        for (int arrow = 0; arrow < 3; ++arrow) drawArrow(input, shape, arrow);
    }
    ImDrawList* list = ImGui::GetWindowDrawList();
    const auto center = input.view.toScreen(shape.center);
    if (center) list->AddCircleFilled(*center, 3.0f * input.scale, IM_COL32(240, 240, 240, 230));
    if (held_ < 0 || !center) return;
    std::string text = fmt::format("{:+.1f}\xc2\xb0", sent_ * kDeg);
    if (held_ >= kMoveX) {
        text = fmt::format("{} {:+.3f} m", "xyz"[held_ - kMoveX],
                           shape.center[held_ - kMoveX] - start_.center[held_ - kMoveX]);
    }
    const float below = kRadiusPixels * kArrowFactor * input.scale;
    drawPlate(list, ImVec2(center->x, center->y + below), ImVec2(0.5f, 0.0f), text.c_str(), Ink::Text, input.scale);
}

} // namespace ars::ui
