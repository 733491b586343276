#include "engine/metrics/separable_filter.h"

#include "engine/core/parallel.h"

#include <algorithm>
#include <cmath>

namespace ars::detail {
namespace {

int borderIndex(int i, int count, Border border) {
    if (border == Border::Mirror) {
        if (i < 0) i = -1 - i;
        if (i >= count) i = 2 * count - 1 - i;
    }
    return std::clamp(i, 0, count - 1);
}

} // namespace

std::vector<double> gaussianTaps(double sigma, int radius) {
    std::vector<double> taps;
    double sum = 0;
    for (int i = -radius; i <= radius; ++i) {
        taps.push_back(std::exp(-0.5 * i * i / (sigma * sigma)));
        sum += taps.back();
    }
    for (double& tap : taps) tap /= sum;
    return taps;
}

Plane filterSeparable(const Plane& plane, std::span<const double> vertical, std::span<const double> horizontal,
                      Border border) {
    const int width = plane.width, height = plane.height;
    const int up = static_cast<int>(vertical.size() / 2), left = static_cast<int>(horizontal.size() / 2);
    Plane out(width, height);
    // Pieces of a millisecond or so: less is not worth waking threads for.
    const std::size_t grain =
        1 + (std::size_t{1} << 20) / (static_cast<std::size_t>(width) * (vertical.size() + horizontal.size()));
    parallelRanges(static_cast<std::size_t>(height), grain, [&](std::size_t begin, std::size_t end) {
        // One row filtered across the rows, with its borders put on, then along itself.
        std::vector<double> row(static_cast<std::size_t>(width + 2 * left));
        for (std::size_t y = begin; y < end; ++y) {
            double* inner = row.data() + left;
            std::fill(row.begin(), row.end(), 0.0);
            for (int i = -up; i <= up; ++i) {
                const int source = borderIndex(static_cast<int>(y) + i, height, border);
                const double* in =
                    plane.values.data() + static_cast<std::size_t>(source) * static_cast<std::size_t>(width);
                const double tap = vertical[static_cast<std::size_t>(i + up)];
                for (int x = 0; x < width; ++x) inner[x] += tap * in[x];
            }
            for (int x = 1; x <= left; ++x) {
                inner[-x] = inner[borderIndex(-x, width, border)];
                inner[width - 1 + x] = inner[borderIndex(width - 1 + x, width, border)];
            }
            double* to = out.values.data() + y * static_cast<std::size_t>(width);
            for (int j = -left; j <= left; ++j) {
                const double tap = horizontal[static_cast<std::size_t>(j + left)];
                for (int x = 0; x < width; ++x) to[x] += tap * inner[x + j];
            }
        }
    });
    return out;
}

} // namespace ars::detail
