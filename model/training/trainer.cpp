#include "model/training/trainer.h"

#include "engine/capture/capture.h"
#include "engine/core/file.h"
#include "engine/io/png.h"
#include "engine/io/safetensors.h"
#include "engine/light/environment.h"
#include "engine/maps/pose_pca.h"
#include "engine/maps/position_maps.h"
#include "model/avatar/avatar_model.h"
#include "model/loss/losses.h"
#include "model/loss/perceptual.h"
#include "model/runtime.h"
#include "model/training/adam.h"
#include "model/training/data_reader.h"
#include "model/training/preview.h"
#include "model/training/step_random.h"

#include <ATen/ATen.h>
#include <c10/util/Exception.h>

#include <nlohmann/json.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <list>
#include <numbers>

namespace ars {
namespace {

enum class Stage { Template, Radiance, Pbr };
constexpr std::array<std::string_view, 3> kStageNames{"template", "radiance", "pbr"};
constexpr std::size_t kMaxPcaPoses = 512;
constexpr std::size_t kMaxMapBytes = std::size_t(512) << 20;

/// Splits a step's wall time among its parts.
class StepClock {
public:
    void mark(const std::string& part) {
        const auto now = std::chrono::steady_clock::now();
        parts_["time." + part + "_ms"] += std::chrono::duration<double, std::milli>(now - last_).count();
        last_ = now;
    }
    double totalMs() const {
        return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start_).count();
    }
    const std::map<std::string, double>& parts() const { return parts_; }

private:
    std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now(), last_ = start_;
    std::map<std::string, double> parts_;
};

/// Weighted terms of a step; their sum is differentiated.
class LossTerms {
public:
    void add(const std::string& name, double weight, const at::Tensor& value) {
        if (weight == 0.0 || !value.defined()) return;
        const at::Tensor weighted = weight * value;
        const auto found = terms_.find(name);
        if (found == terms_.end())
            terms_[name] = weighted;
        else
            found->second = found->second + weighted;
    }
    /// The sum; Internal naming a term that is not a number.
    Result<at::Tensor> total(std::map<std::string, double>& values) const {
        at::Tensor sum;
        double number = 0.0;
        for (const auto& [name, term] : terms_) {
            const double value = term.item<double>();
            if (!std::isfinite(value)) {
                return makeError(ErrorCode::Internal, "loss." + name, fmt::format("is {}, expected a number", value));
            }
            values["loss." + name] = value;
            number += value;
            sum = sum.defined() ? sum + term : term;
        }
        values["loss.total"] = number;
        if (!sum.defined()) return makeError(ErrorCode::InvalidArgument, "loss", "every weight is 0");
        return sum;
    }

private:
    std::map<std::string, at::Tensor> terms_;
};

ImageView<const float> pictureView(const Image& image) {
    return {image.pixels.data(), image.width, image.height, image.channels};
}

/// sRGB-encoded background of a step; both pictures get it where there is nobody.
struct Background {
    std::array<float, 3> srgb{};
    at::Tensor tensor; ///< (3)
};
float srgbToLinear(float c) { return c <= 0.04045f ? c / 12.92f : std::pow((c + 0.055f) / 1.055f, 2.4f); }

bool startsWith(std::string_view text, std::string_view start) { return text.substr(0, start.size()) == start; }

/// Which group of rates a tensor of the networks belongs to.
bool geometryTensor(std::string_view name) {
    return startsWith(name, "geometry.") || startsWith(name, "position.") || startsWith(name, "other.");
}

class AvatarTrainer final : public TrainingTask {
public:
    AvatarTrainer(TrainerSources sources, TrainingConfig config)
        : sources_(std::move(sources)), config_(std::move(config)),
          adam_(config_.schedule.beta1, config_.schedule.beta2) {}

