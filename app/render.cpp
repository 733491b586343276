#include "app/render.h"

#include "app/avatar_source.h"
#include "app/picture_writer.h"
#include "app/progress_bar.h"
#include "app/render_document.h"
#include "app/rig_source.h"
#include "app/text.h"
#include "engine/capture/calibration.h"
#include "engine/frame/framing.h"
#include "engine/frame/light_source.h"
#include "engine/rig/motion_import.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>

namespace ars::app {
namespace fs = std::filesystem;
namespace {

Error wrongUsage(std::string option, std::string message) {
    return makeError(ErrorCode::InvalidArgument, std::move(option), std::move(message));
}

/// Everything that is rendered, read and checked before the first frame.
struct RenderPlan {
    std::shared_ptr<AvatarEvaluator> avatar;
    RestAvatarOptions restOptions;
    PartRadii initialRadii = initialPartRadii(); ///< or learned
    Device device;
    Motion motion; ///< at least one frame
    std::size_t firstNumber = 0;
    bool animated = false;
    std::size_t frameCount = 1;
    Camera camera;
    std::optional<Bounds> orbitBounds; ///< set: the camera moves around them
    LightSource light;
    FrameInputs inputs; ///< but pose, camera and placement
    DisplaySettings display;
    std::vector<BufferId> buffers; ///< --aov
    PictureFormats formats;
    std::vector<std::string> notes;
};

Result<Motion> readPoses(const RenderOptions& options, const AvatarEvaluator& avatar, std::vector<std::string>& notes) {
    const std::string& path = options.motion.empty() ? options.pose : options.motion;
    MotionImportOptions import;
    import.skipLeadIn = !options.motion.empty(); // a single pose is named by its number in the file
    const auto up = parseUpAxis(options.up);
    if (!up) return atPlace(up.error(), "--up");
    import.up = *up;
    import.framesPerSecond = options.framesPerSecond;
    import.map = options.map == "auto" ? "" : options.map;
    import.soleHeightM = soleHeightM(avatar.mesh().mesh.positions);
    RetargetReport report;
    ARS_TRY(Motion motion, importMotion(path, avatar.rig().skeleton, import, &report));
    if (report.skippedFrames > 0) {
        notes.push_back(
            fmt::format("the motion begins with {} of rest pose, left out", counted(report.skippedFrames, "frame")));
    }
    FrameRange range{options.poseFrame, options.poseFrame + 1};
    if (!options.motion.empty()) {
        range = FrameRange{};
        if (!options.frames.empty()) {
            ARS_TRY(range, parseFrameRange(options.frames));
        }
    }
    if (const Status cut = cutFrames(motion, range); !cut) return atPlace(cut.error(), path);
    return motion;
}

/// Arms hanging a little away from the body, elbows slightly bent: how people stand when they are looked at.
Pose relaxedPose() {
    Pose pose = restPose(kSmplxJointCount);
    const auto turn = [&](const char* joint, const glm::vec3& axisAngle) {
        pose.rotations[static_cast<std::size_t>(smplxJointIndex(joint))] = quatFromAxisAngle(axisAngle);
    };
    turn("left_shoulder", {0.05f, 0.0f, -1.12f});
    turn("right_shoulder", {0.05f, 0.0f, 1.12f});
    turn("left_elbow", {0.0f, -0.22f, 0.0f});
    turn("right_elbow", {0.0f, 0.22f, 0.0f});
    return pose;
}

Status planPoses(const RenderOptions& options, RenderPlan& plan) {
    if (!options.pose.empty() && !options.motion.empty()) {
        return wrongUsage("--pose", "give either --pose (one frame) or --motion, not both");
    }
    if (options.motion.empty() && !options.frames.empty()) return wrongUsage("--frames", "needs --motion");
    if (!options.motion.empty() && options.poseFrame > 0) {
        return wrongUsage("--frame", fmt::format("is for --pose; of a motion say --frames {}:{}", options.poseFrame,
                                                 options.poseFrame + 1));
    }
    const int joints = plan.avatar->rig().skeleton.jointCount();
    if (options.motion.empty() && (options.pose.empty() || options.pose == "rest")) {
        plan.motion.frames.push_back(restPose(joints));
    } else if (options.motion.empty() && options.pose == "canonical") {
        plan.motion.frames.push_back(canonicalPose());
    } else if (options.motion.empty() && options.pose == "relaxed") {
        plan.motion.frames.push_back(relaxedPose());
    } else {
        ARS_TRY(plan.motion, readPoses(options, *plan.avatar, plan.notes));
    }
    plan.animated = !options.motion.empty();
    if (!options.frames.empty()) {
        ARS_TRY(const FrameRange range, parseFrameRange(options.frames));
        plan.firstNumber = range.first;
    }
    plan.frameCount = plan.motion.frames.size();
    // A still pose is looked at from all around, or in all lights.
    if (!plan.animated)
        plan.frameCount = static_cast<std::size_t>(std::max({1, options.orbit, options.environmentOrbit}));
    return {};
}

/// The space that the mesh takes in up to 24 frames of the motion.
Result<Bounds> motionBounds(const RenderPlan& plan) {
    std::vector<glm::vec3> corners;
    const std::size_t count = plan.motion.frames.size(), samples = std::min<std::size_t>(24, count);
    for (std::size_t i = 0; i < samples; ++i) {
        const std::size_t frame = samples > 1 ? i * (count - 1) / (samples - 1) : 0;
        ARS_TRY(const std::vector<glm::vec3> vertices, posedTemplate(plan.avatar->mesh(), plan.motion.frames[frame]));
        const Bounds bounds = boundsOf(vertices);
        corners.push_back(bounds.low);
        corners.push_back(bounds.high);
    }
    return boundsOf(corners);
}

Status planCamera(const RenderOptions& options, RenderPlan& plan) {
    std::optional<PictureSize> size;
    if (!options.size.empty()) {
        ARS_TRY(size, parseSize(options.size, "--size"));
    }
    if (!options.camera.empty()) {
        if (options.orbit > 0) return wrongUsage("--orbit", "give either --camera or --orbit, not both");
        ARS_TRY(const CalibratedCamera read, readCameraArgument(options.camera));
        if (read.distorted())
            plan.notes.push_back("the camera's lens distortion is not applied: pictures are undistorted");
        plan.camera = size ? resizedCamera(read.camera, size->width, size->height) : read.camera;
        return validateCamera(plan.camera, options.camera);
    }
    const PictureSize chosen = size.value_or(PictureSize{512, 512});
    ARS_TRY(plan.orbitBounds, motionBounds(plan));
    plan.camera = orbitCamera(*plan.orbitBounds, options.azimuthDeg, options.elevationDeg, options.fieldDeg,
                              chosen.width, chosen.height);
    return validateCamera(plan.camera);
}

Status planOutput(const RenderOptions& options, RenderPlan& plan) {
    if (!options.buffers.empty()) {
        auto buffers = parseBuffers(options.buffers);
        if (!buffers) return atPlace(buffers.error(), "--aov");
        plan.buffers = std::move(*buffers);
    }
    if (!options.formats.empty()) {
        ARS_TRY(plan.formats, parseFormats(options.formats));
        if ((plan.formats.exr || plan.formats.buffers) && plan.buffers.empty()) plan.buffers = {BufferId::Beauty};
        return {};
    }
    plan.formats.png = true;
    plan.formats.exr = !plan.buffers.empty();
    plan.formats.mp4 = plan.frameCount > 1;
    return {};
}

/// A word, a file, or the learned light of a trained avatar.
Result<LightSource> readPlannedLight(const RenderOptions& options, const Device& device,
                                     const ProgressFunction& progress) {
    const std::string& source = options.environment;
    if (!looksLikeTrainedAvatar(source)) {
        return readLightSource(source, device, LightQuality::Exact, options.lightSize, progress);
    }
    ARS_TRY(Environment learned, trainedAvatarLight(source));
    return filterLight(source, std::move(learned), device, LightQuality::Exact, options.lightSize, progress);
}

Result<RenderPlan> makePlan(const RenderOptions& options, ProgressBar& bar) {
    RenderPlan plan;
    ARS_TRY(plan.device, chooseDevice(options.frame.device));
    FrameOptions frame = options.frame;
    std::erase_if(frame.settings, isAvatarSetting);
    ARS_TRY_STATUS(applyFrameOptions(frame, plan.inputs));
    ARS_TRY(plan.display, displaySettings(options.display));
    if (options.display.transparent && options.display.backdrop) {
        return wrongUsage("--transparent", "a picture with the environment behind it is opaque; leave out --backdrop");
    }
    if (!(options.environmentScale >= 0.0) || !std::isfinite(options.environmentRotationDeg)) {
        return wrongUsage("--env-scale", "expected a factor of 0 or more");
    }
    ARS_TRY(LoadedAvatar loaded,
            loadAvatar(options.avatar, options.surfels, options.frame.settings, bar.part(0.0, 0.08)));
    plan.avatar = std::move(loaded.avatar);
    if (loaded.trained) { // what was asked for comes before what was learned
        plan.inputs.radii = plan.initialRadii = loaded.trained->radii;
        plan.inputs.splat = loaded.trained->splat;
        plan.inputs.posing = loaded.trained->posing;
        plan.inputs.occlusion.screenSpace = loaded.trained->occlusion;
        if (!loaded.trained->occluded) plan.inputs.occlusion.method = OcclusionMethod::Off;
        ARS_TRY_STATUS(applyFrameOptions(frame, plan.inputs));
    }
    plan.restOptions = loaded.options;
    plan.notes = std::move(loaded.notes);
    ARS_TRY_STATUS(planPoses(options, plan));
    ARS_TRY_STATUS(planCamera(options, plan));
    ARS_TRY_STATUS(planOutput(options, plan));
    auto light = readPlannedLight(options, plan.device, bar.part(0.08, 0.12));
    if (!light && light.error().code == ErrorCode::InvalidArgument) return atPlace(light.error(), "--env");
    if (!light) return std::move(light).error();
    plan.light = std::move(*light);
    for (const std::string& note : plan.light.environment.notes) plan.notes.push_back(note);
    return plan;
}

/// Pose, camera and light of a frame.
FrameInputs inputsOf(const RenderOptions& options, const RenderPlan& plan, std::size_t frame) {
    FrameInputs inputs = plan.inputs;
    inputs.pose = plan.motion.frames[std::min(frame, plan.motion.frames.size() - 1)];
    inputs.camera = plan.camera;
    const auto turn = [frame](int framesOfATurn) {
        return framesOfATurn > 0 ? 360.0 * static_cast<double>(frame) / framesOfATurn : 0.0;
    };
    if (plan.orbitBounds && options.orbit > 0) {
        inputs.camera = orbitCamera(*plan.orbitBounds, options.azimuthDeg + turn(options.orbit), options.elevationDeg,
                                    options.fieldDeg, plan.camera.width, plan.camera.height);
    }
    inputs.placement.scale = static_cast<float>(options.environmentScale);
    inputs.placement.rotationDeg =
        static_cast<float>(std::fmod(options.environmentRotationDeg + turn(options.environmentOrbit), 360.0));
    return inputs;
}

/// The session that shows frame `frame` of the rendering.
std::string documentOf(const RenderOptions& options, const RenderPlan& plan, const FrameInputs& inputs,
                       std::size_t frame) {
    RenderedFrame rendered;
    rendered.options = &options;
    rendered.rest = plan.restOptions;
    rendered.inputs = &inputs;
    rendered.initialRadii = plan.initialRadii;
    rendered.tone = plan.display.tone;
    rendered.skeleton = &plan.avatar->rig().skeleton;
    rendered.soleHeightM = soleHeightM(plan.avatar->mesh().mesh.positions);
    rendered.surfels = plan.avatar->rig().weights.pointCount();
    rendered.device = plan.device;
    rendered.lightQuality = plan.light.filtered->quality;
    rendered.motion = plan.animated ? &plan.motion : nullptr;
    rendered.frame = frame;
    rendered.number = plan.firstNumber + frame;
    return renderedDocument(rendered);
}

Result<RenderSummary> renderFrames(const RenderOptions& options, const RenderPlan& plan,
                                   const ProgressFunction& progress) {
    ARS_TRY(const std::unique_ptr<FramePipeline> pipeline, FramePipeline::create(plan.avatar, plan.device));
    pipeline->setLight(plan.light.filtered);
    pipeline->waitForTimings(true);
    std::vector<BufferId> wanted = plan.buffers;
    wanted.push_back(BufferId::Opacity);
    if (plan.formats.png || plan.formats.mp4) wanted.push_back(BufferId::Beauty);

    PictureWriter writer(options.out, plan.formats, plan.buffers);
    writer.framesPerSecond = plan.animated ? plan.motion.framesPerSecond : 30.0;
    WrittenFrame written;
    written.picture = [&](BufferId id) { return pipeline->picture(id); };
    written.shown = [&](BufferId id, bool backdrop) -> Result<Image> {
        ARS_TRY(Image picture, pipeline->picture(id));
        ARS_TRY(const Image opacity, pipeline->picture(BufferId::Opacity));
        const FrameInputs& inputs = pipeline->inputs();
        if (backdrop && options.display.backdrop)
            ARS_TRY_STATUS(addBackdrop(picture, inputs.camera, plan.light.environment, inputs.placement));
        return displayPicture(id, picture, opacity, plan.display);
    };
    RenderSummary summary;
    const auto begin = std::chrono::steady_clock::now();
    for (std::size_t i = 0; i < plan.frameCount; ++i) {
        ARS_TRY_STATUS(reportProgress(progress, static_cast<double>(i) / static_cast<double>(plan.frameCount),
                                      fmt::format("frame {} of {}", i + 1, plan.frameCount)));
        const FrameInputs inputs = inputsOf(options, plan, i);
        ARS_TRY_STATUS(pipeline->render(inputs, wanted));
        written.number = plan.firstNumber + i;
        written.document = documentOf(options, plan, inputs, i);
        if (i == 0) writer.filmDocument = written.document;
        ARS_TRY_STATUS(writer.add(written));
        for (const StageReport& stage : pipeline->stages()) {
            if (stage.ran) summary.stageMs[static_cast<std::size_t>(stage.stage)] += stage.milliseconds;
        }
    }
    ARS_TRY_STATUS(writer.finish());
    ARS_TRY_STATUS(reportProgress(progress, 1.0, "written"));
    summary.avatar = plan.avatar->description();
    summary.device = plan.device;
    summary.notes = plan.notes;
    summary.frames = plan.frameCount;
    summary.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    summary.files = writer.files();
    summary.memory = memoryUse();
    return summary;
}

void describe(const OutputOptions& output, const RenderSummary& summary) {
    if (output.json) {
        Json json{{"avatar", summary.avatar}, {"device", deviceName(summary.device)},
                  {"frames", summary.frames}, {"seconds", summary.seconds},
                  {"files", Json::array()},   {"stages_ms", Json::object()},
                  {"notes", summary.notes}};
        for (const fs::path& file : summary.files) json["files"].push_back(file.string());
        for (int i = 0; i < kFrameStageCount; ++i) {
            json["stages_ms"][std::string(frameStageName(static_cast<FrameStage>(i)))] =
                summary.stageMs[static_cast<std::size_t>(i)] / static_cast<double>(summary.frames);
        }
        json["memory"] = Json::array();
        for (const MemoryUse& use : summary.memory) {
            json["memory"].push_back(Json{{"owner", use.owner},
                                          {"device", deviceName(use.device)},
                                          {"bytes", use.bytes},
                                          {"peak_bytes", use.peakBytes}});
        }
        return printJson(json);
    }
    std::string stages;
    for (int i = 0; i < kFrameStageCount; ++i) {
        stages += fmt::format("{}{} {:.1f}", i ? ", " : "", frameStageName(static_cast<FrameStage>(i)),
                              summary.stageMs[static_cast<std::size_t>(i)] / static_cast<double>(summary.frames));
    }
    const bool measured = std::any_of(summary.stageMs.begin(), summary.stageMs.end(), [](double ms) { return ms > 0; });
    fmt::print("{}\n{} in {:.1f} s on {}{}\n", printable(summary.avatar), counted(summary.frames, "frame"),
               summary.seconds, deviceName(summary.device), measured ? fmt::format(" (ms a frame: {})", stages) : "");
    const std::vector<fs::path>& files = summary.files;
    if (!files.empty()) {
        fmt::print("{}{}\n", printable(files.front().string()),
                   files.size() > 1 ? fmt::format(" to {}, {}", printable(files.back().filename().string()),
                                                  counted(files.size(), "file"))
                                    : "");
    }
    for (const std::string& note : summary.notes) printNote(note, output);
}

Status render(const RenderOptions& options, ProgressBar& bar) {
    if (!options.project.empty()) {
        ARS_TRY(const RenderSummary shown, renderProject(options, bar.part(0.0, 1.0)));
        bar.clear();
        describe(options.output, shown);
        return {};
    }
    if (options.avatar.empty()) return wrongUsage("--avatar", "give an avatar, or a project with --project");
    ARS_TRY(const RenderPlan plan, makePlan(options, bar));
    ARS_TRY(const RenderSummary summary, renderFrames(options, plan, bar.part(0.12, 1.0)));
    bar.clear();
    describe(options.output, summary);
    return {};
}

} // namespace

int runRender(const RenderOptions& options) {
    offerTrainedAvatars();
    ProgressBar bar(options.output.quiet);
    const Status status = render(options, bar);
    bar.clear();
    return status.ok() ? kSuccess : reportError(status.error(), options.output);
}

int runTurntable(const OutputOptions& output) {
    RenderOptions options;
    options.avatar = "rest:open";
    options.orbit = 48;
    options.frame.settings = {"occlusion.adaptive=off"}; // a first look should not take a minute
    options.size = "480x640";
    options.environment = "studio";
    options.formats = "png,mp4";
    options.display.curve = "agx";
    options.display.background = "0.13,0.13,0.14";
    options.pose = "relaxed";
    options.out = "ars-turntable";
    options.output = output;
    if (!output.json) fmt::print("No window here: rendering a turntable of the open body into {}/\n", options.out);
    return runRender(options);
}

} // namespace ars::app
