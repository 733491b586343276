#pragma once

#include "app/command.h"
#include "engine/core/error.h"

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace ars::app {

/// One thing that is known about a file, for people and for machines.
struct Fact {
    std::string key;  ///< JSON key; people see it with blanks for '_'
    std::string text; ///< empty: for machines only
    Json value;
};

/// What `ars info` says of one file.
struct FileReport {
    std::string path;
    std::string kind = "unknown"; ///< what the content means: "body_model", "motion", "picture"...
    std::string format;           ///< what it is stored in: "npz", "exr"...
    std::string title;            ///< for people: "numpy archive, SMPL-X style body model"
    std::vector<Fact> facts;
    std::vector<std::string> warnings; ///< sound, but the user should know
    bool checked = false;              ///< everything was decoded and validated
    std::optional<Error> error;        ///< why it is not sound, or not read

    void add(std::string key, std::string text, Json value);
    void add(std::string key, std::string text); ///< the text is the value
    void warn(std::string text) { warnings.push_back(std::move(text)); }
    /// Ends the examination with the reason; the file's own path is taken off the error's place.
    void fail(const Error& reason);
    bool ok() const { return !error; }
    /// Neither sound nor broken: a file that this program does not read, or one that was looked at with --fast.
    bool undecided() const { return error ? error->code == ErrorCode::Unsupported : !checked; }
};

/// A head line, aligned facts, warnings, and the verdict.
std::string formatReport(const FileReport& report);
Json reportJson(const FileReport& report);

} // namespace ars::app
