#pragma once

#include "engine/frame/color_map.h"
#include "ui/viewport/view.h"

#include <string>

namespace ars::ui {

/// The bar of a data buffer at the right edge of the picture: colours, range and unit. Its ends are dragged to change
/// the range (view.range), a right click brings back the buffer's own.
class Legend {
public:
    bool dragging() const { return gesture_.active(); }
    /// Draws it where the buffer has one; its widgets lie over the picture, so call it after the picture's own.
    void draw(const ViewportInput& input, BufferId buffer);
    void cancel(Session& session) { gesture_.cancel(session); }

private:
    void end(const ViewportInput& input, BufferId buffer, bool maximum, const ImVec2& low, const ImVec2& high);
    Gesture gesture_;
    float startMinimum_ = 0.0f, startMaximum_ = 0.0f, startY_ = 0.0f;
};

/// A bar without widgets, for error maps: from `minimum` at the bottom to `maximum` at the top.
void drawColorBar(const PictureView& view, float scale, ColorMap map, const std::string& minimum,
                  const std::string& maximum, const std::string& title);

} // namespace ars::ui
