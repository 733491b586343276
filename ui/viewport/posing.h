#pragma once

#include "engine/gl/presenter.h"
#include "ui/viewport/picking.h"
#include "ui/viewport/view.h"

#include <memory>
#include <optional>
#include <vector>

namespace ars::ui {

/// Dragging limbs in the picture. What lies under the cursor lights up and says its name; pressing and moving drags the
/// far end of that segment in the plane through the grabbed point that is parallel to the screen; a click alone selects
/// the joint, which gets its rings.
class LimbDragging {
public:
    bool dragging() const { return held_ && moved_; }
    bool held() const { return held_; }

    /// What is under the cursor, once per frame; nothing while something else is dragged.
    void hover(const ViewportInput& input, bool allowed);
    const std::optional<BodyHit>& hit() const { return hit_; }
    /// The body is under the cursor: a press would take hold of it.
    bool ready() const { return hit_.has_value(); }

    void begin(const ViewportInput& input);
    void update(const ViewportInput& input);
    void cancel(Session& session);
    void drawName(const ViewportInput& input) const;
    void drawDrag(const ViewportInput& input) const;

    /// Dots of the skin that would be dragged, to be marked in the picture; null where none is.
    std::shared_ptr<const std::vector<OverlayLine>> marks() const { return marks_; }

private:
    void makeMarks(const ViewportInput& input, int dragged);

    std::optional<BodyHit> hit_;
    std::shared_ptr<const Frame> hitFrame_;
    ImVec2 hitAt_{-1.0f, -1.0f};
    std::shared_ptr<const std::vector<OverlayLine>> marks_;
    const void* marksMeans_ = nullptr;
    int marksJoint_ = -1;

    bool held_ = false, moved_ = false;
    BodyHit grabbed_;
    int joint_ = -1;         ///< that is dragged
    glm::dvec3 offset_{0.0}; ///< joint minus grabbed point
    ImVec2 pressedAt_;
    Gesture gesture_;
};

} // namespace ars::ui
