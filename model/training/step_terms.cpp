#include "model/training/step_terms.h"

#include "model/loss/perceptual_patch.h"
#include "model/operators/surfel_operators.h"

#include <ATen/ATen.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace ars {
namespace {

constexpr std::size_t kMaxMapBytes = std::size_t(512) << 20;

ImageView<const float> pictureView(const Image& image) {
    return {image.pixels.data(), image.width, image.height, image.channels};
}

/// sRGB-encoded background of a step; both pictures get it where there is nobody.
std::array<float, 3> randomBackground(StepRandom& random) {
    std::array<float, 3> background;
    for (float& c : background) c = static_cast<float>(random.uniform());
    return background;
}

ChannelSet channelsOf(bool pbr, bool radiance, RadiusTraining radii) {
    ChannelSet channels{Channel::Opacity, Channel::Depth, Channel::Normal};
    if (radiance) channels.add(Channel::Radiance);
    if (!pbr) return channels;
    channels = channels.united({Channel::Albedo, Channel::Roughness});
    if (radii == RadiusTraining::Off) return channels;
    channels = channels.united({Channel::Radius, Channel::Importance, Channel::Bone});
    return radii == RadiusTraining::Fixed ? channels : channels.united({Channel::RadiusPlus, Channel::RadiusMinus});
}

RawAttributes zerosLike(const RawAttributes& raw) {
    RawAttributes zero;
    zero.offsets = at::zeros_like(raw.offsets);
    zero.opacities = at::zeros_like(raw.opacities);
    zero.scales = at::zeros_like(raw.scales);
    zero.rotations = at::zeros_like(raw.rotations);
    return zero;
}

/// Mean |opacity - mask| over the pixels of which the photograph says anything.
at::Tensor opacityMaskLoss(const at::Tensor& opacity, const at::Tensor& mask, const Image& unknown) {
    if (unknown.pixels.empty()) return (opacity - mask).abs().mean();
    return l1Loss(opacity, mask, 1.0 - tensorOf(pictureView(unknown)).to(opacity.device()));
}

} // namespace

struct StepTerms::View {
    const CapturedView& photograph;
    std::array<float, 3> srgb; ///< the background
    at::Tensor background;     ///< the same, (3)
    double share;              ///< of the step's views
    std::int64_t step;
};

Status StepTerms::prepare() {
    neighbours_ = canonicalNeighbours(state_.model.maps.positions);
    skin_ = skinTensors(*state_.model.weights, device());
    if (config_.loss.perceptual == 0.0) return {};
    if (config_.loss.perceptualBackbone.empty()) {
        perceptual_ = msSsimGradientLoss();
        return {};
    }
    ARS_TRY(perceptual_, readLpips(config_.loss.perceptualBackbone, config_.loss.perceptualHeads));
    perceptual_->moveTo(device());
    return {};
}

c10::Device StepTerms::device() const { return state_.lightLog.device(); }

/// A copy of a picture, (height, width, channels), where the step runs.
at::Tensor StepTerms::placed(const Image& image) const { return tensorOf(pictureView(image)).to(device()); }

std::int64_t StepTerms::totalSteps() const {
    const ScheduleParams& s = config_.schedule;
    return std::int64_t(s.templateSteps) + s.radianceSteps + s.pbrSteps;
}

/// Maps of a frame; those of the last frames are kept.
Result<AvatarNetworkInputs> StepTerms::inputsOf(int frame) {
    const auto found = inputs_.find(frame);
    if (found != inputs_.end()) return found->second;
    ARS_TRY(const PoseMaps maps, poseMaps(state_.model, capture_.pose(frame), false));
    ARS_TRY(AvatarNetworkInputs inputs, networkInputs(state_.model, maps));
    inputs.positions = inputs.positions.to(device());
    if (inputs.priors.defined()) inputs.priors = inputs.priors.to(device());
    const std::size_t bytes =
        4 * static_cast<std::size_t>(inputs.positions.numel() + (inputs.priors.defined() ? inputs.priors.numel() : 0));
    if ((inputs_.size() + 1) * bytes > kMaxMapBytes) inputs_.clear();
    inputs_[frame] = inputs;
    return inputs;
}

/// View maps of the first `count` views.
Result<std::vector<at::Tensor>> StepTerms::viewMaps(const TrainingSample& sample, std::size_t count,
                                                    StepRandom& random) const {
    std::vector<at::Tensor> views(count);
    if (!config_.network.viewDependent) return views;
    std::vector<glm::vec3> noise(state_.model.inputMaps.pointCount());
    for (std::size_t v = 0; v < views.size(); ++v) {
        for (glm::vec3& n : noise) {
            n.x = static_cast<float>(config_.schedule.viewNoise * random.normal());
            n.y = static_cast<float>(config_.schedule.viewNoise * random.normal());
            n.z = static_cast<float>(config_.schedule.viewNoise * random.normal());
        }
        ARS_TRY(const at::Tensor map,
                viewMap(state_.model, capture_.pose(sample.frame), sample.views[v]->camera, noise));
        views[v] = map.to(device());
    }
    return views;
}

