#pragma once

#include <cstdlib>

/// What tests/gradient/sign_flips.py puts around the terms of backward functions: `flipped(12, x)` is -x when the
/// environment says ARS_FLIP=12, else x. All flips of a group are compiled at once and tried one by one.
namespace ars::flips {

inline int chosen() {
    static const int number = std::getenv("ARS_FLIP") ? std::atoi(std::getenv("ARS_FLIP")) : -1;
    return number;
}

template <typename T>
inline T flipped(int number, const T& value) {
    return number == chosen() ? static_cast<T>(-value) : value;
}

} // namespace ars::flips
