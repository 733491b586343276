#include "engine/capture/capture_check.h"

#include "engine/capture/picture_header.h"
#include "engine/capture/undistortion.h"
#include "engine/io/text_scanner.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace ars {
namespace {

constexpr double kMinFocal = 0.05, kMaxFocal = 100.0; ///< of the longer side
constexpr double kMaxDistanceM = 100.0;
constexpr std::size_t kMaxPoses = 64;
constexpr std::size_t kMaxFiles = 4096;
constexpr std::size_t kFilesPerReport = 64;

Status checkIntrinsics(const Camera& camera, const std::string& place) {
    const double longer = std::max(camera.width, camera.height);
    for (const double focal : {camera.fx, camera.fy}) {
        if (focal >= kMinFocal * longer && focal <= kMaxFocal * longer) continue;
        return makeError(
            ErrorCode::BadFile, place,
            fmt::format("a focal length of {:g} pixels cannot belong to a picture of {} x {}; expected {:g} "
                        "to {:g}",
                        focal, camera.width, camera.height, kMinFocal * longer, kMaxFocal * longer));
    }
    const bool near = camera.cx >= -camera.width && camera.cx <= 2.0 * camera.width && camera.cy >= -camera.height &&
                      camera.cy <= 2.0 * camera.height;
    if (near) return {};
    return makeError(ErrorCode::BadFile, place,
                     fmt::format("the principal point ({:g}, {:g}) lies far outside the picture of {} x {} pixels",
                                 camera.cx, camera.cy, camera.width, camera.height));
}

/// Rest pelvis plus translation of up to kMaxPoses frames, metres.
std::vector<glm::dvec3> pelvisPositions(const Capture& capture) {
    std::vector<glm::dvec3> positions;
    const std::size_t count = capture.frames.size();
    const std::size_t step = std::max<std::size_t>(1, count / kMaxPoses);
    for (std::size_t i = 0; i < count; i += step) {
        positions.push_back(glm::dvec3(kSmplxPelvisM + capture.pose(static_cast<int>(i)).translation));
    }
    return positions;
}

Status checkPlace(const Camera& camera, const std::vector<glm::dvec3>& pelvis, const std::string& place) {
    double nearest = 1e300;
    bool seen = false;
    for (const glm::dvec3& position : pelvis) {
        nearest = std::min(nearest, glm::length(camera.centerWorld() - position));
        seen = seen || camera.toCamera(position).z > 0.0;
    }
    if (!(nearest <= kMaxDistanceM)) {
        return makeError(
            ErrorCode::BadFile, place,
            fmt::format("the camera stands {:.4g} m from the person, expected up to {:g} m; is T in metres?", nearest,
                        kMaxDistanceM));
    }
    if (seen) return {};
    return makeError(ErrorCode::BadFile, place,
                     "the person is behind the camera in every frame; R and T must take the world to the camera");
}

/// Picture and mask of a view agree with the calibration and with each other.
Status checkView(const Capture& capture, ViewId view) {
    const CalibratedCamera& camera = capture.cameras[static_cast<std::size_t>(view.camera)];
    const std::filesystem::path picture = capture.imagePath(view);
    ARS_TRY(const PictureHeader header, readPictureHeader(picture));
    if (header.width != camera.camera.width || header.height != camera.camera.height) {
        return makeError(ErrorCode::BadFile, picture.string(),
                         fmt::format("has {} x {} pixels, the calibration says {} x {}", header.width, header.height,
                                     camera.camera.width, camera.camera.height));
    }
    const std::filesystem::path maskPath = capture.maskPath(view);
    if (maskPath.empty()) {
        if (header.alpha) return {};
        return makeError(ErrorCode::BadFile, picture.string(), "has no mask: neither a file of its own nor alpha");
    }
    ARS_TRY(const PictureHeader mask, readPictureHeader(maskPath));
    if (mask.width == header.width && mask.height == header.height) return {};
    return makeError(ErrorCode::InvalidArgument, maskPath.string(),
                     fmt::format("the mask has {} x {} pixels, its picture {} x {}", mask.width, mask.height,
                                 header.width, header.height));
}

/// First view of every camera, then others evenly spread, in the order of cameras and frames.
std::vector<ViewId> viewsToCheck(const Capture& capture) {
    std::vector<ViewId> all, views;
    for (int camera = 0; camera < static_cast<int>(capture.cameras.size()); ++camera) {
        bool first = true;
        for (int frame = 0; frame < static_cast<int>(capture.frames.size()); ++frame) {
            const ViewId view{camera, frame};
            if (!capture.has(view)) continue;
            (first ? views : all).push_back(view);
            first = false;
        }
    }
    const std::size_t room = std::max(kMaxFiles / 2, views.size()) - views.size();
    const std::size_t count = std::min(all.size(), room);
    for (std::size_t i = 0; i < count; ++i) views.push_back(all[i * all.size() / count]);
    std::sort(views.begin(), views.end());
    return views;
}

} // namespace

Status checkCaptureCameras(const Capture& capture, const std::filesystem::path& place) {
    const std::vector<glm::dvec3> pelvis = pelvisPositions(capture);
    for (const CalibratedCamera& camera : capture.cameras) {
        const std::string where = fmt::format("{}: camera {}", place.string(), quotedFound(camera.name));
        ARS_TRY_STATUS(checkIntrinsics(camera.camera, where));
        ARS_TRY_STATUS(validateCamera(camera.camera, where));
        ARS_TRY_STATUS(checkPlace(camera.camera, pelvis, where));
        if (const auto lens = lensDistortion(camera); !lens) return atPlace(lens.error(), place.string());
    }
    return {};
}

Status checkCapturePictures(const Capture& capture, const ProgressFunction& progress) {
    const std::vector<ViewId> views = viewsToCheck(capture);
    for (std::size_t i = 0; i < views.size(); ++i) {
        if (i % kFilesPerReport == 0) {
            ARS_TRY_STATUS(reportProgress(progress, static_cast<double>(i) / static_cast<double>(views.size()),
                                          "looking at pictures"));
        }
        ARS_TRY_STATUS(checkView(capture, views[i]));
    }
    return {};
}

} // namespace ars
