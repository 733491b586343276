#pragma once

#include "engine/core/error.h"
#include "engine/core/image_view.h"
#include "engine/light/prefilter_gradient.h"
#include "engine/shade/shading.h"

namespace ars {

/// Where the gradients of shading go; every pixel of a view that is not empty is written. All on the host.
struct ShadingGradientOutputs {
    ImageView<float> albedo;    ///< 3
    ImageView<float> roughness; ///< 1
    ImageView<float> normal;    ///< 3: of the picture's vector, its length included
    ImageView<float> opacity;   ///< 1
    ImageView<float> occlusion; ///< 1; per unit of O, zero where there is none
};

/// Backward of shade(): dL/d of its pictures and of the light, from dL/dbeauty (docs/math/shading.md, Backward).
///
/// The view direction carries no gradient: a position on the pixel's own ray does not change it.
/// @param gradBeauty  4 channels: dL/d of linear premultiplied colour and opacity
/// @param light       receives dL/d of the levels (resized and set), or null
/// @return InvalidArgument naming the picture whose size or channels differ
Status shadeBackward(const ShadingParams& params, const ShadingInputs& inputs, ImageView<const float> gradBeauty,
                     const ShadingGradientOutputs& outputs, LightLevelGradients* light);

} // namespace ars
