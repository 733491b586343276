#pragma once

#include "engine/core/camera.h"
#include "engine/core/error.h"
#include "engine/core/image_view.h"
#include "engine/light/light_math.h"

namespace ars {

/// Deferred split-sum shading (paper eq. for C_diff and C_spec; docs/math/shading.md).
struct ShadingParams {
    bool occlude = true;         ///< multiply by ambient occlusion where it is given
    bool occludeSpecular = true; ///< the paper's reading; false occludes the diffuse part alone
    float f0 = 0.04f;            ///< reflectance at normal incidence of every surface

    bool operator==(const ShadingParams&) const = default;
};

/// All pictures have one size and lie on one device; `light` is of that device, too.
struct ShadingInputs {
    ImageView<const float> albedo;    ///< 3, linear
    ImageView<const float> roughness; ///< 1; taken into [0.08, 1]
    ImageView<const float> normal;    ///< 3, camera space, of any length but zero
    ImageView<const float> opacity;   ///< 1
    ImageView<const float> occlusion; ///< 1, 1 is open; may be empty
    ImageView<const float> position;  ///< 3, world, metres; may be empty: then the pixel's ray is the view direction,
                                      ///< which is the same for positions that were made of depth
    Camera camera;                    ///< of the pictures' size
    LightView<float> light;
};

/// What is wanted; empty views are left out. Every pixel is written; where opacity is below kMinOpacity all are 0.
struct ShadingOutputs {
    ImageView<float> beauty;     ///< 4: linear radiance, premultiplied by opacity, and opacity
    ImageView<float> diffuse;    ///< 3: linear, not premultiplied; occluded as the parameters say
    ImageView<float> specular;   ///< 3: linear, not premultiplied; diffuse + specular = beauty / opacity
    ImageView<float> unoccluded; ///< 3: linear, not premultiplied; the sum of both before occlusion
};

/// C = O (albedo E(n) + S(r, roughness) (F0 A + B)). Pixels whose inputs are not finite or whose normal is zero become
/// (0, 0, 0, opacity); an opacity that is not finite counts as 0.
///
/// @return InvalidArgument naming the picture whose size or channels differ, a missing input, or a bad camera.
Status shade(const Device& device, const ShadingParams& params, const ShadingInputs& inputs,
             const ShadingOutputs& outputs);

} // namespace ars