Status StepTerms::addTemplate(const TrainingSample& sample, LossTerms& terms, StepClock& clock) {
    const AvatarModel& model = state_.model;
    ARS_TRY(const AvatarNetworkInputs inputs, inputsOf(sample.frame));
    const RawAttributes raw =
        model.network->evaluate(inputs, model.pixels, {.geometry = true, .materials = false, .colors = false});
    clock.mark("network");
    const DecodedSurfels now = decodeSurfels(config_.decoding, model.base, raw);
    const DecodedSurfels wanted = decodeSurfels(config_.decoding, model.base, zerosLike(raw));
    const auto unit = [](const at::Tensor& q) { return q / q.norm(2, 1, true).clamp_min(1e-8); };
    terms.add("position", 1.0, (now.surfels.means - wanted.surfels.means).abs().mean());
    terms.add("opacity", 1.0, (now.surfels.opacities - wanted.surfels.opacities).abs().mean());
    terms.add("scale", 1.0, (now.surfels.scales - wanted.surfels.scales).abs().mean());
    terms.add("rotation", 1.0, (unit(now.surfels.rotations) - unit(wanted.surfels.rotations)).abs().mean());
    return {};
}

Status StepTerms::addPictures(TrainingStage stage, std::int64_t step, const TrainingSample& sample, StepRandom& random,
                              LossTerms& terms, StepClock& clock) {
    const AvatarModel& model = state_.model;
    const bool pbr = stage == TrainingStage::Pbr;
    const bool radiance = !pbr || config_.loss.radianceInPbr > 0.0;
    ARS_TRY(const AvatarNetworkInputs inputs, inputsOf(sample.frame));
    // In the PBR stage one view a step keeps the colours; they share their trunk with the materials.
    const std::size_t colored = !radiance ? 0 : pbr ? 1 : sample.views.size();
    std::vector<at::Tensor> views, rawColors;
    if (radiance) {
        ARS_TRY(views, viewMaps(sample, colored, random));
    }
    clock.mark("maps");
    const RawAttributes raw = model.network->evaluate(
        inputs, model.pixels, {.geometry = true, .materials = pbr, .colors = radiance}, views, rawColors);
    const DecodedSurfels decoded = decodeSurfels(config_.decoding, model.base, raw);
    clock.mark("network");
    PoseSurfelsParams posing = config_.posing;
    posing.trainingRadii = pbr && config_.freeze.radii == RadiusTraining::Learned;
    ARS_TRY(PosingContext context, posingContext(model, capture_.pose(sample.frame), posing));
    const at::Tensor initial = tensorOf(std::span<const float>(model.spec.initialRadii)).to(device());
    SurfelTensors surfels = poseSurfelTensors(std::make_shared<const PosingContext>(std::move(context)), skin_,
                                              decoded.surfels, initial * (1.0 + state_.radiusOffsets));
    clock.mark("pose");
    std::shared_ptr<LightTensors> light;
    const at::Tensor texels = state_.lightLog.exp();
    if (pbr) light = lightTensors(texels);
    clock.mark("light");

    const double share = 1.0 / static_cast<double>(sample.views.size());
    for (std::size_t v = 0; v < sample.views.size(); ++v) {
        const CapturedView& photograph = *sample.views[v];
        surfels.colors = v < colored ? decodeColors(model.base, rawColors[v]) : at::Tensor();
        View view{photograph, randomBackground(random), {}, share, step};
        view.background = tensorOf(std::span<const float>(view.srgb)).to(device());
        const GBufferTensors gbuffer = splatTensors(config_.splat, surfels, photograph.camera,
                                                    channelsOf(pbr, v < colored, config_.freeze.radii), scratch_);
        clock.mark("splat");
        addGeometry(gbuffer, view, terms);
        if (v < colored) {
            const at::Tensor& opacity = gbuffer[Channel::Opacity];
            const at::Tensor picture = gbuffer[Channel::Radiance] * opacity + view.background * (1.0 - opacity);
            addPictureLosses(picture, view, pbr ? config_.loss.radianceInPbr : share, pbr ? "radiance_" : "", random,
                             terms);
        }
        clock.mark("loss");
        if (pbr) addShaded(gbuffer, view, light, random, terms, clock);
    }
    terms.add("offset", config_.loss.offset, offsetLoss(decoded.offsets, config_.loss.offsetSquared));
    if (!pbr) {
        terms.add("normal_deformation", config_.loss.normalDeformation, normalTerm(surfels, random));
    } else if (state_.lightLog.requires_grad()) {
        terms.add("light_tv", config_.loss.lightVariation, lightTotalVariation(texels));
        terms.add("white_light", config_.loss.whiteLight, whiteLightLoss(texels));
    }
    return {};
}

