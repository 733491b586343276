#pragma once

#include "engine/surfel/splat_pixel_math.h"

/// Backward of splat_pixel_math.h: what one pixel passes to one surfel. Under the same rules: templated on the type of
/// a pixel's numbers (S is that of a surfel's), no branches on a pixel's value, no GLM, no standard functions.
///
/// A surfel needs only sums over its pixels of a few terms times 1, x, y, x^2, x y and y^2 of the pixel's place: its
/// moments. Where from is chosen by the caller, as long as falloffGradient() gets moments about (u, v).
namespace ars {

inline constexpr double kLn2 = 0.6931471805599453;
inline constexpr int kMoments = 6; ///< of 1, x, y, x^2, x y, y^2

/// Terms of the falloff. GaussianSurfel: dL/dlog2Alpha. RaySplat: that, dL/d of the two numerators of the disc's
/// coordinates and of their denominator, and the one of the low-pass; of all but the first moments to degree 1.
template <SurfelKernel Kernel>
inline constexpr int kFalloffTerms = Kernel == SurfelKernel::GaussianSurfel ? 1 : 5;
/// Terms of depth: dL/d of the centre's depth and of the tilt; moments of degree 0 and 1.
inline constexpr int kDepthTerms = 2;

/// dL/d of a ProjectedSurfel; its bounds carry none.
template <typename T>
struct ProjectedGradient {
    T u = T(0), v = T(0);
    T shape[4] = {T(0), T(0), T(0), T(0)};
    T tiltX = T(0), tiltY = T(0);
    T depth = T(0);
    T log2Opacity = T(0);
};

/// One pixel's chain from its blended sums to one surfel's alpha (reference 1.5, step 2, the scalar trick):
/// dL/dalpha_i = T_i h_i - (sum_{j>i} w_j h_j) / (1 - alpha_i), with h_i = sum_k dL/dSum_k f_ik.
///
/// With w = alpha T that is T_i / w_i times w (h - suffix / T_{i+1}): no alpha is needed, and where nothing was blended
/// (w = 0) nothing passes.
/// @param before, after  the transmittance T_i and T_{i+1} = T_i - w_i
/// @return dL/dlog2Alpha; 0 where alpha is clamped at 0.99, which T_i times 0.99 meets exactly
template <typename S, typename T>
ARS_HD inline T blendBackward(const T& weight, const T& before, const T& after, const T& h, const T& suffix) {
    const T passed = weight * (h - suffix / after) * T(S(kLn2));
    // One product and no sum: nothing that a compiler could fuse, so that this is the product of the forward pass.
    return select(weight >= before * T(S(kMaxAlpha)), T(S(0)), passed);
}

/// Terms of log2AlphaAt for `g` = dL/dlog2Alpha at the offset (dx, dy).
template <SurfelKernel Kernel, typename T, typename S>
ARS_HD inline void falloffTerms(const ProjectedSurfel<S>& s, const T& dx, const T& dy, const T& g, T* terms) {
    terms[0] = g;
    if constexpr (Kernel == SurfelKernel::RaySplat) {
        // As in the forward pass: pixels with a smaller denominator are not blended, g is 0 there.
        const T denominator = mulAdd(T(s.tiltX), dx, mulAdd(T(s.tiltY), dy, T(S(1))));
        const T inverse = T(S(1)) / maxOf(denominator, T(S(0.5 * kMinRayDenominator)));
        const T x = mulAdd(T(s.shape[0]), dx, T(s.shape[1]) * dy) * inverse;
        const T y = mulAdd(T(s.shape[2]), dx, T(s.shape[3]) * dy) * inverse;
        const auto disc = mulAdd(x, x, y * y) < T(S(2)) * mulAdd(dx, dx, dy * dy);
        const T zero(S(0)), gFalloff = T(S(-kLog2E)) * g;
        const T gDisc = select(disc, gFalloff * inverse, zero);
        const T gx = gDisc * x, gy = gDisc * y;
        terms[1] = gx;
        terms[2] = gy;
        terms[3] = zero - mulAdd(gx, x, gy * y);
        terms[4] = select(disc, zero, T(S(2)) * gFalloff);
    }
}

/// Terms of depthAt for `g` = dL/dz.
template <SurfelKernel Kernel, DepthMode Depth, typename T, typename S>
ARS_HD inline void depthTerms(const ProjectedSurfel<S>& s, const T& dx, const T& dy, const T& g, T* terms) {
    const T tilt = mulAdd(T(s.tiltX), dx, T(s.tiltY) * dy), zero(S(0)), one(S(1));
    const T slope = (zero - g) * T(s.depth);
    if constexpr (Kernel == SurfelKernel::RaySplat) {
        const T least = T(S(kMinRayDenominator)), inverse = one / maxOf(tilt + one, least);
        terms[0] = g * inverse;
        terms[1] = select(least < tilt + one, slope * inverse * inverse, zero);
    } else {
        const T most = T(S(kMaxTilt)), least = zero - most, kept = minOf(maxOf(tilt, least), most);
        const auto inside = both(least < tilt, tilt < most);
        if constexpr (Depth == DepthMode::Linear) {
            terms[0] = g * (one - kept);
            terms[1] = select(inside, slope, zero);
        } else {
            const T inverse = one / (one + kept);
            terms[0] = g * inverse;
            terms[1] = select(inside, slope * inverse * inverse, zero);
        }
    }
}

/// From the moments of the falloff's terms about (u, v) to the surfel; adds.
template <SurfelKernel Kernel, typename S>
ARS_HD inline void falloffGradient(const ProjectedSurfel<S>& s, const S (*m)[kMoments], ProjectedGradient<S>& out) {
    out.log2Opacity += m[0][0];
    if constexpr (Kernel == SurfelKernel::GaussianSurfel) {
        out.shape[0] += m[0][3];
        out.shape[1] += m[0][4];
        out.shape[2] += m[0][5];
        out.u -= S(2) * s.shape[0] * m[0][1] + s.shape[1] * m[0][2]; // dx = x - u
        out.v -= S(2) * s.shape[2] * m[0][2] + s.shape[1] * m[0][1];
    } else {
        out.shape[0] += m[1][1];
        out.shape[1] += m[1][2];
        out.shape[2] += m[2][1];
        out.shape[3] += m[2][2];
        out.tiltX += m[3][1];
        out.tiltY += m[3][2];
        out.u -= m[1][0] * s.shape[0] + m[2][0] * s.shape[2] + m[3][0] * s.tiltX + m[4][1];
        out.v -= m[1][0] * s.shape[1] + m[2][0] * s.shape[3] + m[3][0] * s.tiltY + m[4][2];
    }
}

/// The same of depth's terms.
template <typename S>
ARS_HD inline void depthGradient(const ProjectedSurfel<S>& s, const S (*m)[kMoments], ProjectedGradient<S>& out) {
    out.depth += m[0][0];
    out.tiltX += m[1][1];
    out.tiltY += m[1][2];
    out.u -= m[1][0] * s.tiltX;
    out.v -= m[1][0] * s.tiltY;
}

/// Moments about (u, v) from those about a point that lies at the offset (a, b) from it.
template <typename S>
ARS_HD inline void shiftMoments(S a, S b, const S* m, S* shifted) {
    shifted[0] = m[0];
    shifted[1] = m[1] + a * m[0];
    shifted[2] = m[2] + b * m[0];
    shifted[3] = m[3] + a * (S(2) * m[1] + a * m[0]);
    shifted[4] = m[4] + a * m[2] + b * (m[1] + a * m[0]);
    shifted[5] = m[5] + b * (S(2) * m[2] + b * m[0]);
}

} // namespace ars
