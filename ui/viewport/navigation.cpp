#include "ui/viewport/navigation.h"

#include "engine/scene/evaluate.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace ars::ui {

namespace {

constexpr double kOrbitDegPerPixel = 0.4;
constexpr double kLookDegPerPixel = 0.15;
constexpr double kLightDegPerPixel = 0.5;
constexpr double kWheelFactor = 0.88; ///< distance after one notch over that before
constexpr double kWheelPauseS = 0.35; ///< notches closer than this are one undo entry
constexpr double kFocusShare = 0.6;   ///< of the distance, after a double click
constexpr double kNearestFocusM = 0.5;

double targetDistance(const ViewportInput& input) {
    const SceneCamera camera = cameraAt(input.context.document(), input.context.session.timeS());
    return std::max(glm::length(camera.target - camera.eye), 1e-3);
}

bool keysAreFree() { return !ImGui::GetIO().WantTextInput; }

} // namespace

bool Navigation::turnsLight() { return keysAreFree() && ImGui::IsKeyDown(ImGuiKey_L); }

void Navigation::begin(const ViewportInput& input, Drag drag, ImGuiMouseButton button, const char* name) {
    wheelGesture_.end(input.context.session);
    gesture_.begin(input.context.session, name);
    drag_ = drag;
    button_ = button;
}

void Navigation::beginOrbit(const ViewportInput& input) { begin(input, Drag::Orbit, ImGuiMouseButton_Left, "orbit"); }

void Navigation::beginLight(const ViewportInput& input) {
    begin(input, Drag::Light, ImGuiMouseButton_Left, "light");
    const Document& document = input.context.document();
    lightDeg_ = placementAt(document, input.context.session.timeS()).rotationDeg;
}

void Navigation::cancel(Session& session) {
    gesture_.cancel(session);
    drag_ = Drag::None;
}

void Navigation::update(const ViewportInput& input, const glm::dvec3* focus) {
    Session& session = input.context.session;
    if (drag_ == Drag::None && input.hovered) {
        if (ImGui::IsMouseClicked(ImGuiMouseButton_Middle)) begin(input, Drag::Pan, ImGuiMouseButton_Middle, "pan");
        if (ImGui::IsMouseClicked(ImGuiMouseButton_Right)) begin(input, Drag::Look, ImGuiMouseButton_Right, "look");
    }
    if (drag_ != Drag::None) {
        move(input);
        if (drag_ == Drag::Look) fly(input);
        if (!ImGui::IsMouseDown(button_)) {
            gesture_.end(session);
            drag_ = Drag::None;
        }
    }
    wheel(input, focus);
}

void Navigation::move(const ViewportInput& input) {
    const ImVec2 delta = ImGui::GetIO().MouseDelta;
    if (delta.x == 0.0f && delta.y == 0.0f) return;
    const double dx = delta.x / input.scale, dy = delta.y / input.scale;
    const double speed = input.context.settings.orbitSpeed;
    if (drag_ == Drag::Orbit) {
        gesture_.run(input.context, "camera.orbit",
                     {{"yaw", -dx * kOrbitDegPerPixel * speed}, {"pitch", dy * kOrbitDegPerPixel * speed}});
    } else if (drag_ == Drag::Look) {
        gesture_.run(input.context, "camera.look",
                     {{"yaw", dx * kLookDegPerPixel * speed}, {"pitch", -dy * kLookDegPerPixel * speed}});
    } else if (drag_ == Drag::Pan) {
        const double metres = input.view.metresPerPixel(targetDistance(input));
        gesture_.run(input.context, "camera.pan", {{"x", -delta.x * metres}, {"y", delta.y * metres}});
    } else if (drag_ == Drag::Light) {
        lightDeg_ += static_cast<float>(dx * kLightDegPerPixel);
        if (std::abs(lightDeg_) > 360.0f) lightDeg_ -= std::copysign(360.0f, lightDeg_);
        gesture_.run(input.context, "light.rotate", {{"degrees", lightDeg_}});
    }
}

