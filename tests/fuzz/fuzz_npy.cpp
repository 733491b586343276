#include "engine/io/npz.h"

#include <cstdint>
#include <cstdlib>

/// What is read without an error must be written and read again as the same array.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    ars::ReadLimits limits;
    limits.maxBytes = 64 << 20;
    const auto array = ars::parseNpy({reinterpret_cast<const std::byte*>(data), size}, limits);
    if (!array) return array.error().describe().empty() ? std::abort(), 0 : 0;
    if (!ars::validateArray(*array)) std::abort();
    const auto file = ars::encodeNpy(*array);
    if (!file) std::abort();
    limits.maxBytes = 1 << 30;
    const auto again = ars::parseNpy(*file, limits);
    if (!again || again->shape != array->shape || again->dtype != array->dtype) std::abort();
    if (again->bytes != array->bytes || again->texts != array->texts) std::abort();
    return 0;
}
