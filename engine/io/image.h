#pragma once

#include "engine/core/error.h"
#include "engine/core/limits.h"

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace ars {

/// How the stored numbers relate to light.
enum class ColorSpace {
    Linear, ///< Rec.709 primaries, proportional to light
    Srgb,   ///< Rec.709 primaries, encoded with the piecewise sRGB transfer function
    Data,   ///< not colour: masks, depth, normals, roughness
};
std::string_view colorSpaceName(ColorSpace space);

/// A float image, row-major, interleaved, row 0 on top. 8- and 16-bit files are scaled to [0,1]; values stay encoded as
/// the colour space says.
struct Image {
    int width = 0;
    int height = 0;
    int channels = 0; ///< 1 Y, 2 YA, 3 RGB (XYZ for vectors), 4 RGBA (straight alpha unless premultiplied is set)
    ColorSpace space = ColorSpace::Linear;
    bool premultiplied = false;
    int sourceBits = 32; ///< what the numbers came from: 8 or 16 for integer files, 16 for half, 32 for float
    std::vector<float> pixels;

    bool hasAlpha() const { return channels == 2 || channels == 4; }
    float& at(int row, int column, int channel) {
        return pixels[(static_cast<std::size_t>(row) * width + column) * channels + channel];
    }
    float at(int row, int column, int channel) const {
        return pixels[(static_cast<std::size_t>(row) * width + column) * channels + channel];
    }
};

/// The number of floats of an image of this size, checked before memory is taken: BadFile where a side is zero or
/// negative, LimitExceeded where a side exceeds maxImageSide or the floats exceed maxBytes.
Result<std::size_t> imageValueCount(std::int64_t width, std::int64_t height, std::int64_t channels,
                                    const ReadLimits& limits);

/// A writer's first question: sides and channels positive, channels <= 4, pixels.size() as they say. InvalidArgument.
Status checkImage(const Image& image);

/// Piecewise sRGB transfer function (IEC 61966-2-1); values outside [0,1] go through odd-symmetrically unclamped.
float linearToSrgb(float linear);
float srgbToLinear(float encoded);

/// The same picture with its numbers in `space`; alpha is never encoded, and premultiplied colours are divided by it
/// before and multiplied after. Data can be neither source nor target (unless both are): InvalidArgument.
Result<Image> convertColorSpace(Image image, ColorSpace space);

/// The same picture with straight alpha (colours divided by it, 0 where it is 0) or premultiplied alpha. Images without
/// alpha come back as they are. The division happens in the space that the image is in.
Image straightAlpha(Image image);
Image premultipliedAlpha(Image image);

} // namespace ars
