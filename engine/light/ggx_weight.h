#pragma once

#include "engine/core/host_device.h"

namespace ars {

/// Weight of radiance from w in the lobe about n (n = v), up to a factor that the normalisation takes away:
/// (n.w) D(n.h) dw with D = alpha^2 / (pi (1 - (n.h)^2 (1 - alpha^2))^2).
///
/// @param e  1 - n.w = |n - w|^2 / 2; (n.h)^2 = 1 - e / 2. Taken instead of n.w, which would lose the lobe of small
///           alpha to rounding.
/// V is a number or a vector of them; this header includes nothing, so that files for single instruction sets may.
template <typename V, typename T>
ARS_HD inline V ggxWeight(const V& e, const V& solidAngle, T alphaSquared) {
    const V half = e * T(0.5);
    const V d = alphaSquared + half * (T(1) - alphaSquared);
    return (T(1) - e) * solidAngle / (d * d);
}

} // namespace ars
