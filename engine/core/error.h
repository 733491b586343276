#pragma once

#include <fmt/format.h>

#include <cassert>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

namespace ars {

/// A line of source. Stands in for std::source_location, which clang before 16 does not have with this standard
/// library.
class SourceLocation {
public:
    static constexpr SourceLocation current(const char* file = __builtin_FILE(), unsigned line = __builtin_LINE(),
                                            const char* function = __builtin_FUNCTION()) {
        SourceLocation location;
        location.file_ = file;
        location.line_ = line;
        location.function_ = function;
        return location;
    }
    constexpr const char* fileName() const { return file_; }
    constexpr unsigned line() const { return line_; }
    constexpr const char* functionName() const { return function_; }

private:
    const char* file_ = "";
    unsigned line_ = 0;
    const char* function_ = "";
};

/// What kind of thing went wrong, for code that must act on it. People read the message.
enum class ErrorCode {
    InvalidArgument, ///< a caller or a command line asked for something impossible
    NotFound,        ///< a file, key, joint or device that does not exist
    BadFile,         ///< a file that is broken: wrong magic, truncated, inconsistent, hostile
    Unsupported,     ///< a sound file or request that this program does not handle
    LimitExceeded,   ///< more memory, joints, pixels... than a stated limit allows
    OutOfMemory,     ///< the host or a device refused an allocation
    Io,              ///< the operating system refused: permission, disk full, broken pipe
    Unavailable,     ///< a device, library or display that is not here
    Cancelled,       ///< stopped on request
    Internal,        ///< a mistake of this program
};

/// Lower-case name, as it stands in JSON ("bad_file").
std::string_view errorCodeName(ErrorCode code);

/// One failure in words a person can act on.
///
/// `place` says where in the user's world (a file, a key, a row), `message` what was expected and what was found, and
/// `context` what was being done, innermost first. `origin` is the line of source, for the log only.
struct Error {
    ErrorCode code = ErrorCode::Internal;
    std::string message;
    std::string place;
    std::vector<std::string> context;
    SourceLocation origin;

    /// "place: message (while ...)", one line, no trailing period.
    std::string describe() const;
};

/// An error with a formatted message. `place` may be empty: whoever knows the file adds it with Error::at or
/// ARS_TRY_AT.
Error makeError(ErrorCode code, std::string place, std::string message,
                SourceLocation origin = SourceLocation::current());

/// The same error with `place` put before the place that it already has: "file" + "chunk 2" -> "file: chunk 2".
Error atPlace(Error error, std::string_view place);

/// The same error with one more line of what was being done.
Error withContext(Error error, std::string context);

/// A value or an Error. Never both, never neither.
template <typename T>
class [[nodiscard]] Result {
public:
    Result(T value) : state_(std::in_place_index<0>, std::move(value)) {}
    Result(Error error) : state_(std::in_place_index<1>, std::move(error)) {}

    bool ok() const { return state_.index() == 0; }
    explicit operator bool() const { return ok(); }

    T& value() & {
        assert(ok());
        return std::get<0>(state_);
    }
    const T& value() const& {
        assert(ok());
        return std::get<0>(state_);
    }
    T&& value() && {
        assert(ok());
        return std::get<0>(std::move(state_));
    }
    T& operator*() & { return value(); }
    const T& operator*() const& { return value(); }
    T&& operator*() && { return std::move(*this).value(); }
    T* operator->() { return &value(); }
    const T* operator->() const { return &value(); }

    const Error& error() const& {
        assert(!ok());
        return std::get<1>(state_);
    }
    Error&& error() && {
        assert(!ok());
        return std::get<1>(std::move(state_));
    }

private:
    std::variant<T, Error> state_;
};

/// Success or an Error.
class [[nodiscard]] Status {
public:
    Status() = default;
    Status(Error error) : error_(std::move(error)) {}

    bool ok() const { return !error_.has_value(); }
    explicit operator bool() const { return ok(); }
    const Error& error() const& {
        assert(!ok());
        return *error_;
    }
    Error&& error() && {
        assert(!ok());
        return std::move(*error_);
    }

private:
    std::optional<Error> error_;
};

} // namespace ars

#define ARS_CONCAT_INNER(a, b) a##b
#define ARS_CONCAT(a, b) ARS_CONCAT_INNER(a, b)

/// ARS_TRY(auto mesh, readPly(path)); returns the error from the enclosing function, else declares the value.
#define ARS_TRY(declaration, expression)                                                                               \
    auto ARS_CONCAT(arsResult, __LINE__) = (expression);                                                               \
    if (!ARS_CONCAT(arsResult, __LINE__)) return std::move(ARS_CONCAT(arsResult, __LINE__)).error();                   \
    declaration = std::move(ARS_CONCAT(arsResult, __LINE__)).value()

/// ARS_TRY_STATUS(checkShape(a)); returns the error from the enclosing function, else goes on.
#define ARS_TRY_STATUS(expression)                                                                                     \
    do {                                                                                                               \
        if (auto arsStatus = (expression); !arsStatus) return std::move(arsStatus).error();                            \
    } while (false)
