#pragma once

#include "engine/core/error.h"
#include "engine/core/parameters.h"
#include "engine/rig/body_parts.h"
#include "engine/rig/pose.h"
#include "engine/rig/skinning.h"
#include "engine/surfel/surfels.h"

#include <glm/glm.hpp>

#include <array>
#include <span>
#include <vector>

namespace ars {

/// Occlusion radius r_g of each of the nine parts, metres, in the order of BodyPart.
using PartRadii = std::array<float, kBodyPartCount>;
/// r_init of every part (docs/conventions.md, Body parts).
PartRadii initialPartRadii();
/// The same radius everywhere.
PartRadii uniformPartRadii(float radiusM);

/// How surfels are posed (paper Sec. 3.4 and supplement).
struct PoseSurfelsParams {
    float importanceFalloffM = 0.15f; ///< sigma of the importance I, metres
    bool trainingRadii = false;       ///< also R+ and R-: r +- epsilon
    float radiusStepFraction = 0.05f; ///< epsilon = max(this r, minRadiusStepM)
    float minRadiusStepM = 0.002f;    ///< metres

    bool operator==(const PoseSurfelsParams&) const = default;
};
const ParameterTable<PoseSurfelsParams>& poseSurfelsParameters();

/// One pose as surfels see it. Spans must outlive the call.
struct SurfelPosing {
    std::span<const glm::mat4> matrices;       ///< (J) M_j = A_j A_canonical,j^-1: canonical pose to posed world
    std::span<const glm::vec3> jointPositions; ///< (J) p_j: posed joints, world, metres
    std::span<const BodyPart> parts;           ///< (J)
    PartRadii radii = initialPartRadii();      ///< r_g, metres; I always uses r_init
};

/// M_j = A_j A_canonical,j^-1 (J). `canonical` may be empty: then the canonical pose is the rest pose and M = A.
/// InvalidArgument when the counts differ; a canonical matrix that has no inverse or is not finite is named.
Result<std::vector<glm::mat4>> canonicalToPosed(std::span<const glm::mat4> posed, std::span<const glm::mat4> canonical);

/// p_j (J): joint positions under a pose, its translation included.
std::vector<glm::vec3> posedJointPositions(const Skeleton& skeleton, const Pose& pose);

/// What changes with the pose, N of each; the rest of a live surfel is its canonical surfel's.
struct PosedSurfels {
    std::vector<glm::vec3> means;   ///< world, metres: sum_j w_ij M_j [mu_c; 1]
    std::vector<float> rotations;   ///< (N, 4) w, x, y, z: polar rotation of the blended matrix times the canonical one
    std::vector<float> radii;       ///< r_i = sum_j w_ij r_part(j), metres
    std::vector<float> radiiPlus;   ///< r_i + epsilon_i; empty unless asked for
    std::vector<float> radiiMinus;  ///< r_i - epsilon_i; empty unless asked for
    std::vector<float> importances; ///< I_i = sum_j w_ij exp(-|x_i - p_j| / sigma) r_j / sum_j w_ij r_j, in [0, 1]
    std::vector<glm::vec3> bones;   ///< q_i = normalize(sum_j w_ij V_j e_y), V_j the rotation of M_j; world

    std::size_t count() const { return means.size(); }
};

/// Stage 4 of a frame on the host: canonical surfels to live ones. Reads means and rotations of `canonical`.
///
/// Memory of `posed` is used again. A rotation of zero length or with numbers that are not finite counts as none.
/// @return InvalidArgument when counts disagree, a weight's joint does not exist, the falloff or a radius is not
/// positive
Status poseSurfels(const PoseSurfelsParams& params, const SurfelPosing& posing, const SkinWeights& weights,
                   const Surfels& canonical, PosedSurfels& posed);

/// Stage 4': only the radii anew, after a change of r_g. `posed` keeps everything else.
Status poseRadii(const PoseSurfelsParams& params, const SurfelPosing& posing, const SkinWeights& weights,
                 PosedSurfels& posed);

/// The live surfels without a copy: posed attributes of `posed`, the others of `canonical`. Valid as long as neither is
/// changed. Counts must agree (asserted).
SurfelView liveView(const Surfels& canonical, const PosedSurfels& posed);

/// The same with copies, for callers that keep them.
Surfels liveSurfels(const Surfels& canonical, const PosedSurfels& posed);

/// Raw arrays of stage 4, all on one device. Outputs that are null are not written.
struct PoseSurfelsArrays {
    std::size_t count = 0;                     ///< N
    std::size_t jointCount = 0;                ///< J
    const glm::mat4* matrices = nullptr;       ///< (J) M_j
    const glm::vec3* jointPositions = nullptr; ///< (J) p_j
    const float* jointRadii = nullptr;         ///< (J) r_part(j), metres
    const float* jointInitialRadii = nullptr;  ///< (J) r_init of the joint's part, metres
    const std::uint16_t* joints = nullptr;     ///< (N, 8), 16-byte aligned
    const float* weights = nullptr;            ///< (N, 8), 16-byte aligned
    const glm::vec3* means = nullptr;          ///< (N) canonical
    const float* rotations = nullptr;          ///< (N, 4) canonical, w, x, y, z

    glm::vec3* posedMeans = nullptr; ///< may be `means`
    float* posedRotations = nullptr; ///< may be `rotations`
    float* radii = nullptr;
    float* radiiPlus = nullptr;
    float* radiiMinus = nullptr;
    float* importances = nullptr;
    glm::vec3* bones = nullptr;
};

/// Stage 4 on any device, nothing copied and nothing waited for (CUDA: queued on the default stream). Joint indices
/// beyond J count as weight 0. InvalidArgument for missing inputs, Unavailable where the device is not here.
Status poseSurfelsOnDevice(const PoseSurfelsParams& params, const Device& device, const PoseSurfelsArrays& arrays);

} // namespace ars
