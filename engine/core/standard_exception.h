#pragma once

#include "engine/core/error.h"

#include <exception>
#include <string>

namespace ars {

/// The error of what the standard library threw: OutOfMemory where memory or a thread (which needs some) was refused,
/// else Internal in the exception's own words. For the places beyond which no exception may go.
Error errorOfStandardException(const std::exception& thrown, std::string place);

} // namespace ars
