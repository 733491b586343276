#pragma once

#include "engine/core/host_device.h"

#include <glm/glm.hpp>

namespace ars {

/// OpenCV's lens model, k1 k2 p1 p2 k3 with the optional denominator k4 k5 k6 (docs/math/undistortion.md). T is double;
/// nothing here depends on it.
template <typename T>
struct LensDistortion {
    T k1 = 0, k2 = 0, p1 = 0, p2 = 0, k3 = 0, k4 = 0, k5 = 0, k6 = 0;
};

/// Where the lens puts a ray: (x, y) = (X/Z, Y/Z) without distortion to the same with it.
template <typename T>
ARS_HD glm::vec<2, T, glm::defaultp> distorted(const LensDistortion<T>& lens, T x, T y) {
    const T r2 = x * x + y * y;
    const T radial = (T(1) + r2 * (lens.k1 + r2 * (lens.k2 + r2 * lens.k3))) /
                     (T(1) + r2 * (lens.k4 + r2 * (lens.k5 + r2 * lens.k6)));
    return {x * radial + T(2) * lens.p1 * x * y + lens.p2 * (r2 + T(2) * x * x),
            y * radial + lens.p1 * (r2 + T(2) * y * y) + T(2) * lens.p2 * x * y};
}

/// d(r radial)/dr, the radial part's slope: beyond its first zero the polynomial folds back and means nothing.
template <typename T>
ARS_HD T radialSlope(const LensDistortion<T>& lens, T x, T y) {
    const T r2 = x * x + y * y;
    const T upper = T(1) + r2 * (lens.k1 + r2 * (lens.k2 + r2 * lens.k3));
    const T lower = T(1) + r2 * (lens.k4 + r2 * (lens.k5 + r2 * lens.k6));
    const T upperSlope = T(2) * r2 * (lens.k1 + r2 * (T(2) * lens.k2 + r2 * T(3) * lens.k3)); // r d/dr
    const T lowerSlope = T(2) * r2 * (lens.k4 + r2 * (T(2) * lens.k5 + r2 * T(3) * lens.k6));
    return upper / lower + (upperSlope * lower - upper * lowerSlope) / (lower * lower);
}

} // namespace ars
