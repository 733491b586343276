#pragma once

#include "engine/light/light_math.h"

namespace ars {

// One pixel of deferred split-sum shading (docs/math/shading.md), host and device, T float or double.

/// What one pixel gives to the light: all in the camera's frame.
template <typename T>
struct ShadingPoint {
    glm::vec<3, T> albedo;   ///< linear
    T roughness;             ///< as stored
    glm::vec<3, T> normal;   ///< towards the camera, any length but zero
    glm::vec<3, T> toCamera; ///< from the surface to the camera, any length but zero
};

template <typename T>
struct ShadedPoint {
    glm::vec<3, T> diffuse, specular; ///< linear, not occluded
};

/// The mirror direction of the view, r = 2 (n.v) n - v, with n.v not below 0.
template <typename T>
ARS_HD inline glm::vec<3, T> mirrorDirection(const glm::vec<3, T>& normal, const glm::vec<3, T>& view,
                                             T normalDotView) {
    return T(2) * normalDotView * normal - view;
}

template <typename T>
ARS_HD inline T lightRoughness(T roughness) {
    return roughness > T(kMinLightRoughness) ? (roughness < T(1) ? roughness : T(1)) : T(kMinLightRoughness);
}

/// C_diff = a E(n), C_spec = S(r, roughness) (F0 A + B).
/// @param cameraToEnvironment  LightView::worldToEnvironment times camera to world
template <typename T>
ARS_HD inline ShadedPoint<T> shadePoint(const ShadingPoint<T>& point, const LightView<T>& light,
                                        const glm::mat<3, 3, T>& cameraToEnvironment, T f0) {
    const glm::vec<3, T> n = point.normal * (T(1) / std::sqrt(glm::dot(point.normal, point.normal)));
    const glm::vec<3, T> v = point.toCamera * (T(1) / std::sqrt(glm::dot(point.toCamera, point.toCamera)));
    T cosine = glm::dot(n, v);
    cosine = cosine > T(0) ? cosine : T(0);
    const T roughness = lightRoughness(point.roughness);
    const glm::vec<3, T> mirror = cameraToEnvironment * mirrorDirection(n, v, cosine);
    const T nov = cosine > T(1e-4) ? (cosine < T(1) ? cosine : T(1)) : T(1e-4);
    const glm::vec<2, T> ab = lookupSplitSum(light.lut, light.lutSize, nov, roughness);
    ShadedPoint<T> shaded;
    shaded.diffuse = light.scale * (point.albedo * lookupIrradiance(light, cameraToEnvironment * n));
    shaded.specular = (light.scale * (f0 * ab.x + ab.y)) * lookupSpecular(light, mirror, roughness);
    return shaded;
}

/// False for NaN and infinity; compiles to two comparisons, and not away.
template <typename T>
ARS_HD inline bool isFiniteNumber(T x) {
    return x - x == T(0);
}

template <typename T>
ARS_HD inline bool isUsable(const ShadingPoint<T>& point) {
    const T lengths = glm::dot(point.normal, point.normal), ways = glm::dot(point.toCamera, point.toCamera);
    return isFiniteNumber(point.albedo.x + point.albedo.y + point.albedo.z + point.roughness) && lengths > T(0) &&
           isFiniteNumber(lengths) && ways > T(0) && isFiniteNumber(ways);
}

} // namespace ars
