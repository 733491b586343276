#include "tests/unit/ui/small_trained_avatar.h"

#include "engine/io/safetensors.h"
#include "engine/rig/body_model.h"
#include "model/avatar/avatar_model.h"
#include "model/plugin.h"

extern "C" ars::ModelPlugin* arsModelPlugin();

namespace ars::test {
namespace {

/// Raw outputs of untrained networks are about as large as 1 to 3: opacities and scales would go anywhere. The layers
/// that put the outputs together, (1, out, in, 1, 1), scale them.
Status calmOutputs(const std::filesystem::path& path, float factor) {
    ARS_TRY(SafetensorsFile file, readSafetensors(path));
    for (auto& [name, array] : file.tensors) {
        if (array.shape.size() != 5 || array.shape[3] != 1) continue;
        ARS_TRY(std::vector<float> values, array.toFloat());
        for (float& value : values) value *= factor;
        array = Array::fromFloats(array.shape, values);
    }
    return writeSafetensors(path, file);
}

} // namespace

Status writeSmallTrainedAvatar(const std::filesystem::path& folder) {
    ARS_TRY(const BodyModel body, readOpenBody());
    AvatarSpec spec;
    spec.network.inputSize = 64;
    spec.network.channelMultiplier = 0.25;
    spec.network.maxChannels = 16;
    spec.network.styleSize = 32;
    spec.network.zeroOutputs = false;
    spec.decoding.offsetScale = 0.01;
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
    ARS_TRY_STATUS(writeAvatar(folder, model, {}));
    return calmOutputs(folder / "weights.safetensors", 0.1f);
}

Result<OpenedTrainedAvatar> openThroughPlugin(const std::filesystem::path& folder, bool project) {
    return arsModelPlugin()->openAvatar(folder, project, AvatarPrecision::Exact);
}

} // namespace ars::test
