#pragma once

#include <cstdint>

namespace ars {

/// Bounds that every reader checks before it takes memory. A file that asks for more gets ErrorCode::LimitExceeded with
/// both numbers. `ARS_MAX_BYTES` in the environment raises or lowers maxBytes.
struct ReadLimits {
    std::uint64_t maxBytes = 8ull << 30;      ///< memory that one file may ask for after decoding, bytes
    std::uint64_t maxFileBytes = 16ull << 30; ///< size of the file itself, bytes
    std::uint32_t maxImageSide = 32768;       ///< width or height, pixels
    std::uint32_t maxJoints = 4096;           ///< joints of one skeleton
    std::uint64_t maxElements = 1ull << 28;   ///< vertices, faces, frames... of one file
    std::uint32_t maxNesting = 256;           ///< depth of a tree: joints in BVH, nodes in glTF, JSON
};

/// The defaults with the environment applied.
ReadLimits defaultReadLimits();

} // namespace ars
