#pragma once

#include "engine/core/camera.h"
#include "engine/core/host_device.h"
#include "engine/surfel/splat_pixel_math.h"

#include <glm/glm.hpp>

#include <cmath>

/// What one surfel is to one camera (rendering reference 1.2, 1.4, 1.9), for every device and for double.
namespace ars {

template <typename T>
using Vec2 = glm::vec<2, T, glm::defaultp>;
template <typename T>
using Vec3 = glm::vec<3, T, glm::defaultp>;

inline constexpr double kLowPassPx2 = 0.3;
inline constexpr double kMinFacing = 0.01;  ///< metres: kept where p . n < -0.01 (p the mean, not normalised)
inline constexpr double kMinGrazing = 0.01; ///< |cosine| between the normal and the ray to the mean

/// The camera and the choices that hold for all surfels of a frame.
template <typename T>
struct SplatView {
    PinholeCamera<T> camera;
    SurfelKernel kernel = SurfelKernel::GaussianSurfel;
    bool twoSided = false;
    DepthMode depth = DepthMode::Linear;
    /// x/z and y/z are held within these inside the Jacobian: the picture's field and 15 % of its width beyond each
    /// side.
    Vec2<T> minSlope{}, maxSlope{};
};

/// The published limit, 1.3 tan(fov / 2), written for any principal point.
template <typename T>
SplatView<T> splatView(const PinholeCamera<T>& camera, SurfelKernel kernel, bool twoSided,
                       DepthMode depth = DepthMode::Linear) {
    const T width = T(camera.width), height = T(camera.height);
    SplatView<T> view{camera, kernel, twoSided, depth, {}, {}};
    view.minSlope = {(-camera.cx - T(0.15) * width) / camera.fx, (-camera.cy - T(0.15) * height) / camera.fy};
    view.maxSlope = {(T(1.15) * width - camera.cx) / camera.fx, (T(1.15) * height - camera.cy) / camera.fy};
    return view;
}

/// Pixels whose centres a surfel may reach, both ends included.
struct PixelRect {
    int x0 = 0, y0 = 0, x1 = -1, y1 = -1;
};

template <typename T>
ARS_HD inline bool isFiniteNumber(T x) {
    return x - x == T(0);
}

/// Columns 0 and 1 of R(q), the tangents; q need not be of unit length but must have one.
template <typename T>
ARS_HD inline void tangentsOf(const T* q, T lengthSquared, Vec3<T>& first, Vec3<T>& second) {
    const T w = q[0], x = q[1], y = q[2], z = q[3], s = T(2) / lengthSquared;
    first = {T(1) - s * (y * y + z * z), s * (x * y + w * z), s * (x * z - w * y)};
    second = {s * (x * y - w * z), T(1) - s * (x * x + z * z), s * (y * z + w * x)};
}

/// The affine image of the disc: conic, bound and half extents of the footprint (reference 1.2 in its two-vector form).
/// m_k = J s_k t_k, Sigma' = m_0 m_0^T + m_1 m_1^T + 0.3 I.
template <typename T>
ARS_HD inline void projectGaussian(const SplatView<T>& view, const Vec3<T>& p, const Vec3<T>& t0, const Vec3<T>& t1,
                                   const Vec2<T>& scale, T tau, ProjectedSurfel<T>& s, Vec2<T>& extent) {
    const T inverseZ = T(1) / p.z;
    const T slopeX = minOf(maxOf(p.x * inverseZ, view.minSlope.x), view.maxSlope.x);
    const T slopeY = minOf(maxOf(p.y * inverseZ, view.minSlope.y), view.maxSlope.y);
    const T jx = view.camera.fx * inverseZ, jy = view.camera.fy * inverseZ;
    const Vec2<T> m0 = scale.x * Vec2<T>(jx * (t0.x - slopeX * t0.z), jy * (t0.y - slopeY * t0.z));
    const Vec2<T> m1 = scale.y * Vec2<T>(jx * (t1.x - slopeX * t1.z), jy * (t1.y - slopeY * t1.z));
    const T low = T(kLowPassPx2);
    const T xx = m0.x * m0.x + m1.x * m1.x, yy = m0.y * m0.y + m1.y * m1.y, xy = m0.x * m0.y + m1.x * m1.y;
    // |m0 x m1|^2 is the determinant without the low-pass, free of the cancellation in xx yy - xy^2.
    const T cross = m0.x * m1.y - m0.y * m1.x;
    const T inverse = T(1) / (cross * cross + low * (xx + yy) + low * low);
    const T a = (yy + low) * inverse, b = -xy * inverse, c = (xx + low) * inverse;
    s.shape[0] = T(-0.5 * kLog2E) * a;
    s.shape[1] = T(-kLog2E) * b;
    s.shape[2] = T(-0.5 * kLog2E) * c;
    s.shape[3] = T(0);
    if (view.depth == DepthMode::Filtered) {
        // E[z | d] = z_c + Cov(z, d) Sigma'^-1 d for the disc's Gaussian and the low-pass added to its image.
        const T z0 = scale.x * t0.z, z1 = scale.y * t1.z;
        const T zx = z0 * m0.x + z1 * m1.x, zy = z0 * m0.y + z1 * m1.y;
        s.tiltX = -(a * zx + b * zy) * inverseZ;
        s.tiltY = -(b * zx + c * zy) * inverseZ;
    }
    const T inside = T(0.5) / tau;
    s.boundA = a * inside;
    s.boundB = b * inside;
    s.boundC = c * inside;
    s.boundX = s.boundY = s.boundRadius2 = T(0);
    extent = {std::sqrt(T(2) * tau * (xx + low)), std::sqrt(T(2) * tau * (yy + low))};
}

/// The exact disc coordinates at a pixel and the conic that bounds them (reference 1.9). With r = p / p_z and the
/// plane's tilt q, the ray meets the plane at p_z (r + (a, b, 0)) / (1 + q), so that coordinate k is p_z (t_k.x a +
/// t_k.y b - q (t_k . r)) / (s_k (1 + q)): linear in the offset over linear in the offset.
template <typename T>
ARS_HD inline void projectRaySplat(const SplatView<T>& view, const Vec3<T>& p, const Vec3<T>& t0, const Vec3<T>& t1,
                                   const Vec2<T>& scale, T tau, ProjectedSurfel<T>& s, Vec2<T>& extent) {
    const Vec3<T> r = p / p.z;
    const T ax = T(1) / view.camera.fx, ay = T(1) / view.camera.fy;
    const T k0 = p.z / scale.x, k1 = p.z / scale.y, r0 = glm::dot(t0, r), r1 = glm::dot(t1, r);
    s.shape[0] = k0 * (t0.x * ax - s.tiltX * r0);
    s.shape[1] = k0 * (t0.y * ay - s.tiltY * r0);
    s.shape[2] = k1 * (t1.x * ax - s.tiltX * r1);
    s.shape[3] = k1 * (t1.y * ay - s.tiltY * r1);
    // alpha >= 1/255 on |s|^2 <= 2 tau, that is |M d|^2 <= 2 tau (1 + e.d)^2, or within sqrt(tau) px of the mean.
    const T k = T(2) * tau, e = s.tiltX, f = s.tiltY;
    const T a = s.shape[0] * s.shape[0] + s.shape[2] * s.shape[2] - k * e * e;
    const T b = s.shape[0] * s.shape[1] + s.shape[2] * s.shape[3] - k * e * f;
    const T c = s.shape[1] * s.shape[1] + s.shape[3] * s.shape[3] - k * f * f;
    const T cross = s.shape[0] * s.shape[3] - s.shape[1] * s.shape[2];
    const T skew0 = s.shape[0] * f - s.shape[1] * e, skew1 = s.shape[2] * f - s.shape[3] * e;
    const T full = cross * cross, det = full - k * (skew0 * skew0 + skew1 * skew1);
    const T radius = std::sqrt(tau);
    s.boundRadius2 = tau;
    if (det > T(1e-3) * full && a > T(0) && c > T(0)) {
        s.boundX = k * (c * e - b * f) / det;
        s.boundY = k * (a * f - b * e) / det;
        const T size = k * (T(1) + e * s.boundX + f * s.boundY);
        s.boundA = a / size;
        s.boundB = b / size;
        s.boundC = c / size;
        extent = {maxOf(std::sqrt(size * c / det) + std::abs(s.boundX), radius),
                  maxOf(std::sqrt(size * a / det) + std::abs(s.boundY), radius)};
    } else {
        // The part of the disc that matters reaches (almost) the camera's plane: no ellipse bounds it.
        s.boundX = s.boundY = s.boundB = T(0);
        s.boundA = s.boundC = T(1e-30);
        extent = {T(1e15), T(1e15)};
    }
}

/// Pixel centres within `extent` of (u, v); empty where the picture has none. Compared as floats before they become
/// integers, so that 1e30 is no overflow.
template <typename T>
ARS_HD inline PixelRect pixelsWithin(const PinholeCamera<T>& camera, T u, T v, const Vec2<T>& extent) {
    const T left = u - extent.x - T(0.5), right = u + extent.x - T(0.5);
    const T top = v - extent.y - T(0.5), bottom = v + extent.y - T(0.5);
    const T lastX = T(camera.width - 1), lastY = T(camera.height - 1);
    if (!(left <= lastX && right >= T(0) && top <= lastY && bottom >= T(0))) return {};
    return {int(std::ceil(maxOf(left, T(0)))), int(std::ceil(maxOf(top, T(0)))), int(std::floor(minOf(right, lastX))),
            int(std::floor(minOf(bottom, lastY)))};
}

/// All of a surfel's preprocessing.
/// @param rotation w, x, y, z
/// @param s, normal, rect written only where the fate is Visible; `normal` is in camera space and faces the camera
template <typename T>
ARS_HD inline SurfelFate projectSurfel(const SplatView<T>& view, const Vec3<T>& mean, const T* rotation,
                                       const Vec2<T>& scale, T opacity, ProjectedSurfel<T>& s, Vec3<T>& normal,
                                       PixelRect& rect) {
    const T lengthSquared =
        rotation[0] * rotation[0] + rotation[1] * rotation[1] + rotation[2] * rotation[2] + rotation[3] * rotation[3];
    // x - x is not 0 for NaN and infinities, and sums keep that: one test instead of ten.
    // Squares, because the projection squares them.
    if (!isFiniteNumber(T(0) * lengthSquared + T(0) * glm::dot(scale, scale) + T(0) * opacity)) {
        return SurfelFate::NotFinite;
    }
    if (!(scale.x > T(0) && scale.y > T(0) && lengthSquared > T(1e-20))) return SurfelFate::Degenerate;
    if (opacity < T(1.0 / 255.0)) return SurfelFate::Transparent;
    const PinholeCamera<T>& camera = view.camera;
    const Vec3<T> p = camera.toCamera(mean);
    if (!isFiniteNumber(glm::dot(p, p))) return SurfelFate::NotFinite;
    if (p.z < T(kNearM)) return SurfelFate::TooNear;

    Vec3<T> first, second;
    tangentsOf(rotation, lengthSquared, first, second);
    const Vec3<T> t0 = camera.rotation * first, t1 = camera.rotation * second;
    normal = glm::cross(t0, t1);
    const T facing = glm::dot(p, normal);
    if (view.kernel == SurfelKernel::GaussianSurfel &&
        !((view.twoSided ? std::abs(facing) : -facing) > T(kMinFacing))) {
        return SurfelFate::BackFacing;
    }
    if (facing > T(0)) normal = -normal;
    const Vec3<T> r = p / p.z;
    const T tilt = glm::dot(normal, r);
    if (!(-tilt > T(kMinGrazing) * std::sqrt(glm::dot(r, r)))) return SurfelFate::Grazing;

    const T kept = minOf(opacity, T(1)); // opacities above 1 mean nothing more than 1
    // ln(255 o), a little larger: the bounds must hold against rounding, the exact test is made at each pixel.
    const T logOpacity = std::log(kept);
    const T tau = maxOf(logOpacity + T(5.541263545158426), T(0)) * T(1.0001) + T(1e-3);
    s.u = camera.fx * r.x + camera.cx;
    s.v = camera.fy * r.y + camera.cy;
    s.tiltX = normal.x / (tilt * camera.fx);
    s.tiltY = normal.y / (tilt * camera.fy);
    s.depth = p.z;
    s.log2Opacity = logOpacity * T(kLog2E);
    Vec2<T> extent;
    if (view.kernel == SurfelKernel::GaussianSurfel) {
        projectGaussian(view, p, t0, t1, scale, tau, s, extent);
    } else {
        projectRaySplat(view, p, t0, t1, scale, tau, s, extent);
    }
    const T sum = T(0) * (s.u + s.v) + T(0) * (s.shape[0] + s.shape[1]) + T(0) * (s.shape[2] + s.shape[3]) +
                  T(0) * (s.boundA + s.boundB + s.boundC) + T(0) * (extent.x + extent.y);
    if (!isFiniteNumber(sum) || !(s.boundA > T(0) && s.boundC > T(0))) return SurfelFate::NotFinite;
    rect = pixelsWithin(camera, s.u, s.v, extent);
    return rect.x0 <= rect.x1 && rect.y0 <= rect.y1 ? SurfelFate::Visible : SurfelFate::OutsidePicture;
}

} // namespace ars
