#include "model/training/learned_state.h"

#include "engine/io/safetensors.h"
#include "engine/light/environment.h"

#include <ATen/ATen.h>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace ars {
namespace {

bool startsWith(std::string_view text, std::string_view start) { return text.substr(0, start.size()) == start; }

/// Which group of rates a tensor of the networks belongs to.
bool geometryTensor(std::string_view name) {
    return startsWith(name, "geometry.") || startsWith(name, "position.") || startsWith(name, "other.");
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

} // namespace

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
        return makeError(ErrorCode::BadFile, "",
                         "was made with other networks or another template than this run has now");
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
    return takeTensor(file, "light.log", lightLog);
}

/// Texels are learned as logarithms: a sun and a grey wall then move at the same pace, and none becomes negative.
Status createLearnedLight(const LightLearningParams& light, const FreezeParams& freeze, LearnedState& state) {
    const int side = light.cubeSize;
    if (light.file.empty()) {
        state.lightLog = at::full({6, side, side, 3}, std::log(light.initial));
    } else {
        ARS_TRY(const Environment environment, readEnvironment(light.file));
        ARS_TRY(const CubeMap cube, cubeFromLatLong(environment.picture, side));
        state.lightLog = tensorOf(std::span<const float>(cube.texels)).view({6, side, side, 3}).clamp_min(1e-6).log();
    }
    state.lightLog = state.lightLog.contiguous().set_requires_grad(light.learn && !freeze.light);
    state.radiusOffsets = at::zeros({kBodyPartCount}).set_requires_grad(freeze.radii == RadiusTraining::Learned);
    return {};
}

Adam optimiserOf(const ScheduleParams& schedule, const LearnedState& state) {
    Adam adam(schedule.beta1, schedule.beta2);
    std::vector<NetworkTensor> geometry, appearance;
    for (const NetworkTensor& tensor : state.model.network->tensors().all()) {
        if (tensor.trainable) (geometryTensor(tensor.name) ? geometry : appearance).push_back(tensor);
    }
    adam.addGroup("geometry", std::move(geometry));
    adam.addGroup("appearance", std::move(appearance));
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
    const double base = share * s.baseRate;
    adam.setRate("base_geometry", config.freeze.geometry ? 0.0 : base * s.baseGeometryShare);
    adam.setRate("base_appearance", config.freeze.materials ? 0.0 : base);
    adam.setRate("light", share * s.lightRate);
    adam.setRate("radii", share * s.radiusRate);
    return network;
}

} // namespace ars