    Status load(const ProgressFunction& progress) override {
        initializeTorch();
        ARS_TRY_STATUS(validateTrainingConfig(config_));
        ARS_TRY_STATUS(reportProgress(progress, 0.0, "reading the capture"));
        ARS_TRY(Capture capture, openCapture(sources_.capture));
        capture_ = std::make_shared<const Capture>(std::move(capture));
        ARS_TRY(split_, trainingSplit(*capture_, config_.cameras, config_.frames));
        ARS_TRY_STATUS(loadPerceptual());
        ARS_TRY_STATUS(reportProgress(progress, 0.2, "reading body and template"));
        ARS_TRY_STATUS(createModel());
        ARS_TRY_STATUS(reportProgress(progress, 0.6, "fitting the principal components of the poses"));
        ARS_TRY_STATUS(fitPca());
        neighbours_ = canonicalNeighbours(model_.maps.positions);
        ARS_TRY_STATUS(createLight());
        radiusOffsets_ = at::zeros({kBodyPartCount}).set_requires_grad(config_.freeze.radii == RadiusTraining::Learned);
        enterStage(stageOf(0));
        ARS_TRY_STATUS(startReader(0));
        return reportProgress(progress, 1.0, "ready");
    }

    std::int64_t totalSteps() const override {
        return std::int64_t(config_.schedule.templateSteps) + config_.schedule.radianceSteps +
               config_.schedule.pbrSteps;
    }
    std::int64_t stepsDone() const override { return done_; }

    Result<StepReport> step() override {
        try {
            return stepUnguarded();
        } catch (const OperatorFailure& failure) {
            return atStep(failure.error());
        } catch (const c10::Error& error) {
            const std::string what = error.what_without_backtrace();
            const bool memory = what.find("alloc") != std::string::npos || what.find("memory") != std::string::npos;
            return atStep(makeError(memory ? ErrorCode::OutOfMemory : ErrorCode::Internal, "", what));
        } catch (const std::bad_alloc&) {
            return atStep(makeError(ErrorCode::OutOfMemory, "", "no memory is left"));
        }
    }

    Status save(const std::filesystem::path& folder) override {
        syncModel();
        ARS_TRY_STATUS(writeAvatarFiles(folder, model_, {}));
        SafetensorsFile state;
        adam_.store(state);
        state.tensors["light.log"] = arrayFromTensor(lightLog_.detach());
        state.tensors["radius_offsets"] = arrayFromTensor(radiusOffsets_.detach());
        state.metadata["step"] = std::to_string(done_);
        state.metadata["stage"] = std::string(kStageNames[static_cast<std::size_t>(stage_)]);
        return writeSafetensors(folder / "trainer.safetensors", state);
    }

    Status restore(const std::filesystem::path& folder) override {
        ARS_TRY(AvatarModel saved, readAvatar(folder));
        const std::filesystem::path path = folder / "trainer.safetensors";
        ARS_TRY(const SafetensorsFile state, readSafetensors(path));
        if (Status status = restoreFrom(saved, state); !status) return atPlace(status.error(), path.string());
        return startReader(done_);
    }

    Status preview(const std::filesystem::path& folder) override {
        syncModel();
        PreviewOptions options;
        options.splat = config_.splat;
        options.occlusion = config_.occlusion;
        options.occlude = config_.freeze.radii != RadiusTraining::Off;
        options.shaded = stage_ == Stage::Pbr;
        ViewOptions view;
        view.scale = config_.schedule.imageScale;
        const int frames = static_cast<int>(split_.frames.size()), cameras = static_cast<int>(split_.cameras.size());
        for (int i = 0; i < 2; ++i) {
            const ViewId id{split_.cameras[static_cast<std::size_t>(i * cameras / 2)],
                            split_.frames[static_cast<std::size_t>(i * frames / 2)]};
            if (!capture_->has(id)) continue;
            ARS_TRY(const CapturedView photograph, readView(*capture_, id, view));
            ARS_TRY(const Image picture, previewPicture(model_, capture_->pose(id.frame), photograph, options));
            ARS_TRY_STATUS(writePng(folder / fmt::format("{:08}_{}.png", done_, i), picture));
        }
        return {};
    }

private:
    Error atStep(Error error) const { return atPlace(std::move(error), fmt::format("step {}", done_)); }

