#pragma once

#include "engine/capture/calibration.h"
#include "engine/capture/undistortion_math.h"
#include "engine/io/image.h"

namespace ars {

/// The coefficients of a calibration: k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4 [tx ty]]]] or none. BadFile for another
/// count; Unsupported where thin prism or tilt (s, t) are not 0.
Result<LensDistortion<double>> lensDistortion(const CalibratedCamera& camera);

/// For every pixel of a picture without distortion, taken by the same K: where it lies in the distorted picture.
/// (height, width), 2 channels: u and v in pixels from the left and top edge, as everywhere in this project; NaN where
/// the lens model folds back.
Image undistortionMap(const Camera& camera, const LensDistortion<double>& lens);

/// Bilinear lookup, `map` as above: the result has the map's size and the source's channels. `inside` (1 channel) is 1
/// where all of a lookup's pixels with weight exist, else 0 and the result is the nearest pixel's value (0 for NaN).
/// Colours must be linear: light adds, its encoding does not.
Image resampled(const Image& source, const Image& map, Image& inside);

} // namespace ars
