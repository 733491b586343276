#include "engine/scene/session_notices.h"

#include "engine/scene/run_folder.h"

#include <algorithm>

namespace ars {
namespace {

std::string hintFor(ErrorCode code) {
    switch (code) {
    case ErrorCode::NotFound:
        return "Check that it has not been moved or renamed, and that its drive is connected.";
    case ErrorCode::BadFile:
        return "The file is damaged or incomplete: copy or export it again.";
    case ErrorCode::Unsupported:
        return "Avatars: body npz, glb, glTF, OBJ, PLY, folders of trained avatars and runs. Light: EXR, HDR, a folder "
               "of six faces. Motion: npz, npy, BVH, "
               "glb. Captures: calibration_full.json. Pictures: EXR, PNG, JPEG. Projects: ars.";
    case ErrorCode::LimitExceeded:
        return "Ask for less, or allow files more memory with ARS_MAX_BYTES.";
    case ErrorCode::OutOfMemory:
        return "Close other programs, or use fewer surfels or a smaller picture.";
    case ErrorCode::Io:
        return "Check that the folder may be read and written and that its disk has space.";
    case ErrorCode::Unavailable:
        return "Choose another device in the settings, or install what the message names.";
    case ErrorCode::InvalidArgument:
        return "Change the value that the message names.";
    case ErrorCode::Cancelled:
        break;
    case ErrorCode::Internal:
        return "This is a mistake of the program; its log has more about it.";
    }
    return {};
}

} // namespace

Notice failureNotice(std::string title, const Error& error, std::string hint) {
    if (hint.empty()) hint = hintFor(error.code);
    return {Notice::Kind::Error, std::move(title), error.describe(), std::move(hint)};
}

std::string shortName(const std::string& source) {
    if (source == "rest:open") return "the open body";
    const std::filesystem::path path(source.starts_with("rest:") ? source.substr(5) : source);
    if (path.parent_path().filename() == kRunCheckpointFolder) { // "casual, step 1200"
        const std::string step = path.filename().string();
        return path.parent_path().parent_path().filename().string() + ", step " +
               step.substr(std::min(step.find_first_not_of('0'), step.size() - 1));
    }
    const std::filesystem::path name = path.has_filename() ? path.filename() : path.parent_path().filename();
    return name.empty() ? source : name.string();
}

} // namespace ars