    Status loadPerceptual() {
        if (config_.loss.perceptual == 0.0) return {};
        if (config_.loss.perceptualBackbone.empty()) {
            perceptual_ = msSsimGradientLoss();
            return {};
        }
        ARS_TRY(perceptual_, readLpips(config_.loss.perceptualBackbone, config_.loss.perceptualHeads));
        return {};
    }

    Result<std::filesystem::path> templatePath() const {
        if (!sources_.templateFile.empty()) return sources_.templateFile;
        for (const char* name : {"template.npz", "template.glb", "template.ply", "template.obj"}) {
            if (std::filesystem::exists(sources_.capture / name)) return sources_.capture / name;
        }
        return std::filesystem::path();
    }

    Status createModel() {
        ARS_TRY(BodyModel body, sources_.body.empty() ? readOpenBody() : readBodyModel(sources_.body));
        const BodyShape shape{.betas = capture_->betas, .expression = {}};
        const auto shaped = std::make_shared<const BodyModel>(shapedBody(body, shape));
        ARS_TRY(const std::filesystem::path path, templatePath());
        TemplateMesh mesh;
        if (path.empty()) {
            mesh = templateFromBody(body, shape);
        } else {
            ARS_TRY(mesh, readTemplate(path, body, shape));
        }
        AvatarSpec spec;
        spec.network = config_.network;
        spec.decoding = config_.decoding;
        spec.splat = config_.splat;
        spec.preset = config_.preset;
        spec.maps.centerM = canonicalCenter(body, shape);
        ARS_TRY(model_, createAvatar(std::move(spec), std::move(mesh), shaped,
                                     static_cast<std::uint64_t>(config_.schedule.seed)));
        return {};
    }

    Status fitPca() {
        if (model_.spec.network.canonicalOnly || split_.frames.size() < 2) return {};
        std::vector<std::vector<float>> samples;
        const std::size_t stride = (split_.frames.size() + kMaxPcaPoses - 1) / kMaxPcaPoses;
        for (std::size_t i = 0; i < split_.frames.size(); i += stride) {
            ARS_TRY(const std::vector<glm::vec3> points,
                    posedMapPoints(model_.mesh.skeleton(), model_.inputMaps, capture_->pose(split_.frames[i])));
            const float* numbers = &points.front().x;
            samples.emplace_back(numbers, numbers + 3 * points.size());
        }
        ARS_TRY(model_.pca, fitPosePca(samples));
        return {};
    }

    /// Texels are learned as logarithms: a sun and a grey wall then move at the same pace, and none becomes negative.
    Status createLight() {
        const int side = config_.light.cubeSize;
        if (config_.light.file.empty()) {
            lightLog_ = at::full({6, side, side, 3}, std::log(config_.light.initial));
        } else {
            ARS_TRY(const Environment environment, readEnvironment(config_.light.file));
            ARS_TRY(const CubeMap cube, cubeFromLatLong(environment.picture, side));
            lightLog_ = tensorOf(std::span<const float>(cube.texels)).view({6, side, side, 3}).clamp_min(1e-6).log();
        }
        lightLog_ = lightLog_.contiguous().set_requires_grad(config_.light.learn && !config_.freeze.light);
        return {};
    }

    Status startReader(std::int64_t step) {
        reader_.reset();
        DataOptions options;
        options.view.scale = config_.schedule.imageScale;
        options.view.cropMargin = config_.schedule.cropMargin;
        options.view.bandPixels = config_.schedule.bandPixels;
        options.viewsPerStep = config_.schedule.viewsPerStep;
        options.seed = static_cast<std::uint64_t>(config_.schedule.seed);
        options.cacheBytes = static_cast<std::size_t>(config_.run.cacheMegabytes) << 20;
        options.cacheFolder = config_.run.cacheFolder;
        ARS_TRY(reader_, DataReader::start(capture_, split_, options, step));
        return {};
    }

