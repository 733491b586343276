#pragma once

#include "engine/core/camera.h"
#include "engine/light/prefilter.h"
#include "engine/occlusion/ambient_occlusion.h"
#include "engine/shade/shading.h"
#include "engine/shade/tone.h"
#include "engine/surfel/pose_surfels.h"
#include "engine/surfel/splat.h"
#include "model/tensors.h"

#include <memory>

/// The operators of engine/ as functions of autograd: forward and backward are the engine's own. Float tensors, all of
/// a call in host memory or on one CUDA device (model/device.h); pictures are (height, width, channels). Gradients:
/// those of the engine's *_gradient.h, none to what these call detached. An operator's failure is thrown as
/// OperatorFailure with its Error: autograd has no other way; the trainer catches it at the step.
namespace ars {

class OperatorFailure : public std::exception {
public:
    explicit OperatorFailure(Error error) : error_(std::move(error)) {}
    const Error& error() const { return error_; }
    const char* what() const noexcept override { return error_.message.c_str(); }

private:
    Error error_;
};

/// Surfels as tensors; undefined: the attribute is absent.
struct SurfelTensors {
    at::Tensor means;       ///< (N, 3)
    at::Tensor rotations;   ///< (N, 4)
    at::Tensor scales;      ///< (N, 2)
    at::Tensor opacities;   ///< (N) or (N, 1)
    at::Tensor colors;      ///< (N, 3)
    at::Tensor albedos;     ///< (N, 3)
    at::Tensor roughnesses; ///< (N) or (N, 1)
    at::Tensor radii;       ///< (N), and the next two
    at::Tensor radiiPlus;
    at::Tensor radiiMinus;
    at::Tensor importances; ///< (N), carries no gradient
    at::Tensor bones;       ///< (N, 3), carries no gradient
};

/// Copies to host arrays (for evaluators, files and previews).
Surfels surfelsFromTensors(const SurfelTensors& tensors);

/// What one pose is: shared by every use of it in a step.
struct PosingContext {
    PoseSurfelsParams params;
    std::vector<glm::mat4> matrices;       ///< (J) M_j
    std::vector<glm::vec3> jointPositions; ///< (J)
    std::vector<BodyPart> parts;           ///< (J)
    std::shared_ptr<const SkinWeights> weights;
};

/// Stage 4: canonical means, rotations -> posed ones, radii (with R+ and R- where params.trainingRadii), importance and
/// bone direction; the other attributes are handed on.
/// @param radii (9) r_g, metres; the gradient reaches it through `radii` alone
SurfelTensors poseSurfelTensors(const std::shared_ptr<const PosingContext>& context, const SurfelTensors& canonical,
                                const at::Tensor& radii);

/// Pictures of a splat, (height, width, channels); undefined where they were not wanted.
struct GBufferTensors {
    std::array<at::Tensor, kChannelCount> pictures;
    at::Tensor& operator[](Channel channel) { return pictures[static_cast<std::size_t>(channel)]; }
    const at::Tensor& operator[](Channel channel) const { return pictures[static_cast<std::size_t>(channel)]; }
};

/// Memory of splatting, used again from step to step: one for each splat of a step that backward has yet to pass.
class SplatScratch;
class SplatScratchPool {
public:
    SplatScratchPool();
    ~SplatScratchPool();
    std::shared_ptr<SplatScratch> take();

private:
    friend class SplatScratch;
    struct State;
    std::shared_ptr<State> state_;
};

/// Stage 5 with gradients to every attribute (SplatBackwardParams' default set is detached).
GBufferTensors splatTensors(const SplatParams& params, const SurfelTensors& surfels, const Camera& camera,
                            ChannelSet channels, SplatScratchPool& pool);

/// Stage 6: O (height, width, 1) whose gradient is the paper's finite difference and reaches R alone.
/// Pictures as splatTensors gives them, with RadiusPlus and RadiusMinus; without them O carries no gradient.
/// @param pass  which directions, see ambientOcclusion
at::Tensor occlusionTensor(const OcclusionParams& params, const GBufferTensors& gbuffer, const Camera& camera,
                           OcclusionWorkspace& workspace, int pass);

/// A cube light of (6, side, side, 3) linear texels, not negative, filtered for shading: made once a step, used by all
/// its views.
struct LightTensors;
std::shared_ptr<LightTensors> lightTensors(const at::Tensor& texels);

/// Stage 7: (height, width, 4) linear premultiplied colour and opacity, with gradients to albedo, roughness, normal,
/// opacity, occlusion and the light's texels. `occlusion` may be undefined (O = 1).
at::Tensor shadeTensors(const ShadingParams& params, const GBufferTensors& gbuffer, const at::Tensor& occlusion,
                        const Camera& camera, const std::shared_ptr<LightTensors>& light);

/// toneMap: linear premultiplied RGBA (height, width, 4) to sRGB-encoded RGBA over the background of `params`.
at::Tensor toneTensor(const ToneParams& params, const at::Tensor& linear);

} // namespace ars
