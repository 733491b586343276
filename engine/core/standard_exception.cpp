#include "engine/core/standard_exception.h"

#include <new>
#include <system_error>

namespace ars {

Error errorOfStandardException(const std::exception& thrown, std::string place) {
    if (dynamic_cast<const std::bad_alloc*>(&thrown) != nullptr) {
        return makeError(ErrorCode::OutOfMemory, std::move(place), "not enough memory");
    }
    if (const auto* const refused = dynamic_cast<const std::system_error*>(&thrown)) {
        if (refused->code() == std::errc::resource_unavailable_try_again) {
            return makeError(ErrorCode::OutOfMemory, std::move(place), "not enough memory: a thread was refused");
        }
        if (refused->code() == std::errc::not_enough_memory) {
            return makeError(ErrorCode::OutOfMemory, std::move(place), "not enough memory");
        }
    }
    return makeError(ErrorCode::Internal, std::move(place), thrown.what());
}

} // namespace ars
