#include "app/avatar_source.h"
#include "app/inspect.h"
#include "app/text.h"

#include "engine/scene/run_folder.h"
#include "engine/scene/trained_avatar.h"

#include <fmt/ranges.h>

namespace ars::app {
namespace {

namespace fs = std::filesystem;

void addRun(FileReport& report) {
    const fs::path folder = report.path;
    const auto status = readRunStatus(folder);
    if (!status) return report.fail(status.error());
    std::string steps = fmt::format("{}, {} of {}", runStateName(status->state), grouped(status->step),
                                    counted(static_cast<std::size_t>(status->totalSteps), "step"));
    if (!status->stage.empty()) steps += fmt::format(" ({})", status->stage);
    report.add("state", steps, std::string(runStateName(status->state)));
    report.add("step", "", status->step);
    report.add("total_steps", "", status->totalSteps);
    if (const auto config = readRunConfig(folder); config && config->contains("sources")) {
        report.add("capture", config->at("sources").value("capture", ""));
    }
    if (const auto checkpoints = listCheckpoints(folder); checkpoints && !checkpoints->empty()) {
        report.add("checkpoints",
                   fmt::format("{}, the newest at step {}", checkpoints->size(), grouped(checkpoints->back().step)),
                   checkpoints->size());
    }
    if (!status->error.empty()) report.warn(status->error);
}

/// Facts of avatar.json; what it lacks is for opening to say.
Status addDescription(FileReport& report, const fs::path& folder, const InspectOptions& options) {
    ARS_TRY(const Json json, readJsonFile(folder / "avatar.json", options.limits));
    const Json maps = json.value("maps", Json::object());
    report.add("preset", json.value("preset", ""));
    report.add("origin", json.value("origin", ""));
    report.add("surfels", grouped(maps.value("points", std::uint64_t(0))), maps.value("points", 0));
    report.add("maps", fmt::format("{} pixels a side", maps.value("size", 0)), maps.value("size", 0));
    std::vector<std::string> radii;
    Json learned = Json::object();
    const Json parts = json.value("radii", Json::object());
    for (const auto& [part, radius] : parts.items()) {
        const double metres = radius.value("initial", 0.0) * (1.0 + radius.value("offset", 0.0));
        radii.push_back(fmt::format("{} {:.1f}", part, 100.0 * metres));
        learned[part] = metres;
    }
    report.add("radii", fmt::format("{} cm", fmt::join(radii, ", ")), learned);
    const bool light = fs::exists(folder / "light.exr");
    report.add("light", light ? "light.exr" : "none", light);
    return {};
}

} // namespace

bool inspectAvatarFolder(FileReport& report, const InspectOptions& options) {
    const fs::path folder = report.path;
    const bool run = looksLikeRunFolder(folder);
    if (!run && !looksLikeTrainedAvatar(folder)) return false;
    report.kind = run ? "run" : "avatar";
    report.title = run ? "training run" : "trained avatar";
    if (run) addRun(report);
    if (!report.ok()) return true;
    const auto source = trainedAvatarFolder(folder);
    if (!source) {
        // A run that has not got as far as a checkpoint is no broken one.
        if (!run) report.fail(source.error());
        return true;
    }
    try {
        if (Status described = addDescription(report, *source, options); !described) {
            report.fail(described.error());
            return true;
        }
    } catch (const Json::exception&) {
        report.fail(makeError(ErrorCode::BadFile, (*source / "avatar.json").string(),
                              "holds values of other kinds than an avatar's description has"));
        return true;
    }
    if (options.fast) return true;
    offerTrainedAvatars();
    if (const auto opened = openTrainedAvatar(*source); !opened) report.fail(opened.error());
    return true;
}

} // namespace ars::app
