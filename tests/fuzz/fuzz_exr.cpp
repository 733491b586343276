#include "engine/io/exr.h"

#include <cstdint>
#include <cstdlib>

/// Any bytes through the header reader and the whole reader; sound pictures through layer extraction as well.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    const std::span bytes(reinterpret_cast<const std::byte*>(data), size);
    ars::ReadLimits limits;
    limits.maxBytes = 16 << 20;
    limits.maxImageSide = 4096;
    const auto info = ars::parseExrInfo(bytes);
    const auto image = ars::parseExr(bytes, limits);
    if (!image) return 0;
    // What can be read can be listed, and every layer that is listed exists.
    if (!info) std::abort();
    for (const std::string& layer : ars::exrLayers(*image)) {
        const auto picture = ars::exrLayer(*image, layer, ars::ExrWindow::Display, limits);
        if (!picture && picture.error().code == ars::ErrorCode::NotFound) std::abort();
    }
    return 0;
}
