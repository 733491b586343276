#pragma once

#include "ui/panel.h"
#include "ui/pose/joint_tree_view.h"

namespace ars::ui {

/// Numbers of the selected joint: rotation, range of motion, reset; of a root joint also where it is.
class JointEditor {
public:
    void draw(StudioContext& context, const PoseReading& reading);

private:
    void drawHeader(StudioContext& context, const PoseReading& reading, int joint);
    void drawRotation(StudioContext& context, const PoseReading& reading, int joint);
    void drawLimits(StudioContext& context, const PoseReading& reading, int joint);
    void drawRoot(StudioContext& context, const PoseReading& reading);

    // While a field is dragged its own numbers count: read back from the rotation, they would jump at 180 degrees and
    // where Euler angles meet.
    glm::vec3 dragged_{0.0f};
    int draggedJoint_ = -1;
};

} // namespace ars::ui
