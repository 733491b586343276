#include "model/run/status_keeper.h"

#include "engine/core/log.h"
#include "model/run/run_failure.h"

#include <fmt/format.h>

#include <chrono>

namespace ars {
namespace {

constexpr std::chrono::milliseconds kRefresh{1000};

} // namespace

StatusKeeper::StatusKeeper(RunWriter& writer) : writer_(writer), status_(writer.lastStatus()) {
    thread_ = std::thread([this] { refresh(); });
}

StatusKeeper::~StatusKeeper() { stopRefreshing(); }

void StatusKeeper::stopRefreshing() {
    {
        const std::lock_guard guard(wakeMutex_);
        ended_ = true;
    }
    wake_.notify_all();
    if (thread_.joinable()) thread_.join();
}

void StatusKeeper::refresh() {
    bool told = false;
    std::unique_lock lock(wakeMutex_);
    while (!wake_.wait_for(lock, kRefresh, [this] { return ended_; })) {
        lock.unlock();
        // No exception may leave the thread: where memory is short the next second may have some again.
        const Status written = withoutExceptions<Status>(
            "status.json", [this] { return runStateNeedsProcess(status().state) ? write() : Status(); });
        // The work itself notices what it cannot write; a full disk that has room again a minute later ends no run.
        if (!written && !told) logWarning("{}", written.error().describe());
        told = !written;
        lock.lock();
    }
}

Status StatusKeeper::write() {
    const std::lock_guard file(fileMutex_);
    return writer_.writeStatus(status());
}

Status StatusKeeper::go(RunState state, const Change& change) {
    {
        const std::lock_guard guard(valuesMutex_);
        if (!runStateMayFollow(status_.state, state)) {
            return makeError(ErrorCode::Internal, "run",
                             fmt::format("{} cannot follow {}", runStateName(state), runStateName(status_.state)));
        }
        status_.state = state;
        if (change) change(status_);
    }
    return write();
}

void StatusKeeper::change(const Change& change) {
    const std::lock_guard guard(valuesMutex_);
    change(status_);
}

RunStatus StatusKeeper::status() const {
    const std::lock_guard guard(valuesMutex_);
    return status_;
}

Status StatusKeeper::discard(const std::string& note) {
    stopRefreshing();
    ARS_TRY_STATUS(writer_.discard());
    change([&](RunStatus& status) {
        status = RunStatus();
        status.note = note;
    });
    return {};
}

} // namespace ars
