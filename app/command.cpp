#include "app/command.h"

#include "app/text.h"

#include <fmt/format.h>

#include <cstdio>

namespace ars::app {

void printJson(const Json& value) {
    // Names from files need not be UTF-8.
    fmt::print("{}\n", value.dump(2, ' ', false, Json::error_handler_t::replace));
    std::fflush(stdout);
}

Json errorJson(const Error& error) {
    Json json{{"code", errorCodeName(error.code)}, {"message", printable(error.message)}};
    json["place"] = printable(error.place);
    if (!error.context.empty()) json["context"] = error.context;
    return json;
}

int reportError(const Error& error, const OutputOptions& output) {
    if (output.json) {
        printJson({{"error", errorJson(error)}});
    } else {
        std::fflush(stdout);
        fmt::print(stderr, "error: {}\n", printable(error.describe()));
    }
    // What is wrong with an option is told at its name.
    return error.code == ErrorCode::InvalidArgument && error.place.starts_with("--") ? kWrongUsage : kFailure;
}

void printNote(const std::string& text, const OutputOptions& output) {
    if (!output.quiet) fmt::print(stderr, "note: {}\n", printable(text));
}

} // namespace ars::app
