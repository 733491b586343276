#pragma once

#include "engine/core/buffer.h"
#include "engine/shade/tone.h"

namespace ars {

/// Backward of toneMap: dL/dLinear from dL/dDisplay, both with 4 channels, all on `device`; every pixel is written.
/// Nothing passes where a curve is held at its ends. On CUDA the work is queued on the default stream.
/// @return InvalidArgument naming the picture that differs or a parameter out of range; Unavailable for CUDA in a build
///         without it
Status toneMapBackward(const Device& device, const ToneParams& params, ImageView<const float> linear,
                       ImageView<const float> gradDisplay, ImageView<float> gradLinear);

} // namespace ars
