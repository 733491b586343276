#pragma once

#include "engine/light/ggx_weight.h"
#include "engine/light/light_math.h"

namespace ars {

// Formulas of the prefilter (docs/math/light.md), host and device.

/// Antiderivative of the solid angle of a face: of the rectangle from the centre to (x, y).
template <typename T>
ARS_HD inline T faceSolidAngle(T x, T y) {
    return std::atan2(x * y, std::sqrt(x * x + y * y + T(1)));
}

/// Solid angle of a texel, steradians.
template <typename T>
ARS_HD inline T exactTexelArea(int row, int column, int size) {
    const T x0 = T(2 * column) / T(size) - T(1), x1 = T(2 * column + 2) / T(size) - T(1);
    const T y0 = T(2 * row) / T(size) - T(1), y1 = T(2 * row + 2) / T(size) - T(1);
    return faceSolidAngle(x1, y1) - faceSolidAngle(x0, y1) - faceSolidAngle(x1, y0) + faceSolidAngle(x0, y0);
}

/// What nvdiffrec's kernels take for it: differences of arc tangents along both axes, one texel too far out on the
/// left and upper half.
template <typename T>
ARS_HD inline T nvdiffrecTexelArea(int row, int column, int size) {
    if (size <= 1) return T(1);
    const int half = size / 2;
    const int x = column < half ? half - column : column - half, y = row < half ? half - row : row - half;
    const T dx = std::atan(T(x + 1) / T(half)) - std::atan(T(x) / T(half));
    const T dy = std::atan(T(y + 1) / T(half)) - std::atan(T(y) / T(half));
    return dx * dy;
}

/// Texels of one face that a cone may touch, [x0, x1) x [y0, y1), and the cone's axis in the axes of the face.
struct ConeSpan {
    int face = 0;
    int x0 = 0, x1 = 0, y0 = 0, y1 = 0;
    float right = 0.0f, down = 0.0f, major = 0.0f;
};

/// Texels whose centres lie in a cone, along one axis of a face. Directions m + t a of the plane of the major axis and
/// one face axis touch the cone where (a - t m)^2 = s^2 (1 + t^2), with a and m the axis's components and s the sine of
/// the half-angle. A tenth of a texel is added on both sides: rounding may not cut any off, and the cosine decides in
/// the end.
template <typename T>
ARS_HD inline void coneRange(T a, T m, T sineSquared, int size, int& first, int& last) {
    first = 0;
    last = size;
    const T p = m * m - sineSquared;
    if (!(m > T(0) && p > T(1e-4))) return;
    const T inside = sineSquared * (a * a + p);
    const T root = std::sqrt(inside > T(0) ? inside : T(0)), scale = T(0.5) * T(size) / p;
    const T shift = T(0.5) * T(size) - T(0.5);
    const T from = (a * m - root) * scale + shift + T(0.9), to = (a * m + root) * scale + shift + T(1.1);
    first = from > T(0) ? (from < T(size) ? static_cast<int>(from) : size) : 0;
    last = to < T(size) ? (to > T(0) ? static_cast<int>(to) : 0) : size;
}

/// False when the cone misses the face for certain.
template <typename T>
ARS_HD inline bool coneSpan(const glm::vec<3, T>& axis, T cosine, T sine, int face, int size, ConeSpan& span) {
    const CubeFaceAxes<T> axes = cubeFaceAxes<T>(face);
    const T m = glm::dot(axis, axes.major);
    // A face lies within acos(1/sqrt(3)) of its own axis; beyond that plus the cone's half-angle nothing meets.
    const T reach = T(0.57735026918962576) * cosine - T(0.81649658092772603) * sine;
    if (m < reach - T(1e-3)) return false;
    const T u = glm::dot(axis, axes.right), v = glm::dot(axis, axes.down);
    coneRange(u, m, sine * sine, size, span.x0, span.x1);
    coneRange(v, m, sine * sine, size, span.y0, span.y1);
    span.face = face;
    span.right = static_cast<float>(u);
    span.down = static_cast<float>(v);
    span.major = static_cast<float>(m);
    return span.x0 < span.x1 && span.y0 < span.y1;
}

/// What one texel of the base gives to a filtered one: 0 outside the cone.
/// @param right, down, major  the lobe's axis in the axes of the texel's face, unit
/// @param u, v                the texel's centre
template <typename T>
ARS_HD inline T specularTexelWeight(T right, T down, T major, T u, T v, T solidAngle, T alphaSquared, T cosine) {
    const T inverse = T(1) / std::sqrt(u * u + v * v + T(1));
    const T x = u * inverse - right, y = v * inverse - down, z = inverse - major;
    const T e = T(0.5) * (x * x + y * y + z * z);
    return T(1) - e >= cosine ? ggxWeight(e, solidAngle, alphaSquared) : T(0);
}

/// The diffuse weight clamp(n.w, 0, 0.999) dw / pi.
template <typename T>
ARS_HD inline T diffuseTexelWeight(T cosine, T solidAngle) {
    const T limit = T(kDiffuseCosineLimit);
    const T clamped = cosine > T(0) ? (cosine < limit ? cosine : limit) : T(0);
    return clamped * solidAngle * T(0.31830988618379067154);
}

} // namespace ars
