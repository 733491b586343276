#pragma once

#include "ui/viewport/view.h"

namespace ars::ui {

/// Moves the camera, and turns the light: left drag orbits, middle drag pans, right drag looks around and flies with
/// W A S D Q E, the wheel goes towards the cursor, a left drag with L held turns the light. A double click looks at
/// what lies under the cursor.
class Navigation {
public:
    bool dragging() const { return drag_ != Drag::None; }
    /// True where a press here would turn the light.
    static bool turnsLight();

    void beginOrbit(const ViewportInput& input);
    void beginLight(const ViewportInput& input);
    /// Middle and right button, wheel, keys, and the drag that runs. Call in every frame.
    /// @param focus  point under the cursor, or null: what a double click looks at
    void update(const ViewportInput& input, const glm::dvec3* focus);
    void lookAt(const ViewportInput& input, const glm::dvec3* focus);
    void cancel(Session& session);
    /// "light 40 deg" while the light is turned, else "".
    std::string caption(const StudioContext& context) const;

private:
    enum class Drag { None, Orbit, Pan, Look, Light };
    void begin(const ViewportInput& input, Drag drag, ImGuiMouseButton button, const char* name);
    void move(const ViewportInput& input);
    void fly(const ViewportInput& input);
    void wheel(const ViewportInput& input, const glm::dvec3* focus);

    Drag drag_ = Drag::None;
    ImGuiMouseButton button_ = ImGuiMouseButton_Left;
    Gesture gesture_, wheelGesture_;
    double wheelTime_ = 0.0;
    float lightDeg_ = 0.0f;
};

} // namespace ars::ui
