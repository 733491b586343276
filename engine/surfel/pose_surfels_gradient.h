#pragma once

#include "engine/core/error.h"
#include "engine/surfel/pose_surfels.h"

#include <glm/glm.hpp>

#include <span>
#include <vector>

namespace ars {

/// dL/d of what posing changes, N of each; empty spans pass nothing.
struct PosedSurfelGradients {
    std::span<const glm::vec3> means;
    std::span<const float> rotations; ///< (N, 4)
    std::span<const float> radii;
};

/// Backward of poseSurfels with respect to the canonical surfels and the nine radii. The pose is given and carries no
/// gradient; importance and bone direction are detached (design section 4).
///
/// @param canonical      as given to poseSurfels
/// @param gradMeans      (N), written where dL/dmeans is given
/// @param gradRotations  (N, 4), written where dL/drotations is given: of the quaternions as given, length included
/// @param gradRadii      dL/dr_g of each part, metres; written where dL/dradii is given. Summed in a fixed order.
/// @return InvalidArgument when counts disagree
Status poseSurfelsBackward(const SurfelPosing& posing, const SkinWeights& weights, const Surfels& canonical,
                           const PosedSurfelGradients& gradients, std::span<glm::vec3> gradMeans,
                           std::span<float> gradRotations, PartRadii& gradRadii);

} // namespace ars
