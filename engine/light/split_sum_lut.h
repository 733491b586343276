#pragma once

#include "engine/core/error.h"
#include "engine/core/image_view.h"

#include <memory>

namespace ars {

inline constexpr int kSplitSumLutSize = 256;

/// The table of the split sum (Karis 2013) for GGX with alpha = roughness^2 and the height-correlated Smith term:
/// (256, 256, 2), row = roughness, column = n.v, texel centres; A and B of "specular albedo = F0 A + B".
///
/// Computed once in a process (about 80 ms on two cores) and copied once to each device. OutOfMemory, Unavailable.
Result<std::shared_ptr<const PixelBuffer>> splitSumLut(const Device& device);

/// One entry, by the same sum with `samplesPerAxis`^2 samples.
/// @param normalDotView, roughness  (0, 1]
void splitSumEntry(double normalDotView, double roughness, int samplesPerAxis, double& a, double& b);

} // namespace ars
