#include "engine/io/npz.h"

#include <cstdint>
#include <cstdlib>

/// Every key is either an array that fits its shape or an error with words; all together stay within the limit.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    ars::ReadLimits limits;
    limits.maxBytes = 64 << 20;
    const auto file = ars::parseNpz({reinterpret_cast<const std::byte*>(data), size}, limits);
    if (!file) return file.error().describe().empty() ? std::abort(), 0 : 0;
    std::uint64_t bytes = 0;
    ars::NamedArrays arrays;
    for (const auto& [key, array] : file->arrays) {
        if (!ars::validateArray(array)) std::abort();
        bytes += array.bytes.size();
        if (!key.empty()) arrays.emplace_back(key, array);
    }
    if (bytes > limits.maxBytes) std::abort();
    for (const auto& [key, error] : file->unreadable) {
        if (error.code != ars::ErrorCode::Unsupported || error.describe().empty()) std::abort();
    }
    const auto packed = ars::encodeNpz(arrays, {false, size % 2 == 0});
    if (!packed) std::abort();
    limits.maxBytes = 1 << 30;
    const auto again = ars::parseNpz(*packed, limits);
    if (!again || again->arrays.size() != arrays.size()) std::abort();
    for (const auto& [key, array] : arrays) {
        if (again->arrays.at(key).bytes != array.bytes) std::abort();
    }
    return 0;
}
