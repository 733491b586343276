#include "model/avatar/avatar_preview.h"

#include "engine/frame/display.h"
#include "engine/frame/frame_pipeline.h"
#include "engine/frame/framing.h"

namespace ars {
namespace {

constexpr int kSide = 512;
constexpr float kGrey = 0.2140f; ///< display-linear; sRGB 0.5

FrameInputs previewInputs(const AvatarModel& model) {
    FrameInputs inputs;
    inputs.pose = restPose(model.mesh.skeleton().jointCount());
    inputs.camera = orbitCamera(boundsOf(model.mesh.mesh.positions), 0.0, 0.0, 30.0, kSide, kSide);
    inputs.radii = learnedRadii(model.spec);
    inputs.splat = model.spec.splat;
    inputs.posing = shownPosing(model.spec);
    inputs.occlusion.method = model.spec.occluded ? OcclusionMethod::ScreenSpace : OcclusionMethod::Off;
    inputs.occlusion.screenSpace = shownOcclusion(model.spec);
    inputs.occlusion.screenSpace.quality = OcclusionQuality::Interactive; // a small picture need not take seconds
    return inputs;
}

} // namespace

Result<Image> avatarPreview(const AvatarModel& model) {
    ARS_TRY(const std::unique_ptr<FramePipeline> pipeline, FramePipeline::create(makeTrainedAvatar(model, false)));
    const BufferId shown = model.light ? BufferId::Beauty : BufferId::Radiance;
    if (model.light) {
        auto light = std::make_shared<PrefilteredLight>();
        ARS_TRY_STATUS(prefilterLight({}, *model.light, {}, *light));
        pipeline->setLight(light);
    }
    ARS_TRY_STATUS(pipeline->render(previewInputs(model), {shown, BufferId::Opacity}));
    ARS_TRY(const Image opacity, pipeline->picture(BufferId::Opacity));
    ARS_TRY(const Image picture, pipeline->picture(shown));
    DisplaySettings settings;
    settings.tone.backgroundRed = settings.tone.backgroundGreen = settings.tone.backgroundBlue = kGrey;
    return displayPicture(shown, picture, opacity, settings);
}

} // namespace ars
