#pragma once

#include "engine/core/buffer.h"
#include "engine/core/error.h"
#include "engine/core/image_view.h"

namespace ars {

/// Finite-difference derivative of ambient occlusion with respect to the occlusion radius (paper Sec. 3.4).
///
/// O, O+ and O- are occlusion maps computed at radii R, R+ and R-; geometry is held fixed, so the derivative is exact
/// per pixel: O(p) depends on R(p) alone.
struct RadiusGradientParams {
    float minOpacity = 1e-3f;     ///< pixels below carry no gradient, [0, 1]
    float minRadiusStepM = 1e-6f; ///< smallest |R+ - R-| that is divided by, metres
};

/// dL/dR from dL/dO. Depth, normal, bone direction and importance receive nothing: O has no other way back.
///
/// All images are (height, width), one channel, on `device`. On CUDA the work is queued on the default stream.
/// @param gradOcclusion  dL/dO
/// @param occlusionPlus, occlusionMinus  O+ and O-, in [0, 1]
/// @param radiusPlus, radiusMinus        R+ and R-, metres
/// @param opacity        splatted opacity, [0, 1]
/// @param gradRadius     receives dL/dR per metre; every pixel is written
/// @return InvalidArgument when the sizes differ, naming both; Unavailable for CUDA in a build without it.
Status backwardRadius(const Device& device, const RadiusGradientParams& params, ImageView<const float> gradOcclusion,
                      ImageView<const float> occlusionPlus, ImageView<const float> occlusionMinus,
                      ImageView<const float> radiusPlus, ImageView<const float> radiusMinus,
                      ImageView<const float> opacity, ImageView<float> gradRadius);

} // namespace ars
