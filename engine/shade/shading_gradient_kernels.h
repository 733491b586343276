#pragma once

#include "engine/light/prefilter_gradient.h"
#include "engine/shade/shading_gradient_math.h"
#include "engine/shade/shading_kernels.h"

#include <cstddef>

namespace ars {

/// What both devices are given, checked: pointers of one device.
struct ShadingGradientArguments {
    ShadingArguments shading;          ///< of the forward pass; its outputs are not looked at
    const float* gradBeauty = nullptr; ///< (height, width, 4)
    float *albedo = nullptr, *roughness = nullptr, *normal = nullptr, *opacity = nullptr, *occlusion = nullptr;
};

/// Where the numbers of a light's cubes lie behind one another: specular levels, then the diffuse cube.
struct LightLayout {
    std::size_t start[kMaxLightLevels + 1] = {}; ///< [levels] is the diffuse cube's
    std::size_t count = 0;
    int levels = 0;
};

ARS_HD inline LightLayout lightLayout(const LightView<float>& light) {
    LightLayout layout;
    layout.levels = light.levels;
    for (int l = 0; l <= light.levels; ++l) {
        const int side = l < light.levels ? light.specular[l].size : light.diffuse.size;
        layout.start[l] = layout.count;
        layout.count += 18 * static_cast<std::size_t>(side) * static_cast<std::size_t>(side);
    }
    return layout;
}

/// dL/d of one pixel's inputs.
struct PixelGradient {
    glm::vec3 albedo{0.0f}, normal{0.0f};
    float roughness = 0.0f, opacity = 0.0f, occlusion = 0.0f;
};

/// One pixel's four texels of a cube. add(place in the layout, number).
template <typename Add>
ARS_HD inline void addTexels(std::size_t start, const CubeTaps<float>& taps, const glm::vec3& value, const Add& add) {
    for (int k = 0; k < 4; ++k) {
        for (int c = 0; c < 3; ++c) {
            add(start + 3 * taps.index[k] + static_cast<std::size_t>(c), taps.weight[k] * value[c]);
        }
    }
}

/// dL/d of a pixel's inputs; what it passes to the light goes through `add` when `layout` is not null.
template <typename Add>
ARS_HD inline PixelGradient pixelGradient(const ShadingGradientArguments& a, int row, int column,
                                          const LightLayout* layout, const Add& add) {
    const ShadingArguments& s = a.shading;
    const std::size_t i = pixelIndex(s, row, column);
    PixelGradient result;
    const float opacity = s.opacity[i];
    if (!(opacity >= kMinOpacity) || !isFiniteNumber(opacity)) return result;
    const float* g = a.gradBeauty + 4 * i;
    const ShadingPoint<float> point = readPoint(s, row, column);
    const float occlusion = s.occlusion ? s.occlusion[i] : 1.0f;
    if (!isUsable(point) || !isFiniteNumber(occlusion)) {
        result.opacity = g[3];
        return result;
    }
    const float specularOcclusion = s.occludeSpecular ? occlusion : 1.0f;
    const ShadedPoint<float> shaded = shadePoint(point, s.light, s.cameraToEnvironment, s.f0);
    const glm::vec3 gColor(g[0], g[1], g[2]);
    const glm::vec3 color = occlusion * shaded.diffuse + specularOcclusion * shaded.specular;
    result.opacity = g[3] + glm::dot(gColor, color);
    if (s.occlusion) {
        const glm::vec3 under = s.occludeSpecular ? shaded.diffuse + shaded.specular : shaded.diffuse;
        result.occlusion = opacity * glm::dot(gColor, under);
    }
    LightTexelGradient<float> texels;
    const ShadingPointGradient<float> gPoint =
        shadePointBackward(point, s.light, s.cameraToEnvironment, s.f0, opacity * occlusion * gColor,
                           opacity * specularOcclusion * gColor, layout ? &texels : nullptr);
    result.albedo = gPoint.albedo;
    result.roughness = gPoint.roughness;
    result.normal = gPoint.normal;
    if (!layout) return result;
    addTexels(layout->start[layout->levels], texels.diffuse, texels.diffuseValue, add);
    for (int k = 0; k < 2; ++k)
        addTexels(layout->start[texels.level[k]], texels.specular[k], texels.specularValue[k], add);
    return result;
}

/// The same from memory to memory.
template <typename Add>
ARS_HD inline void shadePixelBackward(const ShadingGradientArguments& a, int row, int column, const LightLayout* layout,
                                      const Add& add) {
    const PixelGradient g = pixelGradient(a, row, column, layout, add);
    const std::size_t i = pixelIndex(a.shading, row, column);
    writeVector(a.albedo, i, g.albedo);
    writeVector(a.normal, i, g.normal);
    if (a.roughness) a.roughness[i] = g.roughness;
    if (a.opacity) a.opacity[i] = g.opacity;
    if (a.occlusion) a.occlusion[i] = g.occlusion;
}

// The light's gradient on CUDA: thousands of threads add to one texel in any order, and the numbers must be the same
// each time. So they add whole numbers: multiples of a power of two that depends on a bound of what any pixel can give.

/// At least as large as any number that this pixel passes to the light; NaN or infinite where one is. A and B of the
/// split sum are at most 1, and so is f0.
ARS_HD inline float lightGradientBound(const ShadingGradientArguments& a, int row, int column) {
    const ShadingArguments& s = a.shading;
    const std::size_t i = pixelIndex(s, row, column);
    const float opacity = s.opacity[i];
    if (!(opacity >= kMinOpacity) || !isFiniteNumber(opacity)) return 0.0f;
    const ShadingPoint<float> point = readPoint(s, row, column);
    const float occlusion = s.occlusion ? std::fabs(s.occlusion[i]) : 1.0f;
    if (!isUsable(point) || !isFiniteNumber(occlusion)) return 0.0f;
    const glm::vec3& albedo = point.albedo;
    const float diffuse = occlusion * (std::fabs(albedo.x) + std::fabs(albedo.y) + std::fabs(albedo.z));
    const float specular = s.occludeSpecular ? 2.0f * occlusion : 2.0f;
    const float* g = a.gradBeauty + 4 * i;
    return opacity * s.light.scale * (diffuse + specular) * (std::fabs(g[0]) + std::fabs(g[1]) + std::fabs(g[2]));
}

/// Binary digits of the largest bound, so that this many pixels together stay below 2^61.
inline int fixedPointBits(std::size_t pixels) {
    int digits = 0;
    while (digits < 40 && (std::size_t(1) << digits) < pixels) ++digits;
    return 61 - digits;
}

/// Steps that 1 is divided into; a power of two.
ARS_HD inline double fixedPointSteps(float bound, int bits) {
    int exponent = 0;
    (void)std::frexp(bound, &exponent);
    return std::ldexp(1.0, bits - exponent);
}

ARS_HD inline long long toFixedPoint(float value, double steps) {
    const double scaled = static_cast<double>(value) * steps;
    return static_cast<long long>(scaled + (scaled < 0.0 ? -0.5 : 0.5));
}

/// NaN where the bound says that something was not finite.
ARS_HD inline float fromFixedPoint(long long sum, float bound, int bits) {
    return isFiniteNumber(bound) ? static_cast<float>(static_cast<double>(sum) / fixedPointSteps(bound, bits))
                                 : bound - bound;
}

namespace cuda {
/// Scratch of the light's gradient on the device.
struct LightSums {
    unsigned int* bound = nullptr; ///< bits of the largest lightGradientBound
    long long* sums = nullptr;     ///< (layout.count) fixed-point numbers
    LightLayout layout;
};

/// Queued on the default stream of device `index`; does not wait. `light` is null when no gradient of it is wanted.
Status shadeBackward(const ShadingGradientArguments& arguments, const LightSums* light,
                     const LightLevelViews<float>& gradLight, int index);
} // namespace cuda

} // namespace ars
