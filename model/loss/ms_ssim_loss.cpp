#include "model/loss/known_gradient.h"
#include "model/loss/losses.h"
#include "model/loss/perceptual.h"

#include <ATen/Dispatch.h>

#include <algorithm>
#include <array>
#include <cmath>

/// The stand-in for LPIPS (docs/math/losses.md). Rows are filtered as flat arrays of 3 x width numbers, so that
/// channels need no loop of their own.
namespace ars {
namespace {

constexpr int kRadius = 5;
constexpr int kTaps = 2 * kRadius + 1;
constexpr double kSigma = 1.5;
constexpr double kC1 = 0.01 * 0.01, kC2 = 0.03 * 0.03;
/// Wang, Simoncelli, Bovik 2003; of fewer scales the first ones, divided by their sum.
constexpr std::array<double, 5> kScaleWeights{0.0448, 0.2856, 0.3001, 0.2363, 0.1333};
/// Means below have no power that could be differentiated.
constexpr double kLeastSimilarity = 1e-4;

template <typename T>
std::array<T, kTaps> gaussian() {
    std::array<double, kTaps> taps{};
    double sum = 0;
    for (int k = 0; k < kTaps; ++k) sum += taps[k] = std::exp(-(k - kRadius) * (k - kRadius) / (2 * kSigma * kSigma));
    std::array<T, kTaps> result{};
    for (int k = 0; k < kTaps; ++k) result[k] = static_cast<T>(taps[k] / sum);
    return result;
}

template <typename T>
struct Plane {
    std::int64_t height = 0, width = 0; ///< width in numbers: 3 a pixel
    std::vector<T> values;
    Plane() = default;
    Plane(std::int64_t h, std::int64_t w) : height(h), width(w), values(static_cast<std::size_t>(h * w)) {}
    T* row(std::int64_t y) { return values.data() + y * width; }
    const T* row(std::int64_t y) const { return values.data() + y * width; }
};

/// One scale of the two pictures; what SSIM says of it.
template <typename T>
struct Scale {
    Plane<T> a, b;
    std::array<double, 3> means{}; ///< per channel: of cs, at the last scale of l cs
    Plane<T> gradient;             ///< d(sum of the map)/da, per channel
    std::int64_t count = 0;        ///< pixels of the map
};

/// out[i] = sum_k taps[k] in[i + 3 k]
template <typename T>
void filterRow(const T* in, const std::array<T, kTaps>& taps, std::int64_t count, T* out) {
    std::fill_n(out, count, T(0));
    for (int k = 0; k < kTaps; ++k) {
        const T tap = taps[k];
        const T* shifted = in + 3 * k;
#pragma omp simd
        for (std::int64_t i = 0; i < count; ++i) out[i] += tap * shifted[i];
    }
}

/// Its adjoint: out[i + 3 k] += taps[k] in[i].
template <typename T>
void spreadRow(const T* in, const std::array<T, kTaps>& taps, std::int64_t count, T* out) {
    std::fill_n(out, count + 3 * (kTaps - 1), T(0));
    for (int k = 0; k < kTaps; ++k) {
        const T tap = taps[k];
        T* shifted = out + 3 * k;
#pragma omp simd
        for (std::int64_t i = 0; i < count; ++i) shifted[i] += tap * in[i];
    }
}

/// What the windows around one row of pixels hold: means of a, b, a^2 + b^2 and a b.
template <typename T>
struct WindowRow {
    std::vector<T> columns[4], windows[4];