    Stage stageOf(std::int64_t step) const {
        if (step < config_.schedule.templateSteps) return Stage::Template;
        return step < config_.schedule.templateSteps + config_.schedule.radianceSteps ? Stage::Radiance : Stage::Pbr;
    }

    /// Groups of Adam; moments start anew with each stage (avatar reference 4).
    void enterStage(Stage stage) {
        stage_ = stage;
        adam_ = Adam(config_.schedule.beta1, config_.schedule.beta2);
        std::vector<NetworkTensor> geometry, appearance;
        for (const NetworkTensor& tensor : model_.network->tensors().all()) {
            if (tensor.trainable) (geometryTensor(tensor.name) ? geometry : appearance).push_back(tensor);
        }
        adam_.addGroup("geometry", std::move(geometry));
        adam_.addGroup("appearance", std::move(appearance));
        if (model_.base.geometry.defined()) {
            adam_.addGroup("base_geometry", {{"base.geometry", model_.base.geometry}});
            adam_.addGroup("base_appearance",
                           {{"base.materials", model_.base.materials}, {"base.colors", model_.base.colors}});
        }
        if (lightLog_.requires_grad()) adam_.addGroup("light", {{"light.log", lightLog_}});
        if (radiusOffsets_.requires_grad()) adam_.addGroup("radii", {{"radius_offsets", radiusOffsets_}});
    }

    /// Warm-up, then a cosine from 1 to the final share over the stage.
    double rateShare() const {
        const ScheduleParams& s = config_.schedule;
        const std::array<int, 3> lengths{s.templateSteps, s.radianceSteps, s.pbrSteps};
        std::int64_t first = 0;
        for (int i = 0; i < static_cast<int>(stage_); ++i) first += lengths[static_cast<std::size_t>(i)];
        const auto within = static_cast<double>(done_ - first);
        const double t = within / std::max(1, lengths[static_cast<std::size_t>(stage_)]);
        const double warm = s.warmUpSteps > 0 ? std::min(1.0, (within + 1.0) / s.warmUpSteps) : 1.0;
        if (stage_ == Stage::Template) return warm;
        return warm * (s.finalRateShare + (1.0 - s.finalRateShare) * 0.5 * (1.0 + std::cos(std::numbers::pi * t)));
    }

    void setRates(StepReport& report) {
        const ScheduleParams& s = config_.schedule;
        const double share = rateShare();
        const double network = share * (stage_ == Stage::Pbr ? s.networkRatePbr : s.networkRate);
        adam_.setRate("geometry", config_.freeze.geometry ? 0.0 : network * s.geometryShare);
        adam_.setRate("appearance", config_.freeze.materials ? 0.0 : network);
        const double base = share * s.baseRate;
        adam_.setRate("base_geometry", config_.freeze.geometry ? 0.0 : base * s.baseGeometryShare);
        adam_.setRate("base_appearance", config_.freeze.materials ? 0.0 : base);
        adam_.setRate("light", share * s.lightRate);
        adam_.setRate("radii", share * s.radiusRate);
        report.values["rate.network"] = network;
    }

    Result<StepReport> stepUnguarded() {
        StepClock clock;
        StepReport report;
        if (const Stage stage = stageOf(done_); stage != stage_) enterStage(stage);
        report.stage = kStageNames[static_cast<std::size_t>(stage_)];
        ARS_TRY(const TrainingSample sample, reader_->next());
        clock.mark("read");
        setRates(report);
        adam_.clearGradients();
        LossTerms terms;
        StepRandom random(static_cast<std::uint64_t>(config_.schedule.seed), done_);
        const Status status = stage_ == Stage::Template ? templateTerms(sample, terms, clock)
                                                        : pictureTerms(sample, random, terms, clock);
        if (!status) return atStep(status.error());
        Result<at::Tensor> total = terms.total(report.values);
        if (!total) return atStep(total.error());
        clock.mark("loss");
        total.value().backward();
        clock.mark("backward");
        if (const Status stepped = adam_.step(); !stepped) return atStep(stepped.error());
        keepInRange();
        clock.mark("optimiser");
        ++done_;
        finishReport(clock, report);
        return report;
    }

