#include "app/train.h"

#include "app/interrupt.h"
#include "app/model_loader.h"
#include "app/text.h"
#include "app/train_progress.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <filesystem>
#include <thread>

namespace ars::app {
namespace fs = std::filesystem;
namespace {

constexpr auto kInterruptPoll = std::chrono::milliseconds(50);
constexpr auto kRequestWait = std::chrono::seconds(10);

Error wrongUsage(std::string option, std::string message) {
    return makeError(ErrorCode::InvalidArgument, std::move(option), std::move(message));
}

void printLine(const Json& json) {
    fmt::print("{}\n", json.dump(-1, ' ', false, Json::error_handler_t::replace));
    std::fflush(stdout);
}

/// As reportError, on one line with --json: what stands before it are lines too.
int reportTrainError(const Error& error, const OutputOptions& output) {
    if (!output.json) return reportError(error, output);
    printLine({{"error", errorJson(error)}});
    const bool usage = error.code == ErrorCode::InvalidArgument && error.place.starts_with("--");
    return usage ? kWrongUsage : kFailure;
}

/// Tells a training that Ctrl-C was pressed, also while it is paused and calls nobody.
class InterruptWatch {
public:
    InterruptWatch() : thread_([this] { watch(); }) {}
    ~InterruptWatch() {
        ended_ = true;
        thread_.join();
    }
    InterruptWatch(const InterruptWatch&) = delete;
    InterruptWatch& operator=(const InterruptWatch&) = delete;
    const std::atomic<bool>& stop() const { return stop_; }

private:
    void watch() {
        while (!ended_) {
            if (interruptRequested()) stop_ = true;
            std::this_thread::sleep_for(kInterruptPoll);
        }
    }

