#pragma once

#include "engine/scene/evaluate.h"
#include "ui/viewport/painter.h"
#include "ui/viewport/view.h"

#include <memory>
#include <optional>
#include <string>

namespace ars::ui {

/// How the view shows a buffer: range, colour map, exposure, curve, background, backdrop.
PresentSettings presentSettings(const Document& document, BufferId buffer, double timeS);

/// The other side of a comparison, ready to be painted.
struct OtherSide {
    std::shared_ptr<const Frame> frame; ///< that it comes from; null for files
    TileContent content;                ///< without overlays
    BufferId buffer = BufferId::Beauty; ///< that decides how it is shown
    std::string label;
    std::string missing; ///< why there is nothing to show; empty when there is
};

/// Numbers of a comparison, computed beside the window.
struct ComparisonNumbers {
    struct Row {
        std::optional<double> psnr, ssim, flip;
    };
    Row whole, mask;                      ///< mask: where the avatar covers at least half a pixel
    std::shared_ptr<const Image> flipMap; ///< one channel
    std::string problem;                  ///< why there are none; empty when there are
};

/// Finds the other side, and measures how far it is from this one.
class Comparison {
public:
    /// @param width, height  of the picture on the screen, pixels: where files are fitted into
    OtherSide otherSide(StudioContext& context, const std::shared_ptr<const Frame>& frame, int width, int height);
    /// Numbers of the last pair that was measured; a new pair is measured beside, when `frame` is full. Null before the
    /// first.
    const ComparisonNumbers* numbers(StudioContext& context, const std::shared_ptr<const Frame>& frame,
                                     const OtherSide& other);
    bool measuring() const { return measuring_ != nullptr; }

private:
    struct Fitted; ///< a file's picture in the picture's frame
    struct Measured;
    void fitFile(StudioContext& context, int width, int height, OtherSide& side);

    std::shared_ptr<Fitted> fitted_, fitting_;
    std::shared_ptr<Measured> measured_, measuring_;
    std::shared_ptr<int> alive_ = std::make_shared<int>(0); ///< work beside may end after this has
};

/// A picture fitted into a rectangle of a frame by area, transparent outside: RGBA, straight alpha, in its own colour
/// space.
Image fittedPicture(const Image& picture, const PixelRect& rect, int width, int height);

} // namespace ars::ui
