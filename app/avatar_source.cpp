#include "app/avatar_source.h"

#include "app/model_loader.h"
#include "app/text.h"

#include <fmt/format.h>

#include <filesystem>
#include <system_error>

namespace ars::app {

namespace {

constexpr std::string_view kSettingPrefix = "rest.";

Result<LoadedAvatar> loadTrained(const std::string& source, const ProgressFunction& progress) {
    ARS_TRY_STATUS(reportProgress(progress, 0.0, "reading the networks"));
    LoadedAvatar loaded;
    ARS_TRY(loaded.trained, openTrainedAvatar(source));
    loaded.avatar = loaded.trained->evaluator;
    loaded.notes = loaded.avatar->mesh().notes;
    return loaded;
}

} // namespace

void offerTrainedAvatars(AvatarPrecision precision) {
    setTrainedAvatarOpener(
        [precision](const std::filesystem::path& folder, bool project) -> Result<OpenedTrainedAvatar> {
            ARS_TRY(ModelPlugin * model, loadModel());
            return model->openAvatar(folder, project, precision);
        });
}

bool isAvatarSetting(const std::string& setting) { return setting.starts_with(kSettingPrefix); }

std::string describeAvatarSettings() {
    std::vector<ParameterInfo> infos = restAvatarParameters().infos();
    for (ParameterInfo& info : infos) info.name = std::string(kSettingPrefix) + info.name;
    return describeParameters(infos);
}

Result<LoadedAvatar> loadAvatar(const std::string& source, int surfels, const std::vector<std::string>& settings,
                                const ProgressFunction& progress) {
    constexpr std::string_view prefix = "rest:";
    std::error_code ignored;
    if (!source.starts_with(prefix) && std::filesystem::is_directory(source, ignored)) {
        return loadTrained(source, progress);
    }
    if (!source.starts_with(prefix)) {
        return makeError(
            ErrorCode::InvalidArgument, "--avatar",
            fmt::format("expected rest:TEMPLATE (a skinned glb, a mesh or a body), rest:open or the folder "
                        "of a trained avatar, run or checkpoint, found \"{}\"",
                        printable(source)));
    }
    RestAvatarOptions options;
    for (const std::string& setting : settings) {
        if (!isAvatarSetting(setting)) continue;
        const std::size_t equal = std::min(setting.find('='), setting.size());
        const Status set = restAvatarParameters().setText(
            options, setting.substr(kSettingPrefix.size(), equal - kSettingPrefix.size()),
            setting.substr(std::min(equal + 1, setting.size())));
        if (!set) {
            return makeError(ErrorCode::InvalidArgument, "--set", fmt::format("rest.{}", set.error().describe()));
        }
    }
    if (surfels > 0) options.maxSurfels = surfels;
    ARS_TRY(std::unique_ptr<RestAvatar> rest, restAvatarFromFile(source.substr(prefix.size()), options, progress));
    LoadedAvatar loaded;
    loaded.options = options;
    loaded.notes = rest->notes();
    for (const std::string& note : rest->mesh().notes) loaded.notes.push_back(note);
    loaded.avatar = std::move(rest);
    return loaded;
}

} // namespace ars::app
