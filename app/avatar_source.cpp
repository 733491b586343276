#include "app/avatar_source.h"

#include "app/text.h"
#include "engine/frame/rest_avatar.h"

#include <fmt/format.h>

namespace ars::app {

Result<LoadedAvatar> loadAvatar(const std::string& source, int surfels, const ProgressFunction& progress) {
    constexpr std::string_view prefix = "rest:";
    if (!source.starts_with(prefix)) {
        return makeError(
            ErrorCode::InvalidArgument, "--avatar",
            fmt::format("expected rest:TEMPLATE (a skinned glb, a mesh or a body) or rest:open, found \"{}\"",
                        printable(source)));
    }
    RestAvatarOptions options;
    if (surfels > 0) options.maxSurfels = surfels;
    ARS_TRY(std::unique_ptr<RestAvatar> rest, restAvatarFromFile(source.substr(prefix.size()), options, progress));
    LoadedAvatar loaded;
    loaded.notes = rest->notes();
    for (const std::string& note : rest->mesh().notes) loaded.notes.push_back(note);
    loaded.avatar = std::move(rest);
    return loaded;
}

} // namespace ars::app
