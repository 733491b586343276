#include "model/training/preview.h"

#include "engine/frame/display.h"
#include "engine/frame/frame_pipeline.h"

#include <algorithm>

namespace ars {
namespace {

constexpr float kGrey = 0.2140f; ///< display-linear; sRGB 0.5

void paste(const Image& part, int left, Image& row) {
    for (int y = 0; y < part.height; ++y) {
        for (int x = 0; x < part.width; ++x) {
            for (int c = 0; c < 3; ++c) row.at(y, left + x, c) = part.at(y, x, std::min(c, part.channels - 1));
        }
    }
}

} // namespace

Result<Image> previewPicture(const AvatarModel& model, const Pose& pose, const CapturedView& photograph,
                             const PreviewOptions& options) {
    ARS_TRY(const std::unique_ptr<FramePipeline> pipeline, FramePipeline::create(makeTrainedAvatar(model, false)));
    FrameInputs inputs;
    inputs.pose = pose;
    inputs.camera = photograph.camera;
    inputs.radii = learnedRadii(model.spec);
    inputs.splat = options.splat;
    inputs.posing = shownPosing(model.spec);
    inputs.occlusion.screenSpace = options.occlusion;
    if (!options.occlude) inputs.occlusion.method = OcclusionMethod::Off;
    std::vector<BufferId> wanted{BufferId::Radiance, BufferId::Normal, BufferId::Opacity};
    if (options.shaded && model.light) {
        auto light = std::make_shared<PrefilteredLight>();
        ARS_TRY_STATUS(prefilterLight({}, *model.light, {}, *light));
        pipeline->setLight(light);
        wanted.insert(wanted.end(),
                      {BufferId::Beauty, BufferId::Albedo, BufferId::Roughness, BufferId::AmbientOcclusion});
    }
    ARS_TRY_STATUS(pipeline->render(inputs, wanted));
    ARS_TRY(const Image opacity, pipeline->picture(BufferId::Opacity));
    DisplaySettings settings;
    settings.tone.backgroundRed = settings.tone.backgroundGreen = settings.tone.backgroundBlue = kGrey;
    wanted.erase(std::find(wanted.begin(), wanted.end(), BufferId::Opacity));
    Image row;
    row.width = photograph.color.width * static_cast<int>(wanted.size() + 1);
    row.height = photograph.color.height;
    row.channels = 3;
    row.space = ColorSpace::Srgb;
    row.pixels.resize(static_cast<std::size_t>(3 * row.width) * static_cast<std::size_t>(row.height));
    paste(photograph.color, 0, row);
    int left = photograph.color.width;
    for (const BufferId id : wanted) {
        ARS_TRY(const Image picture, pipeline->picture(id));
        ARS_TRY(const Image shown, displayPicture(id, picture, opacity, settings));
        paste(shown, left, row);
        left += photograph.color.width;
    }
    return row;
}

} // namespace ars
