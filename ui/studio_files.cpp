#include "ui/studio_state.h"

#include "engine/rig/motion_import.h"
#include "engine/rig/posed_export.h"
#include "engine/scene/evaluate.h"

#include <algorithm>
#include <cmath>

namespace ars::ui {
namespace {

namespace fs = std::filesystem;

struct RoleWords {
    FileRole role;
    const char* title;
    const char* key;
    std::vector<std::string> endings;
};

const RoleWords& wordsOf(FileRole role) {
    static const std::vector<RoleWords> words = {
        {FileRole::Project, "Open project", "project", {".ars"}},
        {FileRole::Avatar, "Open avatar", "avatar", {".glb", ".gltf", ".npz", ".obj", ".ply"}},
        {FileRole::Light, "Open light", "light", {".exr", ".hdr", ".png", ".jpg"}},
        {FileRole::Clip, "Open motion", "motion", {".npz", ".npy", ".bvh", ".glb", ".gltf"}},
        {FileRole::PoseFile, "Open pose", "pose", {".json", ".npz", ".npy", ".bvh"}},
        {FileRole::Capture, "Open capture", "capture", {".json"}},
        {FileRole::ComparePicture, "Compare with picture", "picture", {".png", ".jpg", ".jpeg", ".exr", ".hdr"}},
        {FileRole::PictureOfOurs, "Restore from picture", "picture", {".png", ".exr", ".mp4"}},
        {FileRole::Run, "Open trained avatar or training run", "training runs", {}},
    };
    for (const RoleWords& row : words) {
        if (row.role == role) return row;
    }
    return words.front();
}

/// The motion of the timeline's range at its rate.
Motion timelineMotion(const Document& document, const SceneAssets& assets, const ProgressFunction& progress) {
    const TimelineSection& timeline = document.timeline;
    const double rate = std::clamp(timeline.framesPerSecond, kMinFramesPerSecond, kMaxFramesPerSecond);
    const auto count =
        static_cast<std::size_t>(std::max(0.0, std::floor((timeline.endS - timeline.startS) * rate + 0.5)));
    Motion motion;
    motion.name = "timeline";
    motion.framesPerSecond = rate;
    motion.betas = document.avatar.betas;
    motion.source = "smpl_params";
    for (std::size_t i = 0; i <= count; ++i) {
        if (progress && !progress(static_cast<double>(i) / static_cast<double>(count + 1), "evaluating poses")) break;
        motion.frames.push_back(poseAt(document, assets, timeline.startS + static_cast<double>(i) / rate));
    }
    return motion;
}

RiggedMesh riggedMesh(const AvatarEvaluator& evaluator) {
    const TemplateMesh& mesh = evaluator.mesh();
    RiggedMesh rig;
    rig.name = mesh.name;
    rig.skeleton = mesh.skeleton();
    rig.mesh = mesh.mesh;
    rig.weights = mesh.weights;
    rig.materials = mesh.materials;
    rig.images = mesh.images;
    rig.parts = evaluator.rig().parts;
    rig.isSmplx = true;
    return rig;
}

/// Asks where to write a file; endings as in FileQuestion.
void askSave(Studio& studio, const char* title, const char* folderKey, std::vector<std::string> endings,
             const std::string& suggestedName, std::function<void(const fs::path&)> chosen) {
    studio.ask({.title = title,
                .saving = true,
                .suggestedName = suggestedName,
                .endings = std::move(endings),
                .folderKey = folderKey,
                .chosen = std::move(chosen)});
}

} // namespace

void Studio::State::open(const fs::path& file) {
    std::error_code error;
    const fs::path path = fs::absolute(file, error);
    const Result<FileRole> role = Session::roleOf(path);
    const bool replaces = role && (*role == FileRole::Project || *role == FileRole::PictureOfOurs);
    if (role && *role == FileRole::Run) studio.setOpen("training", true);
    if (replaces)
        guardUnsaved("Open " + path.filename().string(), [this, path] { session.open(path); });
    else
        session.open(path); // what it is not, its notice says
}

void Studio::State::openAs(const fs::path& file, FileRole role) {
    const bool replaces = role == FileRole::Project || role == FileRole::PictureOfOurs;
    if (replaces)
        guardUnsaved("Open " + file.filename().string(), [this, file, role] { session.openAs(file, role); });
    else
        session.openAs(file, role);
}

void Studio::State::askOpen() {
    studio.ask({.title = "Open", .folderKey = "open", .chosen = [this](const fs::path& file) { open(file); }});
}

void Studio::State::askOpenAs(FileRole role) {
    const RoleWords& words = wordsOf(role);
    const bool folder = role == FileRole::Run; // its contents tell an avatar from a run
    studio.ask({.title = words.title,
                .endings = words.endings,
                .folderKey = words.key,
                .chosen = [this, role, folder](const fs::path& file) { folder ? open(file) : openAs(file, role); },
                .folder = folder});
}

void Studio::State::save(std::function<void()> then) {
    if (session.projectPath().empty()) {
        saveAs(std::move(then));
        return;
    }
    session.save(session.projectPath());
    waitForSave(std::move(then));
}

void Studio::State::saveAs(std::function<void()> then) {
    askSave(studio, "Save project", "project", {".ars"},
            session.projectPath().empty() ? "untitled.ars" : session.projectPath().filename().string(),
            [this, then = std::move(then)](const fs::path& file) {
                session.save(file);
                waitForSave(then);
            });
}

void Studio::State::waitForSave(std::function<void()> then) { afterSave = std::move(then); }

/// Goes on with what waited for a save; forgets it where the save failed.
void Studio::State::checkSaved() {
    if (!afterSave) return;
    if (!session.editor().modified()) {
        const std::function<void()> then = std::move(afterSave);
        afterSave = nullptr;
        then();
    } else if (session.jobs().empty()) {
        afterSave = nullptr;
    }
}

void Studio::State::exportPose() {
    askSave(studio, "Export pose", "export", {".npz"}, "pose.npz", [this](const fs::path& file) {
        const Document document = session.document();
        Motion motion;
        motion.name = "pose";
        motion.framesPerSecond = document.timeline.framesPerSecond;
        motion.betas = document.avatar.betas;
        motion.frames.push_back(poseAt(document, session.assets(), session.timeS()));
        session.start("Exporting " + file.filename().string(),
                      [motion, file](const ProgressFunction&) { return writeSmplParams(file, motion); });
    });
}

void Studio::State::exportClip(const std::string& ending) {
    askSave(studio, ending == ".bvh" ? "Export motion as BVH" : "Export motion", "export", {ending}, "motion" + ending,
            [this, ending](const fs::path& file) {
                const auto document = std::make_shared<const Document>(session.document());
                const SceneAssets assets = session.assets();
                session.start("Exporting " + file.filename().string(),
                              [document, assets, file, ending](const ProgressFunction& progress) -> Status {
                                  const Motion motion = timelineMotion(*document, assets, progress);
                                  ARS_TRY_STATUS(reportProgress(progress, 0.95, "writing the motion"));
                                  if (ending != ".bvh") return writeSmplParams(file, motion);
                                  if (!assets.avatar)
                                      return makeError(ErrorCode::NotFound, "export", "no avatar is open");
                                  return writeMotionBvh(file, motion, assets.avatar->evaluator->rig().skeleton);
                              });
            });
}

void Studio::State::exportGltf() {
    askSave(studio, "Export posed avatar", "export", {".glb"}, "avatar.glb", [this](const fs::path& file) {
        const std::shared_ptr<const AvatarAsset> avatar = session.assets().avatar;
        if (!avatar) {
            studio.showError("Nothing to export", "No avatar is open yet.");
            return;
        }
        const Pose pose = poseAt(session.document(), session.assets(), session.timeS());
        session.start("Exporting " + file.filename().string(), [avatar, pose, file](const ProgressFunction&) {
            return exportPosed(file, riggedMesh(*avatar->evaluator), pose);
        });
    });
}

void Studio::State::screenshot() {
    askSave(studio, "Save screenshot", "picture_out", {".png", ".exr"}, "screenshot.png", [this](const fs::path& file) {
        ScreenshotOptions options;
        options.file = file;
        if (const std::shared_ptr<const Frame> frame = session.frame();
            frame && frame->quality != FrameQuality::Draft) {
            options.width = frame->inputs.camera.width;
            options.height = frame->inputs.camera.height;
        }
        session.screenshot(options);
    });
}

void Studio::State::film() {
    askSave(studio, "Save film", "picture_out", {".mp4"}, "film.mp4", [this](const fs::path& file) {
        VideoOptions options;
        options.file = file;
        session.video(options);
    });
}

} // namespace ars::ui