    void finishReport(const StepClock& clock, StepReport& report) const {
        report.values.insert(clock.parts().begin(), clock.parts().end());
        report.milliseconds = clock.totalMs();
        report.values["time.step_ms"] = report.milliseconds;
        if (stage_ != Stage::Pbr) return;
        const PartRadii radii = learnedRadii(specNow());
        for (int g = 0; g < kBodyPartCount; ++g) {
            report.values[fmt::format("radius.{}", bodyPartName(static_cast<BodyPart>(g)))] =
                radii[static_cast<std::size_t>(g)];
        }
    }

    void keepInRange() {
        at::NoGradGuard noGradient;
        radiusOffsets_.clamp_(-0.8, 2.0);
        if (lightLog_.requires_grad()) lightLog_.clamp_(-12.0, 12.0);
    }

    AvatarSpec specNow() const {
        AvatarSpec spec = model_.spec;
        const float* offsets = radiusOffsets_.const_data_ptr<float>();
        std::copy_n(offsets, kBodyPartCount, spec.radiusOffsets.begin());
        return spec;
    }

    /// What the model says of itself follows what was learned.
    void syncModel() {
        model_.spec = specNow();
        model_.spec.origin = fmt::format("step {} of a training on {}", done_, capture_->subject);
        if (config_.schedule.pbrSteps == 0) return;
        CubeMap cube(config_.light.cubeSize);
        const at::Tensor texels = lightLog_.detach().exp().contiguous();
        std::copy_n(texels.const_data_ptr<float>(), cube.texels.size(), cube.texels.begin());
        model_.light = std::move(cube);
    }

    /// Maps of a frame; those of the last frames are kept.
    Result<AvatarNetworkInputs> inputsOf(int frame) {
        const auto found = inputs_.find(frame);
        if (found != inputs_.end()) return found->second;
        ARS_TRY(const PoseMaps maps, poseMaps(model_, capture_->pose(frame), false));
        ARS_TRY(AvatarNetworkInputs inputs, networkInputs(model_, maps));
        const std::size_t bytes = 4 * static_cast<std::size_t>(inputs.positions.numel() +
                                                               (inputs.priors.defined() ? inputs.priors.numel() : 0));
        if ((inputs_.size() + 1) * bytes > kMaxMapBytes) inputs_.clear();
        inputs_[frame] = inputs;
        return inputs;
    }

    /// View maps of the first `count` views.
    Result<std::vector<at::Tensor>> viewMaps(const TrainingSample& sample, std::size_t count, StepRandom& random) {
        std::vector<at::Tensor> views(count);
        if (!config_.network.viewDependent) return views;
        std::vector<glm::vec3> noise(model_.inputMaps.pointCount());
        for (std::size_t v = 0; v < views.size(); ++v) {
            for (glm::vec3& n : noise) {
                n.x = static_cast<float>(config_.schedule.viewNoise * random.normal());
                n.y = static_cast<float>(config_.schedule.viewNoise * random.normal());
                n.z = static_cast<float>(config_.schedule.viewNoise * random.normal());
            }
            ARS_TRY(views[v], viewMap(model_, capture_->pose(sample.frame), sample.views[v]->camera, noise));
        }
        return views;
    }

