#include "engine/core/file.h"
#include "engine/scene/run_folder.h"
#include "engine/scene/session_state.h"

#include <fmt/format.h>

#include <system_error>

namespace ars {
namespace fs = std::filesystem;
namespace {

std::string titleOf(const fs::path& path) { return "Opening " + shortName(path.string()); }
std::string failureOf(const fs::path& path) { return "Could not open " + shortName(path.string()); }

/// A capture is named by its folder, a calibration by its file. Told by the name: this thread asks no disk.
fs::path calibrationOf(const fs::path& path) {
    return path.extension() == ".json" ? path : path / "calibration_full.json";
}

/// Trained avatars are folders; files give a rest: avatar.
std::string avatarSourceOf(const fs::path& path) {
    std::error_code ignored;
    const bool trained = path.extension() == ".avatar" || fs::is_directory(path, ignored);
    return trained ? path.string() : "rest:" + path.string();
}

} // namespace

void Session::open(const fs::path& given) {
    const fs::path path = absolutePath(given);
    auto role = std::make_shared<FileRole>();
    JobRequest job;
    job.title = titleOf(path);
    job.work = [path, role](const ProgressFunction&) -> Status {
        ARS_TRY(*role, roleOf(path));
        return {};
    };
    job.done = [state = state_.get(), path, role](const Status& status) {
        if (status) return state->openAs(path, *role);
        if (status.error().code == ErrorCode::Cancelled) return;
        state->notify(failureNotice(failureOf(path), status.error()));
    };
    state_->jobs->start(std::move(job));
}

void Session::openAs(const fs::path& path, FileRole role) { state_->openAs(absolutePath(path), role); }

AssetStore::Opening Session::State::opening(const fs::path& path, std::function<Status()> edit) {
    AssetStore::Opening result;
    result.title = titleOf(path);
    result.accept = [this, path, edit = std::move(edit)] {
        endOfGesture();
        if (const Status status = edit(); !status) {
            notify(failureNotice(failureOf(path), status.error()));
            return false;
        }
        remember(path);
        return true;
    };
    result.fail = [this, path](const Error& error) {
        if (error.code == ErrorCode::Cancelled) {
            return notify(
                {Notice::Kind::Note, "Stopped opening " + shortName(path.string()), "Nothing was changed.", ""});
        }
        notify(failureNotice(failureOf(path), error));
    };
    return result;
}

void Session::State::openAs(const fs::path& path, FileRole role) {
    const std::string file = path.string();
    const Document& document = editor.document();
    switch (role) {
    case FileRole::Project:
    case FileRole::PictureOfOurs:
        return openProject(path, role);
    case FileRole::PoseFile:
        return openPose(path);
    case FileRole::Avatar:
        return openAvatar(path, avatarSourceOf(path));
    case FileRole::Run:
        return openRun(path);
    case FileRole::Light: {
        LightSection light = document.light;
        light.kind = LightKind::File;
        light.file = file;
        return store.openLight(light, opening(path, [this, path, file]() -> Status {
                                   ARS_TRY_STATUS(run("light.open", {{"file", file}}));
                                   tell(path, store.assets().light->source->environment.notes);
                                   return {};
                               }));
    }
    case FileRole::Clip:
        return store.openClip(file, opening(path, [this, path, file]() -> Status {
                                  stop();
                                  ARS_TRY_STATUS(run("timeline.open_clip", {{"file", file}}));
                                  tell(path, store.assets().clip->notes);
                                  return {};
                              }));
    case FileRole::Capture: {
        const std::string calibration = calibrationOf(path).string();
        return store.openCapture(calibration, opening(path, [this, calibration] { return enterCapture(calibration); }));
    }
    case FileRole::ComparePicture:
        return store.openPicture(file, "", opening(path, [this, file] { return enterComparison(file); }));
    }
}

void Session::State::openAvatar(const fs::path& path, const std::string& source) {
    AvatarSection avatar = editor.document().avatar;
    avatar.source = source;
    avatar.betas.clear(); // another person's
    store.openAvatar(avatar, opening(path, [this, path, source]() -> Status {
                         ARS_TRY_STATUS(enterAvatar(source));
                         tell(path, store.assets().avatar->notes);
                         return {};
                     }));
}

Status Session::State::enterAvatar(const std::string& source) {
    const std::optional<AvatarAsset::Trained>& trained = store.assets().avatar->trained;
    // The three lamps of a new project are nobody's choice yet.
    const bool untouched =
        !editor.canUndo() && !editor.canRedo() && projectPath.empty() && editor.document().light == newDocument().light;
    const std::string gesture = "open " + source;
    Status status = run("avatar.open", {{"source", source}}, gesture);
    if (status && untouched && trained && trained->hasLight) {
        status = run("light.open", {{"file", source}}, gesture);
    }
    if (!status) editor.cancelGesture();
    endOfGesture();
    return status;
}

bool Session::State::opensBeside(std::string_view command, const Arguments& arguments) const {
    if (command != "avatar.open" || !arguments.is_object() || arguments.size() != 1) return false;
    const auto found = arguments.find("source");
    if (found == arguments.end() || !found->is_string()) return false;
    const std::string source = *found;
    const auto& avatar = store.assets().avatar;
    return namesTrainedAvatar(source) && !(avatar && avatar->key == source);
}

void Session::State::openRun(const fs::path& path) {
    trainingRun = path;
    ++trainingRunsOpened;
    auto checkpoints = std::make_shared<std::size_t>(0);
    JobRequest job;
    job.title = titleOf(path);
    job.work = [path, checkpoints](const ProgressFunction&) -> Status {
        ARS_TRY(const std::vector<CheckpointEntry> found, listCheckpoints(path));
        *checkpoints = found.size();
        return {};
    };
    job.done = [this, path, checkpoints](const Status& status) {
        if (!status) return notify(failureNotice(failureOf(path), status.error()));
        if (*checkpoints > 0) return openAvatar(path, path.string());
        remember(path);
        notify({Notice::Kind::Note, shortName(path.string()),
                "This run has no complete checkpoint yet; the Training panel follows it.", ""});
    };
    jobs->start(std::move(job));
}

void Session::State::endOfGesture() {
    editor.endGesture();
    lastGesture.reset();
}

void Session::State::tell(const fs::path& path, const std::vector<std::string>& notes) {
    for (const std::string& note : notes) notify({Notice::Kind::Note, shortName(path.string()), note, ""});
}

void Session::State::remember(const fs::path& path) {
    JobRequest job; // the list is synced to disk, which may take a while
    job.title = "Remembering " + shortName(path.string());
    job.lane = "recent files";
    job.listed = false;
    job.work = [path, folder = options.stateFolder](const ProgressFunction&) {
        RecentFiles(folder).add(path);
        return Status();
    };
    job.done = [this](const Status&) { recentFiles = RecentFiles(options.stateFolder); };
    jobs->start(std::move(job));
}

Status Session::State::enterCapture(const std::string& calibration) {
    // One entry of the history: undo takes back both.
    const std::string gesture = "open " + calibration;
    Status status = run("camera.open_capture", {{"file", calibration}}, gesture);
    if (status) {
        const std::string first = store.assets().capture->cameras.front().name;
        status = run("camera.dataset", {{"name", first}}, gesture);
    }
    if (!status) editor.cancelGesture();
    endOfGesture();
    return status;
}

Status Session::State::enterComparison(const std::string& file) {
    const std::string gesture = "open " + file;
    Status status = run("compare.picture", {{"file", file}}, gesture);
    // A picture that is dropped is to be seen.
    if (status && !showsTwoSides(editor.document().view.layout)) {
        status = run("view.layout", {{"layout", "side_by_side"}}, gesture);
    }
    if (!status) editor.cancelGesture();
    endOfGesture();
    return status;
}

void Session::State::openProject(const fs::path& path, FileRole role) {
    struct Loaded {
        Document document;
        std::vector<std::string> notes;
    };
    auto loaded = std::make_shared<Loaded>();
    const bool project = role == FileRole::Project;
    JobRequest job;
    job.title = titleOf(path);
    job.work = [path, project, loaded](const ProgressFunction&) -> Status {
        ARS_TRY(loaded->document,
                project ? readProject(path, &loaded->notes) : documentFromPicture(path, &loaded->notes));
        return {};
    };
    job.done = [this, path, project, loaded](const Status& status) {
        if (!status && status.error().code == ErrorCode::Cancelled) return;
        if (!status) return notify(failureNotice(failureOf(path), status.error()));
        replace(std::move(loaded->document), project ? path : fs::path(), project);
        remember(path);
        tell(path, loaded->notes);
        if (!project) {
            notify({Notice::Kind::Note, "Restored from " + shortName(path.string()),
                    "The project that the picture was made from is open; it is not saved yet.", ""});
        }
    };
    jobs->start(std::move(job));
}

void Session::State::openPose(const fs::path& path) {
    auto text = std::make_shared<std::string>();
    JobRequest job;
    job.title = titleOf(path);
    job.work = [path, text](const ProgressFunction&) -> Status {
        ARS_TRY(*text, readTextFile(path));
        return {};
    };
    job.done = [this, path, text](const Status& status) {
        if (!status) return notify(failureNotice(failureOf(path), status.error()));
        endOfGesture();
        if (const Status applied = run("pose.apply", {{"pose", *text}}); !applied) {
            return notify(failureNotice(failureOf(path), atPlace(applied.error(), path.string())));
        }
        remember(path);
    };
    jobs->start(std::move(job));
}

} // namespace ars
