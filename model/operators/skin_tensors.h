#pragma once

#include "model/operators/surfel_operators.h"

namespace ars {

/// Skinning weights on a device, made once for the poses of many steps; on the host over the memory of the weights.
struct SkinTensors {
    at::Tensor joints;  ///< the bytes of (N, 8) indices
    at::Tensor weights; ///< the bytes of (N, 8) floats
};
SkinTensors skinTensors(const SkinWeights& weights, const c10::Device& device);

/// poseSurfelTensors() with `skin` for the context's weights, on the surfels' device.
SurfelTensors poseSurfelTensors(const std::shared_ptr<const PosingContext>& context, const SkinTensors& skin,
                                const SurfelTensors& canonical, const at::Tensor& radii);

} // namespace ars