    /// Stage 0: attributes after activation against those that the template starts with, plain L1.
    Status templateTerms(const TrainingSample& sample, LossTerms& terms, StepClock& clock) {
        ARS_TRY(const AvatarNetworkInputs inputs, inputsOf(sample.frame));
        const RawAttributes raw =
            model_.network->evaluate(inputs, model_.pixels, {.geometry = true, .materials = false, .colors = false});
        clock.mark("network");
        RawAttributes zero;
        zero.offsets = at::zeros_like(raw.offsets);
        zero.opacities = at::zeros_like(raw.opacities);
        zero.scales = at::zeros_like(raw.scales);
        zero.rotations = at::zeros_like(raw.rotations);
        const DecodedSurfels now = decodeSurfels(config_.decoding, model_.base, raw);
        const DecodedSurfels wanted = decodeSurfels(config_.decoding, model_.base, zero);
        const auto unit = [](const at::Tensor& q) { return q / q.norm(2, 1, true).clamp_min(1e-8); };
        terms.add("position", 1.0, (now.surfels.means - wanted.surfels.means).abs().mean());
        terms.add("opacity", 1.0, (now.surfels.opacities - wanted.surfels.opacities).abs().mean());
        terms.add("scale", 1.0, (now.surfels.scales - wanted.surfels.scales).abs().mean());
        terms.add("rotation", 1.0, (unit(now.surfels.rotations) - unit(wanted.surfels.rotations)).abs().mean());
        return {};
    }

    Status pictureTerms(const TrainingSample& sample, StepRandom& random, LossTerms& terms, StepClock& clock) {
        const bool pbr = stage_ == Stage::Pbr;
        const bool radiance = !pbr || config_.loss.radianceInPbr > 0.0;
        ARS_TRY(const AvatarNetworkInputs inputs, inputsOf(sample.frame));
        std::vector<at::Tensor> views, rawColors;
        // In the PBR stage one view a step keeps the colours; they share their trunk with the materials.
        const std::size_t colored = !radiance ? 0 : pbr ? 1 : sample.views.size();
        if (radiance) {
            ARS_TRY(views, viewMaps(sample, colored, random));
        }
        clock.mark("maps");
        RawAttributes raw = model_.network->evaluate(
            inputs, model_.pixels, {.geometry = true, .materials = pbr, .colors = radiance}, views, rawColors);
        const DecodedSurfels decoded = decodeSurfels(config_.decoding, model_.base, raw);
        clock.mark("network");
        PoseSurfelsParams posing = config_.posing;
        posing.trainingRadii = pbr && config_.freeze.radii == RadiusTraining::Learned;
        ARS_TRY(PosingContext context, posingContext(model_, capture_->pose(sample.frame), posing));
        const at::Tensor initial = tensorOf(std::span<const float>(model_.spec.initialRadii));
        SurfelTensors surfels = poseSurfelTensors(std::make_shared<const PosingContext>(std::move(context)),
                                                  decoded.surfels, initial * (1.0 + radiusOffsets_));
        clock.mark("pose");
        std::shared_ptr<LightTensors> light;
        const at::Tensor texels = lightLog_.exp();
        if (pbr) light = lightTensors(texels);
        clock.mark("light");

        const double share = 1.0 / static_cast<double>(sample.views.size());
        for (std::size_t v = 0; v < sample.views.size(); ++v) {
            const CapturedView& photograph = *sample.views[v];
            surfels.colors = v < colored ? decodeColors(model_.base, rawColors[v]) : at::Tensor();
            const Background background = randomBackground(random);
            const GBufferTensors gbuffer =
                splatTensors(config_.splat, surfels, photograph.camera, channelsOf(pbr, v < colored), scratch_);
            clock.mark("splat");
            geometryTerms(gbuffer, photograph.camera, share, terms);
            if (v < colored) {
                const at::Tensor picture = radiancePicture(gbuffer, background);
                comparePictures(picture, photograph, background, pbr ? config_.loss.radianceInPbr : share,
                                pbr ? "radiance_" : "", terms);
            }
            if (config_.loss.opacityMask > 0.0) {
                // Soft alpha says where the outline runs within a pixel, so the band takes part.
                const at::Tensor mask = tensorOf(pictureView(photograph.mask));
                terms.add("opacity_mask", share * config_.loss.opacityMask,
                          (gbuffer[Channel::Opacity] - mask).abs().mean());
            }
            clock.mark("loss");
            if (pbr) shadedTerms(gbuffer, photograph, background, light, share, terms, clock);
        }
        terms.add("offset", config_.loss.offset, offsetLoss(decoded.offsets, config_.loss.offsetSquared));
        if (!pbr) {
            terms.add("normal_deformation", config_.loss.normalDeformation, normalTerm(surfels, random));
        } else if (lightLog_.requires_grad()) {
            terms.add("light_tv", config_.loss.lightVariation, lightTotalVariation(texels));
            terms.add("white_light", config_.loss.whiteLight, whiteLightLoss(texels));
        }
        return {};
    }

