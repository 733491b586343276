#pragma once

#include "engine/core/error.h"
#include "engine/core/limits.h"
#include "engine/io/image.h"

#include <cstddef>
#include <filesystem>
#include <span>
#include <vector>

namespace ars {

struct JpegReadOptions {
    /// Turn the picture upright as its EXIF orientation says, as viewers and OpenCV do. Calibrated captures must agree
    /// with whoever calibrated them: tools that ignore EXIF need false.
    bool applyOrientation = true;
};

/// A JPEG picture and what the file says about it.
struct JpegFile {
    Image image; ///< 1 (gray) or 3 channels (RGB; CMYK and YCCK are converted without a profile), Srgb, 8 bits
    int fileComponents = 3; ///< 1, 3 or 4
    bool progressive = false;
    int exifOrientation = 1; ///< 1..8 as stored; already applied unless the options say otherwise
};

/// Baseline and progressive JPEG. BadFile: broken or truncated (the decoder's padding of missing data is an error
/// here). Unsupported: 12 bits, lossless. LimitExceeded before memory is taken, also for more than 500 scans.
Result<JpegFile> parseJpeg(std::span<const std::byte> bytes, const JpegReadOptions& options = {},
                           const ReadLimits& limits = defaultReadLimits());
Result<JpegFile> readJpeg(const std::filesystem::path& path, const JpegReadOptions& options = {},
                          const ReadLimits& limits = defaultReadLimits());

/// Baseline, colour at full resolution (4:4:4). Linear images are converted to sRGB, Data is written as it is; values
/// are clamped to [0,1] and rounded. Alpha is dropped (premultiplied colours stay premultiplied: over black).
/// @param quality 1..100
/// InvalidArgument: NaN, a quality or size (65,500) that JPEG does not have.
Result<std::vector<std::byte>> encodeJpeg(const Image& image, int quality = 95);
Status writeJpeg(const std::filesystem::path& path, const Image& image, int quality = 95);

} // namespace ars
