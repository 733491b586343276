#include "engine/capture/layout.h"

#include <algorithm>
#include <system_error>

namespace ars {
namespace fs = std::filesystem;
namespace {

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

} // namespace

bool looksLikeCapture(const fs::path& folder) {
    return isThere(folder / "calibration_full.json") || isThere(folder / "calibration.json") ||
           !findActorsHqScale(folder).empty();
}

Result<CaptureLayout> readCaptureLayout(const fs::path& folder, const ReadLimits& limits) {
    ARS_TRY_STATUS(checkFolder(folder));
    if (isThere(folder / "calibration_full.json")) return readAvatarRexLayout(folder, limits);
    if (isThere(folder / "calibration.json")) return readTHuman4Layout(folder, limits);
    if (!findActorsHqScale(folder).empty()) return readActorsHqLayout(folder, limits);
    std::string message = "has no calibration: expected calibration_full.json (AvatarReX), calibration.json (THuman4) "
                          "or calibration.csv (ActorsHQ)";
    if (const std::string inside = capturesInside(folder); !inside.empty()) {
        message += fmt::format("; captures inside it: {}", inside);
    }
    return makeError(ErrorCode::Unsupported, folder.string(), std::move(message));
}

} // namespace ars
