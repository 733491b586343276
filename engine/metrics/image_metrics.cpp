#include "engine/metrics/image_metrics.h"

#include "engine/metrics/picture_sums.h"

#include <algorithm>
#include <limits>

namespace ars {

namespace detail {

Status checkPair(std::string_view place, Picture a, Picture b, int channels) {
    if (a.empty() || b.empty() || a.width < 1 || a.height < 1 || a.channels < 1) {
        return makeError(ErrorCode::InvalidArgument, std::string(place), "an empty picture");
    }
    if (a.width != b.width || a.height != b.height || a.channels != b.channels) {
        return makeError(ErrorCode::InvalidArgument, std::string(place),
                         fmt::format("pictures of {}x{} with {} channels and {}x{} with {}", a.width, a.height,
                                     a.channels, b.width, b.height, b.channels));
    }
    if (channels != 0 && a.channels != channels) {
        return makeError(ErrorCode::InvalidArgument, std::string(place),
                         fmt::format("pictures with {} channels, expected {}", a.channels, channels));
    }
    return {};
}

Status checkMask(std::string_view place, Picture mask, Picture picture) {
    if (mask.empty()) return {};
    if (mask.width == picture.width && mask.height == picture.height && mask.channels == 1) return {};
    return makeError(ErrorCode::InvalidArgument, std::string(place),
                     fmt::format("a mask of {}x{} with {} channels for pictures of {}x{}, expected the same size and 1",
                                 mask.width, mask.height, mask.channels, picture.width, picture.height));
}

Error noPixelCounts(std::string_view place) {
    return makeError(ErrorCode::InvalidArgument, std::string(place), "no pixel to compare, the mask is empty");
}

Error pixelNotFinite(std::string_view place, Picture picture, std::size_t pixel) {
    const auto width = static_cast<std::size_t>(picture.width);
    return makeError(ErrorCode::InvalidArgument, std::string(place),
                     fmt::format("the pixel in row {}, column {} is not finite", pixel / width, pixel % width));
}

double medianOf(std::vector<double>& values) {
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    if (values.size() % 2 == 1) return *middle;
    return 0.5 * (*middle + *std::max_element(values.begin(), middle));
}

} // namespace detail

using namespace detail;

namespace {

double channelsOf(Picture a) { return static_cast<double>(a.channels); }

Result<double> meanSquareError(std::string_view place, Picture a, Picture b, Picture mask) {
    ARS_TRY_STATUS(checkPair(place, a, b));
    ARS_TRY_STATUS(checkMask(place, mask, a));
    std::size_t pixels = 0;
    ARS_TRY(const auto sums, sumOverPixels<1>(place, a, b, mask, pixels, [&](auto& sum, std::size_t p) {
                for (int c = 0; c < a.channels; ++c) {
                    const double d = static_cast<double>(a.pixel(p)[c]) - static_cast<double>(b.pixel(p)[c]);
                    sum[0] += d * d;
                }
            }));
    return sums[0] / (static_cast<double>(pixels) * channelsOf(a));
}

} // namespace

Result<double> meanAbsoluteError(Picture a, Picture b, Picture mask) {
    constexpr std::string_view kPlace = "mean absolute error";
    ARS_TRY_STATUS(checkPair(kPlace, a, b));
    ARS_TRY_STATUS(checkMask(kPlace, mask, a));
    std::size_t pixels = 0;
    ARS_TRY(const auto sums, sumOverPixels<1>(kPlace, a, b, mask, pixels, [&](auto& sum, std::size_t p) {
                for (int c = 0; c < a.channels; ++c) {
                    sum[0] += std::abs(static_cast<double>(a.pixel(p)[c]) - static_cast<double>(b.pixel(p)[c]));
                }
            }));
    return sums[0] / (static_cast<double>(pixels) * channelsOf(a));
}

Result<double> rootMeanSquareError(Picture a, Picture b, Picture mask) {
    ARS_TRY(const double mse, meanSquareError("root mean square error", a, b, mask));
    return std::sqrt(mse);
}

Result<double> peakSignalToNoise(Picture a, Picture b, Picture mask, double peak) {
    constexpr std::string_view kPlace = "PSNR";
    if (!(peak > 0) || !std::isfinite(peak)) {
        return makeError(ErrorCode::InvalidArgument, std::string(kPlace),
                         fmt::format("a peak of {}, expected more than 0", peak));
    }
    ARS_TRY(const double mse, meanSquareError(kPlace, a, b, mask));
    if (mse == 0) return std::numeric_limits<double>::infinity();
    return 10 * std::log10(peak * peak / mse);
}

Result<double> medianAbsoluteError(Picture a, Picture b, Picture mask) {
    constexpr std::string_view kPlace = "median absolute error";
    ARS_TRY_STATUS(checkPair(kPlace, a, b, 1));
    ARS_TRY_STATUS(checkMask(kPlace, mask, a));
    std::vector<double> errors;
    for (std::size_t p = 0; p < a.pixelCount(); ++p) {
        if (!counts(mask, p)) continue;
        if (!std::isfinite(a[p]) || !std::isfinite(b[p])) return pixelNotFinite(kPlace, a, p);
        errors.push_back(std::abs(static_cast<double>(a[p]) - static_cast<double>(b[p])));
    }
    if (errors.empty()) return noPixelCounts(kPlace);
    return medianOf(errors);
}

Result<double> pearsonCorrelation(Picture a, Picture b, Picture mask) {
    constexpr std::string_view kPlace = "correlation";
    ARS_TRY_STATUS(checkPair(kPlace, a, b));
    ARS_TRY_STATUS(checkMask(kPlace, mask, a));
    std::size_t pixels = 0;
    ARS_TRY(const auto sums, sumOverPixels<2>(kPlace, a, b, mask, pixels, [&](auto& sum, std::size_t p) {
                for (int c = 0; c < a.channels; ++c) {
                    sum[0] += static_cast<double>(a.pixel(p)[c]);
                    sum[1] += static_cast<double>(b.pixel(p)[c]);
                }
            }));
    const double count = static_cast<double>(pixels) * channelsOf(a);
    const double meanA = sums[0] / count, meanB = sums[1] / count;
    // A second pass about the means: sums of squares would cancel for pictures far from 0.
    ARS_TRY(const auto moments, sumOverPixels<3>(kPlace, a, b, mask, pixels, [&](auto& sum, std::size_t p) {
                for (int c = 0; c < a.channels; ++c) {
                    const double da = static_cast<double>(a.pixel(p)[c]) - meanA;
                    const double db = static_cast<double>(b.pixel(p)[c]) - meanB;
                    sum[0] += da * db;
                    sum[1] += da * da;
                    sum[2] += db * db;
                }
            }));
    // Rounding of the mean leaves a trace of variance even where all values are equal.
    const auto constant = [count](double variance, double average) {
        return variance <= 1e-24 * count * average * average || variance == 0;
    };
    if (constant(moments[1], meanA) || constant(moments[2], meanB)) {
        return makeError(ErrorCode::InvalidArgument, std::string(kPlace),
                         "a picture that is constant has no correlation with another");
    }
    return std::clamp(moments[0] / (std::sqrt(moments[1]) * std::sqrt(moments[2])), -1.0, 1.0);
}

Result<double> maskIntersectionOverUnion(Picture a, Picture b) {
    constexpr std::string_view kPlace = "mask IoU";
    ARS_TRY_STATUS(checkPair(kPlace, a, b, 1));
    std::size_t both = 0, either = 0;
    for (std::size_t p = 0; p < a.pixelCount(); ++p) {
        if (!std::isfinite(a[p]) || !std::isfinite(b[p])) return pixelNotFinite(kPlace, a, p);
        const bool inA = a[p] > 0.5f, inB = b[p] > 0.5f;
        both += inA && inB;
        either += inA || inB;
    }
    if (either == 0) return makeError(ErrorCode::InvalidArgument, std::string(kPlace), "both masks are empty");
    return static_cast<double>(both) / static_cast<double>(either);
}

Result<AngularError> angularError(Picture a, Picture b, Picture mask) {
    constexpr std::string_view kPlace = "angular error";
    constexpr double kShortest = 1e-6;
    ARS_TRY_STATUS(checkPair(kPlace, a, b, 3));
    ARS_TRY_STATUS(checkMask(kPlace, mask, a));
    std::vector<double> angles;
    double sum = 0;
    for (std::size_t p = 0; p < a.pixelCount(); ++p) {
        if (!counts(mask, p)) continue;
        const float *u = a.pixel(p), *v = b.pixel(p);
        if (!allFinite(u, 3) || !allFinite(v, 3)) return pixelNotFinite(kPlace, a, p);
        const double x[3] = {u[0], u[1], u[2]}, y[3] = {v[0], v[1], v[2]};
        if (std::hypot(x[0], x[1], x[2]) < kShortest || std::hypot(y[0], y[1], y[2]) < kShortest) continue;
        // atan2 of cross and dot: the arc cosine alone cannot tell angles below a thousandth of a degree.
        const double cross =
            std::hypot(x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]);
        const double dot = x[0] * y[0] + x[1] * y[1] + x[2] * y[2];
        angles.push_back(std::atan2(cross, dot) * (180 / 3.14159265358979323846));
        sum += angles.back();
    }
    if (angles.empty()) {
        return makeError(ErrorCode::InvalidArgument, std::string(kPlace),
                         "no pixel to compare, none that the mask counts has two normals");
    }
    AngularError result;
    result.pixels = angles.size();
    result.meanDeg = sum / static_cast<double>(angles.size());
    result.medianDeg = medianOf(angles);
    return result;
}

} // namespace ars
