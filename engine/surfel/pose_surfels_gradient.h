#pragma once

#include "engine/core/buffer.h"
#include "engine/core/error.h"
#include "engine/surfel/pose_surfels.h"

#include <glm/glm.hpp>

#include <cstddef>
#include <cstdint>
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

/// Raw arrays of that backward, all on one device. Inputs that are null pass nothing, and their outputs must be null.
struct PoseSurfelsGradientArrays {
    std::size_t count = 0;                 ///< N
    std::size_t jointCount = 0;            ///< J
    const glm::mat4* matrices = nullptr;   ///< (J) M_j
    const BodyPart* parts = nullptr;       ///< (J)
    const std::uint16_t* joints = nullptr; ///< (N, 8)
    const float* weights = nullptr;        ///< (N, 8)
    const float* rotations = nullptr;      ///< (N, 4) canonical, w, x, y, z

    const glm::vec3* posedMeans = nullptr; ///< (N) dL/d of what posing gave
    const float* posedRotations = nullptr; ///< (N, 4)
    const float* posedRadii = nullptr;     ///< (N)

    glm::vec3* means = nullptr;     ///< (N) dL/d of the canonical surfels; may be `posedMeans`
    float* gradRotations = nullptr; ///< (N, 4), may be `posedRotations`
    float* partRadii = nullptr;     ///< (9) dL/dr_g
};

/// Memory that CUDA keeps between steps.
struct PoseGradientWorkspace {
    Buffer sums; ///< of the parts' radii, piece by piece
};

/// poseSurfelsBackward on any device, nothing copied and nothing waited for (CUDA: queued on the default stream). Joint
/// indices beyond J count as weight 0. Sums are taken in a fixed order. Of no surfels nothing is written.
/// @return InvalidArgument for missing inputs or outputs, Unavailable where the device is not here
Status poseSurfelsBackwardOnDevice(const Device& device, const PoseSurfelsGradientArrays& arrays,
                                   PoseGradientWorkspace& workspace);

} // namespace ars
