#include "engine/shade/shading.h"

#include "engine/shade/shading_kernels.h"

#include <string_view>

namespace ars {
namespace {

template <typename T>
Status checkPicture(std::string_view name, const ImageView<T>& picture, int channels, bool required,
                    const Camera& camera) {
    if (picture.empty() && !required) return {};
    if (picture.empty()) {
        return makeError(ErrorCode::InvalidArgument, "shading", fmt::format("{} is missing", name));
    }
    if (picture.width == camera.width && picture.height == camera.height && picture.channels == channels) return {};
    return makeError(ErrorCode::InvalidArgument, "shading",
                     fmt::format("{} is {}x{} with {} channels, expected {}x{} with {}", name, picture.width,
                                 picture.height, picture.channels, camera.width, camera.height, channels));
}

Status checkInputs(const ShadingInputs& inputs) {
    const Camera& camera = inputs.camera;
    ARS_TRY_STATUS(validateCamera(camera, "shading: camera"));
    ARS_TRY_STATUS(checkPicture("albedo", inputs.albedo, 3, true, camera));
    ARS_TRY_STATUS(checkPicture("roughness", inputs.roughness, 1, true, camera));
    ARS_TRY_STATUS(checkPicture("normal", inputs.normal, 3, true, camera));
    ARS_TRY_STATUS(checkPicture("opacity", inputs.opacity, 1, true, camera));
    ARS_TRY_STATUS(checkPicture("occlusion", inputs.occlusion, 1, false, camera));
    ARS_TRY_STATUS(checkPicture("position", inputs.position, 3, false, camera));
    const LightView<float>& light = inputs.light;
    bool whole = light.levels >= 3 && light.levels <= kMaxLightLevels && light.diffuse.texels &&
                 light.diffuse.size > 0 && light.lut && light.lutSize >= 2;
    for (int l = 0; whole && l < light.levels; ++l) whole = light.specular[l].texels && light.specular[l].size > 0;
    if (!whole) return makeError(ErrorCode::InvalidArgument, "shading", "the light is not filtered");
    if (!isFiniteNumber(light.scale) || light.scale < 0.0f) {
        return makeError(ErrorCode::InvalidArgument, "shading",
                         fmt::format("light scale {}, expected a finite number not below 0", light.scale));
    }
    return {};
}

Status checkOutputs(const ShadingOutputs& outputs, const Camera& camera) {
    ARS_TRY_STATUS(checkPicture("beauty", outputs.beauty, 4, false, camera));
    ARS_TRY_STATUS(checkPicture("diffuse", outputs.diffuse, 3, false, camera));
    ARS_TRY_STATUS(checkPicture("specular", outputs.specular, 3, false, camera));
    return checkPicture("unoccluded", outputs.unoccluded, 3, false, camera);
}

} // namespace

Result<ShadingArguments> shadingArguments(const ShadingParams& params, const ShadingInputs& inputs) {
    ARS_TRY_STATUS(checkInputs(inputs));
    if (!(params.f0 >= 0.0f && params.f0 <= 1.0f)) {
        return makeError(ErrorCode::InvalidArgument, "shading", fmt::format("f0 {}, expected 0 to 1", params.f0));
    }
    const Camera& camera = inputs.camera;
    ShadingArguments a;
    a.width = camera.width;
    a.height = camera.height;
    a.albedo = inputs.albedo.data;
    a.roughness = inputs.roughness.data;
    a.normal = inputs.normal.data;
    a.opacity = inputs.opacity.data;
    a.occlusion = params.occlude ? inputs.occlusion.data : nullptr;
    a.position = inputs.position.data;
    a.fx = static_cast<float>(camera.fx);
    a.fy = static_cast<float>(camera.fy);
    a.cx = static_cast<float>(camera.cx);
    a.cy = static_cast<float>(camera.cy);
    a.worldToCamera = glm::mat3(camera.rotation);
    a.cameraWorld = glm::vec3(camera.centerWorld());
    a.cameraToEnvironment = glm::mat3(glm::dmat3(inputs.light.worldToEnvironment) * glm::transpose(camera.rotation));
    a.light = inputs.light;
    a.f0 = params.f0;
    a.occludeSpecular = params.occludeSpecular;
    return a;
}

Status shade(const Device& device, const ShadingParams& params, const ShadingInputs& inputs,
             const ShadingOutputs& outputs) {
    ARS_TRY(ShadingArguments arguments, shadingArguments(params, inputs));
    ARS_TRY_STATUS(checkOutputs(outputs, inputs.camera));
    arguments.beauty = outputs.beauty.data;
    arguments.diffuse = outputs.diffuse.data;
    arguments.specular = outputs.specular.data;
    arguments.unoccluded = outputs.unoccluded.data;
    if (device.kind == DeviceKind::Host) {
        cpu::shade(arguments);
        return {};
    }
#ifdef ARS_HAVE_CUDA
    return cuda::shade(arguments, device.index);
#else
    return makeError(ErrorCode::Unavailable, "shading", "this build has no CUDA kernels");
#endif
}

} // namespace ars
