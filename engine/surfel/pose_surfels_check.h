#pragma once

#include "engine/surfel/pose_surfels.h"

#include <vector>

namespace ars {

/// Radii of the joints' parts as PoseSurfelsArrays takes them, (J) each, metres.
struct JointRadii {
    std::vector<float> now, initial;
};

/// For callers of poseSurfelsOnDevice(), which sees pointers alone: what poseSurfels() asks of its arguments.
/// @param count  N
/// @return errors of poseSurfels()
Result<JointRadii> checkPosing(const PoseSurfelsParams& params, const SurfelPosing& posing, const SkinWeights& weights,
                               std::size_t count);

} // namespace ars
