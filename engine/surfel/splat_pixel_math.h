#pragma once

#include "engine/core/host_device.h"
#include "engine/surfel/splat_types.h"

#include <cmath>

/// What one surfel does to one pixel. Templated on the type of a pixel's numbers: float on CUDA, double in the oracle,
/// 16 pixels at once on the CPU (splat_simd.h). Nothing here branches on a pixel's value: vectors find their own
/// mulAdd, minOf, maxOf, select, both, butNot, exp2Of by argument-dependent lookup, scalars the ones below. No GLM and
/// no standard functions beyond: this header is compiled once per instruction set, and a shared inline function that
/// was compiled for a newer one must not win at link time.
namespace ars {

template <typename T>
inline constexpr bool kIsPlainNumber = false;
template <>
inline constexpr bool kIsPlainNumber<float> = true;
template <>
inline constexpr bool kIsPlainNumber<double> = true;

template <typename T>
    requires kIsPlainNumber<T>
ARS_HD inline T mulAdd(T a, T b, T c) {
    return a * b + c;
}
template <typename T>
    requires kIsPlainNumber<T>
ARS_HD inline T minOf(T a, T b) {
    return a < b ? a : b;
}
template <typename T>
    requires kIsPlainNumber<T>
ARS_HD inline T maxOf(T a, T b) {
    return a > b ? a : b;
}
template <typename T>
    requires kIsPlainNumber<T>
ARS_HD inline T select(bool condition, T yes, T no) {
    return condition ? yes : no;
}
ARS_HD inline bool both(bool a, bool b) { return a && b; }
ARS_HD inline bool either(bool a, bool b) { return a || b; }
ARS_HD inline bool butNot(bool a, bool b) { return a && !b; }
template <typename T>
    requires kIsPlainNumber<T>
ARS_HD inline T exp2Of(T x) {
    return exp2(x);
}
#if !defined(__CUDACC__)
template <>
inline float exp2Of<float>(float x) {
    return std::exp2(x);
}
#endif

inline constexpr double kMaxAlpha = 0.99;
inline constexpr double kMinLog2Alpha = -7.994353436858858; ///< log2(1/255)
inline constexpr double kMinTransmittance = 1e-4;
/// A surfel's depth at a pixel stays within this of its centre's, relative: a disc seen almost edge-on and widened by
/// the low-pass has a plane that runs away from it.
inline constexpr double kMaxTilt = 0.9;
/// The ray splat leaves a pixel out whose ray meets the plane beyond ten times the centre's depth, or behind the
/// camera.
inline constexpr double kMinRayDenominator = 0.1;
/// Nearer surfels are left out: lens and skin never come closer, J ~ 1/z would blow a millimetre up to the whole
/// picture, and 1/z^2 stays far from float's limits.
inline constexpr double kNearM = 0.01;
inline constexpr double kLog2E = 1.4426950408889634;

/// What a surfel is to the pixels of one camera. Offsets are in pixels from (u, v), the projected mean.
template <typename T>
struct ProjectedSurfel {
    T u, v;
    /// GaussianSurfel: log2 of the falloff is shape[0] dx^2 + shape[1] dx dy + shape[2] dy^2 (the conic times
    /// -log2(e)/2). RaySplat: numerators of the disc's coordinates in standard deviations, (shape[0] dx + shape[1] dy,
    /// shape[2] dx + shape[3] dy) / (1 + tilt).
    T shape[4];
    T tiltX, tiltY; ///< q = tiltX dx + tiltY dy (reference 1.4)
    T depth;        ///< p_z, metres
    T log2Opacity;
    /// Where alpha can reach 1/255: inside the ellipse A x^2 + 2 B x y + C y^2 <= 1 about (u + boundX, v + boundY), or,
    /// of the ray splat, the circle about (u, v). A little larger than exact, so that rounding never cuts a pixel off.
    T boundX, boundY;
    T boundA, boundB, boundC;
    T boundRadius2;
};

/// log2 of opacity times falloff, not yet limited; far below kMinLog2Alpha where the surfel has no point.
template <SurfelKernel Kernel, typename T, typename S>
ARS_HD inline T log2AlphaAt(const ProjectedSurfel<S>& s, const T& dx, const T& dy) {
    if constexpr (Kernel == SurfelKernel::GaussianSurfel) {
        // Reference 1.3: alpha = o exp(-1/2 d^T C d).
        const T along = mulAdd(T(s.shape[0]), dx, T(s.shape[1]) * dy);
        return mulAdd(along, dx, mulAdd(T(s.shape[2]) * dy, dy, T(s.log2Opacity)));
    } else {
        // Reference 1.9: rho = min(|s|^2, 2 |d|^2), alpha = o exp(-rho / 2).
        const T denominator = mulAdd(T(s.tiltX), dx, mulAdd(T(s.tiltY), dy, T(S(1))));
        const T safe = maxOf(denominator, T(S(0.5 * kMinRayDenominator)));
        const T inverse = T(S(1)) / safe;
        const T x = mulAdd(T(s.shape[0]), dx, T(s.shape[1]) * dy) * inverse;
        const T y = mulAdd(T(s.shape[2]), dx, T(s.shape[3]) * dy) * inverse;
        const T onDisc = mulAdd(x, x, y * y);
        const T onScreen = T(S(2)) * mulAdd(dx, dx, dy * dy);
        const T falloff = T(S(-0.5 * kLog2E)) * minOf(onDisc, onScreen);
        const auto met = both(denominator >= T(S(kMinRayDenominator)), T(s.depth) * inverse >= T(S(kNearM)));
        return select(met, falloff + T(s.log2Opacity), T(S(-1e30)));
    }
}

/// Camera z of the surfel on this pixel's ray (reference 1.4, 1.9).
template <SurfelKernel Kernel, DepthMode Depth, typename T, typename S>
ARS_HD inline T depthAt(const ProjectedSurfel<S>& s, const T& dx, const T& dy) {
    const T tilt = mulAdd(T(s.tiltX), dx, T(s.tiltY) * dy);
    if constexpr (Kernel == SurfelKernel::RaySplat) {
        return T(s.depth) / maxOf(tilt + T(S(1)), T(S(kMinRayDenominator)));
    } else {
        const T kept = minOf(maxOf(tilt, T(S(-kMaxTilt))), T(S(kMaxTilt)));
        if constexpr (Depth == DepthMode::Linear) return T(s.depth) - T(s.depth) * kept;
        return T(s.depth) / (kept + T(S(1)));
    }
}

/// One step of front-to-back blending (reference 1.3). `live` turns false, for good, where the step would take the
/// transmittance below 1e-4; nothing is blended there.
/// @return w = alpha T, 0 where nothing is blended
template <typename T, typename Mask>
ARS_HD inline T blendWeight(const T& log2Alpha, T& transmittance, Mask& live) {
    const Mask reaches = both(live, log2Alpha >= T(float(kMinLog2Alpha)));
    const T alpha = minOf(exp2Of(log2Alpha), T(float(kMaxAlpha)));
#if defined(__CUDA_ARCH__)
    // Backward finds T_{i+1} as T - w and a clamped alpha by w >= 0.99 T: both must meet these bits. Hosts round after
    // every operation (-ffp-contract=off); nvcc would fuse T - T alpha. T is float here.
    const T weight = __fmul_rn(transmittance, alpha);
    const T next = __fsub_rn(transmittance, weight);
#else
    const T weight = transmittance * alpha;
    const T next = transmittance - weight;
#endif
    const Mask ends = both(reaches, next < T(float(kMinTransmittance)));
    const Mask blends = butNot(reaches, ends);
    live = butNot(live, ends);
    transmittance = select(blends, next, transmittance);
    return select(blends, weight, T(0.0f));
}

/// Whether the surfel can reach alpha 1/255 at a point of the rectangle (pixels). The least value of the quadratic over
/// a rectangle lies on one of the two edges that face its centre (reference 6.2-2).
template <SurfelKernel Kernel, typename T, typename S>
ARS_HD inline auto reachesRect(const ProjectedSurfel<S>& s, const T& left, const T& top, const T& right,
                               const T& bottom) {
    const T zero(S(0));
    const T centerX(s.u + s.boundX), centerY(s.v + s.boundY);
    const T x0 = left - centerX, x1 = right - centerX, y0 = top - centerY, y1 = bottom - centerY;
    const T nearX = minOf(maxOf(zero, x0), x1), nearY = minOf(maxOf(zero, y0), y1);
    const T bestY = minOf(maxOf(nearX * T(-s.boundB / s.boundC), y0), y1);
    const T bestX = minOf(maxOf(nearY * T(-s.boundB / s.boundA), x0), x1);
    const T a(s.boundA), b(S(2) * s.boundB), c(s.boundC);
    const T onVertical = mulAdd(mulAdd(a, nearX, b * bestY), nearX, c * bestY * bestY);
    const T onHorizontal = mulAdd(mulAdd(a, bestX, b * nearY), bestX, c * nearY * nearY);
    const auto ellipse = minOf(onVertical, onHorizontal) <= T(S(1));
    if constexpr (Kernel == SurfelKernel::RaySplat) {
        const T u(s.u), v(s.v);
        const T dx = minOf(maxOf(zero, left - u), right - u), dy = minOf(maxOf(zero, top - v), bottom - v);
        return either(ellipse, mulAdd(dx, dx, dy * dy) <= T(s.boundRadius2));
    } else {
        return ellipse;
    }
}

} // namespace ars
