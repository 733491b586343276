#pragma once

#include "ui/viewport/view.h"

#include <array>

namespace ars::ui {

/// Rotation rings at the selected joint: three about its own axes and one about the line of sight, turned with the
/// mouse (Ctrl: steps of 5 degrees). The root has arrows, too, that move the body. Sizes are the same on the screen at
/// any distance.
class JointRings {
public:
    bool dragging() const { return held_ >= 0; }
    /// Works out what is under the cursor and draws; nothing where no joint is selected.
    /// @param allowed  false while something else is dragged
    void update(const ViewportInput& input, bool allowed);
    /// A handle is under the cursor: a press would take it.
    bool ready() const { return hot_ >= 0; }
    void begin(const ViewportInput& input);
    void cancel(Session& session);

private:
    enum Handle { kAxisX, kAxisY, kAxisZ, kSight, kMoveX, kMoveY, kMoveZ, kHandleCount };
    struct Shape {
        glm::dvec3 center{0.0};
        std::array<glm::dvec3, 4> axes; ///< world; the fourth is the line of sight
        double radiusM = 0.0;
        bool root = false;
    };
    std::optional<Shape> shape(const ViewportInput& input) const;
    int handleAt(const ViewportInput& input, const Shape& shape) const;
    void drag(const ViewportInput& input);
    void turn(const ViewportInput& input);
    void draw(const ViewportInput& input, const Shape& shape) const;
    void drawRing(const ViewportInput& input, const Shape& shape, int ring) const;
    void drawArrow(const ViewportInput& input, const Shape& shape, int arrow) const;

    int hot_ = -1, held_ = -1;
    Shape start_;          ///< when the drag began: axes stay while turning
    double angle_ = 0.0;   ///< radians turned by the mouse
    double sent_ = 0.0;    ///< of them, what the joint was told
    double lastAngle_ = 0; ///< of the mouse around the ring
    double along_ = 0.0;   ///< of an arrow: metres along it at the press
    Gesture gesture_;
};

} // namespace ars::ui
