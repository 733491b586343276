#pragma once

#include "engine/core/error.h"
#include "engine/core/image_view.h"

#include <cstddef>

namespace ars {

/// Measures of how far one picture is from another. Pictures are (height, width, channels) floats in host memory; sums
/// are taken in double, in an order that does not depend on the number of threads.
///
/// A mask is a picture of the same size with one channel; pixels above 0.5 count. An empty view (no data) counts all.
/// Every measure returns InvalidArgument, never a number that means nothing, when sizes or channels differ (naming
/// both), when a picture is empty, when no pixel counts, or when a pixel that counts is not finite (naming it).
using Picture = ImageView<const float>;

/// Mean of |a - b| over pixels and channels.
Result<double> meanAbsoluteError(Picture a, Picture b, Picture mask = {});
/// Square root of the mean of (a - b)^2 over pixels and channels.
Result<double> rootMeanSquareError(Picture a, Picture b, Picture mask = {});
/// 10 log10(peak^2 / mean squared error) in dB; +infinity for equal pictures.
Result<double> peakSignalToNoise(Picture a, Picture b, Picture mask = {}, double peak = 1.0);
/// Median of |a - b|, one channel: for depth, metres. Of an even count the mean of the middle two.
Result<double> medianAbsoluteError(Picture a, Picture b, Picture mask = {});
/// Pearson's correlation over pixels and channels. InvalidArgument when either picture is constant where it counts.
Result<double> pearsonCorrelation(Picture a, Picture b, Picture mask = {});

/// Structural similarity (Wang et al. 2004): Gaussian window of 11x11 pixels with sigma 1.5, C1 = (0.01 peak)^2,
/// C2 = (0.03 peak)^2, variances without Bessel's correction.
struct SsimParams {
    double peak = 1.0; ///< range of the values
};
/// Mean over channels of the SSIM map's mean, over the pixels whose window lies inside the picture (and which the mask
/// counts), as in the authors' code and scikit-image. The mask picks where the map is averaged; windows at its border
/// see both sides. InvalidArgument also for a picture smaller than 11x11.
Result<double> structuralSimilarity(Picture a, Picture b, Picture mask = {}, const SsimParams& params = {});
/// The map itself, (height, width, channels); borders mirror the picture, edge pixels repeated.
Status structuralSimilarityMap(Picture a, Picture b, ImageView<float> map, const SsimParams& params = {});

/// Intersection over union of two masks (one channel, above 0.5 is inside). InvalidArgument when both are empty.
Result<double> maskIntersectionOverUnion(Picture a, Picture b);

/// Angles between normals.
struct AngularError {
    double meanDeg = 0;
    double medianDeg = 0;
    std::size_t pixels = 0; ///< that were compared
};
/// Three channels; lengths do not matter. Pixels where either vector is shorter than 1e-6 are left out.
Result<AngularError> angularError(Picture a, Picture b, Picture mask = {});

} // namespace ars
