#include "model/evaluation/evaluated_view.h"

#include "engine/shade/shading.h"

#include <algorithm>

namespace ars::detail {
namespace {

ImageView<const float> viewOfImage(const Image& image) {
    return {image.pixels.data(), image.width, image.height, image.channels};
}

Image emptyPicture(const Image& like, int channels, ColorSpace space) {
    Image image;
    image.width = like.width;
    image.height = like.height;
    image.channels = channels;
    image.space = space;
    image.pixels.resize(static_cast<std::size_t>(like.width) * static_cast<std::size_t>(like.height) *
                        static_cast<std::size_t>(channels));
    return image;
}

} // namespace

Result<ViewRenderer> ViewRenderer::create(const EvaluatedAvatar& avatar) {
    if (!avatar.evaluator) return makeError(ErrorCode::InvalidArgument, "", "expected an avatar, found none");
    ARS_TRY(auto pipeline, FramePipeline::create(avatar.evaluator));
    return ViewRenderer(avatar, std::move(pipeline));
}

FrameInputs ViewRenderer::inputsFor(const Pose& pose, const Camera& camera) const {
    FrameInputs inputs;
    inputs.pose = pose;
    inputs.camera = camera;
    inputs.radii = avatar_.radii;
    inputs.splat = avatar_.splat;
    inputs.posing = avatar_.posing;
    inputs.occlusion.method = avatar_.occlude ? OcclusionMethod::ScreenSpace : OcclusionMethod::Off;
    inputs.occlusion.screenSpace = avatar_.occlusion;
    inputs.occlusion.screenSpace.quality = OcclusionQuality::Full;
    return inputs;
}

Result<Image> ViewRenderer::renderAlbedo(const Pose& pose, const Camera& camera) {
    ARS_TRY_STATUS(pipeline_->render(inputsFor(pose, camera), {BufferId::Albedo}));
    return pipeline_->picture(BufferId::Albedo);
}

Result<RenderedView> ViewRenderer::render(const Pose& pose, const Camera& camera) {
    const FrameInputs inputs = inputsFor(pose, camera);
    ARS_TRY_STATUS(
        pipeline_->render(inputs, {BufferId::Radiance, BufferId::Albedo, BufferId::Roughness, BufferId::Normal,
                                   BufferId::Depth, BufferId::Opacity, BufferId::AmbientOcclusion}));
    RenderedView view;
    ARS_TRY(view.radiance, pipeline_->picture(BufferId::Radiance));
    ARS_TRY(view.albedo, pipeline_->picture(BufferId::Albedo));
    ARS_TRY(view.roughness, pipeline_->picture(BufferId::Roughness));
    ARS_TRY(view.normal, pipeline_->picture(BufferId::Normal));
    ARS_TRY(view.depth, pipeline_->picture(BufferId::Depth));
    ARS_TRY(view.opacity, pipeline_->picture(BufferId::Opacity));
    ARS_TRY(view.occlusion, pipeline_->picture(BufferId::AmbientOcclusion));
    return view;
}

Result<Image> ViewRenderer::shade(const RenderedView& view, const Camera& camera, const PrefilteredLight& light,
                                  float scale, const glm::vec3& albedoScale) const {
    Image albedo = view.albedo;
    for (std::size_t i = 0; i < albedo.pixels.size(); ++i) albedo.pixels[i] *= albedoScale[static_cast<int>(i % 3)];
    Image beauty = emptyPicture(view.albedo, 4, ColorSpace::Linear);
    beauty.premultiplied = true;
    ShadingInputs inputs;
    inputs.albedo = viewOfImage(albedo);
    inputs.roughness = viewOfImage(view.roughness);
    inputs.normal = viewOfImage(view.normal);
    inputs.opacity = viewOfImage(view.opacity);
    if (avatar_.occlude) inputs.occlusion = viewOfImage(view.occlusion);
    inputs.camera = camera;
    inputs.light = light.view({.scale = scale});
    ShadingOutputs outputs;
    outputs.beauty = {beauty.pixels.data(), beauty.width, beauty.height, 4};
    ARS_TRY_STATUS(ars::shade({}, {}, inputs, outputs));
    return beauty;
}

Result<std::unique_ptr<PrefilteredLight>> filteredCube(const CubeMap& cube) {
    auto light = std::make_unique<PrefilteredLight>();
    CubeMap base = cube;
    while (base.size > 0 && base.size < kSmallestLightBase) {
        CubeMap larger(2 * base.size);
        for (int face = 0; face < 6; ++face) {
            for (int row = 0; row < larger.size; ++row) {
                for (int column = 0; column < larger.size; ++column)
                    std::copy_n(base.texel(face, row / 2, column / 2), 3, larger.texel(face, row, column));
            }
        }
        base = std::move(larger);
    }
    ARS_TRY_STATUS(prefilterLight({}, base, {}, *light));
    return light;
}

Image composedShading(const Image& shaded, const std::array<float, 3>& background) {
    Image result = emptyPicture(shaded, 3, ColorSpace::Srgb);
    const std::array<float, 3> linear{srgbToLinear(background[0]), srgbToLinear(background[1]),
                                      srgbToLinear(background[2])};
    for (std::size_t p = 0; p < shaded.pixels.size() / 4; ++p) {
        const float* from = &shaded.pixels[4 * p];
        for (std::size_t c = 0; c < 3; ++c) {
            const float value = from[c] + (1.0f - from[3]) * linear[c];
            result.pixels[3 * p + c] = linearToSrgb(std::clamp(value, 0.0f, 1.0f));
        }
    }
    return result;
}

Image composedRadiance(const RenderedView& view, const std::array<float, 3>& background) {
    Image result = emptyPicture(view.radiance, 3, ColorSpace::Srgb);
    for (std::size_t p = 0; p < view.opacity.pixels.size(); ++p) {
        const float opacity = view.opacity.pixels[p];
        for (std::size_t c = 0; c < 3; ++c) {
            const float value = opacity * view.radiance.pixels[3 * p + c] + (1.0f - opacity) * background[c];
            result.pixels[3 * p + c] = std::clamp(value, 0.0f, 1.0f);
        }
    }
    return result;
}

} // namespace ars::detail
