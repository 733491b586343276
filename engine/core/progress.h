#pragma once

#include "engine/core/error.h"

#include <functional>
#include <string_view>

namespace ars {

/// Told about long work. Called at least every few tenths of a second with a fraction in [0,1]; returning false asks
/// the work to stop, which then ends with ErrorCode::Cancelled and leaves nothing half done.
using ProgressFunction = std::function<bool(double fraction, std::string_view what)>;

/// Reports to `progress` when there is one. Cancelled when it asks to stop.
inline Status reportProgress(const ProgressFunction& progress, double fraction, std::string_view what) {
    if (progress && !progress(fraction, what)) {
        return makeError(ErrorCode::Cancelled, "", fmt::format("{} was stopped on request", what));
    }
    return {};
}

} // namespace ars
