#include "model/training/trainer.h"

#include "engine/capture/capture.h"
#include "engine/core/file.h"
#include "engine/core/log.h"
#include "engine/core/parallel.h"
#include "engine/io/png.h"
#include "engine/io/safetensors.h"
#include "engine/maps/pose_pca.h"
#include "engine/maps/position_maps.h"
#include "model/avatar/avatar_model.h"
#include "model/device.h"
#include "model/run/run_failure.h"
#include "model/runtime.h"
#include "model/training/data_reader.h"
#include "model/training/learned_state.h"
#include "model/training/placement.h"
#include "model/training/preview.h"
#include "model/training/step_terms.h"

#include <ATen/ATen.h>

#include <nlohmann/json.hpp>

namespace ars {
namespace {

constexpr std::size_t kMaxPcaPoses = 512;

class AvatarTrainer final : public TrainingTask {
public:
    AvatarTrainer(TrainerSources sources, TrainingConfig config)
        : sources_(std::move(sources)), config_(std::move(config)),
          adam_(config_.schedule.beta1, config_.schedule.beta2) {}

    Status load(const ProgressFunction& progress) override {
        initializeTorch();
        // This thread's team is made here, where a refused one costs speed and nothing else; LibTorch goes on with it.
        parallelFor(static_cast<std::size_t>(threadCount()), [](std::size_t) {}, 1);
        ARS_TRY_STATUS(validateTrainingConfig(config_));
        ARS_TRY(device_, trainingDevice(config_.run.device));
        if (device_.kind == DeviceKind::Cuda) logInfo("training on {}", deviceName(device_));
        ARS_TRY_STATUS(reportProgress(progress, 0.0, "reading the capture"));
        ARS_TRY_STATUS(openSource(progress));
        ARS_TRY(split_, trainingSplit(*capture_, config_.cameras, config_.frames));
        ARS_TRY_STATUS(reportProgress(progress, 0.2, "reading body and template"));
        ARS_TRY_STATUS(createModel());
        ARS_TRY_STATUS(reportProgress(progress, 0.6, "fitting the principal components of the poses"));
        ARS_TRY_STATUS(fitPca());
        ARS_TRY_STATUS(createLearnedLight(config_.light, config_.freeze, state_));
        placeState(state_, torchDevice(device_));
        terms_ = std::make_unique<StepTerms>(config_, *capture_, state_);
        ARS_TRY_STATUS(terms_->prepare());
        enterStage(stageOfStep(config_.schedule, 0));
        ARS_TRY_STATUS(startReader(0));
        return reportProgress(progress, 1.0, "ready");
    }

    std::int64_t totalSteps() const override {
        return std::int64_t(config_.schedule.templateSteps) + config_.schedule.radianceSteps +
               config_.schedule.pbrSteps;
    }
    std::int64_t stepsDone() const override { return done_; }

    Result<StepReport> step() override {
        Result<StepReport> report =
            withoutExceptions<Result<StepReport>>("training", [this] { return stepUnguarded(); });
        if (!report) return atPlace(std::move(report).error(), fmt::format("step {}", done_));
        return report;
    }

    Status save(const std::filesystem::path& folder) override {
        syncModel();
        ARS_TRY_STATUS(writeAvatarFiles(folder, state_.model, {}));
        SafetensorsFile state;
        adam_.store(state);
        state_.store(state);
        state.metadata["step"] = std::to_string(done_);
        state.metadata["stage"] = std::string(kTrainingStageNames[static_cast<std::size_t>(stage_)]);
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
        options.shaded = stage_ == TrainingStage::Pbr;
        ViewOptions view;
        view.scale = config_.schedule.imageScale;
        ARS_TRY(const AvatarModel model, modelOnHost(state_.model));
        const int frames = static_cast<int>(split_.frames.size()), cameras = static_cast<int>(split_.cameras.size());
        for (int i = 0; i < 2; ++i) {
            const ViewId id{split_.cameras[static_cast<std::size_t>(i * cameras / 2)],
                            split_.frames[static_cast<std::size_t>(i * frames / 2)]};
            if (!capture_->has(id)) continue;
            ARS_TRY(const CapturedView photograph, readView(*capture_, id, view));
            ARS_TRY(const Image picture, previewPicture(model, capture_->pose(id.frame), photograph, options));
            ARS_TRY_STATUS(writePng(folder / fmt::format("{:08}_{}.png", done_, i), picture));
        }
        return {};
    }

private:
    Status openSource(const ProgressFunction& progress) {
        capture_ = sources_.opened;
        if (capture_) return {};
        const auto share = [&](double fraction, std::string_view what) {
            return !progress || progress(0.2 * fraction, what);
        };
        ARS_TRY(Capture capture, openCapture(sources_.capture, share));
        capture_ = std::make_shared<const Capture>(std::move(capture));
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
        spec.occluded = config_.freeze.radii != RadiusTraining::Off;
        spec.occlusion = config_.occlusion;
        spec.posing = config_.posing;
        spec.preset = config_.preset;
        spec.maps.centerM = canonicalCenter(body, shape);
        ARS_TRY(state_.model, createAvatar(std::move(spec), std::move(mesh), shaped,
                                           static_cast<std::uint64_t>(config_.schedule.seed)));
        return {};
    }

