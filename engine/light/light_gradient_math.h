#pragma once

#include "engine/light/light_math.h"

#include <glm/glm.hpp>

namespace ars {

// Backward of light_math.h (docs/math/light.md, Backward): per element, host and device, T float or double. Lookups
// pass their gradient to four texels with the weights that the lookup used, and to the direction through the bilinear
// slopes of the face that it fell on.

/// What a lookup passes back: the taps that get `weight` times the value's gradient, and dL/d direction.
template <typename T>
struct CubeLookupGradient {
    CubeTaps<T> taps;
    glm::vec<3, T> direction;
};

/// @param gValue  dL/d of the looked-up radiance
template <typename T>
ARS_HD inline CubeLookupGradient<T> lookupCubeBackward(const CubeView<T>& cube, const glm::vec<3, T>& direction,
                                                       const glm::vec<3, T>& gValue) {
    const CubePoint<T> p = cubePoint(direction);
    const T size = T(cube.size);
    const T rawX = (p.u + T(1)) * T(0.5) * size, rawY = (p.v + T(1)) * T(0.5) * size;
    const T x = texelPlace(p.u, cube.size), y = texelPlace(p.v, cube.size);
    const int x0 = static_cast<int>(x + T(1)) - 1, y0 = static_cast<int>(y + T(1)) - 1;
    const T fx = x - T(x0), fy = y - T(y0);

    CubeLookupGradient<T> result;
    result.taps = cubeTaps(direction, cube.size);
    // Projections of the four texels on the gradient; at a corner the missing one is the mean of the others.
    T value[4];
    int corner = -1;
    for (int k = 0; k < 4; ++k) {
        const int column = x0 + (k & 1), row = y0 + (k >> 1);
        if ((column < 0 || column >= cube.size) && (row < 0 || row >= cube.size)) corner = k;
        const T* texel = cube.texels + 3 * result.taps.index[k];
        value[k] = texel[0] * gValue.x + texel[1] * gValue.y + texel[2] * gValue.z;
    }
    if (corner >= 0) {
        T others = T(0);
        for (int k = 0; k < 4; ++k) others += k == corner ? T(0) : value[k];
        value[corner] = others / T(3);
    }
    T gx = (T(1) - fy) * (value[1] - value[0]) + fy * (value[3] - value[2]);
    T gy = (T(1) - fx) * (value[2] - value[0]) + fx * (value[3] - value[1]);
    if (!(rawX > T(0) && rawX < size)) gx = T(0);
    if (!(rawY > T(0) && rawY < size)) gy = T(0);
    const T gu = gx * T(0.5) * size, gv = gy * T(0.5) * size;
    const CubeFaceAxes<T> axes = cubeFaceAxes<T>(p.face);
    const T major = glm::dot(direction, axes.major);
    const T inverse = major > T(0) ? T(1) / major : T(0);
    result.direction = inverse * (gu * (axes.right - p.u * axes.major) + gv * (axes.down - p.v * axes.major));
    return result;
}

/// d roughnessLevel / d roughness; 0 where the level is held at an end.
template <typename T>
ARS_HD inline T roughnessLevelSlope(T roughness, int levels) {
    const T low = T(kMinLightRoughness), middle = T(kMaxSharpRoughness);
    if (!(roughness > low) || !(roughness < T(1))) return T(0);
    return roughness < middle ? T(levels - 2) / (middle - low) : T(1) / (T(1) - middle);
}

/// What lookupSpecular passes back: two levels' taps with their share of the value's gradient.
template <typename T>
struct SpecularLookupGradient {
    int level[2];
    T share[2];
    CubeTaps<T> taps[2];
    glm::vec<3, T> direction;
    T roughness;
};

template <typename T>
ARS_HD inline SpecularLookupGradient<T> lookupSpecularBackward(const LightView<T>& light,
                                                               const glm::vec<3, T>& direction, T roughness,
                                                               const glm::vec<3, T>& gValue) {
    const T level = roughnessLevel(roughness, light.levels);
    int lower = static_cast<int>(level);
    if (lower > light.levels - 2) lower = light.levels - 2;
    const T t = level - T(lower);
    SpecularLookupGradient<T> result;
    result.direction = glm::vec<3, T>(T(0));
    glm::vec<3, T> values[2];
    for (int k = 0; k < 2; ++k) {
        const CubeView<T>& cube = light.specular[lower + k];
        result.level[k] = lower + k;
        result.share[k] = k == 0 ? T(1) - t : t;
        const CubeLookupGradient<T> lookup = lookupCubeBackward(cube, direction, gValue);
        result.taps[k] = lookup.taps;
        result.direction += result.share[k] * lookup.direction;
        values[k] = lookupCube(cube, direction);
    }
    result.roughness = glm::dot(gValue, values[1] - values[0]) * roughnessLevelSlope(roughness, light.levels);
    return result;
}

/// dL/d(n.v, roughness) of lookupSplitSum; 0 along an axis on which the lookup is held at the table's border.
template <typename T>
ARS_HD inline glm::vec<2, T> lookupSplitSumBackward(const T* lut, int size, T normalDotView, T roughness,
                                                    const glm::vec<2, T>& gValue) {
    const T top = T(size - 1);
    const T rawX = normalDotView * T(size) - T(0.5), rawY = roughness * T(size) - T(0.5);
    const T x = rawX > T(0) ? (rawX < top ? rawX : top) : T(0), y = rawY > T(0) ? (rawY < top ? rawY : top) : T(0);
    int x0 = static_cast<int>(x), y0 = static_cast<int>(y);
    if (x0 > size - 2) x0 = size - 2;
    if (y0 > size - 2) y0 = size - 2;
    const T fx = x - T(x0), fy = y - T(y0);
    const T* a =
        lut + 2 * (static_cast<std::size_t>(y0) * static_cast<std::size_t>(size) + static_cast<std::size_t>(x0));
    const T* b = a + 2 * static_cast<std::size_t>(size);
    glm::vec<2, T> result(T(0));
    for (int k = 0; k < 2; ++k) {
        const T alongUpper = a[2 + k] - a[k], alongBelow = b[2 + k] - b[k];
        const T upper = a[k] + fx * alongUpper, below = b[k] + fx * alongBelow;
        if (rawX > T(0) && rawX < top) result.x += gValue[k] * (alongUpper + fy * (alongBelow - alongUpper)) * T(size);
        if (rawY > T(0) && rawY < top) result.y += gValue[k] * (below - upper) * T(size);
    }
    return result;
}

} // namespace ars
