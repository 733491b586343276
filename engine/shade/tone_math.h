#pragma once

#include "engine/core/host_device.h"

#include <glm/glm.hpp>

#include <cmath>

namespace ars {

// Tone curves and the display's transfer function, per pixel, host and device, T float or double. Sources and units:
// docs/math/shading.md.

/// linear [0, 1] to sRGB (IEC 61966-2-1).
template <typename T>
ARS_HD inline T encodeSrgb(T linear) {
    return linear <= T(0.0031308) ? T(12.92) * linear : T(1.055) * std::pow(linear, T(1.0 / 2.4)) - T(0.055);
}

template <typename T>
ARS_HD inline T clampUnit(T x) {
    return x > T(0) ? (x < T(1) ? x : T(1)) : T(0); // NaN: 0
}

template <typename T>
ARS_HD inline glm::vec<3, T> clampUnit(const glm::vec<3, T>& v) {
    return {clampUnit(v.x), clampUnit(v.y), clampUnit(v.z)};
}

/// S. Hill's fit (2017, BakingLab) of the ACES reference rendering transform and the 100-nit Rec.709 output transform,
/// with its exposure of 0.6 left out: linear Rec.709 in, display-linear out.
template <typename T>
ARS_HD inline glm::vec<3, T> acesCurve(const glm::vec<3, T>& color) {
    using M = glm::mat<3, 3, T>;
    const M in(T(0.59719), T(0.07600), T(0.02840), T(0.35458), T(0.90834), T(0.13383), T(0.04823), T(0.01566),
               T(0.83777));
    const M out(T(1.60475), T(-0.10208), T(-0.00327), T(-0.53108), T(1.10813), T(-0.07276), T(-0.07367), T(-0.00605),
                T(1.07602));
    const glm::vec<3, T> v = in * color;
    const glm::vec<3, T> fit =
        (v * (v + T(0.0245786)) - T(0.000090537)) / (v * (T(0.983729) * v + T(0.4329510)) + T(0.238081));
    return clampUnit(out * fit);
}

/// B. Wrensch's polynomial (2023, "Minimal AgX Implementation") of T. Sobotka's AgX base look: 16.5 stops about middle
/// grey through one curve in a rotated, inset space. Linear Rec.709 in, display-linear out.
template <typename T>
ARS_HD inline glm::vec<3, T> agxCurve(const glm::vec<3, T>& color) {
    using M = glm::mat<3, 3, T>;
    const M inset(T(0.842479062253094), T(0.0423282422610123), T(0.0423756549057051), T(0.0784335999999992),
                  T(0.878468636469772), T(0.0784336), T(0.0792237451477643), T(0.0791661274605434),
                  T(0.879142973793104));
    const M outset(T(1.19687900512017), T(-0.0528968517574562), T(-0.0529716355144438), T(-0.0980208811401368),
                   T(1.15190312990417), T(-0.0980434501171241), T(-0.0990297440797205), T(-0.0989611768448433),
                   T(1.15107367264116));
    const T lowest = T(-12.47393), highest = T(4.026069);
    glm::vec<3, T> v = inset * color;
    for (int c = 0; c < 3; ++c) {
        const T stops = v[c] > T(1e-10) ? std::log2(v[c]) : lowest;
        const T x = clampUnit((stops - lowest) / (highest - lowest)), x2 = x * x, x4 = x2 * x2;
        v[c] = T(15.5) * x4 * x2 - T(40.14) * x4 * x + T(31.96) * x4 - T(6.868) * x2 * x + T(0.4298) * x2 +
               T(0.1191) * x - T(0.00232);
    }
    v = outset * v;
    for (int c = 0; c < 3; ++c) v[c] = v[c] > T(0) ? std::pow(v[c], T(2.2)) : T(0);
    return clampUnit(v);
}

/// Exposed radiance to display-linear [0, 1]; curve as ToneCurve counts.
template <typename T>
ARS_HD inline glm::vec<3, T> toneCurve(int curve, const glm::vec<3, T>& color) {
    if (curve == 1) return acesCurve(color);
    if (curve == 2) return agxCurve(color);
    return clampUnit(color);
}

template <typename T>
struct ToneSettings {
    T exposure = T(1); ///< 2^EV
    int curve = 0;     ///< ToneCurve
    bool transparent = false;
    glm::vec<3, T> background{T(0)}; ///< display-linear
};

/// One pixel: linear premultiplied colour and alpha to encoded colour and alpha.
template <typename T>
ARS_HD inline glm::vec<4, T> tonePixel(const ToneSettings<T>& tone, const glm::vec<4, T>& pixel) {
    const T alpha = clampUnit(pixel.w);
    glm::vec<3, T> display(T(0));
    if (alpha > T(0)) {
        glm::vec<3, T> color = glm::vec<3, T>(pixel) * (tone.exposure / alpha);
        // Far above what any curve tells from white, far below where their squares overflow.
        for (int c = 0; c < 3; ++c) color[c] = color[c] > T(0) ? (color[c] < T(1e9) ? color[c] : T(1e9)) : T(0);
        display = toneCurve(tone.curve, color);
    }
    if (!tone.transparent) display = alpha * display + (T(1) - alpha) * tone.background;
    return {encodeSrgb(display.x), encodeSrgb(display.y), encodeSrgb(display.z), tone.transparent ? alpha : T(1)};
}

} // namespace ars