    std::atomic<bool> stop_{false};
    std::atomic<bool> ended_{false};
    std::thread thread_;
};

std::string presetOf(const TrainOptions& options) { return options.preset.empty() ? "compact" : options.preset; }

/// --set as pairs, each checked against the table: what is wrong is known before anything is read.
Result<std::vector<std::pair<std::string, std::string>>> parseSettings(const TrainOptions& options,
                                                                       const std::vector<ParameterInfo>& infos) {
    std::vector<std::pair<std::string, std::string>> settings;
    for (const std::string& setting : options.settings) {
        const std::size_t equal = setting.find('=');
        if (equal == std::string::npos || equal == 0) {
            return wrongUsage("--set", fmt::format("expected NAME=VALUE, found \"{}\"", printable(setting)));
        }
        const std::string name = setting.substr(0, equal);
        const std::string text = setting.substr(equal + 1);
        const auto info = std::find_if(infos.begin(), infos.end(), [&](const auto& row) { return row.name == name; });
        if (info == infos.end()) return wrongUsage("--set", detail::unknownParameter(infos, name).describe());
        if (auto value = parseParameter(*info, text); !value) return wrongUsage("--set", value.error().describe());
        settings.emplace_back(name, text);
    }
    return settings;
}

Result<std::vector<ParameterInfo>> presetParameters(const TrainOptions& options, ModelPlugin& model) {
    auto infos = model.trainingParameters(presetOf(options));
    if (!infos && infos.error().place == "preset") return wrongUsage("--preset", infos.error().message);
    return infos;
}

Status printParameters(const TrainOptions& options) {
    ARS_TRY(ModelPlugin* const model, loadModel());
    ARS_TRY(const std::vector<ParameterInfo> infos, presetParameters(options, *model));
    if (!options.output.json) {
        fmt::print("Parameters of ars train with the values of preset {}:\n\n{}", presetOf(options),
                   describeParameters(infos));
        return {};
    }
    Json rows = Json::array();
    for (const ParameterInfo& info : infos) {
        Json row{{"name", info.name}, {"type", info.typeName()}};
        std::visit([&](const auto& value) { row["value"] = value; }, info.defaultValue);
        if (info.range.minimum != info.range.maximum) row["range"] = {info.range.minimum, info.range.maximum};
        if (!info.choices.empty()) row["choices"] = info.choices;
        if (!info.unit.empty()) row["unit"] = info.unit;
        row["help"] = info.help;
        rows.push_back(std::move(row));
    }
    printJson({{"preset", presetOf(options)}, {"parameters", std::move(rows)}});
    return {};
}

Result<RunStatus> statusOf(const TrainOptions& options) {
    if (options.run.empty()) return wrongUsage("--run", "expected the folder of a run");
    if (!holdsRun(options.run)) {
        return makeError(ErrorCode::NotFound, options.run, "this is no run folder");
    }
    return readRunStatus(options.run);
}

void printStatus(const std::string& run, const RunStatus& status) {
    fmt::print("{}: {}\n", printable(run), runStateName(status.state));
    fmt::print("  {}\n", progressText(status));
    if (!status.checkpoint.empty()) fmt::print("  newest checkpoint: {}\n", printable(status.checkpoint));
    if (status.process > 0) fmt::print("  process {} on {}\n", status.process, printable(status.host));
    if (!status.error.empty()) fmt::print("  error: {}\n", printable(status.error));
}

Status printStatus(const TrainOptions& options) {
    ARS_TRY(const RunStatus status, statusOf(options));
    if (options.output.json) {
        printJson(Json(runStatusToJson(status)));
    } else {
        printStatus(options.run, status);
    }
    return {};
}

Status sendRequest(const TrainOptions& options) {
    const auto request = runRequestFromName(options.request);
    if (!request) {
        return wrongUsage("--request", fmt::format("expected pause, resume, save, stop or discard, found \"{}\"",
                                                   printable(options.request)));
    }
    ARS_TRY_STATUS([&]() -> Status {
        const auto status = statusOf(options);
        return status ? Status() : Status(status.error());
    }());
    Status asked = requestOfRun(options.run, *request);
    if (!asked) {
        Error error = std::move(asked).error();
        if (error.code == ErrorCode::Unavailable && *request == RunRequest::Resume) {
            error.message += "; ars train --run DIR --resume goes on with it";
        }
        return error;
    }
    // The process looks between steps: wait a little for its answer, so that scripts see what they asked for.
    const fs::path control = fs::path(options.run) / kRunControlFile;
    const auto end = std::chrono::steady_clock::now() + kRequestWait;
    std::error_code ignored;
    while (fs::exists(control, ignored) && std::chrono::steady_clock::now() < end && !interruptRequested()) {
        std::this_thread::sleep_for(kInterruptPoll);
    }
    const bool taken = !fs::exists(control, ignored);
    if (options.output.json) {
        printJson({{"request", options.request}, {"taken", taken}});
    } else {
        fmt::print("{}: {}{}\n", printable(options.run), options.request,
                   taken ? " was taken" : " waits for the end of a long step");
    }
    return {};
}

Result<TrainRequest> trainRequest(const TrainOptions& options, ModelPlugin& model) {
    TrainRequest request;
    ARS_TRY(const std::vector<ParameterInfo> infos, presetParameters(options, model));
    ARS_TRY(request.settings, parseSettings(options, infos));
    request.capture = options.capture;
    request.body = options.body;
    request.templateFile = options.templateFile;
    request.run = options.run;
    request.preset = presetOf(options);
    request.resume = options.resume;
    return request;
}

Status checkUsage(const TrainOptions& options) {
    if (options.run.empty()) return wrongUsage("--run", "expected a folder for the run");
    if (options.resume) {
        for (const auto& [option, value] :
             {std::pair{"--preset", options.preset}, {"--body", options.body}, {"--template", options.templateFile}}) {
            if (!value.empty()) return wrongUsage(option, "a run that is resumed keeps its own");
        }
        if (holdsRun(options.run)) return {};
        return makeError(ErrorCode::NotFound, options.run, "this is no run folder: nothing to resume");
    }
    if (options.capture.empty()) return wrongUsage("--capture", "expected the folder of a capture");
    if (holdsRun(options.run)) {
        return wrongUsage("--run", fmt::format("{}: there is a run in this folder already; add --resume to go on with "
                                               "it, or choose another folder",
                                               printable(options.run)));
    }
    return {};
}

Result<RunStatus> train(const TrainOptions& options) {
    ARS_TRY_STATUS(checkUsage(options));
    ARS_TRY(ModelPlugin* const model, loadModel());
    FaultSentence::coverLoadedLibraries();
    ARS_TRY(const TrainRequest request, trainRequest(options, *model));
    const InterruptWatch watch;
    TrainProgress progress(options.run, options.output);
    auto status = model->train(request, watch.stop(), [&](const RunStatus& told) { progress.show(told); });
    progress.finish();
    return status;
}

void describeEnd(const TrainOptions& options, const RunStatus& status) {
    if (options.output.json) {
        printLine({{"status", Json(runStatusToJson(status))}});
        return;
    }
    const std::string what =
        status.state == RunState::Finished
            ? fmt::format("finished after {} steps", grouped(static_cast<std::uint64_t>(status.step)))
            : printable(status.note.empty() ? std::string(runStateName(status.state)) : status.note);
    const std::string checkpoint = status.checkpoint.empty() ? "" : fmt::format(", {}", printable(status.checkpoint));
    fmt::print("{}: {}{}\n", printable(options.run), what, checkpoint);
    // Not after a discard: then there is no run.
    if (status.state != RunState::Finished && looksLikeRunFolder(options.run)) {
        fmt::print("ars train --run {} --resume goes on with it\n", printable(options.run));
    }
}

} // namespace

int runTrain(const TrainOptions& options) {
    if (options.helpParameters || options.status || !options.request.empty()) {
        const Status done = options.helpParameters ? printParameters(options)
                            : options.status       ? printStatus(options)
                                                   : sendRequest(options);
        return done ? kSuccess : reportError(done.error(), options.output);
    }
    const FaultSentence onFault(fmt::format(
        "\nerror: {}: the program broke off by a fault of its own or of LibTorch; where memory is limited it "
        "was most likely refused some; checkpoints that the run has are intact, and where it had begun --resume goes "
        "on with it\n",
        printable(options.run)));
    const auto status = train(options);
    if (!status) return reportTrainError(status.error(), options.output);
    describeEnd(options, *status);
    // Stopped by Ctrl-C the checkpoint is there, but the program did not do what it was started for.
    return interruptRequested() && status->state != RunState::Finished ? kFailure : kSuccess;
}

} // namespace ars::app
