#pragma once

#include "engine/shade/tone.h"

namespace ars {

/// Backward of toneMap in host memory: dL/dLinear from dL/dDisplay, both with 4 channels. Nothing passes where a curve
/// is held at its ends.
/// @return InvalidArgument naming the picture that differs
Status toneMapBackward(const ToneParams& params, ImageView<const float> linear, ImageView<const float> gradDisplay,
                       ImageView<float> gradLinear);

} // namespace ars
