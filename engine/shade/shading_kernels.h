#pragma once

#include "engine/core/error.h"
#include "engine/core/image_view.h"
#include "engine/shade/shading.h"
#include "engine/shade/shading_math.h"
#include "engine/surfel/gbuffer.h"

namespace ars {

/// What both devices are given, checked: pointers of one device, null where a picture is not there.
struct ShadingArguments {
    int width = 0, height = 0;
    const float *albedo = nullptr, *roughness = nullptr, *normal = nullptr, *opacity = nullptr;
    const float *occlusion = nullptr, *position = nullptr;
    float *beauty = nullptr, *diffuse = nullptr, *specular = nullptr, *unoccluded = nullptr;
    float fx = 1, fy = 1, cx = 0, cy = 0;
    glm::mat3 worldToCamera{1.0f};
    glm::vec3 cameraWorld{0.0f};
    glm::mat3 cameraToEnvironment{1.0f};
    LightView<float> light;
    float f0 = 0.04f;
    bool occludeSpecular = true;
};

/// The arguments of both directions, without outputs. InvalidArgument as shade().
Result<ShadingArguments> shadingArguments(const ShadingParams& params, const ShadingInputs& inputs);

ARS_HD inline std::size_t pixelIndex(const ShadingArguments& a, int row, int column) {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(a.width) + static_cast<std::size_t>(column);
}

ARS_HD inline glm::vec3 readVector(const float* picture, std::size_t pixel) {
    const float* p = picture + 3 * pixel;
    return {p[0], p[1], p[2]};
}

ARS_HD inline void writeVector(float* picture, std::size_t pixel, const glm::vec3& value) {
    if (!picture) return;
    float* p = picture + 3 * pixel;
    p[0] = value.x;
    p[1] = value.y;
    p[2] = value.z;
}

ARS_HD inline void writeShaded(const ShadingArguments& a, std::size_t pixel, const ShadedPoint<float>& shaded,
                               float occlusion, float opacity) {
    const glm::vec3 diffuse = shaded.diffuse * occlusion;
    const glm::vec3 specular = shaded.specular * (a.occludeSpecular ? occlusion : 1.0f);
    if (a.beauty) {
        float* b = a.beauty + 4 * pixel;
        const glm::vec3 color = opacity * (diffuse + specular);
        b[0] = color.x;
        b[1] = color.y;
        b[2] = color.z;
        b[3] = opacity;
    }
    writeVector(a.diffuse, pixel, diffuse);
    writeVector(a.specular, pixel, specular);
    writeVector(a.unoccluded, pixel, shaded.diffuse + shaded.specular);
}

ARS_HD inline ShadingPoint<float> readPoint(const ShadingArguments& a, int row, int column) {
    const std::size_t i = pixelIndex(a, row, column);
    ShadingPoint<float> point;
    point.albedo = readVector(a.albedo, i);
    point.roughness = a.roughness[i];
    point.normal = readVector(a.normal, i);
    if (a.position) {
        point.toCamera = a.worldToCamera * (a.cameraWorld - readVector(a.position, i));
    } else {
        point.toCamera = {(a.cx - (static_cast<float>(column) + 0.5f)) / a.fx,
                          (a.cy - (static_cast<float>(row) + 0.5f)) / a.fy, -1.0f};
    }
    return point;
}

/// One pixel from memory to memory.
ARS_HD inline void shadePixel(const ShadingArguments& a, int row, int column) {
    const std::size_t i = pixelIndex(a, row, column);
    const float opacity = a.opacity[i];
    const ShadedPoint<float> black{glm::vec3(0.0f), glm::vec3(0.0f)};
    if (!(opacity >= kMinOpacity) || !isFiniteNumber(opacity)) {
        writeShaded(a, i, black, 0.0f, 0.0f);
        return;
    }
    const ShadingPoint<float> point = readPoint(a, row, column);
    const float occlusion = a.occlusion ? a.occlusion[i] : 1.0f;
    if (!isUsable(point) || !isFiniteNumber(occlusion)) {
        writeShaded(a, i, black, 0.0f, opacity);
        return;
    }
    writeShaded(a, i, shadePoint(point, a.light, a.cameraToEnvironment, a.f0), occlusion, opacity);
}

namespace cpu {
void shade(const ShadingArguments& arguments);
} // namespace cpu

namespace cuda {
/// Queued on the default stream of device `index`; does not wait.
Status shade(const ShadingArguments& arguments, int index);
} // namespace cuda

} // namespace ars
