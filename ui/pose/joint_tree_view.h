#pragma once

#include "ui/panel.h"
#include "ui/pose/joint_list.h"

#include <string>
#include <vector>

namespace ars::ui {

/// What the pose panel reads anew for every frame of the window.
struct PoseReading {
    const Skeleton* skeleton = nullptr; ///< of the avatar, or that of SMPL-X while none is loaded
    Pose pose;                          ///< on the screen: clip and keys included
    int selected = -1;                  ///< joint, -1: none

    const std::string& name(int joint) const { return skeleton->names[static_cast<std::size_t>(joint)]; }
    /// Relative to the parent; the identity where the pose has none.
    glm::quat rotation(int joint) const;
    bool changed(int joint) const; ///< turned away from the rest pose
};
PoseReading readPose(const StudioContext& context);

/// The joints as a tree with a search box.
class JointTreeView {
public:
    /// @param height  of the list, pixels
    void draw(StudioContext& context, const PoseReading& reading, float height);

private:
    void drawGroup(StudioContext& context, const PoseReading& reading, JointGroup group);
    void drawJoint(StudioContext& context, const PoseReading& reading, int joint);
    void drawFound(StudioContext& context, const PoseReading& reading);
    void drawRowMarks(const StudioContext& context, const PoseReading& reading, int joint);
    void actOnRow(StudioContext& context, const PoseReading& reading, int joint);
    bool isAbove(const PoseReading& reading, int joint) const;

    std::vector<std::string> names_; ///< that tree_ was made of
    JointTree tree_;
    std::string search_;
    int shown_ = -1;      ///< the selected joint that was last scrolled to
    bool reveal_ = false; ///< the selection came from elsewhere: open what it lies in
};

} // namespace ars::ui
