#include "engine/core/limits.h"

#include <cstdlib>

namespace ars {

ReadLimits defaultReadLimits() {
    ReadLimits limits;
    if (const char* text = std::getenv("ARS_MAX_BYTES")) {
        if (const std::uint64_t bytes = std::strtoull(text, nullptr, 10); bytes > 0) limits.maxBytes = bytes;
    }
    return limits;
}

} // namespace ars
