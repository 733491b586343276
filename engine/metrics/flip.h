#pragma once

#include "engine/metrics/image_metrics.h"

namespace ars {

/// How a person sees the pictures.
struct FlipParams {
    /// Pixels per degree of visual angle. Default: a 0.7 m wide screen of 3840 pixels seen from 0.7 m.
    double pixelsPerDegree = 67.02064327658225;
};

/// LDR-FLIP (Andersson et al. 2020, "FLIP: A Difference Evaluator for Alternating Images"): the difference that a
/// person notices when two pictures alternate in place, [0, 1] per pixel.
///
/// @param reference, test  3 channels, sRGB-encoded; clamped to [0, 1]
/// @param map              1 channel, receives the error; every pixel is written
/// @return InvalidArgument as the measures of image_metrics.h, and for pixels per degree outside [1, 1000].
Status flipMap(Picture reference, Picture test, ImageView<float> map, const FlipParams& params = {});

/// Mean of the map over the pixels that the mask counts. The map itself is that of the whole pictures.
Result<double> meanFlip(Picture reference, Picture test, Picture mask = {}, const FlipParams& params = {});

} // namespace ars
