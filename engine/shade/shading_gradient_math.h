#pragma once

#include "engine/light/light_gradient_math.h"
#include "engine/shade/shading_math.h"

namespace ars {

/// dL/d of one pixel's ShadingPoint; the view direction carries none (a pixel's ray does not move).
template <typename T>
struct ShadingPointGradient {
    glm::vec<3, T> albedo{T(0)};
    T roughness = T(0);
    glm::vec<3, T> normal{T(0)}; ///< of the vector as given, its length included
};

/// What a pixel passes to the light: texels of the diffuse cube and of two specular levels get `weight` times these.
template <typename T>
struct LightTexelGradient {
    CubeTaps<T> diffuse;
    glm::vec<3, T> diffuseValue;
    int level[2];
    CubeTaps<T> specular[2];
    glm::vec<3, T> specularValue[2];
};

/// Backward of shadePoint.
/// @param gDiffuse, gSpecular  dL/d of its results
/// @param lightGradient        may be null
template <typename T>
ARS_HD inline ShadingPointGradient<T>
shadePointBackward(const ShadingPoint<T>& point, const LightView<T>& light,
                   const glm::mat<3, 3, T>& cameraToEnvironment, T f0, const glm::vec<3, T>& gDiffuse,
                   const glm::vec<3, T>& gSpecular, LightTexelGradient<T>* lightGradient) {
    using V = glm::vec<3, T>;
    const T inverseLength = T(1) / std::sqrt(glm::dot(point.normal, point.normal));
    const V n = point.normal * inverseLength;
    const V v = point.toCamera * (T(1) / std::sqrt(glm::dot(point.toCamera, point.toCamera)));
    const T rawCosine = glm::dot(n, v), cosine = rawCosine > T(0) ? rawCosine : T(0);
    const T roughness = lightRoughness(point.roughness);
    const V mirror = cameraToEnvironment * mirrorDirection(n, v, cosine);
    const T nov = cosine > T(1e-4) ? (cosine < T(1) ? cosine : T(1)) : T(1e-4);
    const glm::vec<2, T> ab = lookupSplitSum(light.lut, light.lutSize, nov, roughness);
    const T specularScale = light.scale * (f0 * ab.x + ab.y);
    const V normalEnvironment = cameraToEnvironment * n;
    const auto toCameraFrame = glm::transpose(cameraToEnvironment);

    ShadingPointGradient<T> g;
    g.albedo = light.scale * (gDiffuse * lookupIrradiance(light, normalEnvironment));
    const V gIrradiance = light.scale * (gDiffuse * point.albedo);
    const CubeLookupGradient<T> diffuse = lookupCubeBackward(light.diffuse, normalEnvironment, gIrradiance);
    V gNormal = toCameraFrame * diffuse.direction;

    const V gLobe = specularScale * gSpecular;
    const SpecularLookupGradient<T> specular = lookupSpecularBackward(light, mirror, roughness, gLobe);
    const V gMirror = toCameraFrame * specular.direction;
    const T gScale = light.scale * glm::dot(gSpecular, lookupSpecular(light, mirror, roughness));
    const glm::vec<2, T> gTable =
        lookupSplitSumBackward(light.lut, light.lutSize, nov, roughness, glm::vec<2, T>(gScale * f0, gScale));
    gNormal += T(2) * cosine * gMirror;
    T gCosine = T(2) * glm::dot(n, gMirror);
    if (cosine > T(1e-4) && cosine < T(1)) gCosine += gTable.x;
    if (rawCosine > T(0)) gNormal += gCosine * v;
    g.normal = inverseLength * (gNormal - glm::dot(gNormal, n) * n);
    if (point.roughness > T(kMinLightRoughness) && point.roughness < T(1)) g.roughness = specular.roughness + gTable.y;

    if (lightGradient) {
        lightGradient->diffuse = diffuse.taps;
        lightGradient->diffuseValue = gIrradiance;
        for (int k = 0; k < 2; ++k) {
            lightGradient->level[k] = specular.level[k];
            lightGradient->specular[k] = specular.taps[k];
            lightGradient->specularValue[k] = specular.share[k] * gLobe;
        }
    }
    return g;
}

} // namespace ars
