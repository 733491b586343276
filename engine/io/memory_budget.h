#pragma once

#include "engine/core/error.h"
#include "engine/core/limits.h"

#include <cstdint>
#include <string>

namespace ars {

/// Adds up what one file asks for, so that many small requests cannot pass a limit together.
class MemoryBudget {
public:
    explicit MemoryBudget(const ReadLimits& limits) : limit_(limits.maxBytes) {}

    /// Call before memory is taken. LimitExceeded with both numbers.
    Status take(std::uint64_t bytes, const std::string& place) {
        if (bytes <= limit_ - used_) {
            used_ += bytes;
            return {};
        }
        return makeError(
            ErrorCode::LimitExceeded, place,
            fmt::format("needs {} bytes of memory after {} so far, the limit is {}", bytes, used_, limit_));
    }

private:
    std::uint64_t limit_;
    std::uint64_t used_ = 0;
};

} // namespace ars
