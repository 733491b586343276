#include "app/inspect.h"
#include "app/text.h"
#include "engine/capture/calibration.h"
#include "engine/core/file.h"
#include "engine/core/parallel.h"
#include "engine/io/jpeg.h"
#include "engine/rig/motion.h"
#include "engine/rig/retarget.h"

#include <algorithm>
#include <atomic>
#include <map>
#include <mutex>
#include <set>

namespace ars::app {
namespace fs = std::filesystem;
namespace {

/// As a tree JSON takes some twenty times its bytes; calibrations and maps are far below this.
constexpr std::uint64_t kMaxJsonBytes = 64ull << 20;

Result<Json> readJson(const fs::path& path, ReadLimits limits) {
    limits.maxFileBytes = std::min(limits.maxFileBytes, kMaxJsonBytes);
    ARS_TRY(const std::string text, readTextFile(path, limits));
    Json json;
    try {
        json = Json::parse(text);
    } catch (const Json::parse_error& error) {
        // "[json.exception.parse_error.101] parse error at line 1, column 8: ..." without what only programmers know
        std::string_view what = error.what();
        if (const std::size_t bracket = what.find("] "); bracket != std::string_view::npos)
            what.remove_prefix(bracket + 2);
        return makeError(ErrorCode::BadFile, path.string(), fmt::format("is no sound JSON: {}", what));
    }
    return json;
}

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

/// What a capture folder lacks and holds.
struct CaptureFiles {
    std::vector<std::pair<fs::path, fs::path>> pictures; ///< picture and mask
    std::set<std::string> frames;
    std::vector<std::string> absent; ///< not there and not listed as missing
    std::size_t listedMissing = 0;
    std::size_t maskless = 0;
};

/// "24110001/00000003.jpg" for each line of missing_img_files.txt, whatever stands before and however slashes lean.
Result<std::set<std::string>> readMissingList(const fs::path& path, const ReadLimits& limits) {
    std::set<std::string> names;
    std::error_code failure;
    if (!fs::exists(path, failure)) return names;
    ARS_TRY(const std::string text, readTextFile(path, limits));
    std::size_t begin = 0;
    while (begin < text.size()) {
        const std::size_t end = std::min(text.find('\n', begin), text.size());
        std::string line = text.substr(begin, end - begin);
        begin = end + 1;
        std::replace(line.begin(), line.end(), '\\', '/');
        while (!line.empty() && (line.back() == '\r' || line.back() == ' ')) line.pop_back();
        if (line.empty()) continue;
        const fs::path listed(line);
        names.insert((listed.parent_path().filename() / listed.filename()).string());
    }
    return names;
}

std::set<std::string> pictureNames(const fs::path& folder) {
    std::set<std::string> names;
    std::error_code failure;
    for (fs::directory_iterator i(folder, failure), end; !failure && i != end; i.increment(failure)) {
        const fs::path& path = i->path();
        if (path.extension() == ".jpg" || path.extension() == ".png") names.insert(path.filename().string());
    }
    return names;
}

Result<CaptureFiles> listCapture(const fs::path& folder, const std::vector<CalibratedCamera>& cameras,
                                 const ReadLimits& limits) {
    CaptureFiles files;
    ARS_TRY(const std::set<std::string> missing, readMissingList(folder / "missing_img_files.txt", limits));
    files.listedMissing = missing.size();
    std::vector<std::set<std::string>> perCamera;
    for (const CalibratedCamera& camera : cameras) {
        perCamera.push_back(pictureNames(folder / camera.name));
        files.frames.insert(perCamera.back().begin(), perCamera.back().end());
    }
    for (std::size_t c = 0; c < cameras.size(); ++c) {
        for (const std::string& name : files.frames) {
            const fs::path relative = fs::path(cameras[c].name) / name;
            if (perCamera[c].contains(name)) {
                const fs::path mask = folder / cameras[c].name / "mask" / "pha" / name;
                std::error_code failure;
                const bool masked = fs::exists(mask, failure);
                files.maskless += masked ? 0 : 1;
                files.pictures.emplace_back(folder / relative, masked ? mask : fs::path());
            } else if (!missing.contains(relative.string())) {
                files.absent.push_back(relative.string());
            }
        }
    }
    return files;
}

/// Decodes one picture and compares its size with the calibration's.
Status checkPicture(const fs::path& path, int width, int height, const ReadLimits& limits) {
    ARS_TRY(const JpegFile file, readJpeg(path, {.applyOrientation = false}, limits));
    if (file.image.width == width && file.image.height == height) return {};
    return makeError(ErrorCode::BadFile, path.string(),
                     fmt::format("has {} x {} pixels, the calibration says {} x {}", file.image.width,
                                 file.image.height, width, height));
}

/// Decodes every picture and mask; the first failure in the order of files is the answer.
Status checkPictures(const CaptureFiles& files, const std::map<std::string, CalibratedCamera>& cameras,
                     const InspectOptions& options) {
    constexpr std::size_t kBatch = 32;
    for (std::size_t begin = 0; begin < files.pictures.size(); begin += kBatch) {
        ARS_TRY_STATUS(reportProgress(options.progress,
                                      static_cast<double>(begin) / static_cast<double>(files.pictures.size()),
                                      "decoding pictures"));
        const std::size_t count = std::min(kBatch, files.pictures.size() - begin);
        std::vector<Status> results(count);
        parallelFor(
            count,
            [&](std::size_t i) {
                const auto& [picture, mask] = files.pictures[begin + i];
                const Camera& camera = cameras.at(picture.parent_path().filename().string()).camera;
                results[i] = checkPicture(picture, camera.width, camera.height, options.limits);
                if (results[i] && !mask.empty())
                    results[i] = checkPicture(mask, camera.width, camera.height, options.limits);
            },
            1);
        for (Status& result : results) ARS_TRY_STATUS(std::move(result));
    }
    return {};
}

void addCaptureFrames(FileReport& report, const CaptureFiles& files, std::size_t cameras) {
    report.add("frames", grouped(files.frames.size()), files.frames.size());
    report.add("pictures",
               fmt::format("{} of {}", grouped(files.pictures.size()), grouped(files.frames.size() * cameras)),
               files.pictures.size());
    report.add("masks",
               files.maskless ? fmt::format("{} pictures have none", grouped(files.maskless)) : "one for every picture",
               files.pictures.size() - files.maskless);
    report.add("listed_missing", files.listedMissing ? grouped(files.listedMissing) : "", files.listedMissing);
}

Status addCapturePoses(FileReport& report, const CaptureFiles& files, const InspectOptions& options) {
    const fs::path path = fs::path(report.path) / "smpl_params.npz";
    std::error_code failure;
    if (!fs::exists(path, failure)) {
        report.add("poses", "none (no smpl_params.npz)", Json());
        return {};
    }
    ARS_TRY(const Motion motion, readMotionNpz(path, {}, options.limits));
    report.add("poses", counted(motion.frames.size(), "frame"), motion.frames.size());
    // Frames are numbered by their pose, so a picture beyond the last pose has none.
    std::size_t last = 0;
    for (const std::string& name : files.frames) {
        const std::string stem = fs::path(name).stem().string();
        const bool digits = !stem.empty() && stem.size() < 10 &&
                            std::all_of(stem.begin(), stem.end(), [](char c) { return c >= '0' && c <= '9'; });
        if (digits) last = std::max(last, static_cast<std::size_t>(std::stoul(stem)));
    }
    if (last < motion.frames.size()) return {};
    return makeError(
        ErrorCode::BadFile, path.string(),
        fmt::format("has poses for {}, the pictures go up to number {}", counted(motion.frames.size(), "frame"), last));
}

Status inspectCapture(FileReport& report, const InspectOptions& options) {
    const fs::path folder = report.path;
    ARS_TRY(const Json json, readJson(folder / "calibration_full.json", options.limits));
    ARS_TRY(const std::vector<CalibratedCamera> cameras, camerasFromJson(json));
    addCameras(report, cameras);
    ARS_TRY(const CaptureFiles files, listCapture(folder, cameras, options.limits));
    addCaptureFrames(report, files, cameras.size());
    if (files.frames.empty()) return makeError(ErrorCode::BadFile, "", "no camera folder holds a picture");
    ARS_TRY_STATUS(addCapturePoses(report, files, options));
    if (!files.absent.empty()) {
        return makeError(ErrorCode::BadFile, "",
                         fmt::format("{} not there and not in missing_img_files.txt, the first is {}",
                                     counted(files.absent.size(), "picture is", "pictures are"), files.absent.front()));
    }
    if (options.fast) return {};
    std::map<std::string, CalibratedCamera> byName;
    for (const CalibratedCamera& camera : cameras) byName.emplace(camera.name, camera);
    return checkPictures(files, byName, options);
}

} // namespace

void inspectJson(FileReport& report, const InspectOptions& options) {
    const auto json = readJson(report.path, options.limits);
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
    const auto names = readMissingList(report.path, options.limits);
    if (!names) return report.fail(names.error());
    report.add("pictures", names->empty() ? "none is missing" : grouped(names->size()), names->size());
}

void inspectCaptureFolder(FileReport& report, const InspectOptions& options) {
    std::error_code failure;
    const fs::path calibration = fs::path(report.path) / "calibration_full.json";
    fs::directory_iterator entries(report.path, failure);
    if (failure)
        return report.fail(makeError(ErrorCode::Io, "", fmt::format("cannot be opened: {}", failure.message())));
    if (!fs::exists(calibration, failure)) {
        return report.fail(
            makeError(ErrorCode::Unsupported, "",
                      "a folder, but no capture that this program knows: it has no calibration_full.json"));
    }
    report.kind = "capture";
    report.title = "capture in AvatarReX layout";
    if (const Status status = inspectCapture(report, options); !status) report.fail(status.error());
}

} // namespace ars::app
