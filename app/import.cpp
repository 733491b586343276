#include "app/import.h"

#include "app/interrupt.h"
#include "app/progress_bar.h"
#include "app/rig_source.h"
#include "app/text.h"
#include "engine/io/text_scanner.h"
#include "engine/rig/motion_import.h"

#include <fmt/format.h>

#include <filesystem>

namespace ars::app {
namespace fs = std::filesystem;
namespace {

enum class MotionOutput { SmplParams, Bvh };

Result<MotionOutput> outputFor(const std::string& out) {
    const std::string extension = fs::path(out).extension().string();
    if (equalIgnoringCase(extension, ".npz")) return MotionOutput::SmplParams;
    if (equalIgnoringCase(extension, ".bvh")) return MotionOutput::Bvh;
    return makeError(ErrorCode::InvalidArgument, "--out",
                     fmt::format("expected a name that ends with .npz or .bvh, found \"{}\"", printable(out)));
}

Result<FloorPlacement> floorFor(const std::string& name) {
    if (name == "auto") return FloorPlacement::Auto;
    if (name == "keep") return FloorPlacement::Keep;
    if (name == "place") return FloorPlacement::Place;
    return makeError(ErrorCode::InvalidArgument, "--floor",
                     fmt::format("expected auto, keep or place, found \"{}\"", printable(name)));
}

Result<MotionImportOptions> motionOptions(const ImportOptions& options, std::span<const glm::vec3> vertices) {
    MotionImportOptions result;
    const auto up = parseUpAxis(options.up);
    if (!up) return atPlace(up.error(), "--up");
    result.up = *up;
    ARS_TRY(result.floor, floorFor(options.floor));
    result.framesPerSecond = options.framesPerSecond;
    result.metresPerUnit = options.metresPerUnit;
    result.startAtOrigin = !options.keepPosition;
    result.skipLeadIn = !options.keepLeadIn;
    result.soleHeightM = soleHeightM(vertices);
    result.map = options.map == "auto" ? "" : options.map;
    result.animation = options.animation;
    return result;
}

Json retargetJson(const RetargetReport& report) {
    return {{"joint_map", report.mapName},
            {"joints", report.mappedJoints},
            {"body_joints", report.mappedBodyJoints},
            {"missing", report.missing},
            {"unused", report.unused},
            {"up", upAxisName(report.up)},
            {"metres_per_unit", report.metresPerUnit},
            {"floor_shift", report.floorShiftM},
            {"skipped_frames", report.skippedFrames},
            {"first_frame_is_rest", report.firstFrameIsRest}};
}

void describeRetarget(const RetargetReport& report) {
    fmt::print("  joint map  {}: {} of {} joints, {} of 22 body joints\n", printable(report.mapName),
               report.mappedJoints, kSmplxJointCount, report.mappedBodyJoints);
    std::vector<std::string> missingBody;
    for (const std::string& name : report.missing) {
        if (smplxJointIndex(name) < 22) missingBody.push_back(name);
    }
    if (!missingBody.empty()) fmt::print("  missing    {}\n", listed(missingBody));
    if (!report.unused.empty()) fmt::print("  unused     {}\n", printable(listed(report.unused)));
    fmt::print("  axes       up is {}, one unit is {:.4g} m, moved by {:+.3f} m onto the floor\n",
               upAxisName(report.up), report.metresPerUnit, report.floorShiftM);
    if (report.skippedFrames > 0) {
        fmt::print("  lead-in    {} of rest pose dropped (--keep-lead-in keeps it)\n",
                   counted(report.skippedFrames, "frame"));
    }
    if (report.firstFrameIsRest)
        fmt::print("  rest pose  taken from the first frame: the file's own is no standing person\n");
}

void describeImport(const ImportOptions& options, const Motion& motion, const RetargetReport& report) {
    const bool moved = !report.mapName.empty();
    if (options.output.json) {
        Json json{{"file", options.out},
                  {"source", motion.source},
                  {"frames", motion.frames.size()},
                  {"frames_per_second", motion.framesPerSecond},
                  {"duration", motion.durationS()}};
        if (moved) json.update(retargetJson(report));
        return printJson(json);
    }
    fmt::print("{}: {} at {:g} fps, {:.2f} s, from {}\n", printable(options.out),
               counted(motion.frames.size(), "frame"), motion.framesPerSecond, motion.durationS(), motion.source);
    if (moved) describeRetarget(report);
}

Status importFile(const ImportOptions& options, ProgressBar& bar) {
    const ProgressFunction progress = bar.function();
    ARS_TRY(const MotionOutput output, outputFor(options.out));
    FrameRange range;
    if (!options.frames.empty()) {
        ARS_TRY(range, parseFrameRange(options.frames));
    }
    ARS_TRY_STATUS(reportProgress(progress, 0.0, "reading the body"));
    ARS_TRY(const BodyModel body, loadBody(options.body));
    const Skeleton skeleton = bodySkeleton(body, {});
    ARS_TRY(const MotionImportOptions import, motionOptions(options, body.templateVertices));
    ARS_TRY_STATUS(reportProgress(progress, 0.2, "reading the motion"));
    RetargetReport report;
    ARS_TRY(Motion motion, importMotion(options.motion, skeleton, import, &report));
    if (const Status cut = cutFrames(motion, range); !cut) return atPlace(cut.error(), options.motion);
    ARS_TRY_STATUS(reportProgress(progress, 0.8, "writing the motion"));
    if (output == MotionOutput::Bvh) {
        ARS_TRY_STATUS(writeMotionBvh(options.out, motion, skeleton));
    } else {
        ARS_TRY_STATUS(writeSmplParams(options.out, motion));
    }
    bar.clear();
    describeImport(options, motion, report);
    return {};
}

} // namespace

int runImport(const ImportOptions& options) {
    ProgressBar bar(options.output.quiet);
    const Status status = importFile(options, bar);
    bar.clear();
    return status.ok() ? kSuccess : reportError(status.error(), options.output);
}

} // namespace ars::app
