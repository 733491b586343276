#include "model/plugin.h"

#include "engine/capture/capture.h"
#include "engine/frame/rest_avatar.h"
#include "engine/io/utf8.h"
#include "model/avatar/avatar_model.h"
#include "model/avatar/avatar_preview.h"
#include "model/evaluation/evaluation.h"
#include "model/run/run_failure.h"
#include "model/run/training_run.h"
#include "model/training/placement.h"
#include "model/training/trainer.h"
#include "model/training/training_config.h"

#include <nlohmann/json.hpp>

#include <thread>

namespace {

using namespace ars;

Result<EvaluationProtocol> evaluationProtocol(const std::string& word) {
    if (word == "ag") return EvaluationProtocol::Ag;
    if (word == "heldout") return EvaluationProtocol::HeldOut;
    if (word == "masked") return EvaluationProtocol::Masked;
    return makeError(ErrorCode::InvalidArgument, "--protocol",
                     fmt::format("is \"{}\", expected ag, heldout or masked", word));
}

RunOptions runOptions(const TrainingConfig& config) {
    RunOptions options;
    options.checkpointSteps = config.run.checkpointSteps;
    options.previewSteps = config.run.previewSteps;
    options.metricsSteps = config.run.metricsSteps;
    options.policy.newest = config.run.checkpointsKept;
    options.policy.milestoneSteps = config.run.milestoneSteps;
    return options;
}

nlohmann::json runConfig(const TrainerSources& sources, const TrainingConfig& config) {
    return {{"format", "ars.run"},
            {"version", 1},
            {"sources", trainerSourcesToJson(sources)},
            {"training", trainingConfigToJson(config)}};
}

/// What a run goes on with: its own config, under the settings that were given.
struct PreparedRun {
    std::unique_ptr<RunWriter> writer;
    TrainerSources sources;
    TrainingConfig config;
    bool changed = false; ///< config.json says something else
};

Status applySettings(const TrainRequest& request, TrainingConfig& config) {
    for (const auto& [name, value] : request.settings) ARS_TRY_STATUS(setTrainingParameter(config, name, value));
    makePathsAbsolute(config);
    ARS_TRY_STATUS(validateTrainingConfig(config));
    // A device that is not here is told of before a folder is made.
    const Result<Device> device = trainingDevice(config.run.device);
    return device ? Status() : Status(device.error());
}

/// config.json names the files in UTF-8: a run on others could never be resumed.
Status checkNames(const TrainRequest& request) {
    for (const std::filesystem::path& path : {request.capture, request.body, request.templateFile, request.run}) {
        if (path.empty()) continue;
        const std::string name = std::filesystem::absolute(path).string();
        if (isUtf8(name)) continue;
        return makeError(ErrorCode::InvalidArgument, name,
                         "expected a path in UTF-8, as the run's config.json holds it; rename the folder");
    }
    return {};
}

Result<PreparedRun> prepareNewRun(const TrainRequest& request, const std::atomic<bool>& stop) {
    ARS_TRY_STATUS(checkNames(request));
    PreparedRun run;
    run.sources = {std::filesystem::absolute(request.capture),
                   request.body.empty() ? request.body : std::filesystem::absolute(request.body),
                   request.templateFile.empty() ? request.templateFile
                                                : std::filesystem::absolute(request.templateFile)};
    ARS_TRY(run.config, trainingPreset(request.preset));
    ARS_TRY_STATUS(applySettings(request, run.config));
    // What is wrong with the capture is said before a folder is made.
    ARS_TRY(Capture capture, openCapture(run.sources.capture, [&](double, std::string_view) { return !stop; }));
    ARS_TRY(const CaptureSplit split, trainingSplit(capture, run.config.cameras, run.config.frames));
    (void)split;
    run.sources.opened = std::make_shared<const Capture>(std::move(capture));
    ARS_TRY(run.writer, RunWriter::create(request.run, runConfig(run.sources, run.config)));
    return run;
}

Result<PreparedRun> prepareResume(const TrainRequest& request) {
    ARS_TRY_STATUS(checkNames(request));
    PreparedRun run;
    ARS_TRY(const nlohmann::json json, readRunConfig(request.run));
    const std::string place = (request.run / kRunConfigFile).string();
    if (!json.contains("sources") || !json.contains("training")) {
        return makeError(ErrorCode::BadFile, place, "expected \"sources\" and \"training\"");
    }
    ARS_TRY(run.sources, trainerSourcesFromJson(json["sources"]));
    ARS_TRY(run.config, trainingConfigFromJson(json["training"]));
    if (!request.capture.empty()) run.sources.capture = std::filesystem::absolute(request.capture);
    ARS_TRY_STATUS(applySettings(request, run.config));
    ARS_TRY(run.writer, RunWriter::open(request.run));
    run.changed = runConfig(run.sources, run.config) != json;
    return run;
}

/// rest:FILE: nothing learned, what a training must beat.
Result<EvaluatedAvatar> restAvatarOf(const std::string& source, const ProgressFunction& progress) {
    EvaluatedAvatar avatar;
    ARS_TRY(avatar.evaluator, restAvatarFromFile(source, {}, progress));
    avatar.splat.depth = DepthMode::Filtered;
    return avatar;
}

NetworkPrecision networkPrecision(AvatarPrecision precision) {
    const bool quick = precision == AvatarPrecision::Quick && hasNativeBFloat16();
    return quick ? NetworkPrecision::BFloat16 : NetworkPrecision::Float32;
}

class Plugin final : public ModelPlugin {
public:
    TorchInfo initialize() override { return initializeTorch(); }
    TorchSpeed measureSpeed(int repetitions) override { return measureTorchSpeed(repetitions); }

