#pragma once

#include "engine/core/host_device.h"

#include <glm/glm.hpp>

#include <cmath>
#include <cstddef>

namespace ars {

// Cube maps, their lookup and the split-sum light as kernels see it: per element, host and device, T float or double.
// Layout and levels: docs/math/light.md. A cube map is (6, N, N, 3): faces +x -x +y -y +z -z, rows from the top.

inline constexpr int kMaxLightLevels = 9;            ///< of a base of 4,096
inline constexpr int kSmallestLightLevel = 16;       ///< side of the last level and of the diffuse cube
inline constexpr double kMinLightRoughness = 0.08;   ///< of level 0
inline constexpr double kMaxSharpRoughness = 0.5;    ///< of the last level but one; the last has 1
inline constexpr double kDiffuseCosineLimit = 0.999; ///< the reference clamps n.w here

/// Axes of a face: its texel (u, v) in [-1, 1]^2 is seen along major + u right + v down.
template <typename T>
struct CubeFaceAxes {
    glm::vec<3, T> major, right, down;
};

template <typename T>
ARS_HD inline CubeFaceAxes<T> cubeFaceAxes(int face) {
    using V = glm::vec<3, T>;
    switch (face) {
    case 0:
        return {V(1, 0, 0), V(0, 0, -1), V(0, -1, 0)};
    case 1:
        return {V(-1, 0, 0), V(0, 0, 1), V(0, -1, 0)};
    case 2:
        return {V(0, 1, 0), V(1, 0, 0), V(0, 0, 1)};
    case 3:
        return {V(0, -1, 0), V(1, 0, 0), V(0, 0, -1)};
    case 4:
        return {V(0, 0, 1), V(1, 0, 0), V(0, -1, 0)};
    default:
        return {V(0, 0, -1), V(-1, 0, 0), V(0, -1, 0)};
    }
}

/// Where a direction meets the cube: face and (u, v) in [-1, 1]^2.
template <typename T>
struct CubePoint {
    int face = 0;
    T u = 0, v = 0;
};

/// Any length but zero. A direction without one (zero, NaN) gives the centre of +x.
template <typename T>
ARS_HD inline CubePoint<T> cubePoint(const glm::vec<3, T>& d) {
    const T ax = d.x < T(0) ? -d.x : d.x, ay = d.y < T(0) ? -d.y : d.y, az = d.z < T(0) ? -d.z : d.z;
    CubePoint<T> p;
    if (az >= ax && az >= ay && az > T(0)) {
        const T s = T(1) / az;
        p.face = d.z > T(0) ? 4 : 5;
        p.u = (d.z > T(0) ? d.x : -d.x) * s;
        p.v = -d.y * s;
    } else if (ay >= ax && ay > T(0)) {
        const T s = T(1) / ay;
        p.face = d.y > T(0) ? 2 : 3;
        p.u = d.x * s;
        p.v = (d.y > T(0) ? d.z : -d.z) * s;
    } else if (ax > T(0)) {
        const T s = T(1) / ax;
        p.face = d.x > T(0) ? 0 : 1;
        p.u = (d.x > T(0) ? -d.z : d.z) * s;
        p.v = -d.y * s;
    }
    return p;
}

/// Direction of (u, v) on a face, not normalised.
template <typename T>
ARS_HD inline glm::vec<3, T> cubeDirection(int face, T u, T v) {
    const CubeFaceAxes<T> axes = cubeFaceAxes<T>(face);
    return axes.major + u * axes.right + v * axes.down;
}

/// u or v of the centre of texel `index` of `size`.
template <typename T>
ARS_HD inline T texelCoordinate(int index, int size) {
    return (T(2) * T(index) + T(1)) / T(size) - T(1);
}

/// The inverse, held to the face whatever u is: [-0.5, size - 0.5].
template <typename T>
ARS_HD inline T texelPlace(T u, int size) {
    const T x = (u + T(1)) * T(0.5) * T(size);
    return (x > T(0) ? (x < T(size) ? x : T(size)) : T(0)) - T(0.5);
}

/// The index of the texel whose place on `face` is (column, row), where one of the two may lie one step outside: then
/// it is the texel across the edge, at the same place along it.
ARS_HD inline std::size_t cubeTexelIndex(int face, int row, int column, int size) {
    if (row < 0 || row >= size || column < 0 || column >= size) {
        // On the edge itself both faces have the same coordinate along it; which way is out decides the other face.
        const CubeFaceAxes<float> axes = cubeFaceAxes<float>(face);
        const bool sideways = column < 0 || column >= size;
        const glm::vec3 out = sideways ? (column < 0 ? -axes.right : axes.right) : (row < 0 ? -axes.down : axes.down);
        const float along = texelCoordinate<float>(sideways ? row : column, size);
        const glm::vec3 edge = axes.major + along * (sideways ? axes.down : axes.right);
        // Twice the way out makes that axis the largest; halving afterwards keeps the coordinate along the edge.
        const CubePoint<float> p = cubePoint<float>(edge + 2.0f * out);
        face = p.face;
        const auto index = [size](float coordinate) {
            const int i = static_cast<int>((coordinate + 1.0f) * 0.5f * static_cast<float>(size));
            return i < 0 ? 0 : (i >= size ? size - 1 : i);
        };
        const CubeFaceAxes<float> other = cubeFaceAxes<float>(face);
        column = index(glm::dot(edge + out, other.right));
        row = index(glm::dot(edge + out, other.down));
    }
    const std::size_t n = static_cast<std::size_t>(size);
    return (static_cast<std::size_t>(face) * n + static_cast<std::size_t>(row)) * n + static_cast<std::size_t>(column);
}

/// The texels that one bilinear lookup reads and how much of each; the weights sum to 1. The adjoint scatters with the
/// same numbers.
template <typename T>
struct CubeTaps {
    std::size_t index[4]; ///< texel, not float
    T weight[4];
};

/// Bilinear taps that continue across edges. At a corner, where only three texels meet, the missing one counts as the
/// mean of the three, so that all three faces agree there.
template <typename T>
ARS_HD inline CubeTaps<T> cubeTaps(const glm::vec<3, T>& direction, int size) {
    const CubePoint<T> p = cubePoint(direction);
    const T x = texelPlace(p.u, size), y = texelPlace(p.v, size);
    // Adding one before truncation makes it a floor in [-0.5, size - 0.5].
    const int x0 = static_cast<int>(x + T(1)) - 1, y0 = static_cast<int>(y + T(1)) - 1;
    const T fx = x - T(x0), fy = y - T(y0);
    CubeTaps<T> taps;
    taps.weight[0] = (T(1) - fx) * (T(1) - fy);
    taps.weight[1] = fx * (T(1) - fy);
    taps.weight[2] = (T(1) - fx) * fy;
    taps.weight[3] = fx * fy;
    if (x0 >= 0 && y0 >= 0 && x0 + 1 < size && y0 + 1 < size) {
        const std::size_t n = static_cast<std::size_t>(size);
        const std::size_t first =
            (static_cast<std::size_t>(p.face) * n + static_cast<std::size_t>(y0)) * n + static_cast<std::size_t>(x0);
        taps.index[0] = first;
        taps.index[1] = first + 1;
        taps.index[2] = first + n;
        taps.index[3] = first + n + 1;
        return taps;
    }
    int corner = -1;
    for (int k = 0; k < 4; ++k) {
        const int column = x0 + (k & 1), row = y0 + (k >> 1);
        if ((column < 0 || column >= size) && (row < 0 || row >= size)) {
            corner = k;
        } else {
            taps.index[k] = cubeTexelIndex(p.face, row, column, size);
        }
    }
    if (corner >= 0) {
        const T share = taps.weight[corner] / T(3);
        for (int k = 0; k < 4; ++k) taps.weight[k] += share;
        taps.weight[corner] = T(0);
        taps.index[corner] = taps.index[corner ^ 1];
    }
    return taps;
}

/// One cube map: (6, size, size, 3).
template <typename T>
struct CubeView {
    const T* texels = nullptr;
    int size = 0;
};

/// Bilinear radiance along a direction of any length.
template <typename T>
ARS_HD inline glm::vec<3, T> lookupCube(const CubeView<T>& cube, const glm::vec<3, T>& direction) {
    const CubeTaps<T> taps = cubeTaps(direction, cube.size);
    glm::vec<3, T> sum(T(0));
    for (int k = 0; k < 4; ++k) {
        const T* texel = cube.texels + 3 * taps.index[k];
        sum += taps.weight[k] * glm::vec<3, T>(texel[0], texel[1], texel[2]);
    }
    return sum;
}

/// Roughness of level `level` of `levels` (at least 3): evenly from 0.08 to 0.5, then 1.
template <typename T>
ARS_HD inline T levelRoughness(int level, int levels) {
    if (level >= levels - 1) return T(1);
    return T(kMinLightRoughness) + T(level) / T(levels - 2) * T(kMaxSharpRoughness - kMinLightRoughness);
}

/// The level, fractional, that holds this roughness; the inverse of levelRoughness. NaN gives level 0.
template <typename T>
ARS_HD inline T roughnessLevel(T roughness, int levels) {
    const T low = T(kMinLightRoughness), middle = T(kMaxSharpRoughness);
    if (!(roughness > low)) return T(0);
    if (roughness < middle) return (roughness - low) / (middle - low) * T(levels - 2);
    return ((roughness < T(1) ? roughness : T(1)) - middle) / (T(1) - middle) + T(levels - 2);
}

/// A prefiltered light, ready to be looked up. Pointers of one device; the struct travels into kernels by value.
template <typename T>
struct LightView {
    CubeView<T> specular[kMaxLightLevels]; ///< normalised GGX-filtered radiance
    int levels = 0;
    CubeView<T> diffuse;    ///< irradiance / pi
    const T* lut = nullptr; ///< (lutSize, lutSize, 2): row roughness, column n.v, texel centres; A and B
    int lutSize = 0;
    glm::mat<3, 3, T> worldToEnvironment{T(1)};
    T scale = T(1); ///< linear exposure
};

/// Mirror lobe of this roughness about a direction in the environment's frame: trilinear, before LightView::scale.
template <typename T>
ARS_HD inline glm::vec<3, T> lookupSpecular(const LightView<T>& light, const glm::vec<3, T>& direction, T roughness) {
    const T level = roughnessLevel(roughness, light.levels);
    int lower = static_cast<int>(level);
    if (lower > light.levels - 2) lower = light.levels - 2;
    const T t = level - T(lower);
    const glm::vec<3, T> a = lookupCube(light.specular[lower], direction);
    if (t == T(0)) return a;
    return a + t * (lookupCube(light.specular[lower + 1], direction) - a);
}

/// Irradiance / pi about a normal in the environment's frame, before LightView::scale.
template <typename T>
ARS_HD inline glm::vec<3, T> lookupIrradiance(const LightView<T>& light, const glm::vec<3, T>& normal) {
    return lookupCube(light.diffuse, normal);
}

/// The two integrals of the split sum: specular albedo = F0 A + B. Bilinear, clamped to the table.
template <typename T>
ARS_HD inline glm::vec<2, T> lookupSplitSum(const T* lut, int size, T normalDotView, T roughness) {
    const T top = T(size - 1);
    T x = normalDotView * T(size) - T(0.5), y = roughness * T(size) - T(0.5);
    x = x > T(0) ? (x < top ? x : top) : T(0);
    y = y > T(0) ? (y < top ? y : top) : T(0);
    int x0 = static_cast<int>(x), y0 = static_cast<int>(y);
    if (x0 > size - 2) x0 = size - 2;
    if (y0 > size - 2) y0 = size - 2;
    const T fx = x - T(x0), fy = y - T(y0);
    const T* a =
        lut + 2 * (static_cast<std::size_t>(y0) * static_cast<std::size_t>(size) + static_cast<std::size_t>(x0));
    const T* b = a + 2 * static_cast<std::size_t>(size);
    glm::vec<2, T> result;
    for (int k = 0; k < 2; ++k) {
        const T upper = a[k] + fx * (a[2 + k] - a[k]), below = b[k] + fx * (b[2 + k] - b[k]);
        result[k] = upper + fy * (below - upper);
    }
    return result;
}

/// World directions to the environment's for a light that is turned by `rotationDeg` about +y (positive takes +z
/// towards +x): a light at +z of the picture then shines from sin(angle) x + cos(angle) z.
template <typename T>
ARS_HD inline glm::mat<3, 3, T> worldToEnvironment(T rotationDeg) {
    const T angle = rotationDeg * T(0.017453292519943295769);
    const T c = std::cos(angle), s = std::sin(angle);
    // Columns: where world x, y and z go.
    return glm::mat<3, 3, T>(c, T(0), s, T(0), T(1), T(0), -s, T(0), c);
}

} // namespace ars
