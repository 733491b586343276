#pragma once

#include "engine/core/error.h"
#include "engine/occlusion/radius_gradient_math.h"

#include <cstddef>

namespace ars {

/// What both devices are given, checked: one-channel pictures of one device.
struct RadiusGradientArguments {
    const float* gradOcclusion = nullptr;
    const float* occlusionPlus = nullptr;
    const float* occlusionMinus = nullptr;
    const float* radiusPlus = nullptr;
    const float* radiusMinus = nullptr;
    const float* opacity = nullptr;
    float* gradRadius = nullptr;
    std::size_t pixels = 0;
    float minOpacity = 0.0f;
    float minRadiusStepM = 0.0f;
};

/// One pixel from memory to memory.
ARS_HD inline void radiusGradientPixel(const RadiusGradientArguments& a, std::size_t p) {
    const bool covered = a.opacity[p] >= a.minOpacity;
    a.gradRadius[p] = covered ? a.gradOcclusion[p] * occlusionSlope(a.occlusionPlus[p], a.occlusionMinus[p],
                                                                    a.radiusPlus[p], a.radiusMinus[p], a.minRadiusStepM)
                              : 0.0f;
}

namespace cuda {
/// Queued on the default stream of device `index`; does not wait.
Status backwardRadius(const RadiusGradientArguments& arguments, int index);
} // namespace cuda

} // namespace ars
