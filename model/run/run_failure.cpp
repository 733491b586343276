#include "model/run/run_failure.h"

#include "engine/core/buffer.h"
#include "engine/core/standard_exception.h"
#include "model/operators/surfel_operators.h"

#include <c10/util/Exception.h>
#include <fmt/format.h>

#include <charconv>
#include <optional>
#include <string>

namespace ars {
namespace {

std::string_view firstLine(std::string_view text) { return text.substr(0, text.find('\n')); }

/// "you tried to allocate 1234 bytes" (host), "Tried to allocate 1.20 GiB" (CUDA).
std::optional<std::string> wantedMemory(std::string_view text) {
    constexpr std::string_view key = "ried to allocate ";
    const std::size_t place = text.find(key);
    if (place == std::string_view::npos) return std::nullopt;
    const std::string_view rest = text.substr(place + key.size());
    std::uint64_t bytes = 0;
    const auto [end, failure] = std::from_chars(rest.data(), rest.data() + rest.size(), bytes);
    const std::string_view unit = rest.substr(static_cast<std::size_t>(end - rest.data()));
    if (failure == std::errc() && unit.substr(0, 6) == " bytes") return formatBytes(bytes);
    return std::string(rest.substr(0, rest.find(". ")));
}

bool saysOutOfMemory(std::string_view text) {
    // oneDNN, which convolves, says of refused memory only that it could not make the thing that needs it; our shapes
    // give it no other reason.
    for (const std::string_view sign : {"not enough memory", "can't allocate memory", "out of memory",
                                        "could not create a primitive", "could not create a memory object"}) {
        if (text.find(sign) != std::string_view::npos) return true;
    }
    return false;
}

Error outOfMemory(std::string_view doing, std::string_view text) {
    const auto wanted = wantedMemory(text);
    return makeError(ErrorCode::OutOfMemory, std::string(doing),
                     wanted ? fmt::format("not enough memory: {} were refused", *wanted)
                            : std::string("not enough memory"));
}

} // namespace

Error errorOfException(std::string_view doing) {
    try {
        throw;
    } catch (const OperatorFailure& failure) {
        return failure.error();
    } catch (const c10::Error& failure) {
        const std::string_view text = failure.what_without_backtrace();
        if (saysOutOfMemory(text)) return outOfMemory(doing, text);
        return makeError(ErrorCode::Internal, std::string(doing), std::string(firstLine(text)));
    } catch (const std::exception& failure) {
        const std::string_view text = failure.what();
        if (saysOutOfMemory(text)) return outOfMemory(doing, text);
        Error error = errorOfStandardException(failure, std::string(doing));
        error.message = std::string(firstLine(error.message));
        return error;
    } catch (...) {
        return makeError(ErrorCode::Internal, std::string(doing), "an exception of unknown kind");
    }
}

} // namespace ars
