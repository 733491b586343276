#include "engine/io/obj.h"

#include <cstddef>
#include <cstdint>
#include <cstdlib>

/// Any bytes as OBJ. A mesh that is read must be sound, and what is written of it must be read again.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    ars::ReadLimits limits;
    limits.maxBytes = 64u << 20;
    const auto file = ars::parseObj(std::as_bytes(std::span(data, size)), limits);
    if (!file) return 0;
    if (!ars::validateMesh(file->mesh)) std::abort();
    if (const auto text = ars::formatObj(file->mesh)) {
        const auto again = ars::parseObj(std::as_bytes(std::span(*text)), limits);
        if (!again || again->mesh.triangles != file->mesh.triangles) std::abort();
    }
    return 0;
}
