#pragma once

#include "engine/core/error.h"
#include "engine/surfel/pose_surfels_gradient.h"

namespace ars::cpu {
/// Over checked host arrays. Gradients that are null pass nothing.
void poseSurfelsBackward(const PoseSurfelsGradientArrays& arrays);
} // namespace ars::cpu

namespace ars::cuda {
/// Queued on the default stream; does not wait.
Status poseSurfelsBackward(const PoseSurfelsGradientArrays& arrays, PoseGradientWorkspace& workspace,
                           const Device& device);
} // namespace ars::cuda
