#pragma once

#include "engine/core/error.h"
#include "engine/scene/run_folder.h"
#include "model/run/run_writer.h"

#include <condition_variable>
#include <functional>
#include <mutex>
#include <thread>

namespace ars {

/// The one copy of what status.json says. Changes of state are written at once; a thread of its own writes it anew
/// every second, so that readers see life during a long step too.
class StatusKeeper {
public:
    using Change = std::function<void(RunStatus&)>;

    /// Starts from the writer's last status: its checkpoint and step stand until there are newer ones.
    explicit StatusKeeper(RunWriter& writer);
    ~StatusKeeper();
    StatusKeeper(const StatusKeeper&) = delete;
    StatusKeeper& operator=(const StatusKeeper&) = delete;

    /// Goes to a state and writes it, with another change in the same write. Internal for a transition that is not in
    /// the table (nothing is written then).
    Status go(RunState state, const Change& change = {});
    /// Told with the next write.
    void change(const Change& change);
    RunStatus status() const;
    /// Removes the run's folder; nothing is written any more, and the status is idle with this note.
    Status discard(const std::string& note);

private:
    void refresh();
    void stopRefreshing();
    Status write();

    RunWriter& writer_;
    mutable std::mutex valuesMutex_; ///< held shortly
    RunStatus status_;
    std::mutex fileMutex_; ///< held while a file is written, so that an older status never follows a newer one
    std::mutex wakeMutex_;
    std::condition_variable wake_;
    bool ended_ = false;
    std::thread thread_;
};

} // namespace ars
