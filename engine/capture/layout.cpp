#include "engine/capture/layout.h"

#include <algorithm>
#include <array>
#include <string_view>
#include <system_error>

namespace ars {
namespace fs = std::filesystem;
namespace {

/// A layout that is nothing but names: one JSON calibration, and for every camera a folder of pictures and one of
/// masks, both with files %08d. "*" is the camera's name.
struct NamedLayout {
    CaptureKind kind;
    const char* calibration;
    std::string_view pictures;
    std::string_view masks;
};
constexpr std::array<NamedLayout, 2> kNamedLayouts{{
    {CaptureKind::AvatarRex, "calibration_full.json", "*", "*/mask/pha"}, // avatar reference 5.1
    {CaptureKind::THuman4, "calibration.json", "images/*", "masks/*"},    // avatar reference 5.2
}};

fs::path withCamera(std::string_view pattern, const std::string& camera) {
    std::string path(pattern);
    return path.replace(path.find('*'), 1, camera);
}

bool isThere(const fs::path& path) {
    std::error_code ignored;
    return fs::exists(path, ignored);
}

/// Names of captures directly inside a folder: people open the folder above easily.
std::string capturesInside(const fs::path& folder) {
    std::vector<std::string> names;
    std::error_code failure;
    for (fs::directory_iterator i(folder, failure), end; !failure && i != end; i.increment(failure)) {
        std::error_code ignored;
        if (i->is_directory(ignored) && looksLikeCapture(i->path())) names.push_back(i->path().filename().string());
    }
    std::sort(names.begin(), names.end());
    if (names.size() > 8) names.resize(8);
    return fmt::format("{}", fmt::join(names, ", "));
}

Status checkFolder(const fs::path& folder) {
    std::error_code failure;
    const fs::file_status status = fs::status(folder, failure);
    if (status.type() == fs::file_type::not_found) {
        return makeError(ErrorCode::NotFound, folder.string(), "there is no such folder");
    }
    if (failure) {
        return makeError(ErrorCode::Io, folder.string(), fmt::format("cannot be opened: {}", failure.message()));
    }
    if (!fs::is_directory(status)) {
        return makeError(ErrorCode::InvalidArgument, folder.string(),
                         "is a file, expected the folder of a multi-view capture");
    }
    const fs::directory_iterator entries(folder, failure);
    if (failure) {
        return makeError(ErrorCode::Io, folder.string(), fmt::format("cannot be opened: {}", failure.message()));
    }
    return {};
}

/// The layout whose calibration lies in a folder; null where none does.
const NamedLayout* namedLayoutOf(const fs::path& folder) {
    for (const NamedLayout& layout : kNamedLayouts) {
        if (isThere(folder / layout.calibration)) return &layout;
    }
    return nullptr;
}

Result<CaptureLayout> readNamedLayout(const NamedLayout& names, const fs::path& folder, const ReadLimits& limits) {
    CaptureLayout layout;
    layout.kind = names.kind;
    layout.calibration = folder / names.calibration;
    layout.poses = folder / "smpl_params.npz";
    layout.missingList = folder / "missing_img_files.txt";
    ARS_TRY(layout.cameras, readCalibration(layout.calibration, limits));
    for (const CalibratedCamera& camera : layout.cameras) {
        if (const Status fit = checkCameraName(camera.name); !fit) {
            return makeError(ErrorCode::BadFile, layout.calibration.string(), fit.error().message);
        }
        CameraFiles files;
        files.pictures.folder = folder / withCamera(names.pictures, camera.name);
        files.masks.folder = folder / withCamera(names.masks, camera.name);
        layout.files.push_back(std::move(files));
    }
    return layout;
}

} // namespace

bool looksLikeCapture(const fs::path& folder) { return namedLayoutOf(folder) || !findActorsHqScale(folder).empty(); }

Result<CaptureLayout> readCaptureLayout(const fs::path& folder, const ReadLimits& limits) {
    ARS_TRY_STATUS(checkFolder(folder));
    if (const NamedLayout* named = namedLayoutOf(folder)) return readNamedLayout(*named, folder, limits);
    if (!findActorsHqScale(folder).empty()) return readActorsHqLayout(folder, limits);
    std::string message = "has no calibration: expected calibration_full.json (AvatarReX), calibration.json (THuman4) "
                          "or calibration.csv (ActorsHQ)";
    if (const std::string inside = capturesInside(folder); !inside.empty()) {
        message += fmt::format("; captures inside it: {}", inside);
    }
    return makeError(ErrorCode::Unsupported, folder.string(), std::move(message));
}

} // namespace ars