    static ChannelSet channelsOf(bool pbr, bool radiance) {
        ChannelSet channels{Channel::Opacity, Channel::Depth, Channel::Normal};
        if (radiance) channels.add(Channel::Radiance);
        if (!pbr) return channels;
        return channels.united({Channel::Albedo, Channel::Roughness, Channel::Radius, Channel::RadiusPlus,
                                Channel::RadiusMinus, Channel::Importance, Channel::Bone});
    }

    static Background randomBackground(StepRandom& random) {
        Background background;
        for (float& c : background.srgb) c = static_cast<float>(random.uniform());
        background.tensor = tensorOf(std::span<const float>(background.srgb));
        return background;
    }

    at::Tensor radiancePicture(const GBufferTensors& gbuffer, const Background& background) const {
        const at::Tensor& opacity = gbuffer[Channel::Opacity];
        return gbuffer[Channel::Radiance] * opacity + background.tensor * (1.0 - opacity);
    }

    /// L1 and the perceptual loss; background where nobody is in the photograph, and in the band in both.
    void comparePictures(const at::Tensor& picture, const CapturedView& photograph, const Background& background,
                         double weight, const std::string& prefix, LossTerms& terms) const {
        const at::Tensor keep = 1.0 - tensorOf(pictureView(photograph.band));
        const float threshold = 128.5f / 255.0f;
        const at::Tensor inside = (tensorOf(pictureView(photograph.mask)) > threshold).to(at::kFloat) * keep;
        const at::Tensor target = tensorOf(pictureView(photograph.color)) * inside + background.tensor * (1.0 - inside);
        const at::Tensor seen = picture * keep + background.tensor * (1.0 - keep);
        terms.add(prefix + "l1", weight * config_.loss.l1, l1Loss(seen, target));
        if (perceptual_) {
            terms.add(prefix + perceptual_->name(), weight * config_.loss.perceptual,
                      perceptual_->evaluate(seen, target));
        }
    }

    void geometryTerms(const GBufferTensors& gbuffer, const Camera& camera, double share, LossTerms& terms) const {
        const at::Tensor &normal = gbuffer[Channel::Normal], &opacity = gbuffer[Channel::Opacity];
        const double progress =
            static_cast<double>(done_) / static_cast<double>(std::max<std::int64_t>(1, totalSteps()));
        const double consistency = consistencyWeight(config_.loss.consistency, config_.loss.consistencyEnd, progress);
        if (consistency > 0.0) {
            terms.add("consistency", share * consistency,
                      depthNormalLoss(normal, gbuffer[Channel::Depth], opacity, camera));
        }
        if (config_.loss.curvature > 0.0) {
            terms.add("curvature", share * config_.loss.curvature, curvatureLoss(normal, opacity));
        }
    }

    void shadedTerms(const GBufferTensors& gbuffer, const CapturedView& photograph, const Background& background,
                     const std::shared_ptr<LightTensors>& light, double share, LossTerms& terms, StepClock& clock) {
        at::Tensor occlusion;
        if (config_.freeze.radii != RadiusTraining::Off) {
            occlusion = occlusionTensor(config_.occlusion, gbuffer, photograph.camera, occlusionMemory_,
                                        static_cast<int>(done_ & 0xffff));
        }
        clock.mark("occlusion");
        const at::Tensor linear = shadeTensors({}, gbuffer, occlusion, photograph.camera, light);
        ToneParams tone;
        tone.backgroundRed = srgbToLinear(background.srgb[0]);
        tone.backgroundGreen = srgbToLinear(background.srgb[1]);
        tone.backgroundBlue = srgbToLinear(background.srgb[2]);
        const at::Tensor picture = toneTensor(tone, linear).slice(2, 0, 3);
        clock.mark("shade");
        comparePictures(picture, photograph, background, share, "", terms);
        if (config_.loss.brdfVariation > 0.0) {
            const at::Tensor& opacity = gbuffer[Channel::Opacity];
            terms.add("brdf_tv", share * config_.loss.brdfVariation,
                      totalVariation(gbuffer[Channel::Albedo], opacity) +
                          totalVariation(gbuffer[Channel::Roughness], opacity));
        }
        clock.mark("loss");
    }

