#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace ars::detail {

/// One channel in double, row-major.
struct Plane {
    int width = 0;
    int height = 0;
    std::vector<double> values;

    Plane() = default;
    Plane(int w, int h) : width(w), height(h), values(static_cast<std::size_t>(w) * static_cast<std::size_t>(h), 0.0) {}
};

/// What a filter reads beyond the border: the picture mirrored with its edge pixels repeated (c b a | a b c), or the
/// edge pixel alone (a a a | a b c).
enum class Border { Mirror, Repeat };

/// exp(-x^2 / (2 sigma^2)) at -radius..radius, divided by its sum.
std::vector<double> gaussianTaps(double sigma, int radius);

/// Filters columns with `vertical` and rows with `horizontal`, an odd number of taps each:
/// out(y, x) = sum_ij vertical[i] horizontal[j] in(y + i - r, x + j - s). Mirror needs radii of at most the sides.
Plane filterSeparable(const Plane& plane, std::span<const double> vertical, std::span<const double> horizontal,
                      Border border);

} // namespace ars::detail
