#pragma once

#include "engine/core/error.h"
#include "engine/core/limits.h"
#include "engine/io/image.h"

#include <cstddef>
#include <filesystem>
#include <span>
#include <vector>

namespace ars {

/// Radiance pictures (.hdr, .pic): shared-exponent RGB, decoded as mantissa * 2^(exponent - 136).
///
/// Reads flat, old and new run-length encoding and all eight orientations (the image comes back upright). The header's
/// EXPOSURE and COLORCORR lines say by what pixels were multiplied, so they are divided by the product of all such
/// lines; the result is linear RGB, 3 channels.
/// BadFile: broken, truncated, EXPOSURE not a positive finite number, value beyond a float. Unsupported: XYZE pixels.
Result<Image> parseHdr(std::span<const std::byte> bytes, const ReadLimits& limits = defaultReadLimits());
Result<Image> readHdr(const std::filesystem::path& path, const ReadLimits& limits = defaultReadLimits());

/// Writes new run-length encoding, "-Y height +X width". Linear 1- or 3-channel images as they are, sRGB ones are
/// converted; alpha is dropped (premultiplied colours stay premultiplied). Negative numbers become 0: the format has
/// none. Each component is rounded to 1/256 or less of the pixel's largest. InvalidArgument: NaN, infinity,
/// above 1.6947657e38.
Result<std::vector<std::byte>> encodeHdr(const Image& image);
Status writeHdr(const std::filesystem::path& path, const Image& image);

} // namespace ars
