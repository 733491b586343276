#pragma once

#include "ui/look/buffer_pictures.h"
#include "ui/look/controls.h"

#include <cstdint>

namespace ars::ui {

/// How the shown buffer is shown: its histogram with the range as two lines to drag, range numbers, colour map, and
/// what the buffer means.
class BufferRange {
public:
    void draw(StudioContext& context);

private:
    void follow(const Document& document, const std::shared_ptr<const Frame>& frame);
    void drawHistogram(StudioContext& context);
    void drawRange(StudioContext& context);

    BufferHistogram histogram_;
    BufferId buffer_ = BufferId::Beauty; ///< of the histogram
    std::uint64_t request_ = 0;
    FrameQuality quality_ = FrameQuality::Draft;
    std::pair<float, float> around_{0.0f, 0.0f};
    double time_ = -1.0; ///< of the last count
};

} // namespace ars::ui
