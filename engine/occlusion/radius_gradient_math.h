#pragma once

#include "engine/core/host_device.h"

namespace ars {

/// One pixel of paper Sec. 3.4: dO/dR = (O+ - O-) / (R+ - R-). T is float on devices, double in gradient tests.
template <typename T>
ARS_HD T occlusionSlope(T occlusionPlus, T occlusionMinus, T radiusPlus, T radiusMinus, T minStep) {
    const T step = radiusPlus - radiusMinus;
    // Where nothing was splatted R+ = R-: there is no information, so no gradient. Also false for NaN.
    if (!(step >= minStep || step <= -minStep)) return T(0);
    return (occlusionPlus - occlusionMinus) / step;
}

} // namespace ars