    Status fitPca() {
        if (state_.model.spec.network.canonicalOnly || split_.frames.size() < 2) return {};
        std::vector<std::vector<float>> samples;
        const std::size_t stride = (split_.frames.size() + kMaxPcaPoses - 1) / kMaxPcaPoses;
        for (std::size_t i = 0; i < split_.frames.size(); i += stride) {
            ARS_TRY(
                const std::vector<glm::vec3> points,
                posedMapPoints(state_.model.mesh.skeleton(), state_.model.inputMaps, capture_->pose(split_.frames[i])));
            const float* numbers = &points.front().x;
            samples.emplace_back(numbers, numbers + 3 * points.size());
        }
        ARS_TRY(state_.model.pca, fitPosePca(samples));
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

    void enterStage(TrainingStage stage) {
        stage_ = stage;
        adam_ = optimiserOf(config_.schedule, state_);
    }

    Result<StepReport> stepUnguarded() {
        StepClock clock;
        StepReport report;
        if (const TrainingStage stage = stageOfStep(config_.schedule, done_); stage != stage_) enterStage(stage);
        report.stage = kTrainingStageNames[static_cast<std::size_t>(stage_)];
        ARS_TRY(const TrainingSample sample, reader_->next());
        clock.mark("read");
        report.values["rate.network"] = setRates(config_, stage_, done_, adam_);
        adam_.clearGradients();
        LossTerms terms;
        StepRandom random(static_cast<std::uint64_t>(config_.schedule.seed), done_);
        const Status status = stage_ == TrainingStage::Template
                                  ? terms_->addTemplate(sample, terms, clock)
                                  : terms_->addPictures(stage_, done_, sample, random, terms, clock);
        if (!status) return status.error();
        Result<at::Tensor> total = terms.total(report.values);
        if (!total) return total.error();
        clock.mark("loss");
        total.value().backward();
        clock.mark("backward");
        if (const Status stepped = adam_.step(); !stepped) return stepped.error();
        state_.keepInRange();
        clock.mark("optimiser");
        ++done_;
        finishReport(clock, report);
        return report;
    }

    void finishReport(const StepClock& clock, StepReport& report) const {
        report.values.insert(clock.parts().begin(), clock.parts().end());
        report.milliseconds = clock.totalMs();
        report.values["time.step_ms"] = report.milliseconds;
        if (stage_ != TrainingStage::Pbr) return;
        const PartRadii radii = learnedRadii(state_.specNow());
        for (int g = 0; g < kBodyPartCount; ++g) {
            report.values[fmt::format("radius.{}", bodyPartName(static_cast<BodyPart>(g)))] =
                radii[static_cast<std::size_t>(g)];
        }
    }

    /// What the model says of itself follows what was learned.
    void syncModel() {
        state_.syncModel(fmt::format("step {} of a training on {}", done_, capture_->subject),
                         config_.schedule.pbrSteps > 0);
    }

    Status restoreFrom(AvatarModel& saved, const SafetensorsFile& state) {
        const auto number = state.metadata.find("step");
        if (number == state.metadata.end()) return makeError(ErrorCode::BadFile, "step", "is missing");
        ARS_TRY(const TrainingStage stage, stageOfState(state));
        ARS_TRY_STATUS(state_.load(saved, state));
        done_ = std::atoll(number->second.c_str());
        // The stage of the last step, under the schedule of now. Under another one than it was made with, it may not be
        // the one that the moments belong to: they then begin anew, as in every stage.
        enterStage(stageOfStep(config_.schedule, std::max<std::int64_t>(0, done_ - 1)));
        return stage_ == stage ? adam_.load(state) : Status();
    }

    TrainerSources sources_;
    TrainingConfig config_;
    std::shared_ptr<const Capture> capture_;
    CaptureSplit split_;
    LearnedState state_;
    Device device_; ///< of everything in state_
    std::unique_ptr<StepTerms> terms_;
    Adam adam_;
    std::unique_ptr<DataReader> reader_;
    TrainingStage stage_ = TrainingStage::Template;
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
