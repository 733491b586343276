#include "app/inspect.h"
#include "app/text.h"
#include "engine/io/bvh.h"
#include "engine/rig/body_model.h"
#include "engine/rig/retarget.h"

#include <algorithm>

namespace ars::app {
namespace {

/// How well the motion fits a SMPL-X body: one frame is transferred, which tells joints, axes and scale.
Result<RetargetReport> tryTransfer(const BvhFile& file, const ReadLimits& limits) {
    BvhFile first = file;
    first.frameCount = 1;
    first.values.resize(first.channelCount);
    ARS_TRY(const SourceClip clip, clipFromBvh(first, limits));
    ARS_TRY(const std::vector<RetargetMap> maps, readRetargetMaps());
    ARS_TRY(const RetargetMap map, chooseRetargetMap(clip.skeleton, maps));
    ARS_TRY(const BodyModel body, readOpenBody());
    RetargetReport report;
    ARS_TRY([[maybe_unused]] const Motion motion, retarget(clip, map, bodySkeleton(body, {}), {}, &report));
    return report;
}

void addTransfer(FileReport& report, const BvhFile& file, const InspectOptions& options) {
    const auto transfer = tryTransfer(file, options.limits);
    if (!transfer && transfer.error().place == "resources") {
        return report.warn(fmt::format("no joint map was tried: {}", transfer.error().message));
    }
    if (!transfer) {
        report.add("joint_map", "none fits", Json());
        report.warn(fmt::format("it cannot be moved onto a SMPL-X body as it is: {}", transfer.error().describe()));
        return;
    }
    report.add("joint_map",
               fmt::format("{}: {} of 55 joints, {} of 22 body joints", transfer->mapName, transfer->mappedJoints,
                           transfer->mappedBodyJoints),
               Json{{"name", transfer->mapName},
                    {"joints", transfer->mappedJoints},
                    {"body_joints", transfer->mappedBodyJoints},
                    {"missing", transfer->missing},
                    {"unused", transfer->unused}});
    report.add("up", fmt::format("{}, one unit is {:.4g} m", upAxisName(transfer->up), transfer->metresPerUnit),
               upAxisName(transfer->up));
    report.add("metres_per_unit", "", transfer->metresPerUnit);
}

} // namespace

void inspectBvh(FileReport& report, const InspectOptions& options) {
    report.kind = "motion";
    report.title = "BVH motion";
    if (options.fast) return;
    const auto file = readBvh(report.path, options.limits);
    if (!file) return report.fail(file.error());
    report.title = file->frameCount == 1 ? "BVH pose" : "BVH motion";
    const auto roots =
        std::count_if(file->joints.begin(), file->joints.end(), [](const BvhJoint& j) { return j.parent < 0; });
    report.add("joints", fmt::format("{}, {}", grouped(file->joints.size()), counted(file->channelCount, "channel")),
               file->joints.size());
    if (roots != 1) report.add("roots", std::to_string(roots), roots);
    report.add("frames", grouped(file->frameCount), file->frameCount);
    if (file->frameCount == 0) return report.fail(makeError(ErrorCode::BadFile, "", "the motion has no frames"));
    if (file->frameTimeS > 0.0) {
        report.add("frames_per_second", fmt::format("{:.4g}", 1.0 / file->frameTimeS), 1.0 / file->frameTimeS);
    }
    const double duration = file->frameTimeS * static_cast<double>(file->frameCount - 1);
    report.add("duration", fmt::format("{:.2f} s", duration), duration);
    addTransfer(report, *file, options);
}

} // namespace ars::app
