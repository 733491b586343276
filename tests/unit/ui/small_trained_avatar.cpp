#include "tests/unit/ui/small_trained_avatar.h"

#include "engine/rig/body_model.h"
#include "model/avatar/avatar_model.h"
#include "model/plugin.h"

extern "C" ars::ModelPlugin* arsModelPlugin();

namespace ars::test {

Status writeSmallTrainedAvatar(const std::filesystem::path& folder) {
    ARS_TRY(const BodyModel body, readOpenBody());
    AvatarSpec spec;
    spec.network.inputSize = 64;
    spec.network.channelMultiplier = 0.25;
    spec.network.maxChannels = 16;
    spec.network.styleSize = 32;
    spec.network.zeroOutputs = false;
    spec.decoding.offsetScale = 0.004; // raw offsets of untrained networks are no smaller than 1
    spec.splat.kernel = SurfelKernel::RaySplat;
    spec.preset = "small";
    spec.origin = "untrained";
    for (std::size_t part = 0; part < spec.radiusOffsets.size(); ++part)
        spec.radiusOffsets[part] = 0.05f + 0.02f * static_cast<float>(part);
    ARS_TRY(AvatarModel model, createAvatar(std::move(spec), templateFromBody(body),
                                            std::make_shared<BodyModel>(shapedBody(body, {})), 7));
    model.light = CubeMap(16);
    for (std::size_t i = 0; i < model.light->texels.size(); ++i)
        model.light->texels[i] = i < model.light->texels.size() / 2 ? 0.9f : 0.4f;
    return writeAvatar(folder, model, {});
}

Result<OpenedTrainedAvatar> openThroughPlugin(const std::filesystem::path& folder, bool project) {
    ARS_TRY(OpenedAvatar opened, arsModelPlugin()->openAvatar(folder, project));
    OpenedTrainedAvatar avatar;
    avatar.evaluator = std::move(opened.evaluator);
    avatar.radii = opened.radii;
    avatar.light = std::move(opened.light);
    avatar.splat = opened.splat;
    avatar.preset = std::move(opened.preset);
    avatar.origin = std::move(opened.origin);
    return avatar;
}

} // namespace ars::test