/// L1 and the perceptual loss; background where nobody is in the photograph, and in the band in both.
void StepTerms::addPictureLosses(const at::Tensor& picture, const View& view, double weight, const std::string& prefix,
                                 StepRandom& random, LossTerms& terms) const {
    const at::Tensor keep = 1.0 - placed(view.photograph.band);
    const float threshold = 128.5f / 255.0f;
    const at::Tensor inside = (placed(view.photograph.mask) > threshold).to(at::kFloat) * keep;
    const at::Tensor target = placed(view.photograph.color) * inside + view.background * (1.0 - inside);
    const at::Tensor seen = picture * keep + view.background * (1.0 - keep);
    terms.add(prefix + "l1", weight * config_.loss.l1, l1Loss(seen, target));
    if (perceptual_) {
        terms.add(prefix + perceptual_->name(), weight * config_.loss.perceptual,
                  perceptualTerm(seen, target, inside, view, random));
    }
}

/// The square about the person at the size asked for; late in the training a window of that size at a random place in
/// it (avatar reference 4).
at::Tensor StepTerms::perceptualTerm(const at::Tensor& seen, const at::Tensor& target, const at::Tensor& inside,
                                     const View& view, StepRandom& random) const {
    const std::int64_t size = config_.schedule.perceptualSize;
    if (size == 0) return perceptual_->evaluate(seen, target);
    PictureSquare square = personSquare(inside);
    const std::int64_t room = square.side - size;
    if (view.step - config_.schedule.templateSteps >= config_.schedule.perceptualCropAfter && room > 0) {
        square.x += static_cast<std::int64_t>(random.next() % static_cast<std::uint64_t>(room + 1));
        square.y += static_cast<std::int64_t>(random.next() % static_cast<std::uint64_t>(room + 1));
        square.side = size;
    }
    return perceptual_->evaluate(perceptualPatch(seen, square, size, view.background),
                                 perceptualPatch(target, square, size, view.background));
}

void StepTerms::addGeometry(const GBufferTensors& gbuffer, const View& view, LossTerms& terms) const {
    const at::Tensor &normal = gbuffer[Channel::Normal], &opacity = gbuffer[Channel::Opacity];
    const double progress =
        static_cast<double>(view.step) / static_cast<double>(std::max<std::int64_t>(1, totalSteps()));
    const double consistency = consistencyWeight(config_.loss.consistency, config_.loss.consistencyEnd, progress);
    if (consistency > 0.0) {
        terms.add("consistency", view.share * consistency,
                  depthNormalLoss(normal, gbuffer[Channel::Depth], opacity, view.photograph.camera));
    }
    if (config_.loss.curvature > 0.0) {
        terms.add("curvature", view.share * config_.loss.curvature, curvatureLoss(normal, opacity));
    }
    if (config_.loss.opacityMask > 0.0) {
        // Soft alpha says where the outline runs within a pixel, so the band takes part.
        const at::Tensor mask = placed(view.photograph.mask);
        terms.add("opacity_mask", view.share * config_.loss.opacityMask,
                  opacityMaskLoss(opacity, mask, view.photograph.unknown));
    }
}

void StepTerms::addShaded(const GBufferTensors& gbuffer, const View& view, const std::shared_ptr<LightTensors>& light,
                          StepRandom& random, LossTerms& terms, StepClock& clock) {
    const Camera& camera = view.photograph.camera;
    at::Tensor occlusion;
    if (config_.freeze.radii != RadiusTraining::Off) {
        occlusion =
            occlusionTensor(config_.occlusion, gbuffer, camera, occlusionMemory_, static_cast<int>(view.step & 0xffff));
    }
    clock.mark("occlusion");
    const at::Tensor linear = shadeTensors({}, gbuffer, occlusion, camera, light);
    ToneParams tone;
    tone.backgroundRed = srgbToLinear(view.srgb[0]);
    tone.backgroundGreen = srgbToLinear(view.srgb[1]);
    tone.backgroundBlue = srgbToLinear(view.srgb[2]);
    const at::Tensor picture = toneTensor(tone, linear).slice(2, 0, 3);
    clock.mark("shade");
    addPictureLosses(picture, view, view.share, "", random, terms);
    if (config_.loss.brdfVariation > 0.0) {
        const at::Tensor& opacity = gbuffer[Channel::Opacity];
        terms.add("brdf_tv", view.share * config_.loss.brdfVariation,
                  totalVariation(gbuffer[Channel::Albedo], opacity) +
                      totalVariation(gbuffer[Channel::Roughness], opacity));
    }
    clock.mark("loss");
}

at::Tensor StepTerms::normalTerm(const SurfelTensors& surfels, StepRandom& random) const {
    const std::int64_t pairs = neighbours_.first.numel();
    if (config_.loss.normalDeformation == 0.0 || pairs == 0) return {};
    const std::int64_t wanted = std::min<std::int64_t>(config_.loss.normalPairs, pairs);
    at::Tensor chosen = at::empty({wanted}, at::kLong);
    auto* index = chosen.data_ptr<std::int64_t>();
    for (std::int64_t i = 0; i < wanted; ++i) {
        index[i] = static_cast<std::int64_t>(random.next() % static_cast<std::uint64_t>(pairs));
    }
    return normalDeformationLoss(neighbours_, surfels.means, normalsOfRotations(surfels.rotations), chosen);
}

} // namespace ars
