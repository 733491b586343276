#include "engine/frame/occlusion_stage.h"

#include <glm/gtc/quaternion.hpp>

#include <algorithm>
#include <limits>

namespace ars {

namespace {

Status requireHost(const OcclusionStageInputs& inputs, std::string_view method) {
    if (inputs.live.device.kind == DeviceKind::Host) return {};
    return makeError(ErrorCode::Unsupported, "occlusion",
                     fmt::format("method {} runs on the processor only; use --device cpu", method));
}

std::vector<glm::vec3> surfelNormals(const SurfelView& surfels) {
    std::vector<glm::vec3> normals(surfels.count);
    for (std::size_t i = 0; i < surfels.count; ++i) {
        const float* q = surfels.rotations + 4 * i;
        normals[i] = glm::quat(q[0], q[1], q[2], q[3]) * glm::vec3(0, 0, 1);
    }
    return normals;
}

/// The mesh in the pose of the canonical surfels.
Result<std::vector<glm::vec3>> canonicalVertices(const AvatarEvaluator& avatar) {
    const TriangleMesh& mesh = avatar.mesh().mesh;
    std::vector<glm::vec3> vertices(mesh.positions.size());
    ARS_TRY_STATUS(skinPoints(avatar.rig().canonical, avatar.mesh().weights, mesh.positions, vertices));
    return vertices;
}

} // namespace

Status OcclusionStage::run(const OcclusionSettings& settings, const OcclusionStageInputs& inputs,
                           PixelBuffer& occlusion) {
    const GBuffer& gbuffer = *inputs.gbuffer;
    ARS_TRY_STATUS(occlusion.reshape(inputs.live.device, gbuffer.width(), gbuffer.height(), 1, "occlusion"));
    complete_ = true;
    share_ = 1.0f;
    preparationMs_ = 0.0;
    switch (settings.method) {
    case OcclusionMethod::ScreenSpace:
        return screenSpace(settings.screenSpace, inputs, occlusion);
    case OcclusionMethod::MeshRays:
        return meshRays(settings.meshRays, inputs, occlusion);
    case OcclusionMethod::Rasterised:
        return rasterised(settings.rasterised, inputs, occlusion);
    case OcclusionMethod::Baked:
        return baked(settings.baked, inputs, occlusion);
    case OcclusionMethod::Off:
        break;
    }
    const std::vector<float> ones(occlusion.view().pixelCount(), 1.0f);
    return uploadBuffer(occlusion.memory(), std::as_bytes(std::span(ones)));
}

Status OcclusionStage::screenSpace(const OcclusionParams& params, const OcclusionStageInputs& inputs,
                                   PixelBuffer& occlusion) {
    ARS_TRY(const OcclusionInputs pictures, occlusionInputs(*inputs.gbuffer, inputs.camera));
    if (params.quality == OcclusionQuality::Full)
        return ambientOcclusion(params, pictures, workspace_, occlusion.view());
    ARS_TRY_STATUS(inputs.refinement->refine(params, pictures, inputs.gbufferVersion, workspace_, occlusion.view()));
    complete_ = inputs.refinement->complete();
    share_ = inputs.refinement->share();
    return {};
}

Status OcclusionStage::meshRays(const MeshOcclusionParams& params, const OcclusionStageInputs& inputs,
                                PixelBuffer& occlusion) {
    ARS_TRY_STATUS(requireHost(inputs, "mesh_rays"));
    if (!tree_ || treeVersion_ != inputs.poseVersion) {
        ARS_TRY(const std::vector<glm::vec3> vertices, posedTemplate(inputs.avatar->mesh(), *inputs.pose));
        if (tree_) {
            ARS_TRY_STATUS(tree_->update(vertices));
        } else {
            ARS_TRY(MeshOcclusion tree, MeshOcclusion::build(vertices, inputs.avatar->mesh().mesh.triangles));
            tree_ = std::move(tree);
        }
        treeVersion_ = inputs.poseVersion;
        preparationMs_ = tree_->buildMilliseconds();
    }
    const GBuffer& g = *inputs.gbuffer;
    return tree_->atPixels(params, inputs.camera, g[Channel::Position].view(), g[Channel::Normal].view(),
                           g[Channel::Radius].view(), g[Channel::Opacity].view(), occlusion.view());
}

Status OcclusionStage::rasterised(const RasterisedVisibilityParams& params, const OcclusionStageInputs& inputs,
                                  PixelBuffer& occlusion) {
    ARS_TRY_STATUS(requireHost(inputs, "rasterised"));
    const bool made = visibility_ && visibilityParams_ == params;
    if (made && inputs.keepVisibility && visibilityValues_.size() == inputs.live.count) {
        complete_ = visibilityVersion_ == inputs.poseVersion && visibilityCanonical_ == inputs.canonicalVersion;
        share_ = complete_ ? 1.0f : 0.0f;
        return splatValues(visibilityValues_, inputs, occlusion);
    }
    if (!made || visibilityVersion_ != inputs.poseVersion) {
        visibilityCanonical_ = 0;
        ARS_TRY(const std::vector<glm::vec3> vertices, posedTemplate(inputs.avatar->mesh(), *inputs.pose));
        ARS_TRY(RasterisedVisibility built,
                RasterisedVisibility::build(vertices, inputs.avatar->mesh().mesh.triangles, params));
        visibility_ = std::move(built);
        visibilityVersion_ = inputs.poseVersion;
        visibilityParams_ = params;
        preparationMs_ = visibility_->buildMilliseconds();
    }
    if (visibilityCanonical_ != inputs.canonicalVersion) {
        const std::vector<glm::vec3> normals = surfelNormals(inputs.live);
        visibilityValues_.resize(inputs.live.count);
        ARS_TRY_STATUS(visibility_->atPoints({{inputs.live.means, inputs.live.count}, normals, {}}, visibilityValues_));
        visibilityCanonical_ = inputs.canonicalVersion;
    }
    return splatValues(visibilityValues_, inputs, occlusion);
}

bool OcclusionStage::prepared(const OcclusionSettings& settings) const {
    switch (settings.method) {
    case OcclusionMethod::MeshRays:
        return tree_.has_value();
    case OcclusionMethod::Rasterised:
        return visibility_ && visibilityParams_ == settings.rasterised;
    case OcclusionMethod::Baked:
        return bake_ && bakeParams_ == settings.baked;
    case OcclusionMethod::ScreenSpace:
    case OcclusionMethod::Off:
        break;
    }
    return true;
}

Status OcclusionStage::baked(const BakedVisibilityParams& params, const OcclusionStageInputs& inputs,
                             PixelBuffer& occlusion) {
    ARS_TRY_STATUS(requireHost(inputs, "baked"));
    if (!bake_ || bakeParams_ != params) {
        ARS_TRY(const std::vector<glm::vec3> vertices, canonicalVertices(*inputs.avatar));
        glm::vec3 low(std::numeric_limits<float>::max()), high(-low);
        for (const glm::vec3& vertex : vertices) {
            low = glm::min(low, vertex);
            high = glm::max(high, vertex);
        }
        BakedVisibilityParams centred = params;
        centred.centerM = 0.5f * (low + high);
        ARS_TRY(BakedVisibility bake, BakedVisibility::bake(vertices, inputs.avatar->mesh().mesh.triangles, centred));
        bake_ = std::move(bake);
        preparationMs_ = bake_->bakeMilliseconds();
        bakeParams_ = params;
        bakeVersion_ = 0;
    }
    if (bakeVersion_ != inputs.canonicalVersion) {
        const SurfelView canonical = viewOf(*inputs.canonical);
        const std::vector<glm::vec3> normals = surfelNormals(canonical);
        bakedValues_.resize(canonical.count);
        ARS_TRY_STATUS(bake_->atPoints({{canonical.means, canonical.count}, normals, {}}, bakedValues_));
        bakeVersion_ = inputs.canonicalVersion;
    }
    return splatValues(bakedValues_, inputs, occlusion);
}

/// One value a surfel to one a pixel: splatted in place of the importance, which has the same form.
Status OcclusionStage::splatValues(const std::vector<float>& values, const OcclusionStageInputs& inputs,
                                   PixelBuffer& occlusion) {
    SurfelView surfels = inputs.live;
    surfels.importances = values.data();
    ARS_TRY_STATUS(splat(inputs.splat, surfels, inputs.camera, {Channel::Opacity, Channel::Importance}, splatted_,
                         splatWorkspace_));
    const auto covered = splatted_[Channel::Opacity].view();
    const auto value = splatted_[Channel::Importance].view();
    const auto out = occlusion.view();
    for (std::size_t p = 0; p < out.pixelCount(); ++p) {
        out[p] = covered[p] > kMinOpacity ? std::clamp(value[p], 0.0f, 1.0f) : 1.0f;
    }
    return {};
}

} // namespace ars
