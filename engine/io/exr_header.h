#pragma once

#include "engine/io/exr.h"

#include <cstdint>

namespace ars::detail {

/// OpenEXR headers and block tables read by hand, before the library sees the file: the library believes the sizes in a
/// header, fills missing blocks with nothing, and has crashed on hostile files. Layout: "OpenEXR File Layout"
/// (openexr.com). What is accepted here, the library reads in the same way.

struct ExrTiles {
    std::uint32_t width = 0;
    std::uint32_t height = 0;
    int levelMode = 0; ///< 0 one level, 1 mipmap, 2 ripmap
    bool roundUp = false;
};

struct ExrPart {
    ExrPartInfo info;
    int compressionCode = 0; ///< as stored; may be one that this program does not know
    ExrTiles tiles;          ///< tiled parts only
    std::int64_t declaredBlocks = -1;
};

struct ExrHeader {
    bool multipart = false;
    std::vector<ExrPart> parts;
    std::size_t end = 0; ///< where the tables of block offsets begin
};

/// BadFile when anything is broken. Deep, subsampled and unknown compression are only noted.
Result<ExrHeader> readExrHeader(std::span<const std::byte> bytes);

/// Whether parseExr can read this header: Unsupported, or LimitExceeded for sides and for all channels over `window`.
Status checkExrHeader(const ExrHeader& header, const ExrBox& window, const ReadLimits& limits);

/// Whether every block that the windows ask for is there, whole, and large enough to hold its pixels: BadFile.
Status checkExrBlocks(const ExrHeader& header, std::span<const std::byte> bytes);

/// The smallest rectangle around all data windows.
ExrBox exrDataWindow(const ExrHeader& header);

} // namespace ars::detail