    at::Tensor normalTerm(const SurfelTensors& surfels, StepRandom& random) const {
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

    Status restoreFrom(AvatarModel& saved, const SafetensorsFile& state) {
        if (saved.spec.network != model_.spec.network || saved.maps.pixels != model_.maps.pixels) {
            return makeError(ErrorCode::BadFile, "",
                             "was made with other networks or another template than this run has now");
        }
        const auto number = state.metadata.find("step");
        if (number == state.metadata.end()) return makeError(ErrorCode::BadFile, "step", "is missing");
        SafetensorsFile weights;
        saved.network->tensors().store(weights);
        ARS_TRY_STATUS(model_.network->tensors().load(weights));
        at::NoGradGuard noGradient;
        if (model_.base.geometry.defined() && saved.base.geometry.defined()) {
            model_.base.geometry.copy_(saved.base.geometry);
            model_.base.materials.copy_(saved.base.materials);
            model_.base.colors.copy_(saved.base.colors);
        }
        ARS_TRY_STATUS(takeTensor(state, "radius_offsets", radiusOffsets_));
        ARS_TRY_STATUS(takeTensor(state, "light.log", lightLog_));
        done_ = std::atoll(number->second.c_str());
        // Moments of a stage that is over are dropped as they would have been at its end.
        enterStage(stageOf(std::max<std::int64_t>(0, done_ - 1)));
        return adam_.load(state);
    }

    static Status takeTensor(const SafetensorsFile& file, const std::string& name, at::Tensor& into) {
        ARS_TRY(const Array* array, file.find(name));
        ARS_TRY(const at::Tensor values, tensorFromArray(*array));
        if (values.sizes() != into.sizes()) {
            return makeError(ErrorCode::BadFile, name,
                             fmt::format("{}, expected {} numbers", array->describe(), into.numel()));
        }
        into.copy_(values);
        return {};
    }

    TrainerSources sources_;
    TrainingConfig config_;
    std::shared_ptr<const Capture> capture_;
    CaptureSplit split_;
    AvatarModel model_;
    std::unique_ptr<PerceptualLoss> perceptual_;
    NeighbourPairs neighbours_;
    at::Tensor lightLog_;      ///< (6, side, side, 3)
    at::Tensor radiusOffsets_; ///< (9) delta_g
    Adam adam_;
    std::unique_ptr<DataReader> reader_;
    std::map<int, AvatarNetworkInputs> inputs_; ///< by frame
    SplatScratchPool scratch_;
    OcclusionWorkspace occlusionMemory_;
    Stage stage_ = Stage::Template;
    std::int64_t done_ = 0;
};

} // namespace

nlohmann::json trainerSourcesToJson(const TrainerSources& sources) {
    return {{"capture", sources.capture.string()},
            {"body", sources.body.string()},
            {"template", sources.templateFile.string()}};
}

Result<TrainerSources> trainerSourcesFromJson(const nlohmann::json& json) {
    if (!json.is_object() || !json.contains("capture")) {
        return makeError(ErrorCode::BadFile, "sources", "expected an object with \"capture\"");
    }
    TrainerSources sources;
    sources.capture = json.value("capture", "");
    sources.body = json.value("body", "");
    sources.templateFile = json.value("template", "");
    return sources;
}

std::unique_ptr<TrainingTask> makeAvatarTrainer(TrainerSources sources, TrainingConfig config) {
    return std::make_unique<AvatarTrainer>(std::move(sources), std::move(config));
}

} // namespace ars
