#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace ars::kernels {

/// Rows of the filters of a StyleUNet over channels-last memory, [row][column][channel]; T is float, and double in
/// gradient tests. Forward and backward of one thing stand side by side. S is what memory holds: T, or bfloat16 in the
/// form that does not train. Every function is inlined into a caller that was compiled for the machine's vectors.
#define ARS_ROW_KERNEL __attribute__((always_inline)) inline

inline constexpr double kSlope = 0.2;
inline constexpr double kGain = 1.4142135623730951;

struct BlurShape {
    std::int64_t height, width, channels, outHeight, outWidth;
    std::int64_t before; ///< zeros above and on the left
};

/// Numbers of scratch that blurRow needs: one input row with the zeros on both its sides.
inline std::size_t blurScratch(const BlurShape& shape) {
    return static_cast<std::size_t>((shape.outWidth + 3) * shape.channels);
}

/// Row `row` of gain * blur: first down the columns into `scratch`, then along it.
template <typename S, typename T, typename Out>
ARS_ROW_KERNEL void blurRow(const BlurShape& shape, const S* source, std::int64_t row, T gain, T* scratch, Out* out) {
    const std::int64_t rowNumbers = shape.width * shape.channels;
    const std::int64_t left = shape.before * shape.channels;
    const std::int64_t all = (shape.outWidth + 3) * shape.channels;
    const T outer = gain / T(64), inner = gain * T(3) / T(64);
    std::fill(scratch, scratch + left, T(0));
    std::fill(scratch + left + rowNumbers, scratch + all, T(0));
    T* middle = scratch + left;
    const std::int64_t top = row - shape.before;
    if (top >= 0 && top + 3 < shape.height) {
        const S *a = source + top * rowNumbers, *b = a + rowNumbers, *c = b + rowNumbers, *d = c + rowNumbers;
#pragma omp simd
        for (std::int64_t i = 0; i < rowNumbers; ++i) {
            middle[i] = outer * (static_cast<T>(a[i]) + static_cast<T>(d[i])) +
                        inner * (static_cast<T>(b[i]) + static_cast<T>(c[i]));
        }
    } else {
        std::fill(middle, middle + rowNumbers, T(0));
        for (int t = 0; t < 4; ++t) {
            if (top + t < 0 || top + t >= shape.height) continue;
            const S* line = source + (top + t) * rowNumbers;
            const T tap = t == 0 || t == 3 ? outer : inner;
#pragma omp simd
            for (std::int64_t i = 0; i < rowNumbers; ++i) middle[i] += tap * static_cast<T>(line[i]);
        }
    }
    const std::int64_t c = shape.channels;
#pragma omp simd
    for (std::int64_t i = 0; i < shape.outWidth * c; ++i) {
        out[i] = static_cast<Out>((scratch[i] + scratch[i + 3 * c]) + T(3) * (scratch[i + c] + scratch[i + 2 * c]));
    }
}

/// Slopes of an activation: sqrt(2) and 0.2 sqrt(2) where networks train, 1 and 0.2 where the gain is in the weights.
template <typename T>
struct Slopes {
    T positive, negative;
};

template <typename In, typename S, typename T>
ARS_ROW_KERNEL void activateRow(const In* x, const S* other, const T* noise, T strength, const T* bias,
                                std::int64_t width, std::int64_t channels, Slopes<T> slopes, S* out) {
    for (std::int64_t p = 0; p < width; ++p) {
        const T shift = noise ? strength * noise[p] : T(0);
        const std::int64_t at = p * channels;
        if (other) {
#pragma omp simd
            for (std::int64_t c = 0; c < channels; ++c) {
                const T value = static_cast<T>(x[at + c]) + (bias[c] + shift) + static_cast<T>(other[at + c]);
                out[at + c] = static_cast<S>(value * (value > T(0) ? slopes.positive : slopes.negative));
            }
        } else {
#pragma omp simd
            for (std::int64_t c = 0; c < channels; ++c) {
                const T value = static_cast<T>(x[at + c]) + (bias[c] + shift);
                out[at + c] = static_cast<S>(value * (value > T(0) ? slopes.positive : slopes.negative));
            }
        }
    }
}

/// dL/dx from the output's sign; the row's sums for bias and, channel by channel, for noise strength, added to.
template <typename T>
ARS_ROW_KERNEL void activateRowBackward(const T* y, const T* gradient, const T* noise, std::int64_t width,
                                        std::int64_t channels, T* lower, T* biasSum, T* noiseSum) {
    for (std::int64_t p = 0; p < width; ++p) {
        const T here = noise ? noise[p] : T(0);
        const std::int64_t at = p * channels;
#pragma omp simd
        for (std::int64_t c = 0; c < channels; ++c) {
            const T value = gradient[at + c] * (y[at + c] > T(0) ? T(kGain) : T(kSlope * kGain));
            lower[at + c] = value;
            biasSum[c] += value;
            noiseSum[c] += value * here;
        }
    }
}

