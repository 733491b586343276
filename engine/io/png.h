#pragma once

#include "engine/core/error.h"
#include "engine/core/limits.h"
#include "engine/io/image.h"

#include <cstddef>
#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace ars {

/// A PNG picture and what the file says about it.
struct PngFile {
    /// 1 to 4 channels, straight alpha; palettes come as RGB or RGBA, transparent colours as alpha. Integers are
    /// divided by 255 (sourceBits 8, also for 1, 2 and 4 bits) or 65535 (sourceBits 16). The space is Srgb, or Linear
    /// where the file states a gamma of 1 and neither sRGB nor a profile; a mask or normal map is known as Data by the
    /// caller only.
    Image image;
    int bitDepth = 8; ///< bits per sample or palette index in the file: 1, 2, 4, 8, 16
    bool palette = false;
    bool interlaced = false;
    bool declaresSrgb = false;               ///< an sRGB chunk
    std::optional<double> gamma;             ///< gAMA, as file exponent: 0.45455 for the usual encoding
    std::string profileName;                 ///< of an iCCP chunk; the profile itself is not applied
    std::map<std::string, std::string> text; ///< tEXt, zTXt and iTXt as UTF-8; the first of equal keywords counts
    std::vector<std::string> warnings;       ///< what the decoder passed over (at most 16)
};

/// Any PNG: 1 to 16 bits, gray to RGBA, palettes, interlaced. BadFile: broken or truncated (the end chunk included);
/// LimitExceeded before memory is taken. A text chunk may hold up to 64 MB; a larger one becomes a warning.
Result<PngFile> parsePng(std::span<const std::byte> bytes, const ReadLimits& limits = defaultReadLimits());
Result<PngFile> readPng(const std::filesystem::path& path, const ReadLimits& limits = defaultReadLimits());

struct PngWriteOptions {
    int bits = 8; ///< 8 or 16 per sample
    /// What colour images are converted to: Srgb (with an sRGB chunk) or Linear (with a gamma of 1). Data images are
    /// written as they are with neither, whatever this says.
    ColorSpace space = ColorSpace::Srgb;
    int compressionLevel = 6;                     ///< zlib's, 0..9
    std::map<std::string, std::string> text = {}; ///< UTF-8; keywords of 1 to 79 printable ASCII characters
};

/// Values are clamped to [0,1] and rounded to nearest; premultiplied alpha is made straight first. InvalidArgument:
/// NaN, a bad keyword, a size or option that PNG does not have.
Result<std::vector<std::byte>> encodePng(const Image& image, const PngWriteOptions& options = {});
Status writePng(const std::filesystem::path& path, const Image& image, const PngWriteOptions& options = {});

} // namespace ars
