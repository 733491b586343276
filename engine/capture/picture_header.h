#pragma once

#include "engine/core/error.h"

#include <filesystem>

namespace ars {

/// What the head of a JPEG or PNG says.
struct PictureHeader {
    int width = 0;
    int height = 0;
    bool alpha = false; ///< PNG with an alpha channel
};

/// Size of a picture without decoding it, and whether its end is there: a JPEG's end marker or a PNG's end chunk must
/// stand within the last 64 KiB, so that most truncated files are noticed. NotFound, Io; BadFile for an empty file, one
/// that is neither kind, and one without an end. The path is the error's place.
Result<PictureHeader> readPictureHeader(const std::filesystem::path& path);

} // namespace ars
