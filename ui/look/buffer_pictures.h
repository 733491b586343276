#pragma once

#include "engine/frame/display.h"
#include "engine/gl/texture.h"
#include "engine/scene/document.h"
#include "engine/scene/frame_worker.h"

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

namespace ars::ui {

/// Range, colour map, exposure and curve with which a document shows a buffer.
DisplaySettings displaySettings(const Document& document, BufferId buffer);
/// The range in use: the document's, else the catalogue's.
std::pair<float, float> shownRange(const Document& document, BufferId buffer);

/// A part of a picture, pixels.
struct PixelBox {
    int left = 0, top = 0, width = 0, height = 0;

    bool operator==(const PixelBox&) const = default;
};
/// What a tiny picture of a body shows best: as wide as what is covered, from its top, 4:3. The whole picture where
/// nothing is covered.
PixelBox portraitBox(const Image& opacity);

/// Every n-th pixel of a picture, so that no more than width x height are left; n is the same for rows and columns.
Image thinnedPicture(const Image& picture, int width, int height);
/// The same of a part, which is cut to what lies inside.
Image thinnedPicture(const Image& picture, const PixelBox& box, int width, int height);

/// How often a buffer's values occur where something is covered.
struct BufferHistogram {
    float low = 0.0f;  ///< of the first bin
    float high = 1.0f; ///< of the last bin's end
    int channels = 0;
    std::array<std::vector<float>, 3> shares;      ///< of the covered pixels, per channel and bin; alpha is left out
    std::size_t counted = 0;                       ///< pixels
    float percentile1 = 0.0f, percentile99 = 1.0f; ///< over all channels
};
/// @param around  the axis covers at least this
/// @param opacity of the picture's size; pixels below kMinOpacity and values that are not finite do not count
BufferHistogram histogramOf(const Image& picture, const Image& opacity, std::pair<float, float> around, int bins);

/// Tiny live pictures of the buffers that a frame has, refreshed one by one so that no window frame is long. Needs the
/// OpenGL context.
class BufferThumbnails {
public:
    /// Brings at most one buffer up to date.
    void update(const Document& document, const std::shared_ptr<const Frame>& frame);
    /// Null where the frame does not have the buffer.
    const Texture* find(BufferId buffer) const;

private:
    struct Slot {
        Texture texture;
        std::uint64_t request = 0;
        FrameQuality quality = FrameQuality::Draft;
        std::optional<BufferDisplay> display; ///< that it was made with
        ToneParams tone;
        bool present = false;
    };
    std::array<Slot, kBufferCount> slots_;
    int next_ = 0;
    double lastTime_ = -1.0;
};

} // namespace ars::ui
