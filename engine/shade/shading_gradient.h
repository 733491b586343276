#pragma once

#include "engine/core/error.h"
#include "engine/core/image_view.h"
#include "engine/light/prefilter_gradient.h"
#include "engine/shade/shading.h"

namespace ars {

/// Where the gradients of shading go; every pixel of a view that is not empty is written. All on one device.
struct ShadingGradientOutputs {
    ImageView<float> albedo;      ///< 3
    ImageView<float> roughness;   ///< 1
    ImageView<float> normal;      ///< 3: of the picture's vector, its length included
    ImageView<float> opacity;     ///< 1
    ImageView<float> occlusion;   ///< 1; per unit of O, zero where there is none
    LightLevelViews<float> light; ///< every texel of the levels and the diffuse cube; left out with 0 levels
};

/// Scratch memory of a device, kept between steps: keep one for each pipeline; never use one from two threads at once.
struct ShadingGradientWorkspace {
    Buffer light; ///< the light's gradient while it is summed
};

/// Backward of shade(): dL/d of its pictures and of the light, from dL/dbeauty (docs/math/shading.md, Backward).
///
/// The view direction carries no gradient: a position on the pixel's own ray does not change it. The same numbers come
/// out each time on either device, whatever the number of threads.
/// @param device      of everything; on CUDA the work is queued on the default stream
/// @param gradBeauty  4 channels: dL/d of linear premultiplied colour and opacity
/// @return InvalidArgument naming the picture whose size or channels differ; OutOfMemory; Unavailable for CUDA in a
///         build without it
Status shadeBackward(const Device& device, const ShadingParams& params, const ShadingInputs& inputs,
                     ImageView<const float> gradBeauty, const ShadingGradientOutputs& outputs,
                     ShadingGradientWorkspace& workspace);

} // namespace ars
