#pragma once

#include "engine/core/error.h"

#include <nlohmann/json.hpp>

#include <string>

namespace ars::app {

/// JSON whose keys stay in the order in which they were added: results read like the text they stand for.
using Json = nlohmann::ordered_json;

/// Exit codes; a signal that ends the program gives 128 + its number.
inline constexpr int kSuccess = 0;
inline constexpr int kFailure = 1;
inline constexpr int kWrongUsage = 2;

/// How a command talks, the same for all.
struct OutputOptions {
    bool json = false;  ///< results and errors as JSON on standard output
    bool quiet = false; ///< no progress, no notes
};

/// Prints a result on standard output.
void printJson(const Json& value);
Json errorJson(const Error& error);

/// Prints "error: <one sentence>" on standard error, or {"error": ...} on standard output, and returns the exit code:
/// kWrongUsage for an InvalidArgument whose place is an option ("--frames"), else kFailure.
int reportError(const Error& error, const OutputOptions& output);

/// Prints "note: ..." on standard error unless quiet.
void printNote(const std::string& text, const OutputOptions& output);

} // namespace ars::app
