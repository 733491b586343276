#pragma once

#include "engine/core/error.h"

#include <functional>
#include <string_view>

namespace ars {

/// The exception under way (call from a catch block) as an Error: OperatorFailure's own, OutOfMemory for
/// std::bad_alloc, for threads that the system refused (their stacks are memory) and for allocations that LibTorch was
/// refused, with the bytes wanted where they are known, else Internal with the first line of what it says.
Error errorOfException(std::string_view doing);

/// The result of `work`, or of the exception that it threw: nothing is thrown from here.
template <typename T>
T withoutExceptions(std::string_view doing, const std::function<T()>& work) {
    try {
        return work();
    } catch (...) {
        return errorOfException(doing);
    }
}

} // namespace ars
