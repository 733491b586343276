#include "engine/io/jpeg.h"

#include <cstdint>
#include <cstdlib>

/// Any bytes through the reader; every sound picture holds as many values as its size says.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    ars::ReadLimits limits;
    limits.maxBytes = 16 << 20;
    limits.maxImageSide = 4096;
    const auto file = ars::parseJpeg({reinterpret_cast<const std::byte*>(data), size}, {}, limits);
    if (file && !ars::checkImage(file->image)) std::abort();
    return 0;
}
