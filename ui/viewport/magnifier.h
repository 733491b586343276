#pragma once

#include "engine/frame/buffer_catalogue.h"
#include "ui/viewport/layout.h"
#include "ui/viewport/view.h"

namespace ars::ui {

/// Enlarges the finished picture up to 64 times with Ctrl and the wheel, as an image viewer does: its pixels become
/// squares, and where they have room they say their numbers. The camera stays.
class Magnifier {
public:
    static constexpr float kLargest = 64.0f;

    bool active() const { return zoom_ > 1.0f; }
    float zoom() const { return zoom_; }
    /// The part of the picture that is seen, as shares of its sides.
    ImVec2 low() const { return origin_; }
    ImVec2 high() const { return {origin_.x + 1.0f / zoom_, origin_.y + 1.0f / zoom_}; }
    /// The camera of the part that is seen.
    PictureView magnified(PictureView view) const;

    /// What lies at `place` in an area stays there.
    void zoomAt(const PictureArea& area, const ImVec2& place, float factor);
    void reset() { *this = {}; }
    /// Ctrl + wheel over the picture.
    void update(const ViewportInput& input, const PictureArea& area);
    /// Numbers of the shown buffer on its pixels, and a button that says the zoom and ends it.
    void draw(const ViewportInput& input, BufferId buffer);

private:
    void drawPixels(const ViewportInput& input, BufferId buffer) const;

    float zoom_ = 1.0f;
    ImVec2 origin_{0.0f, 0.0f};
};

} // namespace ars::ui
