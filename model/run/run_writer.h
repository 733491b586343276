#pragma once

#include "engine/core/error.h"
#include "engine/scene/run_folder.h"

#include <nlohmann/json_fwd.hpp>

#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

namespace ars {

/// How checkpoints are kept: the newest `newest`, and every one at a multiple of `milestoneSteps` (0: none) for ever.
struct CheckpointPolicy {
    int newest = 3;
    std::int64_t milestoneSteps = 0;
};

/// The one writer of a run folder. It holds the run's lock (an advisory lock on owner.lock that dies with the process)
/// as long as it lives. Status, metrics and requests may be used from different threads; the rest from one.
class RunWriter {
public:
    /// Makes the folder with its config. InvalidArgument for a folder that holds a run already, or anything that is no
    /// part of one; Unavailable naming the process that owns it.
    static Result<std::unique_ptr<RunWriter>> create(const std::filesystem::path& folder, const nlohmann::json& config);
    /// Opens one that exists, takes it over from an owner that died (the status then says so: failed), and removes what
    /// that one left half written. NotFound for a folder that is no run; Unavailable naming the process that owns it.
    static Result<std::unique_ptr<RunWriter>> open(const std::filesystem::path& folder);
    RunWriter(const RunWriter&) = delete;
    RunWriter& operator=(const RunWriter&) = delete;
    ~RunWriter();

    const std::filesystem::path& folder() const { return folder_; }
    /// Memory, host, process (0 in states that need none) and time are filled in here. Does not bring back a folder
    /// that somebody removed: NotFound.
    Status writeStatus(RunStatus status);
    /// The last status written, with what was filled in.
    RunStatus lastStatus() const;
    /// Appends one line in a single write; after a failure (a full disk) no part of it stands there.
    Status appendMetrics(const MetricsRow& row);
    /// config.json anew (resume under other parameters); the older one is kept as config.STEP.json.
    Status rewriteConfig(const nlohmann::json& config, std::int64_t step);

    /// `write` fills a temporary folder, which is synced and renamed to checkpoints/STEP once complete; then older ones
    /// are pruned by the policy. After a failure nothing has changed (the temporary folder is removed), and the error
    /// says which checkpoint is intact. A complete checkpoint of this very step stays as it is: it holds the same.
    Status saveCheckpoint(std::int64_t step, const CheckpointPolicy& policy,
                          const std::function<Status(const std::filesystem::path&)>& write);
    /// Removes checkpoints after `step` and metrics rows after it: the run goes on from there.
    Status truncateAfter(std::int64_t step);
    /// Renames a checkpoint that does not restore to STEP.broken: it stays for who wants to look, and is never listed
    /// again.
    Status setAside(std::int64_t step);

    /// "the checkpoint of step N is intact", or that there is none yet: the end of every sentence about a failure.
    std::string intactCheckpoint() const;

    /// The request that waits in the control file, taken from it. What cannot be read, or was meant for an owner that
    /// is gone, is dropped with a line in the log.
    std::optional<RunRequest> takeRequest();
    /// Removes the whole folder (stop and discard).
    Status discard();

private:
    RunWriter() = default;
    Status lockFolder();
    Status takeOver();
    Status writeCheckpointFolder(std::int64_t step, const CheckpointPolicy& policy,
                                 const std::filesystem::path& temporary,
                                 const std::function<Status(const std::filesystem::path&)>& write);
    void prune(const CheckpointPolicy& policy);

    std::filesystem::path folder_;
    int lock_ = -1;
    mutable std::mutex statusMutex_;
    RunStatus lastStatus_;
};

} // namespace ars
