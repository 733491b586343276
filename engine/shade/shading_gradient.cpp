#include "engine/shade/shading_gradient.h"

#include "engine/core/parallel.h"
#include "engine/shade/shading_gradient_math.h"
#include "engine/shade/shading_kernels.h"

#include <algorithm>
#include <string_view>
#include <vector>

namespace ars {
namespace {

/// Pieces of the picture that collect the light's gradient for themselves and are then summed in their order: the
/// result does not depend on the number of threads. Few, because each has a copy of the light.
constexpr std::size_t kPieces = 4;

Status checkView(std::string_view name, int width, int height, int channels, const Camera& camera, int expected) {
    if (width == camera.width && height == camera.height && channels == expected) return {};
    return makeError(ErrorCode::InvalidArgument, "shading gradient",
                     fmt::format("{} is {}x{} with {} channels, expected {}x{} with {}", name, width, height, channels,
                                 camera.width, camera.height, expected));
}

template <typename T>
Status checkOptional(std::string_view name, const ImageView<T>& view, const Camera& camera, int expected) {
    if (view.empty()) return {};
    return checkView(name, view.width, view.height, view.channels, camera, expected);
}

struct Job {
    const ShadingParams& params;
    const ShadingInputs& inputs;
    ImageView<const float> gradBeauty;
    const ShadingGradientOutputs& outputs;
    glm::mat3 cameraToEnvironment;
    glm::mat3 worldToCamera;
    glm::vec3 cameraWorld;
};

glm::vec3 vectorAt(const ImageView<const float>& view, std::size_t pixel) {
    const float* p = view.pixel(pixel);
    return {p[0], p[1], p[2]};
}

void put(const ImageView<float>& view, std::size_t pixel, const glm::vec3& value) {
    if (view.empty()) return;
    float* p = view.pixel(pixel);
    p[0] = value.x;
    p[1] = value.y;
    p[2] = value.z;
}

void put(const ImageView<float>& view, std::size_t pixel, float value) {
    if (!view.empty()) view[pixel] = value;
}

void scatter(std::vector<float>& cube, const CubeTaps<float>& taps, const glm::vec3& value) {
    for (int k = 0; k < 4; ++k) {
        float* texel = cube.data() + 3 * taps.index[k];
        for (int c = 0; c < 3; ++c) texel[c] += taps.weight[k] * value[c];
    }
}

ShadingPoint<float> pointAt(const Job& job, std::size_t pixel) {
    const Camera& camera = job.inputs.camera;
    ShadingPoint<float> point;
    point.albedo = vectorAt(job.inputs.albedo, pixel);
    point.roughness = job.inputs.roughness[pixel];
    point.normal = vectorAt(job.inputs.normal, pixel);
    if (!job.inputs.position.empty()) {
        point.toCamera = job.worldToCamera * (job.cameraWorld - vectorAt(job.inputs.position, pixel));
        return point;
    }
    const auto width = static_cast<std::size_t>(camera.width);
    const float column = static_cast<float>(pixel % width) + 0.5f, row = static_cast<float>(pixel / width) + 0.5f;
    point.toCamera = {(static_cast<float>(camera.cx) - column) / static_cast<float>(camera.fx),
                      (static_cast<float>(camera.cy) - row) / static_cast<float>(camera.fy), -1.0f};
    return point;
}

void backwardPixel(const Job& job, std::size_t pixel, LightLevelGradients* light) {
    const ShadingGradientOutputs& out = job.outputs;
    put(out.albedo, pixel, glm::vec3(0.0f));
    put(out.roughness, pixel, 0.0f);
    put(out.normal, pixel, glm::vec3(0.0f));
    put(out.opacity, pixel, 0.0f);
    put(out.occlusion, pixel, 0.0f);
    const float opacity = job.inputs.opacity[pixel];
    if (!(opacity >= kMinOpacity) || !isFiniteNumber(opacity)) return;
    const float* g = job.gradBeauty.pixel(pixel);
    const ShadingPoint<float> point = pointAt(job, pixel);
    const bool occluded = job.params.occlude && !job.inputs.occlusion.empty();
    const float occlusion = occluded ? job.inputs.occlusion[pixel] : 1.0f;
    if (!isUsable(point) || !isFiniteNumber(occlusion)) {
        put(out.opacity, pixel, g[3]);
        return;
    }
    const float specularOcclusion = job.params.occludeSpecular ? occlusion : 1.0f;
    const ShadedPoint<float> shaded = shadePoint(point, job.inputs.light, job.cameraToEnvironment, job.params.f0);
    const glm::vec3 gColor(g[0], g[1], g[2]);
    const glm::vec3 color = occlusion * shaded.diffuse + specularOcclusion * shaded.specular;
    put(out.opacity, pixel, g[3] + glm::dot(gColor, color));
    if (occluded) {
        const glm::vec3 under = job.params.occludeSpecular ? shaded.diffuse + shaded.specular : shaded.diffuse;
        put(out.occlusion, pixel, opacity * glm::dot(gColor, under));
    }
    LightTexelGradient<float> texels;
    const ShadingPointGradient<float> gPoint = shadePointBackward(
        point, job.inputs.light, job.cameraToEnvironment, job.params.f0, opacity * occlusion * gColor,
        opacity * specularOcclusion * gColor, light ? &texels : nullptr);
    put(out.albedo, pixel, gPoint.albedo);
    put(out.roughness, pixel, gPoint.roughness);
    put(out.normal, pixel, gPoint.normal);
    if (!light) return;
    scatter(light->diffuse, texels.diffuse, texels.diffuseValue);
    for (int k = 0; k < 2; ++k) {
        scatter(light->specular[static_cast<std::size_t>(texels.level[k])], texels.specular[k],
                texels.specularValue[k]);
    }
}

void addTo(std::vector<float>& sum, const std::vector<float>& part) {
    for (std::size_t i = 0; i < sum.size(); ++i) sum[i] += part[i];
}

} // namespace

Status shadeBackward(const ShadingParams& params, const ShadingInputs& inputs, ImageView<const float> gradBeauty,
                     const ShadingGradientOutputs& outputs, LightLevelGradients* light) {
    const Camera& camera = inputs.camera;
    ARS_TRY_STATUS(checkView("dL/dbeauty", gradBeauty.width, gradBeauty.height, gradBeauty.channels, camera, 4));
    ARS_TRY_STATUS(checkView("albedo", inputs.albedo.width, inputs.albedo.height, inputs.albedo.channels, camera, 3));
    ARS_TRY_STATUS(
        checkView("roughness", inputs.roughness.width, inputs.roughness.height, inputs.roughness.channels, camera, 1));
    ARS_TRY_STATUS(checkView("normal", inputs.normal.width, inputs.normal.height, inputs.normal.channels, camera, 3));
    ARS_TRY_STATUS(
        checkView("opacity", inputs.opacity.width, inputs.opacity.height, inputs.opacity.channels, camera, 1));
    ARS_TRY_STATUS(checkOptional("occlusion", inputs.occlusion, camera, 1));
    ARS_TRY_STATUS(checkOptional("position", inputs.position, camera, 3));
    ARS_TRY_STATUS(checkOptional("dL/dalbedo", outputs.albedo, camera, 3));
    ARS_TRY_STATUS(checkOptional("dL/droughness", outputs.roughness, camera, 1));
    ARS_TRY_STATUS(checkOptional("dL/dnormal", outputs.normal, camera, 3));
    ARS_TRY_STATUS(checkOptional("dL/dopacity", outputs.opacity, camera, 1));
    ARS_TRY_STATUS(checkOptional("dL/docclusion", outputs.occlusion, camera, 1));
    const Job job{params,
                  inputs,
                  gradBeauty,
                  outputs,
                  glm::mat3(glm::dmat3(inputs.light.worldToEnvironment) * glm::transpose(camera.rotation)),
                  glm::mat3(camera.rotation),
                  glm::vec3(camera.centerWorld())};
    const std::size_t pixels = gradBeauty.pixelCount(), size = (pixels + kPieces - 1) / kPieces;
    std::vector<LightLevelGradients> parts(light ? kPieces : 0);
    for (LightLevelGradients& part : parts) part.reset(inputs.light);
    parallelFor(
        kPieces,
        [&](std::size_t piece) {
            for (std::size_t p = piece * size; p < std::min(pixels, (piece + 1) * size); ++p) {
                backwardPixel(job, p, light ? &parts[piece] : nullptr);
            }
        },
        1);
    if (!light) return {};
    *light = std::move(parts[0]);
    for (std::size_t k = 1; k < kPieces; ++k) {
        for (int l = 0; l < light->levels; ++l) {
            const auto level = static_cast<std::size_t>(l);
            addTo(light->specular[level], parts[k].specular[level]);
        }
        addTo(light->diffuse, parts[k].diffuse);
    }
    return {};
}

} // namespace ars