    explicit WindowRow(std::int64_t width) {
        for (auto& c : columns) c.resize(static_cast<std::size_t>(width));
        for (auto& w : windows) w.resize(static_cast<std::size_t>(width));
    }
    void fill(const Plane<T>& a, const Plane<T>& b, const std::array<T, kTaps>& taps, std::int64_t y) {
        const std::int64_t width = a.width;
        for (auto& c : columns) std::fill(c.begin(), c.end(), T(0));
        T *ma = columns[0].data(), *mb = columns[1].data(), *ms = columns[2].data(), *mp = columns[3].data();
        for (int k = 0; k < kTaps; ++k) {
            const T tap = taps[k];
            const T *pa = a.row(y + k), *pb = b.row(y + k);
#pragma omp simd
            for (std::int64_t i = 0; i < width; ++i) {
                ma[i] += tap * pa[i];
                mb[i] += tap * pb[i];
                ms[i] += tap * (pa[i] * pa[i] + pb[i] * pb[i]);
                mp[i] += tap * (pa[i] * pb[i]);
            }
        }
        for (int f = 0; f < 4; ++f) filterRow(columns[f].data(), taps, width - 3 * (kTaps - 1), windows[f].data());
    }
};

/// The map of a row; where wanted, its derivatives by the windows' means of a, a^2 + b^2 and a b.
template <typename T>
void similarityRow(const WindowRow<T>& w, std::int64_t count, bool luminance, T* map, T* byMean, T* bySquares,
                   T* byProducts) {
    const T c1 = static_cast<T>(kC1), c2 = static_cast<T>(kC2);
    const T *ma = w.windows[0].data(), *mb = w.windows[1].data(), *ms = w.windows[2].data(), *mp = w.windows[3].data();
#pragma omp simd
    for (std::int64_t i = 0; i < count; ++i) {
        const T squares = ma[i] * ma[i] + mb[i] * mb[i], product = ma[i] * mb[i];
        const T spread = T(1) / (ms[i] - squares + c2);
        const T cs = (T(2) * (mp[i] - product) + c2) * spread;
        const T bright = T(1) / (squares + c1);
        const T l = luminance ? (T(2) * product + c1) * bright : T(1);
        const T byMeanOfL = luminance ? T(2) * (mb[i] - l * ma[i]) * bright : T(0);
        map[i] = l * cs;
        byMean[i] = T(2) * l * (cs * ma[i] - mb[i]) * spread + cs * byMeanOfL;
        bySquares[i] = -l * cs * spread;
        byProducts[i] = T(2) * l * spread;
    }
}

/// da += taps' adjoint of the three derivative maps: byMean + 2 a bySquares + b byProducts.
template <typename T>
void similarityBackward(const Scale<T>& scale, const std::array<Plane<T>, 3>& maps, const std::array<T, kTaps>& taps,
                        Plane<T>& gradient) {
    const std::int64_t inner = maps[0].width, width = scale.a.width;
    parallelRanges(static_cast<std::size_t>(scale.a.height), detail::kRowGrain,
                   [&](std::size_t begin, std::size_t end) {
                       std::vector<T> columns(static_cast<std::size_t>(inner)), spread[3];
                       for (auto& s : spread) s.resize(static_cast<std::size_t>(width));
                       for (auto y = static_cast<std::int64_t>(begin); y < static_cast<std::int64_t>(end); ++y) {
                           for (int f = 0; f < 3; ++f) {
                               std::fill(columns.begin(), columns.end(), T(0));
                               for (int k = 0; k < kTaps; ++k) {
                                   if (y - k < 0 || y - k >= maps[f].height) continue;
                                   const T tap = taps[k];
                                   const T* in = maps[f].row(y - k);
                                   T* out = columns.data();
#pragma omp simd
                                   for (std::int64_t i = 0; i < inner; ++i) out[i] += tap * in[i];
                               }
                               spreadRow(columns.data(), taps, inner, spread[f].data());
                           }
                           const T *pa = scale.a.row(y), *pb = scale.b.row(y);
                           const T *s0 = spread[0].data(), *s1 = spread[1].data(), *s2 = spread[2].data();
                           T* out = gradient.row(y);
#pragma omp simd
                           for (std::int64_t i = 0; i < width; ++i)
                               out[i] = s0[i] + T(2) * pa[i] * s1[i] + pb[i] * s2[i];
                       }
                   });
}

template <typename T>
void similarity(Scale<T>& scale, bool luminance, bool wantGradient) {
    const auto taps = gaussian<T>();
    const std::int64_t height = scale.a.height - kTaps + 1, width = scale.a.width - 3 * (kTaps - 1);
    std::array<Plane<T>, 3> maps;
    if (wantGradient) maps.fill(Plane<T>(height, width));
    std::vector<std::array<double, 3>> rows(static_cast<std::size_t>(height));
    parallelRanges(rows.size(), detail::kRowGrain, [&](std::size_t begin, std::size_t end) {
        WindowRow<T> windows(scale.a.width);
        std::vector<T> map(static_cast<std::size_t>(width)), unused[3];
        for (auto& u : unused) u.resize(wantGradient ? 0 : map.size());
        for (std::size_t y = begin; y < end; ++y) {
            const auto row = static_cast<std::int64_t>(y);
            windows.fill(scale.a, scale.b, taps, row);
            T* derivatives[3];
            for (int f = 0; f < 3; ++f) derivatives[f] = wantGradient ? maps[f].row(row) : unused[f].data();
            similarityRow(windows, width, luminance, map.data(), derivatives[0], derivatives[1], derivatives[2]);
            for (std::size_t i = 0; i < map.size(); ++i) rows[y][i % 3] += map[i];
        }
    });
    scale.count = height * (width / 3);
    for (const auto& row : rows) {
        for (int c = 0; c < 3; ++c) scale.means[c] += row[c] / static_cast<double>(scale.count);
    }
    if (!wantGradient) return;
    scale.gradient = Plane<T>(scale.a.height, scale.a.width);
    similarityBackward(scale, maps, taps, scale.gradient);
}

/// Means of 2 x 2 pixels; an odd last row or column is left out.
template <typename T>
Plane<T> halved(const Plane<T>& plane) {
    Plane<T> half(plane.height / 2, plane.width / 3 / 2 * 3);
    parallelFor(
        static_cast<std::size_t>(half.height),
        [&](std::size_t y) {
            const auto row = static_cast<std::int64_t>(y);
            const T *top = plane.row(2 * row), *bottom = plane.row(2 * row + 1);
            T* out = half.row(row);
            for (std::int64_t x = 0; x < half.width / 3; ++x) {
                for (int c = 0; c < 3; ++c) {
                    const std::int64_t i = 6 * x + c;
                    out[3 * x + c] = T(0.25) * ((top[i] + top[i + 3]) + (bottom[i] + bottom[i + 3]));
                }
            }
        },
        detail::kRowGrain);
    return half;
}

/// fine = factor[channel] fine + what the coarser scale passes to its four pixels.
template <typename T>
void gatherGradient(Plane<T>& fine, const std::array<double, 3>& factor, const Plane<T>* coarse) {
    parallelFor(
        static_cast<std::size_t>(fine.height),
        [&](std::size_t y) {
            const auto row = static_cast<std::int64_t>(y);
            T* out = fine.row(row);
            const bool below = coarse && row / 2 < coarse->height;
            for (std::int64_t x = 0; x < fine.width / 3; ++x) {
                for (int c = 0; c < 3; ++c) {
                    out[3 * x + c] *= static_cast<T>(factor[c]);
                    if (below && 3 * (x / 2) < coarse->width)
                        out[3 * x + c] += T(0.25) * coarse->row(row / 2)[3 * (x / 2) + c];
                }
            }
        },
        detail::kRowGrain);
}

std::size_t scaleCount(std::int64_t height, std::int64_t width) {
    std::size_t count = 0;
    for (std::int64_t side = std::min(height, width); side >= kTaps && count < kScaleWeights.size(); side /= 2) ++count;
    return count;
}

template <typename T>
std::vector<Scale<T>> scalesOf(const at::Tensor& a, const at::Tensor& b, std::size_t count) {
    std::vector<Scale<T>> scales(count);
    for (std::size_t s = 0; s < count; ++s) {
        if (s > 0) {
            scales[s].a = halved(scales[s - 1].a);
            scales[s].b = halved(scales[s - 1].b);
            continue;
        }
        scales[0].a = Plane<T>(a.size(0), 3 * a.size(1));
        scales[0].b = scales[0].a;
        std::copy_n(a.const_data_ptr<T>(), a.numel(), scales[0].a.values.data());
        std::copy_n(b.const_data_ptr<T>(), b.numel(), scales[0].b.values.data());
    }
    return scales;
}

/// (1 - MS-SSIM) / 2 and, where wanted, its gradient by the first picture.
template <typename T>
double multiScale(const at::Tensor& a, const at::Tensor& b, at::Tensor* gradient) {
    const std::size_t count = scaleCount(a.size(0), a.size(1));
    std::vector<Scale<T>> scales = scalesOf<T>(a, b, count);
    double weightSum = 0;
    for (std::size_t s = 0; s < count; ++s) {
        similarity(scales[s], s + 1 == count, gradient != nullptr);
        weightSum += kScaleWeights[s];
    }
    double mean = 0;
    std::array<double, 3> products{};
    for (std::size_t c = 0; c < 3; ++c) {
        products[c] = 1;
        for (std::size_t s = 0; s < count; ++s) {
            // Not max(): it would turn a mean that is no number into one.
            const double similarityMean = scales[s].means[c] < kLeastSimilarity ? kLeastSimilarity : scales[s].means[c];
            products[c] *= std::pow(similarityMean, kScaleWeights[s] / weightSum);
        }
        mean += products[c] / 3;
    }
    const Plane<T>* coarse = nullptr;
    for (std::size_t s = count; gradient && s-- > 0;) {
        std::array<double, 3> factor{};
        for (std::size_t c = 0; c < 3; ++c) {
            if (scales[s].means[c] < kLeastSimilarity) continue;
            factor[c] = -0.5 / 3 * kScaleWeights[s] / weightSum * products[c] /
                        (scales[s].means[c] * static_cast<double>(scales[s].count));
        }
        gatherGradient(scales[s].gradient, factor, coarse);
        coarse = &scales[s].gradient;
    }
    if (gradient) {
        *gradient = at::empty_like(a);
        std::copy_n(scales[0].gradient.values.data(), a.numel(), gradient->data_ptr<T>());
    }
    return 0.5 * (1 - mean);
}

class MsSsimGradientLoss final : public PerceptualLoss {
public:
    std::string name() const override { return "ms_ssim_gradient"; }

    at::Tensor evaluate(const at::Tensor& picture, const at::Tensor& target) const override {
        TORCH_CHECK(picture.dim() == 3 && picture.size(2) == 3 && picture.sizes() == target.sizes(),
                    "ms_ssim_gradient: expected two pictures (height, width, 3), found ", picture.sizes(), " and ",
                    target.sizes());
        const at::Tensor edges = totalVariation(picture - target.detach(), {});
        if (scaleCount(picture.size(0), picture.size(1)) == 0) return edges;
        const at::Tensor a = detail::onHost(picture);
        const at::Tensor b = detail::onHost(target).to(a.scalar_type());
        at::Tensor gradient;
        double value = 0;
        AT_DISPATCH_FLOATING_TYPES(a.scalar_type(), "ms_ssim_gradient", [&] {
            value = multiScale<scalar_t>(a, b, detail::wantsGradient(picture) ? &gradient : nullptr);
        });
        return detail::lossOf(value, 1.0, {picture, gradient}) + edges;
    }
};

} // namespace

std::unique_ptr<PerceptualLoss> msSsimGradientLoss() { return std::make_unique<MsSsimGradientLoss>(); }

} // namespace ars
