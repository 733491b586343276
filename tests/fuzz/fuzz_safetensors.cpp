#include "engine/io/safetensors.h"

#include <cstdint>
#include <cstdlib>

/// What is read without an error must be written and read again as the same tensors.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    ars::ReadLimits limits;
    limits.maxBytes = 64 << 20;
    const auto file = ars::parseSafetensors({reinterpret_cast<const std::byte*>(data), size}, limits);
    if (!file) return file.error().describe().empty() ? std::abort(), 0 : 0;
    for (const auto& [name, tensor] : file->tensors) {
        if (!ars::validateArray(tensor)) std::abort();
    }
    const auto bytes = ars::encodeSafetensors(*file);
    if (!bytes) std::abort();
    const auto again = ars::parseSafetensors(*bytes, limits);
    if (!again || again->tensors.size() != file->tensors.size() || again->metadata != file->metadata) std::abort();
    for (const auto& [name, tensor] : file->tensors) {
        if (again->tensors.at(name).bytes != tensor.bytes) std::abort();
    }
    return 0;
}
