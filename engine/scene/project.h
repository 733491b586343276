#pragma once

#include "engine/core/error.h"
#include "engine/scene/document.h"

#include <nlohmann/json.hpp>

#include <chrono>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace ars {

/// Project files NAME.ars: JSON of the document. Paths are absolute in memory and, in the file, relative to its folder
/// where they lie on the same volume ("rest:" prefixes and words like "open" stay). Numbers read back exactly.
inline constexpr int kProjectFormat = 1;

/// @param folder  paths become relative to it; empty: they stay absolute
nlohmann::ordered_json documentToJson(const Document& document, const std::filesystem::path& folder = {});
/// Keys that are missing keep their default; unknown ones are ignored with a note, so that files of newer versions
/// open ("program", "picture" and "recovery" belong to others and are passed over). Keys of tracks out of order, a null
/// where a number should be (how JSON writes NaN) and rotations of another length are put right with a note. BadFile
/// with the key, what was expected and what was found; Unsupported for a newer format number.
Result<Document> documentFromJson(const nlohmann::ordered_json& json, const std::filesystem::path& folder = {},
                                  std::vector<std::string>* notes = nullptr);

Status saveProject(const std::filesystem::path& path, const Document& document);
Result<Document> readProject(const std::filesystem::path& path, std::vector<std::string>* notes = nullptr);

/// The document in a picture of this program (PNG and EXR: attribute "ars", MP4: comment, through ffprobe). NotFound
/// when it has none. Relative paths are meant from the picture's folder.
Result<Document> documentFromPicture(const std::filesystem::path& path, std::vector<std::string>* notes = nullptr);

/// $XDG_STATE_HOME/ars, else ~/.local/state/ars; ARS_STATE overrides. For autosave, recovery, recent files, settings.
std::filesystem::path stateFolder();

/// Saves a document every few seconds while it changes, on a thread of its own, so that a crash costs at most ten
/// seconds. One file per running program, named by its process; removed by a clean end.
class Autosave {
public:
    explicit Autosave(std::filesystem::path folder, std::chrono::milliseconds interval = std::chrono::seconds(5));
    ~Autosave(); ///< removes its file
    Autosave(const Autosave&) = delete;
    Autosave& operator=(const Autosave&) = delete;
    /// Takes a copy when `version` differs from the last; never waits for the disk.
    /// @param project  where the document lives; empty: not saved yet
    void update(const Document& document, std::uint64_t version, const std::filesystem::path& project);
    /// Writes what is still outstanding now (tests, clean end).
    void flush();
    std::optional<Error> takeError();

private:
    struct State;
    std::unique_ptr<State> state_;
};

/// What a crashed program left.
struct Recovery {
    std::filesystem::path file;
    std::filesystem::path project; ///< may be empty
    std::chrono::system_clock::time_point saved;
    Document document;
};
/// Files of programs that no longer run, newest first. Those without which nothing would be lost (the project holds the
/// same, or the document is the untouched new one) are removed; broken ones are renamed to NAME.broken with a line in
/// the log.
std::vector<Recovery> findRecoveries(const std::filesystem::path& folder);
void discardRecovery(const Recovery& recovery);

/// The files opened last, newest first, at most 20; survives in the state folder.
class RecentFiles {
public:
    explicit RecentFiles(std::filesystem::path folder);
    void add(const std::filesystem::path& path); ///< absolute; moves to the front
    const std::vector<std::filesystem::path>& files() const { return files_; }
    void clear();

private:
    Status save() const;
    std::filesystem::path file_;
    std::vector<std::filesystem::path> files_;
};

} // namespace ars
