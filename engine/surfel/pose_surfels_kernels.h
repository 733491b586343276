#pragma once

#include "engine/core/error.h"
#include "engine/surfel/pose_surfels.h"

namespace ars::cpu {
/// Stage 4 over checked host arrays.
void poseSurfels(const PoseSurfelsParams& params, const PoseSurfelsArrays& arrays);
} // namespace ars::cpu

namespace ars::cuda {
/// Queued on the default stream of device `index`; does not wait.
Status poseSurfels(const PoseSurfelsParams& params, const PoseSurfelsArrays& arrays, int index);
} // namespace ars::cuda
