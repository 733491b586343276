#include "engine/io/gltf.h"

#include <cstddef>
#include <cstdint>
#include <cstdlib>

/// Any bytes as glTF without a folder, so that no file is opened. Meshes that are read must be sound; a document that
/// can be written must be read again.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    ars::ReadLimits limits;
    limits.maxBytes = 64u << 20;
    const auto document = ars::parseGltf(std::as_bytes(std::span(data, size)), {}, limits);
    if (!document) return 0;
    for (const ars::GltfMesh& mesh : document->meshes) {
        for (const ars::GltfPrimitive& primitive : mesh.primitives) {
            if (!ars::validateMesh(primitive.mesh)) std::abort();
        }
    }
    document->globalMatrices();
    if (const auto bytes = ars::encodeGlb(*document)) {
        const auto again = ars::parseGltf(*bytes, {}, limits);
        // What is written is larger than what was read, so a limit may be met; nothing else may be wrong.
        if (!again && again.error().code != ars::ErrorCode::LimitExceeded) std::abort();
    }
    return 0;
}
