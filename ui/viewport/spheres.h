#pragma once

#include "engine/rig/body_parts.h"
#include "ui/viewport/view.h"

namespace ars::ui {

/// Spheres of the occlusion radius at the joints of the nine parts: those of the selected part strong, the others
/// faint. Dragging a rim sets the part's radius; its label says it in metres and what it was at first.
class RadiusSpheres {
public:
    bool dragging() const { return held_ >= 0; }
    void update(const ViewportInput& input, bool allowed);
    bool ready() const { return hot_ >= 0; }
    void begin(const ViewportInput& input);
    void cancel(Session& session);

private:
    struct Rim {
        BodyPart part = BodyPart::Torso;
        ImVec2 center;
        float pixels = 0.0f; ///< radius of the outline
        double depthM = 0.0;
    };
    std::vector<Rim> rims(const ViewportInput& input) const;
    void drag(const ViewportInput& input);
    void draw(const ViewportInput& input, const std::vector<Rim>& rims) const;

    int hot_ = -1, held_ = -1; ///< index among the rims
    Rim grabbed_;
    double grabbedOffset_ = 0.0; ///< pixels between cursor and rim at the press
    Gesture gesture_;
};

} // namespace ars::ui
