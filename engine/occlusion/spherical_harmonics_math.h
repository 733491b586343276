#pragma once

#include "engine/core/host_device.h"

#include <glm/glm.hpp>

namespace ars {

/// Coefficients of real spherical harmonics of degree <= 3.
inline constexpr int kHarmonicCount = 16;

/// The real orthonormal spherical harmonics Y_lm(d) of degree <= 3 with the Condon-Shortley sign, ordered by l and then
/// m from -l to l; d of unit length. T is float on devices, double in tests.
template <typename T>
ARS_HD void sphericalHarmonics(const glm::vec<3, T, glm::defaultp>& d, T (&y)[kHarmonicCount]) {
    const T xx = d.x * d.x, yy = d.y * d.y, zz = d.z * d.z;
    y[0] = T(0.28209479177387814);        // 1/2 sqrt(1/pi)
    y[1] = T(-0.48860251190291992) * d.y; // sqrt(3/(4 pi))
    y[2] = T(0.48860251190291992) * d.z;
    y[3] = T(-0.48860251190291992) * d.x;
    y[4] = T(1.0925484305920792) * d.x * d.y; // 1/2 sqrt(15/pi)
    y[5] = T(-1.0925484305920792) * d.y * d.z;
    y[6] = T(0.31539156525252005) * (T(2) * zz - xx - yy); // 1/4 sqrt(5/pi)
    y[7] = T(-1.0925484305920792) * d.x * d.z;
    y[8] = T(0.54627421529603959) * (xx - yy);                             // 1/4 sqrt(15/pi)
    y[9] = T(-0.59004358992664352) * d.y * (T(3) * xx - yy);               // 1/4 sqrt(35/(2 pi))
    y[10] = T(2.8906114426405538) * d.x * d.y * d.z;                       // 1/2 sqrt(105/pi)
    y[11] = T(-0.45704579946446572) * d.y * (T(4) * zz - xx - yy);         // 1/4 sqrt(21/(2 pi))
    y[12] = T(0.37317633259011540) * d.z * (T(2) * zz - T(3) * (xx + yy)); // 1/4 sqrt(7/pi)
    y[13] = T(-0.45704579946446572) * d.x * (T(4) * zz - xx - yy);
    y[14] = T(1.4453057213202769) * d.z * (xx - yy); // 1/4 sqrt(105/pi)
    y[15] = T(-0.59004358992664352) * d.x * (xx - T(3) * yy);
}

/// The function with coefficients c at d.
template <typename T>
ARS_HD T evaluateHarmonics(const T (&c)[kHarmonicCount], const glm::vec<3, T, glm::defaultp>& d) {
    T y[kHarmonicCount];
    sphericalHarmonics(d, y);
    T sum = T(0);
    for (int i = 0; i < kHarmonicCount; ++i) sum += c[i] * y[i];
    return sum;
}

/// Visibility is in [0, 1]; the ringing of a cut-off series is not, and is clamped sample by sample as in GS-IR.
template <typename T>
ARS_HD T clampedVisibility(const T (&c)[kHarmonicCount], const glm::vec<3, T, glm::defaultp>& d) {
    const T v = evaluateHarmonics(c, d);
    return v < T(0) ? T(0) : (v > T(1) ? T(1) : v);
}

} // namespace ars
