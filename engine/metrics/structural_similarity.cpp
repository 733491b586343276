#include "engine/metrics/picture_sums.h"
#include "engine/metrics/separable_filter.h"

namespace ars {

using namespace detail;

namespace {

constexpr std::string_view kPlace = "SSIM";
constexpr int kRadius = 5; ///< the window is 11x11
constexpr double kSigma = 1.5;

/// The map of one channel, row-major, in double.
std::vector<double> channelMap(Picture a, Picture b, int channel, double peak) {
    const auto at = [channel](Picture picture, std::size_t p) {
        return static_cast<double>(picture.pixel(p)[channel]);
    };
    const auto filtered = [&](auto&& value) {
        Plane plane(a.width, a.height);
        for (std::size_t p = 0; p < plane.values.size(); ++p) plane.values[p] = value(p);
        const std::vector<double> window = gaussianTaps(kSigma, kRadius);
        return filterSeparable(plane, window, window, Border::Mirror).values;
    };
    const std::vector<double> meanA = filtered([&](std::size_t p) { return at(a, p); });
    const std::vector<double> meanB = filtered([&](std::size_t p) { return at(b, p); });
    const std::vector<double> squareA = filtered([&](std::size_t p) { return at(a, p) * at(a, p); });
    const std::vector<double> squareB = filtered([&](std::size_t p) { return at(b, p) * at(b, p); });
    const std::vector<double> product = filtered([&](std::size_t p) { return at(a, p) * at(b, p); });
    const double c1 = 0.01 * peak * 0.01 * peak, c2 = 0.03 * peak * 0.03 * peak;
    std::vector<double> map(meanA.size());
    parallelFor(
        map.size(),
        [&](std::size_t p) {
            const double ab = meanA[p] * meanB[p], aa = meanA[p] * meanA[p], bb = meanB[p] * meanB[p];
            map[p] = (2 * ab + c1) * (2 * (product[p] - ab) + c2) /
                     ((aa + bb + c1) * (squareA[p] - aa + squareB[p] - bb + c2));
        },
        16384);
    return map;
}

/// Windows read their whole neighbourhood, so every pixel must be finite, counted or not.
Status checkSsim(Picture a, Picture b, const SsimParams& params) {
    ARS_TRY_STATUS(checkPair(kPlace, a, b));
    if (!(params.peak > 0) || !std::isfinite(params.peak)) {
        return makeError(ErrorCode::InvalidArgument, std::string(kPlace),
                         fmt::format("a peak of {}, expected more than 0", params.peak));
    }
    if (a.width <= 2 * kRadius || a.height <= 2 * kRadius) {
        return makeError(ErrorCode::InvalidArgument, std::string(kPlace),
                         fmt::format("pictures of {}x{}, smaller than the window of 11x11", a.width, a.height));
    }
    for (std::size_t p = 0; p < a.pixelCount(); ++p) {
        if (!allFinite(a.pixel(p), a.channels) || !allFinite(b.pixel(p), b.channels))
            return pixelNotFinite(kPlace, a, p);
    }
    return {};
}

} // namespace

Result<double> structuralSimilarity(Picture a, Picture b, Picture mask, const SsimParams& params) {
    ARS_TRY_STATUS(checkSsim(a, b, params));
    ARS_TRY_STATUS(checkMask(kPlace, mask, a));
    double sum = 0;
    std::size_t pixels = 0;
    for (int channel = 0; channel < a.channels; ++channel) {
        const std::vector<double> map = channelMap(a, b, channel, params.peak);
        for (int y = kRadius; y < a.height - kRadius; ++y) {
            for (int x = kRadius; x < a.width - kRadius; ++x) {
                const auto p =
                    static_cast<std::size_t>(y) * static_cast<std::size_t>(a.width) + static_cast<std::size_t>(x);
                if (!counts(mask, p)) continue;
                sum += map[p];
                ++pixels;
            }
        }
    }
    if (pixels == 0) return noPixelCounts(kPlace);
    return sum / static_cast<double>(pixels);
}

Status structuralSimilarityMap(Picture a, Picture b, ImageView<float> map, const SsimParams& params) {
    ARS_TRY_STATUS(checkSsim(a, b, params));
    ARS_TRY_STATUS(checkPair(kPlace, a, map));
    for (int channel = 0; channel < a.channels; ++channel) {
        const std::vector<double> values = channelMap(a, b, channel, params.peak);
        for (std::size_t p = 0; p < values.size(); ++p) map.pixel(p)[channel] = static_cast<float>(values[p]);
    }
    return {};
}

} // namespace ars
