#pragma once

#include "engine/surfel/splat_gradient_pixel_math.h"
#include "engine/surfel/splat_math.h"

#include <glm/glm.hpp>

/// Backward of splat_math.h and splat_pixel_math.h (rendering reference 1.5; docs/math/splat.md): the true gradient of
/// what is blended, for every device and for double. Cut-offs (1/255, 0.99, 1e-4, the clamp of the slopes) are held
/// fixed: where one acts, nothing passes.
namespace ars {

/// The moments of `terms` at one offset.
template <int Terms, typename T>
ARS_HD inline void momentsAt(const T* terms, T dx, T dy, T (*m)[kMoments]) {
    const T powers[kMoments] = {T(1), dx, dy, dx * dx, dx * dy, dy * dy};
    for (int t = 0; t < Terms; ++t) {
        for (int k = 0; k < kMoments; ++k) m[t][k] = terms[t] * powers[k];
    }
}

/// Backward of log2AlphaAt: adds what `g` = dL/dlog2Alpha passes to the surfel.
template <SurfelKernel Kernel, typename T>
ARS_HD inline void log2AlphaBackward(const ProjectedSurfel<T>& s, T dx, T dy, T g, ProjectedGradient<T>& out) {
    T terms[kFalloffTerms<Kernel>], moments[kFalloffTerms<Kernel>][kMoments];
    falloffTerms<Kernel>(s, dx, dy, g, terms);
    momentsAt<kFalloffTerms<Kernel>>(terms, dx, dy, moments);
    falloffGradient<Kernel>(s, moments, out);
}

/// Backward of depthAt: adds what `g` = dL/dz passes to the surfel.
template <SurfelKernel Kernel, DepthMode Depth, typename T>
ARS_HD inline void depthBackward(const ProjectedSurfel<T>& s, T dx, T dy, T g, ProjectedGradient<T>& out) {
    T terms[kDepthTerms], moments[kDepthTerms][kMoments];
    depthTerms<Kernel, Depth>(s, dx, dy, g, terms);
    momentsAt<kDepthTerms>(terms, dx, dy, moments);
    depthGradient(s, moments, out);
}

/// dL/d of a surfel's own geometry.
template <typename T>
struct SurfelGeometryGradient {
    Vec3<T> mean{T(0)};
    T rotation[4] = {T(0), T(0), T(0), T(0)}; ///< of the quaternion as it was given, its length included
    Vec2<T> scale{T(0)};
    T opacity = T(0);
};

/// Backward of tangentsOf: gradients of columns 0 and 1 of R(q) to q.
template <typename T>
ARS_HD inline void tangentsBackward(const T* q, const Vec3<T>& f, const Vec3<T>& e, T* out) {
    const T w = q[0], x = q[1], y = q[2], z = q[3], s = T(2) / (w * w + x * x + y * y + z * z);
    const T gs = -f.x * (y * y + z * z) + f.y * (x * y + w * z) + f.z * (x * z - w * y) + e.x * (x * y - w * z) -
                 e.y * (x * x + z * z) + e.z * (y * z + w * x);
    const T along = -s * s * gs; // ds/dq = -s^2 q
    out[0] += s * (f.y * z - f.z * y - e.x * z + e.z * x) + along * w;
    out[1] += s * (f.y * y + f.z * z + e.x * y - T(2) * e.y * x + e.z * w) + along * x;
    out[2] += s * (T(-2) * f.x * y + f.y * x - f.z * w + e.x * x + e.z * z) + along * y;
    out[3] += s * (T(-2) * f.x * z + f.y * w + f.z * x - e.x * w - T(2) * e.y * z + e.z * y) + along * z;
}

/// What the projection's parts pass on, in camera space.
template <typename T>
struct CameraSpaceGradient {
    Vec3<T> p{T(0)}, t0{T(0)}, t1{T(0)}, normal{T(0)}, r{T(0)};
    Vec2<T> scale{T(0)};
};

/// Backward of projectGaussian (reference 1.5, steps 4 and 5, with the exact derivative where a slope is clamped). With
/// DepthMode::Filtered the tilts come from here, too.
template <typename T>
ARS_HD inline void projectGaussianBackward(const SplatView<T>& view, const Vec3<T>& p, const Vec3<T>& t0,
                                           const Vec3<T>& t1, const Vec2<T>& scale, const ProjectedGradient<T>& g,
                                           CameraSpaceGradient<T>& out) {
    const T iz = T(1) / p.z;
    const T rawX = p.x * iz, rawY = p.y * iz;
    const T sx = minOf(maxOf(rawX, view.minSlope.x), view.maxSlope.x);
    const T sy = minOf(maxOf(rawY, view.minSlope.y), view.maxSlope.y);
    const T jx = view.camera.fx * iz, jy = view.camera.fy * iz;
    const Vec2<T> e0(t0.x - sx * t0.z, t0.y - sy * t0.z), e1(t1.x - sx * t1.z, t1.y - sy * t1.z);
    const Vec2<T> m0 = scale.x * Vec2<T>(jx * e0.x, jy * e0.y), m1 = scale.y * Vec2<T>(jx * e1.x, jy * e1.y);
    const T low = T(kLowPassPx2);
    const T xx = m0.x * m0.x + m1.x * m1.x, yy = m0.y * m0.y + m1.y * m1.y, xy = m0.x * m0.y + m1.x * m1.y;
    const T cross = m0.x * m1.y - m0.y * m1.x;
    const T inverse = T(1) / (cross * cross + low * (xx + yy) + low * low);
    const T a = (yy + low) * inverse, b = -xy * inverse, c = (xx + low) * inverse;

    T ga = T(-0.5 * kLog2E) * g.shape[0], gb = T(-kLog2E) * g.shape[1], gc = T(-0.5 * kLog2E) * g.shape[2];
    Vec2<T> gm0(T(0)), gm1(T(0));
    T gInverseZ = T(0);
    if (view.depth == DepthMode::Filtered) {
        const T z0 = scale.x * t0.z, z1 = scale.y * t1.z;
        const T zx = z0 * m0.x + z1 * m1.x, zy = z0 * m0.y + z1 * m1.y;
        const T hx = -g.tiltX * iz, hy = -g.tiltY * iz;
        ga += hx * zx;
        gb += hx * zy + hy * zx;
        gc += hy * zy;
        const T gzx = a * hx + b * hy, gzy = b * hx + c * hy;
        gInverseZ -= g.tiltX * (a * zx + b * zy) + g.tiltY * (b * zx + c * zy);
        gm0 += Vec2<T>(gzx, gzy) * z0;
        gm1 += Vec2<T>(gzx, gzy) * z1;
        const T gz0 = gzx * m0.x + gzy * m0.y, gz1 = gzx * m1.x + gzy * m1.y;
        out.scale += Vec2<T>(gz0 * t0.z, gz1 * t1.z);
        out.t0.z += gz0 * scale.x;
        out.t1.z += gz1 * scale.y;
    }
    // dL/dSigma' = -C G C, with G the symmetric matrix of the conic's gradient.
    const T half = T(0.5) * gb;
    const T r00 = ga * a + half * b, r01 = ga * b + half * c, r10 = half * a + gc * b, r11 = half * b + gc * c;
    const T s00 = -(a * r00 + b * r10), s01 = -(a * r01 + b * r11), s11 = -(b * r01 + c * r11);
    gm0 += T(2) * Vec2<T>(s00 * m0.x + s01 * m0.y, s01 * m0.x + s11 * m0.y);
    gm1 += T(2) * Vec2<T>(s00 * m1.x + s01 * m1.y, s01 * m1.x + s11 * m1.y);

    out.scale.x += gm0.x * jx * e0.x + gm0.y * jy * e0.y;
    out.scale.y += gm1.x * jx * e1.x + gm1.y * jy * e1.y;
    const Vec2<T> h0 = gm0 * scale.x, h1 = gm1 * scale.y;
    out.t0 += Vec3<T>(h0.x * jx, h0.y * jy, -(h0.x * jx * sx + h0.y * jy * sy));
    out.t1 += Vec3<T>(h1.x * jx, h1.y * jy, -(h1.x * jx * sx + h1.y * jy * sy));
    gInverseZ += view.camera.fx * (h0.x * e0.x + h1.x * e1.x) + view.camera.fy * (h0.y * e0.y + h1.y * e1.y);
    if (rawX > view.minSlope.x && rawX < view.maxSlope.x) {
        const T gsx = -jx * (h0.x * t0.z + h1.x * t1.z);
        out.p.x += gsx * iz;
        gInverseZ += gsx * p.x;
    }
    if (rawY > view.minSlope.y && rawY < view.maxSlope.y) {
        const T gsy = -jy * (h0.y * t0.z + h1.y * t1.z);
        out.p.y += gsy * iz;
        gInverseZ += gsy * p.y;
    }
    out.p.z -= gInverseZ * iz * iz;
}

/// Backward of projectRaySplat; adds to the gradient of the tilts.
template <typename T>
ARS_HD inline void projectRaySplatBackward(const SplatView<T>& view, const Vec3<T>& p, const Vec3<T>& t0,
                                           const Vec3<T>& t1, const Vec2<T>& scale, const ProjectedSurfel<T>& s,
                                           ProjectedGradient<T>& g, CameraSpaceGradient<T>& out) {
    const Vec3<T> r = p / p.z;
    const T ax = T(1) / view.camera.fx, ay = T(1) / view.camera.fy;
    const T k0 = p.z / scale.x, k1 = p.z / scale.y, r0 = glm::dot(t0, r), r1 = glm::dot(t1, r);
    const T g0x = g.shape[0] * k0, g0y = g.shape[1] * k0, g1x = g.shape[2] * k1, g1y = g.shape[3] * k1;
    const T gk0 = (g.shape[0] * s.shape[0] + g.shape[1] * s.shape[1]) / k0;
    const T gk1 = (g.shape[2] * s.shape[2] + g.shape[3] * s.shape[3]) / k1;
    const T gr0 = -(g0x * s.tiltX + g0y * s.tiltY), gr1 = -(g1x * s.tiltX + g1y * s.tiltY);
    g.tiltX -= g0x * r0 + g1x * r1;
    g.tiltY -= g0y * r0 + g1y * r1;
    out.t0 += gr0 * r;
    out.t0.x += g0x * ax;
    out.t0.y += g0y * ay;
    out.t1 += gr1 * r;
    out.t1.x += g1x * ax;
    out.t1.y += g1y * ay;
    out.r += gr0 * t0 + gr1 * t1;
    out.p.z += gk0 / scale.x + gk1 / scale.y;
    out.scale.x -= gk0 * k0 / scale.x;
    out.scale.y -= gk1 * k1 / scale.y;
}

/// Backward of projectSurfel for a visible surfel: adds to `out`.
/// @param s        what the forward projection gave
/// @param gNormal  dL/d of the camera-space normal that faces the camera
template <typename T>
ARS_HD inline void projectSurfelBackward(const SplatView<T>& view, const Vec3<T>& mean, const T* rotation,
                                         const Vec2<T>& scale, T opacity, const ProjectedSurfel<T>& s,
                                         ProjectedGradient<T> g, const Vec3<T>& gNormal,
                                         SurfelGeometryGradient<T>& out) {
    const PinholeCamera<T>& camera = view.camera;
    const T lengthSquared =
        rotation[0] * rotation[0] + rotation[1] * rotation[1] + rotation[2] * rotation[2] + rotation[3] * rotation[3];
    Vec3<T> first, second;
    tangentsOf(rotation, lengthSquared, first, second);
    const Vec3<T> p = camera.toCamera(mean), t0 = camera.rotation * first, t1 = camera.rotation * second;
    const Vec3<T> cross = glm::cross(t0, t1);
    const T sign = glm::dot(p, cross) > T(0) ? T(-1) : T(1);
    const Vec3<T> normal = sign * cross, r = p / p.z;

    CameraSpaceGradient<T> c;
    c.normal = gNormal;
    if (view.kernel == SurfelKernel::GaussianSurfel) {
        projectGaussianBackward(view, p, t0, t1, scale, g, c);
    } else {
        projectRaySplatBackward(view, p, t0, t1, scale, s, g, c);
    }
    if (view.kernel == SurfelKernel::RaySplat || view.depth != DepthMode::Filtered) {
        const T inverseTilt = T(1) / glm::dot(normal, r);
        const T gTilt = -(g.tiltX * s.tiltX + g.tiltY * s.tiltY) * inverseTilt;
        c.normal.x += g.tiltX * inverseTilt / camera.fx;
        c.normal.y += g.tiltY * inverseTilt / camera.fy;
        c.normal += gTilt * r;
        c.r += gTilt * normal;
    }
    c.r.x += g.u * camera.fx;
    c.r.y += g.v * camera.fy;
    const T iz = T(1) / p.z;
    c.p += Vec3<T>(c.r.x * iz, c.r.y * iz, -(c.r.x * r.x + c.r.y * r.y) * iz);
    c.p.z += g.depth;
    c.t0 += sign * glm::cross(t1, c.normal);
    c.t1 += sign * glm::cross(c.normal, t0);

    const auto toWorld = glm::transpose(camera.rotation);
    out.mean += toWorld * c.p;
    out.scale += c.scale;
    tangentsBackward(rotation, toWorld * c.t0, toWorld * c.t1, out.rotation);
    if (opacity <= T(1)) out.opacity += g.log2Opacity * T(kLog2E) / opacity;
}

/// Backward of a channel's normalisation at a pixel: out = sum / opacity, or sum / |sum| where `unit`.
/// @param g       dL/dOut
/// @param length  |sum|; only where `unit`
/// @param gSum    receives dL/dSum
/// @return what goes to dL/dOpacity
template <typename T>
ARS_HD inline T normaliseBackward(int width, bool unit, T opacity, T length, const T* out, const T* g, T* gSum) {
    T along = T(0);
    for (int k = 0; k < width; ++k) along += g[k] * out[k];
    if (unit) {
        const T inverse = length > T(1e-10) ? T(1) / length : T(0);
        for (int k = 0; k < width; ++k) gSum[k] = (g[k] - along * out[k]) * inverse;
        return T(0);
    }
    const T inverse = T(1) / opacity;
    for (int k = 0; k < width; ++k) gSum[k] = g[k] * inverse;
    return -along * inverse;
}

} // namespace ars