/// Rows 2 row and 2 row + 1 of the inverse Haar transform plus the doubled previous image (zero insertion,
/// [1,3,3,1]/4).
template <typename T>
ARS_ROW_KERNEL void subbandRows(const T* bands, const T* previous, std::int64_t height, std::int64_t width,
                                std::int64_t channels, std::int64_t row, T* scratch, T* out) {
    const std::int64_t rowNumbers = width * channels;
    const std::int64_t padded = rowNumbers + 2 * channels;
    T* lines[2] = {out + 2 * row * 2 * rowNumbers, out + (2 * row + 1) * 2 * rowNumbers};
    std::fill(scratch, scratch + 2 * padded, T(0));
    if (previous) {
        const T* middle = previous + row * rowNumbers;
        for (int h = 0; h < 2; ++h) {
            T* line = scratch + h * padded + channels;
            const std::int64_t neighbour = h == 0 ? row - 1 : row + 1;
            const bool inside = neighbour >= 0 && neighbour < height;
            const T* next = previous + (inside ? neighbour : row) * rowNumbers;
            const T share = inside ? T(0.25) : T(0);
            for (std::int64_t i = 0; i < rowNumbers; ++i) line[i] = T(0.75) * middle[i] + share * next[i];
        }
    }
    const T* band = bands + row * width * 4 * channels;
    for (std::int64_t p = 0; p < width; ++p) {
        const T* ll = band + p * 4 * channels;
        for (std::int64_t c = 0; c < channels; ++c) {
            const T a = ll[c], b = ll[c + channels], d = ll[c + 2 * channels], e = ll[c + 3 * channels];
            const T haar[2][2] = {{T(0.5) * ((a + b) + (d + e)), T(0.5) * ((a + b) - (d + e))},
                                  {T(0.5) * ((a - b) + (d - e)), T(0.5) * ((a - b) - (d - e))}};
            for (int h = 0; h < 2; ++h) {
                const T* old = scratch + h * padded + (p + 1) * channels + c;
                lines[h][2 * p * channels + c] = haar[h][0] + (T(0.25) * old[-channels] + T(0.75) * old[0]);
                lines[h][(2 * p + 1) * channels + c] = haar[h][1] + (T(0.75) * old[0] + T(0.25) * old[channels]);
            }
        }
    }
}

/// Row `row` of the subbands' gradient: the Haar transform of the image's, which is its inverse's transpose.
template <typename T>
ARS_ROW_KERNEL void subbandRowsBackward(const T* gradient, std::int64_t, std::int64_t width, std::int64_t channels,
                                        std::int64_t row, T* bands) {
    const T* upper = gradient + 2 * row * 2 * width * channels;
    const T* lower = upper + 2 * width * channels;
    T* band = bands + row * width * 4 * channels;
    for (std::int64_t p = 0; p < width; ++p) {
        for (std::int64_t c = 0; c < channels; ++c) {
            const std::int64_t at = 2 * p * channels + c;
            const T a = upper[at], b = upper[at + channels], d = lower[at], e = lower[at + channels];
            T* to = band + p * 4 * channels + c;
            to[0] = T(0.5) * ((a + b) + (d + e));
            to[channels] = T(0.5) * ((a + b) - (d + e));
            to[2 * channels] = T(0.5) * ((a - b) + (d - e));
            to[3 * channels] = T(0.5) * ((a - b) - (d - e));
        }
    }
}

/// Row `row` of the previous image's gradient: transpose of the doubling.
template <typename T>
ARS_ROW_KERNEL void upsampleRowBackward(const T* gradient, std::int64_t height, std::int64_t width,
                                        std::int64_t channels, std::int64_t row, T* scratch, T* previous) {
    const std::int64_t rowNumbers = 2 * width * channels;
    T* line = scratch + channels;
    std::fill(scratch, scratch + rowNumbers + 2 * channels, T(0));
    const T taps[4] = {T(0.25), T(0.75), T(0.75), T(0.25)};
    for (int t = 0; t < 4; ++t) {
        const std::int64_t from = 2 * row - 1 + t;
        if (from < 0 || from >= 2 * height) continue;
        const T* source = gradient + from * rowNumbers;
        for (std::int64_t i = 0; i < rowNumbers; ++i) line[i] += taps[t] * source[i];
    }
    for (std::int64_t p = 0; p < width; ++p) {
        for (std::int64_t c = 0; c < channels; ++c) {
            const T* at = line + 2 * p * channels + c;
            previous[(row * width + p) * channels + c] =
                T(0.75) * (at[0] + at[channels]) + T(0.25) * (at[-channels] + at[2 * channels]);
        }
    }
}

/// One output's filter: scaled, modulated, demodulated; returns what it was multiplied with in the end.
template <typename T>
ARS_ROW_KERNEL T modulateFilter(const T* weight, const T* style, std::int64_t inputs, std::int64_t taps,
                                bool demodulate, T* result) {
    const T scale = T(1) / std::sqrt(static_cast<T>(inputs * taps));
    T squares = 0;
    for (std::int64_t i = 0; i < inputs; ++i) {
        const T factor = scale * style[i];
        for (std::int64_t t = 0; t < taps; ++t) {
            const T value = factor * weight[i * taps + t];
            result[i * taps + t] = value;
            squares += value * value;
        }
    }
    if (!demodulate) return T(1);
    const T norm = T(1) / std::sqrt(squares + T(1e-8));
    for (std::int64_t i = 0; i < inputs * taps; ++i) result[i] *= norm;
    return norm;
}

/// With m = n w', n = (sum w'^2 + eps)^-1/2: dL/dw' = n (g - m sum(g m)).
template <typename T>
ARS_ROW_KERNEL void modulateFilterBackward(const T* weight, const T* modulated, const T* gradient, const T* style,
                                           T norm, std::int64_t inputs, std::int64_t taps, bool demodulate,
                                           T* weightGradient, T* styleGradient) {
    const T scale = T(1) / std::sqrt(static_cast<T>(inputs * taps));
    T along = 0;
    if (demodulate) {
        for (std::int64_t i = 0; i < inputs * taps; ++i) along += gradient[i] * modulated[i];
    }
    for (std::int64_t i = 0; i < inputs; ++i) {
        T sum = 0;
        for (std::int64_t t = 0; t < taps; ++t) {
            const std::int64_t at = i * taps + t;
            const T plain = norm * (gradient[at] - modulated[at] * along);
            weightGradient[at] = plain * scale * style[i];
            sum += plain * weight[at];
        }
        styleGradient[i] = sum * scale;
    }
}

} // namespace ars::kernels
