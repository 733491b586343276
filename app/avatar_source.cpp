#include "app/avatar_source.h"

#include "app/text.h"

#include <fmt/format.h>

namespace ars::app {

namespace {
constexpr std::string_view kSettingPrefix = "rest.";
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
    if (!source.starts_with(prefix)) {
        return makeError(
            ErrorCode::InvalidArgument, "--avatar",
            fmt::format("expected rest:TEMPLATE (a skinned glb, a mesh or a body) or rest:open, found \"{}\"",
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
