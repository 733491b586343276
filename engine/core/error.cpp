#include "engine/core/error.h"

namespace ars {

std::string_view errorCodeName(ErrorCode code) {
    switch (code) {
    case ErrorCode::InvalidArgument:
        return "invalid_argument";
    case ErrorCode::NotFound:
        return "not_found";
    case ErrorCode::BadFile:
        return "bad_file";
    case ErrorCode::Unsupported:
        return "unsupported";
    case ErrorCode::LimitExceeded:
        return "limit_exceeded";
    case ErrorCode::OutOfMemory:
        return "out_of_memory";
    case ErrorCode::Io:
        return "io";
    case ErrorCode::Unavailable:
        return "unavailable";
    case ErrorCode::Cancelled:
        return "cancelled";
    case ErrorCode::Internal:
        return "internal";
    }
    return "internal";
}

std::string Error::describe() const {
    std::string text = place.empty() ? message : fmt::format("{}: {}", place, message);
    for (const std::string& line : context) text += fmt::format(" (while {})", line);
    // One sentence is one line, whatever a hostile file put into a name.
    for (char& c : text) {
        if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = ' ';
    }
    return text;
}

Error makeError(ErrorCode code, std::string place, std::string message, SourceLocation origin) {
    return Error{code, std::move(message), std::move(place), {}, origin};
}

Error atPlace(Error error, std::string_view place) {
    error.place = error.place.empty() ? std::string(place) : fmt::format("{}: {}", place, error.place);
    return error;
}

Error withContext(Error error, std::string context) {
    error.context.push_back(std::move(context));
    return error;
}

} // namespace ars