    Result<OpenedTrainedAvatar> openAvatar(const std::filesystem::path& folder, bool project,
                                           AvatarPrecision precision) override {
        return withoutExceptions<Result<OpenedTrainedAvatar>>(folder.string(), [&]() -> Result<OpenedTrainedAvatar> {
            return openUnguarded(folder, project, precision);
        });
    }

    Result<RunStatus> train(const TrainRequest& request, const std::atomic<bool>& stop,
                            const std::function<void(const RunStatus&)>& listener) override {
        ARS_TRY(PreparedRun run, request.resume ? prepareResume(request) : prepareNewRun(request, stop));
        RunOptions options = runOptions(run.config);
        // Only then it is known that the run goes on under them: a mistake is not to be the next resume's as well.
        options.onRestored = [&](std::int64_t step) {
            return run.changed ? run.writer->rewriteConfig(runConfig(run.sources, run.config), step) : Status();
        };
        const std::unique_ptr<TrainingTask> task = makeAvatarTrainer(run.sources, run.config);
        RunSignals signals;
        const RunListener told = [&](const RunStatus& status) {
            if (stop) signals.stop = true;
            if (listener) listener(status);
        };
        // A stop is heard within a tenth of a second also while a step is long.
        const std::jthread watch([&](const std::stop_token& ended) {
            while (!ended.stop_requested() && !signals.stop) {
                if (stop) signals.stop = true;
                std::this_thread::sleep_for(std::chrono::milliseconds(50));
            }
        });
        return runTraining(*run.writer, *task, options, request.resume, signals, told);
    }

    Result<nlohmann::ordered_json> evaluate(const EvalRequest& request, const ProgressFunction& progress) override {
        return withoutExceptions<Result<nlohmann::ordered_json>>(
            "evaluation", [&]() -> Result<nlohmann::ordered_json> { return evaluateUnguarded(request, progress); });
    }

    Result<std::vector<ParameterInfo>> trainingParameters(const std::string& preset) override {
        ARS_TRY(const TrainingConfig config, trainingPreset(preset));
        return trainingParameterInfos(config);
    }

    Status exportAvatar(const std::filesystem::path& source, const std::filesystem::path& folder) override {
        return withoutExceptions<Status>("export", [&]() -> Status {
            initializeTorch();
            ARS_TRY(const std::filesystem::path from, trainedAvatarFolder(source));
            ARS_TRY(const AvatarModel model, readAvatar(from));
            ARS_TRY(const Image preview, avatarPreview(model));
            return writeAvatar(folder, model, preview);
        });
    }

private:
    static Result<OpenedTrainedAvatar> openUnguarded(const std::filesystem::path& folder, bool project,
                                                     AvatarPrecision precision) {
        initializeTorch();
        ARS_TRY(AvatarModel model, readAvatar(folder));
        OpenedTrainedAvatar opened;
        opened.radii = learnedRadii(model.spec);
        opened.light = model.light;
        opened.splat = model.spec.splat;
        opened.occluded = model.spec.occluded;
        opened.occlusion = shownOcclusion(model.spec);
        opened.posing = shownPosing(model.spec);
        opened.preset = model.spec.preset;
        opened.origin = model.spec.origin;
        opened.evaluator = makeTrainedAvatar(std::move(model), project, networkPrecision(precision));
        return opened;
    }

    Result<nlohmann::ordered_json> evaluateUnguarded(const EvalRequest& request, const ProgressFunction& progress) {
        ARS_TRY(const EvaluatedAvatar avatar, evaluatedAvatar(request, progress));
        EvaluationOptions options;
        ARS_TRY(options.protocol, evaluationProtocol(request.protocol));
        options.split = request.split;
        options.cameras = request.cameras;
        options.frames = request.frames;
        options.outFolder = request.out;
        options.pictures = request.pictures;
        options.light = request.light;
        options.lpipsBackbone = request.lpipsBackbone;
        options.lpipsHeads = request.lpipsHeads;
        return evaluateAvatar(avatar, request.capture, options, progress);
    }

    Result<EvaluatedAvatar> evaluatedAvatar(const EvalRequest& request, const ProgressFunction& progress) {
        constexpr std::string_view kRest = "rest:";
        const std::string name = request.avatar.string();
        EvaluatedAvatar avatar;
        if (name.starts_with(kRest)) {
            ARS_TRY(avatar, restAvatarOf(name.substr(kRest.size()), progress));
        } else {
            const TrainedAvatarOpener opener = [this](const std::filesystem::path& folder, bool project) {
                return openAvatar(folder, project, AvatarPrecision::Exact);
            };
            ARS_TRY(const OpenedTrainedAvatar opened, openTrainedAvatar(request.avatar, request.project, opener));
            avatar.evaluator = opened.evaluator;
            avatar.radii = opened.radii;
            avatar.light = opened.light;
            avatar.splat = opened.splat;
            avatar.occlude = opened.occluded;
            avatar.occlusion = opened.occlusion;
            avatar.posing = opened.posing;
        }
        avatar.name = name;
        return avatar;
    }
};

} // namespace

extern "C" ars::ModelPlugin* arsModelPlugin() {
    static Plugin plugin;
    return &plugin;
}
