#pragma once

#include "engine/shade/tone_math.h"

namespace ars {

// Backward of tone_math.h (docs/math/shading.md, Tone). Where a curve is held at 0 or 1 nothing passes.

/// d encodeSrgb / d linear.
template <typename T>
ARS_HD inline T encodeSrgbSlope(T linear) {
    return linear <= T(0.0031308) ? T(12.92) : T(1.055 / 2.4) * std::pow(linear, T(1.0 / 2.4 - 1.0));
}

/// Slope of clampUnit at x: 1 strictly inside.
template <typename T>
ARS_HD inline T clampUnitSlope(T x) {
    return x > T(0) && x < T(1) ? T(1) : T(0);
}

template <typename T>
ARS_HD inline glm::vec<3, T> acesBackward(const glm::vec<3, T>& color, glm::vec<3, T> g) {
    using M = glm::mat<3, 3, T>;
    const M in(T(0.59719), T(0.07600), T(0.02840), T(0.35458), T(0.90834), T(0.13383), T(0.04823), T(0.01566),
               T(0.83777));
    const M out(T(1.60475), T(-0.10208), T(-0.00327), T(-0.53108), T(1.10813), T(-0.07276), T(-0.07367), T(-0.00605),
                T(1.07602));
    const glm::vec<3, T> v = in * color;
    const glm::vec<3, T> top = v * (v + T(0.0245786)) - T(0.000090537);
    const glm::vec<3, T> bottom = v * (T(0.983729) * v + T(0.4329510)) + T(0.238081);
    const glm::vec<3, T> before = out * (top / bottom);
    for (int c = 0; c < 3; ++c) g[c] *= clampUnitSlope(before[c]);
    g = glm::transpose(out) * g;
    const glm::vec<3, T> topSlope = T(2) * v + T(0.0245786), bottomSlope = T(2 * 0.983729) * v + T(0.4329510);
    for (int c = 0; c < 3; ++c) {
        g[c] *= (topSlope[c] * bottom[c] - top[c] * bottomSlope[c]) / (bottom[c] * bottom[c]);
    }
    return glm::transpose(in) * g;
}

template <typename T>
ARS_HD inline glm::vec<3, T> agxBackward(const glm::vec<3, T>& color, glm::vec<3, T> g) {
    using M = glm::mat<3, 3, T>;
    const M inset(T(0.842479062253094), T(0.0423282422610123), T(0.0423756549057051), T(0.0784335999999992),
                  T(0.878468636469772), T(0.0784336), T(0.0792237451477643), T(0.0791661274605434),
                  T(0.879142973793104));
    const M outset(T(1.19687900512017), T(-0.0528968517574562), T(-0.0529716355144438), T(-0.0980208811401368),
                   T(1.15190312990417), T(-0.0980434501171241), T(-0.0990297440797205), T(-0.0989611768448433),
                   T(1.15107367264116));
    const T lowest = T(-12.47393), highest = T(4.026069);
    const glm::vec<3, T> v = inset * color;
    glm::vec<3, T> fit, slope;
    for (int c = 0; c < 3; ++c) {
        const T stops = v[c] > T(1e-10) ? std::log2(v[c]) : lowest;
        const T raw = (stops - lowest) / (highest - lowest), x = clampUnit(raw), x2 = x * x, x4 = x2 * x2;
        fit[c] = T(15.5) * x4 * x2 - T(40.14) * x4 * x + T(31.96) * x4 - T(6.868) * x2 * x + T(0.4298) * x2 +
                 T(0.1191) * x - T(0.00232);
        const T dFit = T(93) * x4 * x - T(200.7) * x4 + T(127.84) * x2 * x - T(20.604) * x2 + T(0.8596) * x + T(0.1191);
        const bool inside = v[c] > T(1e-10) && raw > T(0) && raw < T(1);
        slope[c] = inside ? dFit * T(1.4426950408889634) / (v[c] * (highest - lowest)) : T(0);
    }
    const glm::vec<3, T> turned = outset * fit;
    for (int c = 0; c < 3; ++c) {
        const T power = turned[c] > T(0) ? std::pow(turned[c], T(2.2)) : T(0);
        g[c] *= turned[c] > T(0) ? clampUnitSlope(power) * T(2.2) * std::pow(turned[c], T(1.2)) : T(0);
    }
    g = glm::transpose(outset) * g;
    for (int c = 0; c < 3; ++c) g[c] *= slope[c];
    return glm::transpose(inset) * g;
}

template <typename T>
ARS_HD inline glm::vec<3, T> toneCurveBackward(int curve, const glm::vec<3, T>& color, glm::vec<3, T> g) {
    if (curve == 1) return acesBackward(color, g);
    if (curve == 2) return agxBackward(color, g);
    for (int c = 0; c < 3; ++c) g[c] *= clampUnitSlope(color[c]);
    return g;
}

/// Backward of tonePixel: dL/d of linear premultiplied colour and alpha from dL/d of the encoded ones.
template <typename T>
ARS_HD inline glm::vec<4, T> tonePixelBackward(const ToneSettings<T>& tone, const glm::vec<4, T>& pixel,
                                               const glm::vec<4, T>& g) {
    const T alpha = clampUnit(pixel.w);
    glm::vec<3, T> color(T(0)), raw(T(0)), display(T(0));
    if (alpha > T(0)) {
        raw = glm::vec<3, T>(pixel) * (tone.exposure / alpha);
        for (int c = 0; c < 3; ++c) color[c] = raw[c] > T(0) ? (raw[c] < T(1e9) ? raw[c] : T(1e9)) : T(0);
        display = toneCurve(tone.curve, color);
    }
    const glm::vec<3, T> out = tone.transparent ? display : alpha * display + (T(1) - alpha) * tone.background;
    glm::vec<3, T> gOut;
    for (int c = 0; c < 3; ++c) gOut[c] = g[c] * encodeSrgbSlope(out[c]);
    T gAlpha = tone.transparent ? g.w : glm::dot(gOut, display - tone.background);
    if (!(alpha > T(0))) return glm::vec<4, T>(T(0), T(0), T(0), gAlpha * clampUnitSlope(pixel.w));
    glm::vec<3, T> gColor = toneCurveBackward(tone.curve, color, tone.transparent ? gOut : alpha * gOut);
    for (int c = 0; c < 3; ++c) {
        if (!(raw[c] > T(0) && raw[c] < T(1e9))) gColor[c] = T(0);
    }
    const glm::vec<3, T> gPixel = gColor * (tone.exposure / alpha);
    gAlpha -= glm::dot(gColor, raw) / alpha;
    return glm::vec<4, T>(gPixel, gAlpha * clampUnitSlope(pixel.w));
}

} // namespace ars
