#pragma once

#include "engine/core/error.h"
#include "engine/core/limits.h"
#include "engine/io/image.h"

#include <cstddef>
#include <filesystem>
#include <optional>
#include <span>
#include <string_view>

namespace ars {

enum class ImageFormat { Exr, Hdr, Png, Jpeg };
std::string_view imageFormatName(ImageFormat format);

/// Which picture the bytes are the beginning of, by their content; 16 bytes are enough.
std::optional<ImageFormat> recogniseImage(std::span<const std::byte> head);

/// A picture of any known format, recognised by content whatever the file is called. Of an EXR comes the layer without
/// a name, or the only layer there is, cropped or padded to the display window (exr.h reads all layers). JPEGs are
/// turned upright. Colours stay in the file's space (Image::space).
/// Unsupported when the content is none of the four, naming them; otherwise the errors of the format's own reader.
Result<Image> parseImageFile(std::span<const std::byte> bytes, const ReadLimits& limits = defaultReadLimits());
Result<Image> readImageFile(const std::filesystem::path& path, const ReadLimits& limits = defaultReadLimits());

} // namespace ars
