#include "engine/scene/trained_avatar.h"

#include "engine/core/standard_exception.h"
#include "engine/scene/run_folder.h"

#include <fmt/format.h>

#include <exception>
#include <mutex>
#include <new>
#include <system_error>

namespace ars {
namespace fs = std::filesystem;
namespace {

constexpr const char* kAvatarFile = "avatar.json";
constexpr const char* kLightFile = "light.exr";

struct Hook {
    std::mutex mutex;
    TrainedAvatarOpener opener;
};

Hook& hook() {
    static Hook made;
    return made;
}

Result<OpenedTrainedAvatar> guarded(const TrainedAvatarOpener& opener, const fs::path& folder, bool project) {
    try {
        auto opened = opener(folder, project);
        if (!opened && opened.error().place.empty()) return atPlace(opened.error(), folder.string());
        if (opened && !opened->evaluator) {
            return makeError(ErrorCode::Internal, folder.string(), "the avatar was opened without its networks");
        }
        return opened;
    } catch (const std::bad_alloc&) {
        return makeError(ErrorCode::OutOfMemory, folder.string(), "not enough memory for the networks");
    } catch (const std::exception& error) {
        return errorOfStandardException(error, folder.string());
    }
}

bool isThere(const fs::path& path) {
    std::error_code ignored;
    return fs::exists(path, ignored);
}

} // namespace

void setTrainedAvatarOpener(TrainedAvatarOpener opener) {
    const std::lock_guard lock(hook().mutex);
    hook().opener = std::move(opener);
}

bool namesTrainedAvatar(std::string_view source) {
    return source.substr(0, 5) != "rest:" && fs::path(source).is_absolute();
}

bool looksLikeTrainedAvatar(const fs::path& folder) {
    std::error_code ignored;
    if (!fs::is_directory(folder, ignored)) return false;
    return isThere(folder / kAvatarFile) || looksLikeRunFolder(folder);
}

Result<fs::path> trainedAvatarFolder(const fs::path& source) {
    if (!isThere(source)) {
        return makeError(ErrorCode::NotFound, source.string(), "there is no such avatar or training run");
    }
    if (isThere(source / kAvatarFile)) return source;
    if (!looksLikeRunFolder(source)) {
        return makeError(ErrorCode::Unsupported, source.string(),
                         "expected a trained avatar (avatar.json), a training run or one of its checkpoints, found "
                         "none of them");
    }
    ARS_TRY(const std::vector<CheckpointEntry> checkpoints, listCheckpoints(source));
    if (checkpoints.empty()) {
        return makeError(ErrorCode::NotFound, source.string(), "this run has no complete checkpoint yet");
    }
    return checkpoints.back().folder;
}

Result<OpenedTrainedAvatar> openTrainedAvatar(const fs::path& source, bool project) {
    TrainedAvatarOpener opener;
    {
        const std::lock_guard lock(hook().mutex);
        opener = hook().opener;
    }
    return openTrainedAvatar(source, project, opener);
}

Result<OpenedTrainedAvatar> openTrainedAvatar(const fs::path& source, bool project, const TrainedAvatarOpener& opener) {
    ARS_TRY(const fs::path folder, trainedAvatarFolder(source));
    if (!opener) {
        return makeError(ErrorCode::Unavailable, source.string(),
                         "trained avatars need LibTorch, which this program was built without");
    }
    auto opened = guarded(opener, folder, project);
    if (opened) return opened;
    // A run that goes on may have pruned the checkpoint while it was read.
    const auto newest = trainedAvatarFolder(source);
    if (!newest || *newest == folder) return opened;
    return guarded(opener, *newest, project);
}

Result<Environment> trainedAvatarLight(const fs::path& source) {
    ARS_TRY(const fs::path folder, trainedAvatarFolder(source));
    if (isThere(folder / kLightFile)) return readEnvironment(folder / kLightFile);
    ARS_TRY(const OpenedTrainedAvatar opened, openTrainedAvatar(source));
    if (!opened.light) return makeError(ErrorCode::NotFound, source.string(), "this avatar has learned no light");
    Environment environment;
    // Four pixels to a face's texel at the horizon, as environmentFromImage makes them of cubes.
    ARS_TRY(environment.picture, latLongFromCube(*opened.light, 4 * opened.light->size, 2 * opened.light->size));
    return environment;
}

} // namespace ars
