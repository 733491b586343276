#include "engine/capture/capture.h"

#include "engine/capture/capture_check.h"
#include "engine/capture/layout.h"
#include "engine/capture/missing_pictures.h"
#include "engine/capture/picture_header.h"
#include "engine/capture/published_settings.h"
#include "engine/io/text_scanner.h"

#include <algorithm>
#include <array>
#include <map>
#include <system_error>

namespace ars {
namespace fs = std::filesystem;
namespace {

constexpr std::size_t kBetaCount = 10;
constexpr std::array<std::string_view, 3> kExtensions = {".jpg", ".jpeg", ".png"};

std::string counted(std::size_t count, const char* one, const char* many) {
    return fmt::format("{} {}", count, count == 1 ? one : many);
}

/// The numbers of the pictures in a folder, and how they are written.
struct PictureListing {
    std::set<int> numbers;
    PictureNames names;
    std::size_t ignored = 0; ///< pictures whose name is none of theirs
};

/// The number in "Cam001_rgb000012.jpg" under the prefix "Cam001_rgb"; -1 for any other name.
int pictureNumber(const std::string& stem, const std::string& prefix, int& digits) {
    constexpr std::size_t kMostDigits = 9;
    if (stem.compare(0, prefix.size(), prefix) != 0) return -1;
    const std::string text = stem.substr(prefix.size());
    if (text.empty() || text.size() > kMostDigits) return -1;
    if (!std::all_of(text.begin(), text.end(), [](char c) { return c >= '0' && c <= '9'; })) return -1;
    digits = static_cast<int>(text.size());
    return std::stoi(text);
}

/// Lists one folder. Names of another number of digits or kind than the shortest and most common are left out.
Result<PictureListing> listPictures(const PictureNames& names) {
    struct Entry {
        int number;
        int digits;
        fs::path path;
    };
    std::map<std::string, std::vector<Entry>> byExtension;
    std::error_code failure;
    for (fs::directory_iterator i(names.folder, failure), end; !failure && i != end; i.increment(failure)) {
        const std::string extension = i->path().extension().string();
        if (std::find(kExtensions.begin(), kExtensions.end(), extension) == kExtensions.end()) continue;
        int digits = 0;
        const int number = pictureNumber(i->path().stem().string(), names.prefix, digits);
        if (number >= 0) byExtension[extension].push_back({number, digits, i->path()});
    }
    if (failure && failure != std::errc::no_such_file_or_directory) {
        return makeError(ErrorCode::Io, names.folder.string(), fmt::format("cannot be opened: {}", failure.message()));
    }
    PictureListing listing;
    listing.names = names;
    const std::vector<Entry>* most = nullptr;
    for (const auto& [extension, entries] : byExtension) {
        if (most && most->size() >= entries.size()) continue;
        most = &entries;
        listing.names.extension = extension;
    }
    if (!most) return listing;
    const auto shortest = std::min_element(most->begin(), most->end(),
                                           [](const Entry& a, const Entry& b) { return a.digits < b.digits; });
    listing.names.digits = shortest->digits;
    for (const Entry& entry : *most) {
        if (listing.names.of(entry.number) == entry.path) listing.numbers.insert(entry.number);
    }
    for (const auto& [extension, entries] : byExtension) listing.ignored += entries.size();
    listing.ignored -= listing.numbers.size();
    return listing;
}

/// The listings of all cameras while views are being counted.
struct Listings {
    std::vector<std::set<int>> pictures;
    std::vector<std::set<int>> masks;
};

/// "CAMERA/00000003.jpg"-like name for a note.
std::string shortName(const Capture& capture, const PictureNames& names, int number) {
    return names.of(number).lexically_relative(capture.folder).string();
}

/// Where a camera has no masks: its pictures' own alpha must serve.
Status checkMasklessCamera(const Capture& capture, const CameraFiles& files, const std::set<int>& pictures) {
    const fs::path first = files.pictures.of(*pictures.begin());
    ARS_TRY(const PictureHeader header, readPictureHeader(first));
    if (header.alpha) return {};
    return makeError(ErrorCode::BadFile, files.masks.folder.string(),
                     fmt::format("has no mask of {}, and that picture has no alpha",
                                 first.lexically_relative(capture.folder).string()));
}

Status listCamera(Capture& capture, std::size_t camera, bool mayLack, const MissingPictures& missing,
                  Listings& listings) {
    CameraFiles& files = capture.files[camera];
    ARS_TRY(const PictureListing pictures, listPictures(files.pictures));
    ARS_TRY(const PictureListing masks, listPictures(files.masks));
    const std::string& name = capture.cameras[camera].name;
    if (pictures.numbers.empty() && !mayLack && !missing.cameras.contains(static_cast<int>(camera))) {
        return makeError(ErrorCode::BadFile, files.pictures.folder.string(),
                         fmt::format("holds no picture of camera {}, expected names like {}", quotedFound(name),
                                     files.pictures.of(0).filename().string()));
    }
    files.pictures = pictures.names;
    files.masks = masks.names;
    if (pictures.ignored > 0) {
        capture.notes.push_back(fmt::format("camera {}: {} with names unlike {}, left out", quotedFound(name),
                                            counted(pictures.ignored, "picture", "pictures"),
                                            files.pictures.of(*pictures.numbers.begin()).filename().string()));
    }
    if (masks.numbers.empty() && !pictures.numbers.empty()) {
        ARS_TRY_STATUS(checkMasklessCamera(capture, files, pictures.numbers));
        files.masks.folder.clear();
    }
    listings.pictures.push_back(pictures.numbers);
    listings.masks.push_back(masks.numbers);
    return {};
}

/// Every number of which some camera has a picture that is not listed as missing.
std::vector<int> frameNumbers(const Listings& listings, const MissingPictures& missing) {
    std::set<int> numbers;
    for (std::size_t camera = 0; camera < listings.pictures.size(); ++camera) {
        for (const int number : listings.pictures[camera]) {
            if (!missing.views.contains({static_cast<int>(camera), number})) numbers.insert(number);
        }
    }
    return {numbers.begin(), numbers.end()};
}

/// Fills Capture::missing; says how many views are absent without having been announced.
void findMissing(Capture& capture, const MissingPictures& listed, const Listings& listings) {
    std::size_t absent = 0, maskless = 0, lacking = 0;
    std::string firstAbsent, firstMaskless;
    for (std::size_t c = 0; c < capture.cameras.size(); ++c) {
        const bool masks = !capture.files[c].masks.folder.empty();
        if (listings.pictures[c].empty()) ++lacking;
        for (std::size_t f = 0; f < capture.frames.size(); ++f) {
            const ViewId view{static_cast<int>(c), static_cast<int>(f)};
            const int number = capture.frames[f];
            const bool announced = listed.views.contains({view.camera, number});
            const bool picture = listings.pictures[c].contains(number);
            const bool mask = !masks || listings.masks[c].contains(number);
            if (!announced && picture && mask) continue;
            capture.missing.insert(view);
            if (announced || listings.pictures[c].empty()) continue;
            capture.unlisted.insert(view);
            if (!picture && absent++ == 0) firstAbsent = shortName(capture, capture.files[c].pictures, number);
            if (picture && !mask && maskless++ == 0) firstMaskless = shortName(capture, capture.files[c].masks, number);
        }
    }
    const auto note = [&](std::size_t count, const char* one, const char* many, const std::string& first) {
        if (count == 0) return;
        capture.notes.push_back(fmt::format("{} not there, the first is {}", counted(count, one, many), first));
    };
    note(absent, "picture is", "pictures are", firstAbsent);
    note(maskless, "mask is", "masks are", firstMaskless);
    if (lacking > 0) {
        capture.notes.push_back(
            fmt::format("{} of {} cameras have no pictures here and are left out", lacking, capture.cameras.size()));
    }
}

/// Frames are numbered by their pose. Frames beyond the last pose are refused, or left out where a layout allows that.
Status matchPoses(Capture& capture, const CaptureLayout& layout) {
    const std::size_t poses = capture.motion.frames.size();
    const auto beyond = std::find_if(capture.frames.begin(), capture.frames.end(),
                                     [&](int number) { return static_cast<std::size_t>(number) >= poses; });
    if (beyond == capture.frames.end()) return {};
    if (!layout.posesMayEndEarly || beyond == capture.frames.begin()) {
        return makeError(ErrorCode::BadFile, layout.poses.string(),
                         fmt::format("has {} (0 to {}), the pictures go from number {} to {}",
                                     counted(poses, "pose", "poses"), poses - 1, capture.frames.front(),
                                     capture.frames.back()));
    }
    const auto late = static_cast<std::size_t>(std::distance(beyond, capture.frames.end()));
    capture.notes.push_back(
        fmt::format("no pose for {} from number {} on, left out", counted(late, "frame", "frames"), *beyond));
    capture.frames.erase(beyond, capture.frames.end());
    return {};
}

Status readPoses(Capture& capture, const CaptureLayout& layout, const ReadLimits& limits) {
    std::error_code failure;
    if (!fs::exists(layout.poses, failure)) {
        return makeError(ErrorCode::NotFound, layout.poses.string(),
                         "is not there; a capture needs the SMPL-X pose of every frame");
    }
    ARS_TRY(capture.motion, readMotionNpz(layout.poses, {}, limits));
    if (capture.motion.frames.empty()) {
        return makeError(ErrorCode::BadFile, layout.poses.string(), "holds no pose");
    }
    capture.betas = capture.motion.betas;
    if (capture.betas.size() > kBetaCount) {
        capture.notes.push_back(
            fmt::format("of {} shape coefficients the first {} are used", capture.betas.size(), kBetaCount));
    }
    capture.betas.resize(kBetaCount, 0.0f);
    return {};
}

Status findPictures(Capture& capture, const CaptureLayout& layout, const ProgressFunction& progress,
                    const ReadLimits& limits) {
    ARS_TRY(const MissingPictures missing, readMissingPictures(layout.missingList, layout, limits));
    capture.listedMissing = missing.views.size();
    if (missing.strangers > 0) {
        capture.notes.push_back(fmt::format("no picture of this capture is named by {} of {}",
                                            counted(missing.strangers, "line", "lines"),
                                            layout.missingList.filename().string()));
    }
    Listings listings;
    for (std::size_t camera = 0; camera < capture.cameras.size(); ++camera) {
        ARS_TRY_STATUS(reportProgress(
            progress, static_cast<double>(camera) / static_cast<double>(capture.cameras.size()), "listing pictures"));
        ARS_TRY_STATUS(listCamera(capture, camera, layout.camerasMayLack, missing, listings));
    }
    capture.frames = frameNumbers(listings, missing);
    if (capture.frames.empty()) {
        return makeError(ErrorCode::BadFile, capture.folder.string(),
                         fmt::format("holds no picture; expected {}", layout.files.front().pictures.of(0).string()));
    }
    ARS_TRY_STATUS(matchPoses(capture, layout));
    findMissing(capture, missing, listings);
    return {};
}

void nameSubject(Capture& capture) {
    std::error_code failure;
    fs::path whole = fs::absolute(capture.folder, failure).lexically_normal();
    if (!whole.has_filename()) whole = whole.parent_path();
    capture.subject = whole.filename().string();
    const PublishedSubject* published = findPublishedSubject(capture.kind, capture.folder, capture.cameras.size());
    if (!published) return;
    capture.subject = std::string(published->name);
    if (!published->note.empty()) capture.notes.emplace_back(published->note);
}

} // namespace

std::string_view captureKindName(CaptureKind kind) {
    switch (kind) {
    case CaptureKind::AvatarRex:
        return "avatarrex";
    case CaptureKind::THuman4:
        return "thuman4";
    case CaptureKind::ActorsHq:
        return "actorshq";
    }
    return "unknown";
}

fs::path PictureNames::of(int number) const {
    return folder / fmt::format("{}{:0{}d}{}", prefix, number, digits, extension);
}

fs::path Capture::imagePath(ViewId view) const {
    return files[static_cast<std::size_t>(view.camera)].pictures.of(frames[static_cast<std::size_t>(view.frame)]);
}

fs::path Capture::maskPath(ViewId view) const {
    const PictureNames& masks = files[static_cast<std::size_t>(view.camera)].masks;
    return masks.folder.empty() ? fs::path() : masks.of(frames[static_cast<std::size_t>(view.frame)]);
}

const Pose& Capture::pose(int frame) const {
    return motion.frames[static_cast<std::size_t>(frames[static_cast<std::size_t>(frame)])];
}

Result<Capture> openCapture(const fs::path& folder, const ProgressFunction& progress, const ReadLimits& limits) {
    ARS_TRY(const CaptureLayout layout, readCaptureLayout(folder, limits));
    Capture capture;
    capture.kind = layout.kind;
    capture.folder = folder;
    capture.cameras = layout.cameras;
    capture.files = layout.files;
    capture.notes = layout.notes;
    nameSubject(capture);
    ARS_TRY_STATUS(readPoses(capture, layout, limits));
    ARS_TRY_STATUS(findPictures(capture, layout, progress, limits));
    ARS_TRY_STATUS(checkCaptureCameras(capture, layout.calibration));
    ARS_TRY_STATUS(checkCapturePictures(capture, progress));
    return capture;
}

} // namespace ars
