#include "engine/io/ply.h"

#include <cstddef>
#include <cstdint>
#include <cstdlib>

/// Any bytes as PLY. What is read is written and read again: both must agree, and a mesh that passes must be sound.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    ars::ReadLimits limits;
    limits.maxBytes = 64u << 20;
    const auto file = ars::parsePly(std::as_bytes(std::span(data, size)), limits);
    if (!file) return 0;
    if (const auto mesh = ars::meshFromPly(*file); mesh && !ars::validateMesh(*mesh)) std::abort();
    if (const auto bytes = ars::encodePly(*file)) {
        const auto again = ars::parsePly(*bytes, limits);
        if (!again || again->elements.size() != file->elements.size()) std::abort();
    }
    return 0;
}
