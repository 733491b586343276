#include "model/training/learned_state.h"

#include "engine/io/safetensors.h"
#include "engine/light/environment.h"

#include <ATen/ATen.h>

#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>

namespace ars {
namespace {

bool startsWith(std::string_view text, std::string_view start) { return text.substr(0, start.size()) == start; }

/// Which group of rates a tensor of the networks belongs to. The prior encoder's features go into every network: what
/// moves them moves shape and materials alike.
const char* groupOf(std::string_view name) {
    if (startsWith(name, "prior_encoder.")) return "shared";
    const bool geometry = startsWith(name, "geometry.") || startsWith(name, "position.") || startsWith(name, "other.");
    return geometry ? "geometry" : "appearance";
}

Status takeTensor(const SafetensorsFile& file, const std::string& name, at::Tensor& into) {
    ARS_TRY(const Array* array, file.find(name));
    ARS_TRY(const at::Tensor values, tensorFromArray(*array));
    if (values.sizes() != into.sizes()) {
        return makeError(ErrorCode::BadFile, name,
                         fmt::format("{}, expected {} numbers", array->describe(), into.numel()));
    }
    into.copy_(values);
    return {};
}

Status takeLight(const SafetensorsFile& file, at::Tensor& lightLog) {
    ARS_TRY(const Array* array, file.find("light.log"));
    const auto side = static_cast<std::size_t>(lightLog.size(1));
    if (array->shape.size() == 4 && array->shape[1] != side) {
        return makeError(
            ErrorCode::InvalidArgument, "light.cube_size",
            fmt::format("is {} now, expected {} as the light that was learned so far has", side, array->shape[1]));
    }
    return takeTensor(file, "light.log", lightLog);
}

} // namespace

Result<TrainingStage> stageOfState(const SafetensorsFile& state) {
    const auto stage = state.metadata.find("stage");
    if (stage == state.metadata.end()) return makeError(ErrorCode::BadFile, "stage", "is missing");
    const auto name = std::find(kTrainingStageNames.begin(), kTrainingStageNames.end(), stage->second);
    if (name != kTrainingStageNames.end()) return static_cast<TrainingStage>(name - kTrainingStageNames.begin());
    return makeError(ErrorCode::BadFile, "stage",
                     fmt::format("expected {}, found \"{}\"", fmt::join(kTrainingStageNames, ", "), stage->second));
}

TrainingStage stageOfStep(const ScheduleParams& schedule, std::int64_t step) {
    if (step < schedule.templateSteps) return TrainingStage::Template;
    return step < std::int64_t(schedule.templateSteps) + schedule.radianceSteps ? TrainingStage::Radiance
                                                                                : TrainingStage::Pbr;
}

double rateShare(const ScheduleParams& s, TrainingStage stage, std::int64_t step) {
    const std::array<int, 3> lengths{s.templateSteps, s.radianceSteps, s.pbrSteps};
    std::int64_t first = 0;
    for (int i = 0; i < static_cast<int>(stage); ++i) first += lengths[static_cast<std::size_t>(i)];
    const auto within = static_cast<double>(step - first);
    const double t = within / std::max(1, lengths[static_cast<std::size_t>(stage)]);
    const double warm = s.warmUpSteps > 0 ? std::min(1.0, (within + 1.0) / s.warmUpSteps) : 1.0;
    if (stage == TrainingStage::Template) return warm;
    return warm * (s.finalRateShare + (1.0 - s.finalRateShare) * 0.5 * (1.0 + std::cos(std::numbers::pi * t)));
}

void LearnedState::keepInRange() {
    at::NoGradGuard noGradient;
    radiusOffsets.clamp_(-0.8, 2.0);
    if (lightLog.requires_grad()) lightLog.clamp_(-12.0, 12.0);
}

AvatarSpec LearnedState::specNow() const {
    AvatarSpec spec = model.spec;
    std::copy_n(radiusOffsets.detach().cpu().const_data_ptr<float>(), kBodyPartCount, spec.radiusOffsets.begin());
    return spec;
}

void LearnedState::syncModel(std::string origin, bool withLight) {
    model.spec = specNow();
    model.spec.origin = std::move(origin);
    if (!withLight) return;
    CubeMap cube(static_cast<int>(lightLog.size(1)));
    const at::Tensor texels = lightLog.detach().exp().cpu().contiguous();
    std::copy_n(texels.const_data_ptr<float>(), cube.texels.size(), cube.texels.begin());
    model.light = std::move(cube);
}

void LearnedState::store(SafetensorsFile& file) const {
    file.tensors["light.log"] = arrayFromTensor(lightLog.detach());
    file.tensors["radius_offsets"] = arrayFromTensor(radiusOffsets.detach());
}

Status LearnedState::load(AvatarModel& saved, const SafetensorsFile& file) {
    if (saved.spec.network != model.spec.network || saved.maps.pixels != model.maps.pixels) {
        return makeError(ErrorCode::InvalidArgument, "",
                         "was made with other networks or another template than this run has now");
    }
    if (saved.base.geometry.defined() && !model.base.geometry.defined()) {
        return makeError(ErrorCode::InvalidArgument, "decoding.learn_base",
                         "is off now, but was on: the base values that were learned would be lost; leave it on");
    }
    SafetensorsFile weights;
    saved.network->tensors().store(weights);
    ARS_TRY_STATUS(model.network->tensors().load(weights));
    at::NoGradGuard noGradient;
    if (model.base.geometry.defined() && saved.base.geometry.defined()) {
        model.base.geometry.copy_(saved.base.geometry);
        model.base.materials.copy_(saved.base.materials);
        model.base.colors.copy_(saved.base.colors);
    }
    ARS_TRY_STATUS(takeTensor(file, "radius_offsets", radiusOffsets));
    return lightKnown ? Status() : takeLight(file, lightLog);
}

/// Texels are learned as logarithms: a sun and a grey wall then move at the same pace, and none becomes negative.
Status createLearnedLight(const LightLearningParams& light, const FreezeParams& freeze, LearnedState& state) {
    const int side = light.cubeSize;
    state.lightKnown = !light.file.empty();
    if (light.file.empty()) {
        state.lightLog = at::full({6, side, side, 3}, std::log(light.initial));
    } else {
        ARS_TRY(const Environment environment, readEnvironment(light.file));
        ARS_TRY(const CubeMap cube, cubeFromLatLong(environment.picture, side));
        state.lightLog = tensorOf(std::span<const float>(cube.texels)).view({6, side, side, 3}).clamp_min(1e-6).log();
    }
    state.lightLog = state.lightLog.contiguous().set_requires_grad(learnsLight(light, freeze));
    state.radiusOffsets = at::zeros({kBodyPartCount}).set_requires_grad(freeze.radii == RadiusTraining::Learned);
    return {};
}

Adam optimiserOf(const ScheduleParams& schedule, const LearnedState& state) {
    Adam adam(schedule.beta1, schedule.beta2);
    std::map<std::string, std::vector<NetworkTensor>> networks;
    for (const NetworkTensor& tensor : state.model.network->tensors().all()) {
        if (tensor.trainable) networks[groupOf(tensor.name)].push_back(tensor);
    }
    for (auto& [name, tensors] : networks) adam.addGroup(name, std::move(tensors));
    if (const SurfelBase& base = state.model.base; base.geometry.defined()) {
        adam.addGroup("base_geometry", {{"base.geometry", base.geometry}});
        adam.addGroup("base_appearance", {{"base.materials", base.materials}, {"base.colors", base.colors}});
    }
    if (state.lightLog.requires_grad()) adam.addGroup("light", {{"light.log", state.lightLog}});
    if (state.radiusOffsets.requires_grad()) adam.addGroup("radii", {{"radius_offsets", state.radiusOffsets}});
    return adam;
}

double setRates(const TrainingConfig& config, TrainingStage stage, std::int64_t step, Adam& adam) {
    const ScheduleParams& s = config.schedule;
    const double share = rateShare(s, stage, step);
    const double network = share * (stage == TrainingStage::Pbr ? s.networkRatePbr : s.networkRate);
    adam.setRate("geometry", config.freeze.geometry ? 0.0 : network * s.geometryShare);
    adam.setRate("appearance", config.freeze.materials ? 0.0 : network);
    adam.setRate("shared", config.freeze.geometry || config.freeze.materials ? 0.0 : network);
    const double base = share * s.baseRate;
    adam.setRate("base_geometry", config.freeze.geometry ? 0.0 : base * s.baseGeometryShare);
    adam.setRate("base_appearance", config.freeze.materials ? 0.0 : base);
    adam.setRate("light", share * s.lightRate);
    adam.setRate("radii", share * s.radiusRate);
    return network;
}

} // namespace ars