void Navigation::fly(const ViewportInput& input) {
    if (!keysAreFree()) return;
    auto axis = [](ImGuiKey more, ImGuiKey less) {
        return (ImGui::IsKeyDown(more) ? 1.0 : 0.0) - (ImGui::IsKeyDown(less) ? 1.0 : 0.0);
    };
    const glm::dvec3 way(axis(ImGuiKey_D, ImGuiKey_A), axis(ImGuiKey_E, ImGuiKey_Q), axis(ImGuiKey_W, ImGuiKey_S));
    if (way == glm::dvec3(0.0)) return;
    // A stalled frame must not throw the eye across the room.
    const double seconds = std::min(static_cast<double>(ImGui::GetIO().DeltaTime), 0.1);
    const double metres = seconds * input.context.settings.flySpeed * (ImGui::GetIO().KeyShift ? 3.0 : 1.0);
    gesture_.run(input.context, "camera.fly",
                 {{"right", way.x * metres}, {"up", way.y * metres}, {"forward", way.z * metres}});
}

/// Towards the cursor: what lies under it, in the plane of the target, stays under it.
void Navigation::wheel(const ViewportInput& input, const glm::dvec3* focus) {
    Session& session = input.context.session;
    const ImGuiIO& io = ImGui::GetIO();
    const double now = ImGui::GetTime();
    if (wheelGesture_.active() && now - wheelTime_ > kWheelPauseS) wheelGesture_.end(session);
    if (!input.hovered || io.MouseWheel == 0.0f || io.KeyCtrl || drag_ != Drag::None) return;
    if (!wheelGesture_.active()) wheelGesture_.begin(session, "wheel");
    wheelTime_ = now;
    const double notches = input.context.settings.invertZoom ? -io.MouseWheel : io.MouseWheel;
    const double factor = std::pow(kWheelFactor, notches);
    const double distance = targetDistance(input);
    const PictureView& view = input.view;
    const double depth = focus ? view.depthOf(*focus) : distance;
    const double x = (input.mouse.x - view.origin.x - view.camera.cx) / view.camera.fx;
    const double y = (input.mouse.y - view.origin.y - view.camera.cy) / view.camera.fy;
    // The eye moves by (1 - factor) distance along its axis; sideways as much as the point under the cursor asks for.
    const double forward = std::min((1.0 - factor) * distance, 0.9 * depth);
    wheelGesture_.run(input.context, "camera.dolly", {{"factor", 1.0 - forward / distance}});
    wheelGesture_.run(input.context, "camera.pan", {{"x", forward * x}, {"y", -forward * y}});
}

void Navigation::lookAt(const ViewportInput& input, const glm::dvec3* focus) {
    gesture_.end(input.context.session);
    drag_ = Drag::None;
    if (!focus) {
        gesture_.run(input.context, "camera.focus", Arguments::object());
        return;
    }
    const SceneCamera camera = cameraAt(input.context.document(), input.context.session.timeS());
    const glm::dvec3 away = camera.eye - camera.target;
    const double distance = std::max(glm::length(away), 1e-6);
    const double wanted = std::max(std::min(kFocusShare * distance, distance), std::min(kNearestFocusM, distance));
    const glm::dvec3 eye = *focus + away * (wanted / distance);
    gesture_.run(input.context, "camera.set",
                 {{"eye_x", eye.x},
                  {"eye_y", eye.y},
                  {"eye_z", eye.z},
                  {"target_x", focus->x},
                  {"target_y", focus->y},
                  {"target_z", focus->z}});
}

std::string Navigation::caption(const StudioContext& context) const {
    if (drag_ != Drag::Light) return {};
    return fmt::format("Light {:.0f}\xc2\xb0", placementAt(context.document(), context.session.timeS()).rotationDeg);
}

} // namespace ars::ui
