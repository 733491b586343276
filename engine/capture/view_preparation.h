#pragma once

#include "engine/capture/calibration.h"
#include "engine/capture/capture.h"
#include "engine/io/image.h"

namespace ars {

/// A rectangle of pixels: columns [x, x + width), rows [y, y + height).
struct PixelBox {
    int x = 0, y = 0, width = 0, height = 0;
    bool operator==(const PixelBox&) const = default;
};

/// Smallest box of all pixels above the threshold (0 to 255; alpha in [0, 1]); empty (width 0) where there is none.
PixelBox maskBounds(const Image& mask, int threshold);

/// The box of a picture that is `scale` times smaller, with `margin` pixels around it, inside that picture. Every pixel
/// of `box` lies in it. The whole picture for an empty box or a negative margin.
PixelBox cropBox(const PixelBox& box, int width, int height, int scale, int margin);

/// Averages of scale x scale pixels, each channel for itself; the last column and row average what there is of them.
/// Sizes are rounded up, so that nothing is lost.
Image areaAveraged(const Image& image, int scale);

/// The camera of areaAveraged: a smaller picture, everything in pixels divided by the scale.
Camera scaledCamera(const Camera& camera, int scale);

/// A part of a picture, and its camera: the principal point moves by exactly the box's corner.
Image cropped(const Image& image, const PixelBox& box);
Camera croppedCamera(const Camera& camera, const PixelBox& box);

/// Boundary band (avatar reference 4): with P the pixels above the threshold, dilate(P) xor erode(P) by a square of
/// 2 halfWidth + 1 pixels, and every soft pixel 5 < alpha < 250 (of 255). The picture's edge neither dilates nor
/// erodes. 1 inside the band, else 0. `box` says for which part of the picture it is computed.
Image boundaryBand(const Image& mask, const PixelBox& box, int threshold, int halfWidth);

/// The rest of readView after the files: undistorts, scales, finds band and crop.
/// @param color 3 channels, Srgb, of the camera's size   @param mask 1 channel, alpha, of the same size
/// Pixels that the distorted picture does not have, and the incomplete last column and row of a scaled picture, are in
/// the band. Errors are those of lensDistortion.
Result<CapturedView> prepareView(ViewId id, const CalibratedCamera& camera, Image color, Image mask,
                                 const ViewOptions& options);

} // namespace ars
