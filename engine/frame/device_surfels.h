#pragma once

#include "engine/core/buffer.h"
#include "engine/rig/body_parts.h"
#include "engine/rig/skinning.h"
#include "engine/surfel/pose_surfels.h"
#include "engine/surfel/surfels.h"

#include <span>
#include <vector>

namespace ars {

/// Surfels that live on a CUDA device: canonical attributes go there once, posing happens there.
class DeviceSurfels {
public:
    /// Copies attributes and weights to the device. OutOfMemory, Unavailable.
    Status setCanonical(const Device& device, const Surfels& canonical, const SkinWeights& weights);
    /// Copies surfels that are posed already; the view holds until the next call.
    Result<SurfelView> setSurfels(const Device& device, const Surfels& surfels);
    /// Stage 4 on the device. Spans as in SurfelPosing.
    Status pose(const PoseSurfelsParams& params, std::span<const glm::mat4> matrices,
                std::span<const glm::vec3> jointPositions, std::span<const BodyPart> parts, const PartRadii& radii);
    /// The posed surfels; valid until the next call of either.
    SurfelView view() const;
    /// Copies of them in host memory; waits for the device.
    Result<Surfels> download() const;
    Result<std::vector<glm::vec3>> downloadMeans() const;

private:
    Device device_;
    std::size_t count_ = 0;
    Buffer joints_, weights_, means_, rotations_, scales_, opacities_, colors_, albedos_, roughnesses_;
    Buffer matrices_, jointPositions_, jointRadii_, jointInitialRadii_;
    Buffer posedMeans_, posedRotations_, radii_, radiiPlus_, radiiMinus_, importances_, bones_;
};

} // namespace ars
