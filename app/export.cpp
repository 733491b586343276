#include "app/export.h"

#include "app/interrupt.h"
#include "app/model_loader.h"
#include "app/progress_bar.h"
#include "app/rig_source.h"
#include "app/text.h"
#include "engine/core/file.h"
#include "engine/rig/posed_export.h"
#include "engine/rig/template_mesh.h"

#include <fmt/format.h>

#include <unistd.h>

#include <cstdio>

namespace ars::app {
namespace fs = std::filesystem;
namespace {

Error wrongUsage(std::string option, std::string message) {
    return makeError(ErrorCode::InvalidArgument, std::move(option), std::move(message));
}

/// What is exported: a body with all its deformations, or a rig (a template or any skinned glTF).
struct Subject {
    std::optional<BodyModel> body;
    BodyShape shape;
    RiggedMesh rig; ///< of the body too: what a glb holds

    bool isSmplx() const { return rig.isSmplx; }
};

/// The poses to write; `numbers` are what a numbered file is called by.
struct Poses {
    Motion motion;
    std::size_t firstNumber = 0;
    bool animated = false; ///< from --motion: a glb gets an animation
    std::optional<RetargetReport> retarget;
};

Status checkCombination(const ExportOptions& options) {
    if (!options.pose.empty() && !options.motion.empty()) {
        return wrongUsage("--pose", "give either --pose (one frame) or --motion, not both");
    }
    if (options.motion.empty() && (!options.frames.empty() || options.framesPerSecond != 0.0)) {
        return wrongUsage(options.frames.empty() ? "--fps" : "--frames", "needs --motion");
    }
    return {};
}

Result<Subject> loadTemplateSubject(const ExportOptions& options, Subject subject, const ProgressFunction& progress) {
    const fs::path path = options.templateFile;
    ARS_TRY(const std::vector<std::byte> head, readFileHead(path, 64));
    // A rig of its own joints is no avatar template, but it can be looked at and converted in its rest pose.
    const MotionFormat format = recogniseMotion(head);
    if (format == MotionFormat::Gltf) {
        auto rig = readGltfRig(path);
        if (rig) {
            subject.rig = std::move(*rig);
            return subject;
        }
        if (rig.error().code != ErrorCode::Unsupported) return std::move(rig).error();
    }
    ARS_TRY(const BodyModel body, loadBody(options.body.empty() ? "open" : options.body));
    ARS_TRY(const TemplateMesh mesh, readTemplate(path, body, subject.shape, {}, progress));
    subject.rig = rigFromTemplate(mesh);
    for (const std::string& note : mesh.notes) subject.rig.notes.push_back(note);
    return subject;
}

Result<Subject> loadSubject(const ExportOptions& options, const std::vector<float>& motionBetas,
                            const ProgressFunction& progress) {
    Subject subject;
    if (options.betas == "motion") {
        subject.shape.betas = motionBetas;
    } else {
        ARS_TRY(subject.shape.betas, parseNumbers(options.betas, "--betas"));
    }
    ARS_TRY(subject.shape.expression, parseNumbers(options.expression, "--expression"));
    if (!options.templateFile.empty()) return loadTemplateSubject(options, std::move(subject), progress);
    ARS_TRY(BodyModel body, loadBody(options.body.empty() ? "open" : options.body));
    const auto tooMany = [](std::size_t given, int has, const char* option) -> Status {
        if (given <= static_cast<std::size_t>(has)) return {};
        return wrongUsage(option, fmt::format("{} given, the body has {}", counted(given, "coefficient"), has));
    };
    if (options.betas != "motion") ARS_TRY_STATUS(tooMany(subject.shape.betas.size(), body.shapeCount, "--betas"));
    ARS_TRY_STATUS(tooMany(subject.shape.expression.size(), body.expressionCount, "--expression"));
    subject.rig = rigFromTemplate(templateFromBody(body, subject.shape));
    subject.body = std::move(body);
    return subject;
}

MotionImportOptions importOptions(const ExportOptions& options, UpAxis up, const Subject& subject) {
    MotionImportOptions import;
    // A pose is named by its number in the file.
    import.skipLeadIn = !options.motion.empty();
    import.up = up;
    import.framesPerSecond = options.framesPerSecond;
    import.map = options.map == "auto" ? "" : options.map;
    import.soleHeightM = soleHeightM(subject.rig.mesh.positions);
    return import;
}

/// A motion file on the subject's own skeleton.
Result<Motion> loadMotion(const std::string& path, const ExportOptions& options, const Subject& subject,
                          RetargetReport& report) {
    if (!subject.isSmplx()) {
        return makeError(ErrorCode::Unsupported, options.templateFile,
                         "motions need a skeleton with the 55 SMPL-X joints; this rig has joints of its own and can be "
                         "exported in its rest pose only");
    }
    const auto up = parseUpAxis(options.up);
    if (!up) return atPlace(up.error(), "--up");
    return importMotion(path, subject.rig.skeleton, importOptions(options, *up, subject), &report);
}

Motion singlePose(Pose pose, std::string name) {
    Motion motion;
    motion.name = std::move(name);
    motion.frames.push_back(std::move(pose));
    return motion;
}

Result<Poses> loadPoses(const ExportOptions& options, const Subject& subject) {
    Poses poses;
    RetargetReport report;
    if (!options.motion.empty()) {
        FrameRange range;
        if (!options.frames.empty()) {
            ARS_TRY(range, parseFrameRange(options.frames));
        }
        ARS_TRY(poses.motion, loadMotion(options.motion, options, subject, report));
        if (const Status cut = cutFrames(poses.motion, range); !cut) return atPlace(cut.error(), options.motion);
        poses.firstNumber = range.first;
        poses.animated = true;
    } else if (options.pose.empty() || options.pose == "rest") {
        poses.motion = singlePose(restPose(subject.rig.skeleton.jointCount()), "rest");
    } else if (options.pose == "canonical") {
        if (!subject.isSmplx())
            return wrongUsage("--pose", "the canonical pose needs the 55 SMPL-X joints, this rig has its own");
        poses.motion = singlePose(canonicalPose(), "canonical");
    } else {
        ARS_TRY(poses.motion, loadMotion(options.pose, options, subject, report));
        const FrameRange one{options.frame, options.frame + 1};
        if (const Status cut = cutFrames(poses.motion, one); !cut) return atPlace(cut.error(), options.pose);
    }
    if (!report.mapName.empty()) poses.retarget = std::move(report);
    return poses;
}

PosedMesh posedBodyOf(const Subject& subject, const Pose& pose) { return poseBody(*subject.body, subject.shape, pose); }

Status writeFrame(const fs::path& path, PosedFormat format, const Subject& subject, const Pose& pose) {
    if (subject.body) return writePosedMesh(path, format, posedBodyOf(subject, pose));
    ARS_TRY(const PosedMesh posed, poseRig(subject.rig, pose));
    return writePosedMesh(path, format, posed, subject.rig.materials, subject.rig.images);
}

/// "walk.obj" -> "walk_0012.obj"
fs::path numbered(const fs::path& out, std::size_t number) {
    fs::path path = out;
    path.replace_filename(fmt::format("{}_{:04}{}", out.stem().string(), number, out.extension().string()));
    return path;
}

/// A folder for files that become visible all together; whatever is left in it is removed at the end.
class StagingFolder {
public:
    static Result<StagingFolder> create(const fs::path& out) {
        StagingFolder folder;
        folder.path_ = out.parent_path() / fmt::format(".{}.partial-{}", out.filename().string(), ::getpid());
        std::error_code failure;
        fs::create_directories(folder.path_, failure);
        if (failure) {
            folder.path_.clear();
            return makeError(ErrorCode::Io, out.string(), fmt::format("cannot be written: {}", failure.message()));
        }
        return folder;
    }
    StagingFolder(StagingFolder&& other) noexcept : path_(std::exchange(other.path_, {})) {}
    StagingFolder& operator=(StagingFolder&&) = delete;
    ~StagingFolder() {
        std::error_code ignored;
        if (!path_.empty()) fs::remove_all(path_, ignored);
    }
    const fs::path& path() const { return path_; }

private:
    StagingFolder() = default;
    fs::path path_;
};

/// Numbered files, all or none.
Result<std::vector<fs::path>> writeSequence(const fs::path& out, PosedFormat format, const Subject& subject,
                                            const Poses& poses, const ProgressFunction& progress) {
    ARS_TRY(const StagingFolder staging, StagingFolder::create(out));
    std::vector<fs::path> files;
    const std::size_t count = poses.motion.frames.size();
    for (std::size_t i = 0; i < count; ++i) {
        ARS_TRY_STATUS(reportProgress(progress, static_cast<double>(i) / static_cast<double>(count), "writing frames"));
        files.push_back(numbered(out, poses.firstNumber + i));
        ARS_TRY_STATUS(writeFrame(staging.path() / files.back().filename(), format, subject, poses.motion.frames[i]));
    }
    ARS_TRY_STATUS(reportProgress(progress, 1.0, "writing frames"));
    for (const fs::path& file : files) {
        std::error_code failure;
        fs::rename(staging.path() / file.filename(), file, failure);
        if (failure)
            return makeError(ErrorCode::Io, file.string(), fmt::format("cannot be written: {}", failure.message()));
    }
    return files;
}

Result<std::vector<fs::path>> writeGlbOf(const fs::path& out, const Subject& subject, const Poses& poses,
                                         const ProgressFunction& progress) {
    ARS_TRY_STATUS(reportProgress(progress, 0.0, "writing glb"));
    const bool rest = !poses.animated && poses.motion.name == "rest";
    ARS_TRY_STATUS(writeRiggedGlb(out, subject.rig, rest ? nullptr : &poses.motion));
    return std::vector<fs::path>{out};
}

Result<std::vector<fs::path>> writeAll(const ExportOptions& options, PosedFormat format, const Subject& subject,
                                       const Poses& poses, const ProgressFunction& progress) {
    const fs::path out = options.out;
    if (format == PosedFormat::Glb) return writeGlbOf(out, subject, poses, progress);
    if (poses.motion.frames.size() > 1) return writeSequence(out, format, subject, poses, progress);
    ARS_TRY_STATUS(reportProgress(progress, 0.0, "writing the mesh"));
    ARS_TRY_STATUS(writeFrame(out, format, subject, poses.motion.frames.front()));
    return std::vector<fs::path>{out};
}

void describeExport(const ExportOptions& options, PosedFormat format, const Subject& subject, const Poses& poses,
                    const std::vector<fs::path>& files) {
    std::vector<std::string> notes = subject.rig.notes;
    if (format == PosedFormat::Glb && subject.body && !subject.body->poseDirs.empty()) {
        notes.push_back("a glb holds skinning only: the body's pose blend shapes are left out");
    }
    if (!options.templateFile.empty() && (!options.betas.empty() || !options.expression.empty())) {
        notes.push_back("shape and expression act on the body that gives weights, not on the template itself");
    }
    if (poses.retarget && poses.retarget->skippedFrames > 0) {
        notes.push_back(fmt::format("the motion begins with {} of rest pose, left out",
                                    counted(poses.retarget->skippedFrames, "frame")));
    }
    const TriangleMesh& mesh = subject.rig.mesh;
    if (options.output.json) {
        Json json{{"files", Json::array()},
                  {"frames", poses.motion.frames.size()},
                  {"vertices", mesh.positions.size()},
                  {"triangles", mesh.triangles.size()},
                  {"joints", subject.rig.skeleton.jointCount()},
                  {"notes", notes}};
        for (const fs::path& file : files) json["files"].push_back(file.string());
        if (poses.animated) json["frames_per_second"] = poses.motion.framesPerSecond;
        if (poses.retarget) json["joint_map"] = poses.retarget->mapName;
        return printJson(json);
    }
    const std::string what =
        fmt::format("{} vertices, {} triangles", grouped(mesh.positions.size()), grouped(mesh.triangles.size()));
    const std::string where = files.size() == 1
                                  ? files[0].string()
                                  : fmt::format("{} to {}", files.front().string(), files.back().filename().string());
    std::string time = poses.animated ? fmt::format(", {} at {:g} fps", counted(poses.motion.frames.size(), "frame"),
                                                    poses.motion.framesPerSecond)
                                      : "";
    fmt::print("{}: {}{}\n", printable(where), what, time);
    for (const std::string& note : notes) printNote(note, options.output);
}

Status exportSubject(const ExportOptions& options, ProgressBar& bar) {
    ARS_TRY_STATUS(checkCombination(options));
    const auto format = posedFormatFor(options.out);
    if (!format) return atPlace(format.error(), "--out");
    std::vector<float> motionBetas;
    if (options.betas == "motion") {
        const std::string& source = options.motion.empty() ? options.pose : options.motion;
        if (source.empty() || source == "rest" || source == "canonical")
            return wrongUsage("--betas", "\"motion\" needs a motion file");
        ARS_TRY(const Motion shaped, readMotionNpz(source));
        motionBetas = shaped.betas;
    }
    ARS_TRY(const Subject subject, loadSubject(options, motionBetas, bar.part(0.0, 0.5)));
    ARS_TRY_STATUS(reportProgress(bar.function(), 0.5, "reading the motion"));
    ARS_TRY(const Poses poses, loadPoses(options, subject));
    ARS_TRY(const std::vector<fs::path> files, writeAll(options, *format, subject, poses, bar.part(0.5, 1.0)));
    bar.clear();
    describeExport(options, *format, subject, poses, files);
    return {};
}

Status checkAvatarOptions(const ExportOptions& options) {
    for (const auto& [option, value] : {std::pair{"--body", options.body},
                                        {"--template", options.templateFile},
                                        {"--betas", options.betas},
                                        {"--expression", options.expression},
                                        {"--pose", options.pose},
                                        {"--motion", options.motion},
                                        {"--frames", options.frames}}) {
        if (!value.empty()) return wrongUsage(option, "is for meshes; --avatar writes the avatar as it is");
    }
    fs::path name = options.out;
    if (!name.has_filename()) name = name.parent_path();
    if (name.extension() != ".avatar" || name.stem().empty()) {
        return wrongUsage("--out",
                          fmt::format("expected NAME.avatar for an avatar, found \"{}\"", printable(options.out)));
    }
    return {};
}

/// What a training learned, as a folder of its own.
Status exportTrainedAvatar(const ExportOptions& options, ProgressBar& bar) {
    ARS_TRY_STATUS(checkAvatarOptions(options));
    ARS_TRY_STATUS(reportProgress(bar.function(), 0.0, "reading the avatar"));
    ARS_TRY(ModelPlugin* const model, loadModel());
    ARS_TRY_STATUS(model->exportAvatar(options.avatar, options.out));
    bar.clear();
    if (options.output.json) {
        printJson({{"avatar", options.out}});
    } else {
        fmt::print("{}\n", printable(options.out));
    }
    return {};
}

} // namespace

int runExport(const ExportOptions& options) {
    ProgressBar bar(options.output.quiet);
    const Status status = options.avatar.empty() ? exportSubject(options, bar) : exportTrainedAvatar(options, bar);
    bar.clear();
    return status.ok() ? kSuccess : reportError(status.error(), options.output);
}

} // namespace ars::app
