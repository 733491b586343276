#pragma once

#include "engine/core/error.h"

#include <nlohmann/json_fwd.hpp>

#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace ars {

/// What a training run is doing; the only states there are (docs/user/training.md has the picture of their order).
enum class RunState { Idle, Loading, Running, Pausing, Paused, Saving, Stopping, Finished, Failed };
inline constexpr std::array<std::string_view, 9> kRunStateNames{"idle",   "loading",  "running",  "pausing", "paused",
                                                                "saving", "stopping", "finished", "failed"};
std::string_view runStateName(RunState state);
std::optional<RunState> runStateFromName(std::string_view name);
/// Whether a process must be at work in this state (loading to stopping).
bool runStateNeedsProcess(RunState state);
/// The table of transitions: whether status.json may say `to` after `from`. The same state again is always allowed.
bool runStateMayFollow(RunState from, RunState to);

/// status.json of a run folder, rewritten atomically at least every two seconds while a process works on it.
struct RunStatus {
    RunState state = RunState::Idle;
    std::string stage;     ///< "template", "radiance", "pbr"
    std::int64_t step = 0; ///< steps done, all stages
    std::int64_t totalSteps = 0;
    double stepMs = 0;             ///< mean of the last steps
    double etaS = 0;               ///< seconds to the end at this pace
    std::uint64_t memoryBytes = 0; ///< resident now
    std::uint64_t peakMemoryBytes = 0;
    std::map<std::string, double> losses; ///< last values, weighted, and "total"; not a number is null in the file
    std::string error;                    ///< one sentence when failed
    std::string note;                     ///< e.g. why it stopped early
    int process = 0;                      ///< its id; 0: none works on it
    std::string host;
    double updatedUnixS = 0;
    std::string checkpoint; ///< newest complete one, relative ("checkpoints/00001200")
};
nlohmann::json runStatusToJson(const RunStatus& status);
/// BadFile naming the key.
Result<RunStatus> runStatusFromJson(const nlohmann::json& json);

/// One line of metrics.jsonl.
struct MetricsRow {
    std::int64_t step = 0;
    std::string stage;
    std::map<std::string, double>
        values; ///< "loss.l1", "rate.network", "time.step_ms", "memory.resident_mb", "radius.hip"
};
nlohmann::json metricsRowToJson(const MetricsRow& row);
Result<MetricsRow> metricsRowFromJson(const nlohmann::json& json);

/// A checkpoint, complete: its folder has "complete.json".
struct CheckpointEntry {
    std::int64_t step = 0;
    std::filesystem::path folder;
    bool kept = false; ///< a milestone that pruning never takes
};

/// What may be asked of a run through its control file.
enum class RunRequest { Pause, Resume, Save, Stop, Discard };
std::string_view runRequestName(RunRequest request);
std::optional<RunRequest> runRequestFromName(std::string_view name);

/// Names inside a run folder.
inline constexpr const char* kRunConfigFile = "config.json";
inline constexpr const char* kRunStatusFile = "status.json";
inline constexpr const char* kRunMetricsFile = "metrics.jsonl";
inline constexpr const char* kRunControlFile = "control.json";
inline constexpr const char* kRunLockFile = "owner.lock";
inline constexpr const char* kRunCheckpointFolder = "checkpoints";
inline constexpr const char* kRunPreviewFolder = "previews";
inline constexpr const char* kRunLogFile = "log.txt";

/// Whether the folder is one (has config.json and status.json of ours).
bool looksLikeRunFolder(const std::filesystem::path& folder);
/// Whether there is a run, in whatever state its status.json is: what a resume asks for.
bool holdsRun(const std::filesystem::path& folder);
/// The status as it stands; a state that needs a process whose lock nobody holds any more is told as Failed with
/// "the process ended without a word".
Result<RunStatus> readRunStatus(const std::filesystem::path& folder);
Result<nlohmann::json> readRunConfig(const std::filesystem::path& folder);
/// Complete checkpoints, oldest first.
Result<std::vector<CheckpointEntry>> listCheckpoints(const std::filesystem::path& folder);
/// Preview pictures, oldest first.
std::vector<std::filesystem::path> listPreviews(const std::filesystem::path& folder);
/// Whether a live process works on the run: it holds the lock, or runOwnerElsewhere names it. Only asks: it never
/// stands in the way of a process that wants the lock.
bool runOwned(const std::filesystem::path& folder);

/// Who wrote owner.lock last; whether it still lives is runOwned's to say.
struct RunOwner {
    int process = 0; ///< 0: nobody
    std::string host;
};
RunOwner readRunOwner(const std::filesystem::path& folder);
/// How old a status of another machine may be and still be a sign of life, seconds: a process writes it at least every
/// two seconds, and the clocks of two machines differ.
inline constexpr double kFreshStatusS = 10.0;
/// The process that works on the run on another machine, as status.json tells: where a folder is shared by a file
/// system that keeps locks to one machine (sshfs, some of NFS) nothing else shows it. Nobody where the status is older
/// than kFreshStatusS, or later than now by as much.
RunOwner runOwnerElsewhere(const std::filesystem::path& folder);
/// This machine's name; "unknown" where it has none.
std::string hostName();

/// Reads metrics.jsonl piece by piece while it grows; a half-written last line waits for its end, a broken one is
/// skipped and counted. After a resume from an older checkpoint rows of later steps are superseded: `rows` holds each
/// step once, the last written, in increasing order. A file that was cut or replaced is read anew.
class MetricsFollower {
public:
    explicit MetricsFollower(std::filesystem::path folder) : folder_(std::move(folder)) {}
    /// True when something was added.
    Result<bool> poll();
    const std::vector<MetricsRow>& rows() const { return rows_; }
    int brokenLines() const { return broken_; }

private:
    void takeLine(std::string_view line);
    void startAgain();

    std::filesystem::path folder_;
    std::uint64_t offset_ = 0; ///< behind the last complete line
    std::string lastLine_;     ///< that line: still standing there, or the file is another one
    std::vector<MetricsRow> rows_;
    int broken_ = 0;
};

/// Writes the control file for the process that owns the run, which takes it within a step. Unavailable when none does.
Status requestOfRun(const std::filesystem::path& folder, RunRequest request);

} // namespace ars
