#include "engine/io/hdr.h"

#include <cstdint>
#include <cstdlib>

/// Any bytes through the reader; what it accepts must be writable and come back with the same size.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    ars::ReadLimits limits;
    limits.maxBytes = 4 << 20;
    limits.maxImageSide = 4096;
    const auto image = ars::parseHdr({reinterpret_cast<const std::byte*>(data), size}, limits);
    if (!image) return 0;
    const auto bytes = ars::encodeHdr(*image);
    if (!bytes) return 0; // division by a small EXPOSURE can leave the format's range
    const auto back = ars::parseHdr(*bytes, limits);
    if (!back || back->width != image->width || back->height != image->height) std::abort();
    return 0;
}
