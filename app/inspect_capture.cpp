#include "app/inspect.h"
#include "app/text.h"
#include "engine/capture/calibration.h"
#include "engine/capture/capture.h"
#include "engine/capture/layout.h"
#include "engine/core/file.h"
#include "engine/core/parallel.h"
#include "engine/rig/retarget.h"

#include <algorithm>
#include <map>

namespace ars::app {
namespace fs = std::filesystem;
namespace {

void addCameras(FileReport& report, const std::vector<CalibratedCamera>& cameras) {
    std::vector<std::string> names;
    std::map<std::pair<int, int>, std::size_t> sizes;
    double narrow = 180.0, wide = 0.0, near = 1e30, far = 0.0;
    bool distorted = false;
    for (const CalibratedCamera& camera : cameras) {
        names.push_back(camera.name);
        const Camera& view = camera.camera;
        ++sizes[{view.width, view.height}];
        narrow = std::min(narrow, camera.verticalFieldDeg());
        wide = std::max(wide, camera.verticalFieldDeg());
        const double distance = glm::length(view.centerWorld());
        near = std::min(near, distance);
        far = std::max(far, distance);
        distorted = distorted || camera.distorted();
        if (view.cx < 0.0 || view.cy < 0.0 || view.cx > view.width || view.cy > view.height) {
            report.warn(fmt::format("camera \"{}\": the principal point ({:.1f}, {:.1f}) lies outside the picture",
                                    camera.name, view.cx, view.cy));
        }
    }
    report.add("cameras", fmt::format("{}: {}", cameras.size(), listed(names, 4)), names);
    std::vector<std::string> shown;
    Json json = Json::array();
    for (const auto& [size, count] : sizes) {
        shown.push_back(fmt::format("{} x {}", size.first, size.second));
        json.push_back({size.first, size.second});
    }
    report.add("picture_size", listed(shown), json);
    report.add("vertical_field", fmt::format("{:.1f} to {:.1f} degrees", narrow, wide), Json{narrow, wide});
    report.add("distance", fmt::format("{:.2f} to {:.2f} m from the origin", near, far), Json{near, far});
    report.add("distortion", distorted ? "yes: pictures must be undistorted" : "none", distorted);
}

void inspectCalibration(FileReport& report, const Json& json) {
    report.kind = "calibration";
    report.title = "JSON, camera calibration (AvatarReX)";
    const auto cameras = camerasFromJson(json);
    if (!cameras) return report.fail(cameras.error());
    addCameras(report, *cameras);
}

void inspectJointMap(FileReport& report) {
    report.kind = "joint_map";
    report.title = "JSON, map of joint names";
    const auto map = readRetargetMap(report.path);
    if (!map) return report.fail(map.error());
    const auto mapped =
        std::count_if(map->joints.begin(), map->joints.end(), [](const auto& names) { return !names.empty(); });
    report.add("name", map->name);
    report.add("about", map->about);
    report.add("joints", fmt::format("{} of {}", mapped, kSmplxJointCount), mapped);
}

/// The lines of a missing_img_files.txt that is looked at alone.
Result<std::size_t> countMissingList(const fs::path& path, const ReadLimits& limits) {
    ARS_TRY(const std::string text, readTextFile(path, limits));
    std::size_t count = 0;
    bool blank = true;
    for (const char c : text + '\n') {
        if (c == '\n') {
            count += blank ? 0 : 1;
            blank = true;
        } else {
            blank = blank && (c == ' ' || c == '\t' || c == '\r');
        }
    }
    return count;
}

/// Reads every view as a training would; the first failure in the order of cameras and frames is the answer.
Status readEveryView(const Capture& capture, const InspectOptions& options) {
    std::vector<ViewId> views;
    for (int camera = 0; camera < static_cast<int>(capture.cameras.size()); ++camera) {
        for (int frame = 0; frame < static_cast<int>(capture.frames.size()); ++frame) {
            if (capture.has({camera, frame})) views.push_back({camera, frame});
        }
    }
    constexpr std::size_t kBatch = 32;
    for (std::size_t begin = 0; begin < views.size(); begin += kBatch) {
        ARS_TRY_STATUS(reportProgress(options.progress, static_cast<double>(begin) / static_cast<double>(views.size()),
                                      "decoding pictures"));
        const std::size_t count = std::min(kBatch, views.size() - begin);
        std::vector<Status> results(count);
        parallelFor(
            count,
            [&](std::size_t i) {
                const auto view = readView(capture, views[begin + i], {}, options.limits);
                if (!view) results[i] = view.error();
            },
            1);
        for (Status& result : results) ARS_TRY_STATUS(std::move(result));
    }
    return {};
}

void addCaptureFrames(FileReport& report, const Capture& capture) {
    const std::size_t whole = capture.frames.size() * capture.cameras.size();
    const std::size_t pictures = whole - capture.missing.size();
    std::string frames = grouped(capture.frames.size());
    frames += fmt::format(" (numbers {} to {})", capture.frames.front(), capture.frames.back());
    report.add("frames", frames, capture.frames.size());
    report.add("pictures", fmt::format("{} of {}", grouped(pictures), grouped(whole)), pictures);
    const bool alpha = std::any_of(capture.files.begin(), capture.files.end(),
                                   [](const CameraFiles& files) { return files.masks.folder.empty(); });
    report.add("masks", alpha ? "of some cameras the pictures' own alpha" : "one for every picture", pictures);
    report.add("listed_missing", capture.listedMissing ? grouped(capture.listedMissing) : "", capture.listedMissing);
    report.add("poses", counted(capture.motion.frames.size(), "frame"), capture.motion.frames.size());
}

/// What trainings and evaluations take by name.
void addCaptureSplits(FileReport& report, const Capture& capture) {
    std::vector<std::string> shown;
    Json json = Json::object();
    for (const std::string& name : splitNames(capture)) {
        const auto split = namedSplit(capture, name);
        if (!split) {
            report.warn(fmt::format("split {}: {}", name, split.error().describe()));
            continue;
        }
        shown.push_back(fmt::format("{} ({} x {})", name, counted(split->cameras.size(), "camera"),
                                    counted(split->frames.size(), "frame")));
        json[name] = {{"cameras", split->cameras.size()}, {"frames", split->frames.size()}};
    }
    report.add("splits", listed(shown), json);
}

/// The file that an unlisted missing view lacks, seen from the folder.
std::string lackingFile(const Capture& capture, ViewId view) {
    std::error_code failure;
    const fs::path picture = capture.imagePath(view);
    const fs::path file = fs::exists(picture, failure) ? capture.maskPath(view) : picture;
    return file.lexically_relative(capture.folder).string();
}

Status inspectCapture(FileReport& report, const InspectOptions& options) {
    ARS_TRY(const Capture capture, openCapture(report.path, options.progress, options.limits));
    constexpr const char* kLayouts[] = {"AvatarReX", "THuman4", "ActorsHQ"};
    report.title = fmt::format("capture in {} layout", kLayouts[static_cast<int>(capture.kind)]);
    report.add("subject", capture.subject);
    addCameras(report, capture.cameras);
    addCaptureFrames(report, capture);
    addCaptureSplits(report, capture);
    for (const std::string& note : capture.notes) report.warn(note);
    if (!capture.unlisted.empty()) {
        return makeError(ErrorCode::BadFile, "",
                         fmt::format("{} not there and not in missing_img_files.txt, the first is {}",
                                     counted(capture.unlisted.size(), "picture or mask is", "pictures or masks are"),
                                     lackingFile(capture, *capture.unlisted.begin())));
    }
    if (options.fast) return {};
    return readEveryView(capture, options);
}

/// The head line names the folder already.
Error insideFolder(Error error, const std::string& folder) {
    const std::string prefix = folder + (folder.ends_with('/') ? "" : "/");
    if (error.place.starts_with(prefix)) error.place.erase(0, prefix.size());
    return error;
}

} // namespace

void inspectJson(FileReport& report, const InspectOptions& options) {
    const auto json = readJsonFile(report.path, options.limits);
    if (!json) return report.fail(json.error());
    if (looksLikeCalibration(*json)) return inspectCalibration(report, *json);
    if (json->is_object() && json->contains("joints") && (*json)["joints"].is_object()) return inspectJointMap(report);
    report.kind = "json";
    std::vector<std::string> keys;
    if (json->is_object()) {
        for (const auto& [key, value] : json->items()) keys.push_back(key);
        report.add("keys", listed(keys), keys);
    } else {
        report.add("entries", grouped(json->size()), json->size());
    }
    report.fail(makeError(ErrorCode::Unsupported, "",
                          "sound JSON, but no kind that this program reads (calibration, joint map)"));
}

void inspectText(FileReport& report, const InspectOptions& options) {
    report.kind = "text";
    const auto text = readTextFile(report.path, options.limits);
    if (!text) return report.fail(text.error());
    const auto lines = std::count(text->begin(), text->end(), '\n') + (text->ends_with('\n') ? 0 : 1);
    report.add("lines", grouped(static_cast<std::uint64_t>(lines)), lines);
    report.fail(makeError(ErrorCode::Unsupported, "",
                          "this is text for people or other programs; this program does not read it"));
}

void inspectMissingImages(FileReport& report, const InspectOptions& options) {
    report.kind = "missing_images";
    report.title = "text, list of the pictures that a capture lacks";
    const auto count = countMissingList(report.path, options.limits);
    if (!count) return report.fail(count.error());
    report.add("pictures", *count ? grouped(*count) : "none is missing", *count);
}

void inspectCaptureFolder(FileReport& report, const InspectOptions& options) {
    if (looksLikeCapture(report.path)) {
        report.kind = "capture";
        report.title = "multi-view capture";
    }
    if (const Status status = inspectCapture(report, options); !status) {
        report.fail(insideFolder(status.error(), report.path));
    }
}

} // namespace ars::app
