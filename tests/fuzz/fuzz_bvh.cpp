#include "engine/io/bvh.h"

#include <cstddef>
#include <cstdint>
#include <cstdlib>

/// Any bytes as BVH. What is read must be writable, and come back with the same numbers.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    ars::ReadLimits limits;
    limits.maxBytes = 64u << 20;
    const auto file = ars::parseBvh(std::as_bytes(std::span(data, size)), limits);
    if (!file) return 0;
    const auto text = ars::formatBvh(*file);
    if (!text) std::abort();
    const auto again = ars::parseBvh(std::as_bytes(std::span(*text)), limits);
    if (!again || again->values != file->values || again->joints.size() != file->joints.size()) std::abort();
    return 0;
}
