#pragma once

#include "engine/core/parallel.h"
#include "engine/metrics/image_metrics.h"

#include <array>
#include <cmath>
#include <string_view>
#include <vector>

namespace ars::detail {

/// InvalidArgument unless both are whole pictures of one size and number of channels (`channels` of them, unless 0).
Status checkPair(std::string_view place, Picture a, Picture b, int channels = 0);
/// InvalidArgument unless the mask is absent or has the size of `picture` and one channel.
Status checkMask(std::string_view place, Picture mask, Picture picture);

inline bool counts(Picture mask, std::size_t pixel) { return mask.empty() || mask[pixel] > 0.5f; }

inline bool allFinite(const float* values, int count) {
    for (int i = 0; i < count; ++i) {
        if (!std::isfinite(values[i])) return false;
    }
    return true;
}

Error noPixelCounts(std::string_view place);
Error pixelNotFinite(std::string_view place, Picture picture, std::size_t pixel);

/// Adds up what `add(sums, pixel)` puts into N sums, over the pixels that count. Row by row in double, the rows one
/// after another: the same for any number of threads. InvalidArgument when no pixel counts, or where one is not finite.
template <std::size_t N, typename Add>
Result<std::array<double, N>> sumOverPixels(std::string_view place, Picture a, Picture b, Picture mask,
                                            std::size_t& pixels, Add&& add) {
    constexpr std::size_t kNone = ~std::size_t{0};
    struct Row {
        std::array<double, N> sums{};
        std::size_t pixels = 0;
        std::size_t bad = kNone;
    };
    std::vector<Row> rows(static_cast<std::size_t>(a.height));
    parallelFor(
        rows.size(),
        [&](std::size_t y) {
            Row row;
            for (int x = 0; x < a.width && row.bad == kNone; ++x) {
                const std::size_t p = y * static_cast<std::size_t>(a.width) + static_cast<std::size_t>(x);
                if (!counts(mask, p)) continue;
                if (!allFinite(a.pixel(p), a.channels) || !allFinite(b.pixel(p), b.channels)) row.bad = p;
                add(row.sums, p);
                ++row.pixels;
            }
            rows[y] = row;
        },
        16);
    std::array<double, N> sums{};
    pixels = 0;
    for (const Row& row : rows) {
        if (row.bad != kNone) return pixelNotFinite(place, a, row.bad);
        for (std::size_t i = 0; i < N; ++i) sums[i] += row.sums[i];
        pixels += row.pixels;
    }
    if (pixels == 0) return noPixelCounts(place);
    return sums;
}

/// Of an even count the mean of the middle two. Not empty; the order is lost.
double medianOf(std::vector<double>& values);

} // namespace ars::detail
