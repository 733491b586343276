#include "model/run/run_writer.h"

#include "engine/core/buffer.h"
#include "engine/core/file.h"
#include "engine/core/log.h"
#include "model/run/run_failure.h"
#include "model/run/run_lock.h"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstring>
#include <fstream>

namespace ars {
namespace fs = std::filesystem;
namespace {

using Json = nlohmann::json;

/// Room that is kept so that status.json can still say what happened when the disk is full.
constexpr const char* kReserveFile = ".reserve";
constexpr off_t kReserveBytes = 64 << 10;
constexpr std::string_view kPartialEnding = ".partial";
constexpr std::string_view kCompleteFile = "complete.json";

std::string textOf(const Json& json, int indent) {
    return json.dump(indent, ' ', false, Json::error_handler_t::replace) + "\n";
}

std::string stepName(std::int64_t step) { return fmt::format("{:08}", step); }

/// A kilobyte figure of /proc/self/status ("VmRSS:"), bytes.
std::uint64_t processMemory(std::string_view key) {
    std::ifstream file("/proc/self/status");
    for (std::string line; std::getline(file, line);) {
        if (line.compare(0, key.size(), key) == 0) return std::strtoull(line.c_str() + key.size(), nullptr, 10) * 1024;
    }
    return 0;
}

void makeReserve(const fs::path& folder) {
    const int descriptor = ::open((folder / kReserveFile).c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0666);
    if (descriptor < 0) return;
    [[maybe_unused]] const int ignored = ::posix_fallocate(descriptor, 0, kReserveBytes);
    ::close(descriptor);
}

Error removalError(const fs::path& path, const std::error_code& failure) {
    return makeError(ErrorCode::Io, path.string(), fmt::format("cannot be removed: {}", failure.message()));
}

/// What an earlier attempt to make the run, or whoever started us, may have left before there was a config.
bool mayPrecedeRun(const std::string& name) {
    for (const char* ours : {kRunLockFile, kRunStatusFile, kRunLogFile, kRunControlFile, kReserveFile}) {
        if (name == ours || name.find(std::string(ours) + ".tmp-") == 0) return true;
    }
    return name.find(std::string(kRunConfigFile) + ".tmp-") == 0;
}

Status checkRoomForRun(const fs::path& folder) {
    std::error_code failure;
    if (fs::exists(folder / kRunConfigFile, failure)) {
        return makeError(ErrorCode::InvalidArgument, folder.string(),
                         "there is a run in this folder already; resume it or choose another folder");
    }
    for (fs::directory_iterator it(folder, failure), end; !failure && it != end; it.increment(failure)) {
        const std::string name = it->path().filename().string();
        if (mayPrecedeRun(name)) continue;
        return makeError(ErrorCode::InvalidArgument, folder.string(),
                         fmt::format("expected a new or empty folder, found \"{}\" in it", name));
    }
    return {};
}

/// Size of all files below a folder, bytes.
std::uint64_t treeBytes(const fs::path& folder) {
    std::uint64_t bytes = 0;
    std::error_code failure;
    for (fs::recursive_directory_iterator it(folder, failure), end; !failure && it != end; it.increment(failure)) {
        std::error_code ignored;
        if (it->is_regular_file(ignored)) bytes += it->file_size(ignored);
    }
    return bytes;
}

/// Where the row after `step` begins, or the unfinished line that a killed process left; the size when there is none.
Result<std::uint64_t> endOfMetrics(const fs::path& path, std::int64_t step) {
    std::ifstream file(path, std::ios::binary);
    if (!file) return makeError(ErrorCode::Io, path.string(), "cannot be read");
    std::uint64_t offset = 0;
    for (std::string line; std::getline(file, line);) {
        if (file.eof()) return offset; // no line end
        const Json json = Json::parse(line, nullptr, false);
        const auto row = json.is_object() ? metricsRowFromJson(json) : makeError(ErrorCode::BadFile, "", "no object");
        if (row && row->step > step) return offset;
        offset += line.size() + 1;
    }
    return offset;
}

Status cutFile(const fs::path& path, std::uint64_t bytes) {
    const int descriptor = ::open(path.c_str(), O_WRONLY | O_CLOEXEC);
    const bool cut =
        descriptor >= 0 && ::ftruncate(descriptor, static_cast<off_t>(bytes)) == 0 && ::fsync(descriptor) == 0;
    const int number = errno;
    if (descriptor >= 0) ::close(descriptor);
    if (cut) return {};
    return makeError(ErrorCode::Io, path.string(), fmt::format("cannot be cut: {}", std::strerror(number)));
}

} // namespace

Status RunWriter::lockFolder() {
    ARS_TRY(lock_, takeRunLock(folder_ / kRunLockFile));
    return {};
}

Result<std::unique_ptr<RunWriter>> RunWriter::create(const fs::path& folder, const nlohmann::json& config) {
    std::unique_ptr<RunWriter> writer(new RunWriter);
    writer->folder_ = folder;
    std::error_code failure;
    if (fs::exists(folder, failure)) {
        if (!fs::is_directory(folder, failure)) {
            return makeError(ErrorCode::InvalidArgument, folder.string(), "expected a folder, found a file");
        }
        ARS_TRY_STATUS(checkRoomForRun(folder)); // before a lock file is made in a folder that is none of ours
    }
    fs::create_directories(folder, failure);
    if (failure) {
        return makeError(ErrorCode::Io, folder.string(), fmt::format("cannot be made: {}", failure.message()));
    }
    ARS_TRY_STATUS(writer->lockFolder());
    ARS_TRY_STATUS(checkRoomForRun(folder)); // another process may have been first
    makeReserve(folder);
    ARS_TRY_STATUS(writer->writeStatus({}));
    // Last: what makes the folder a run, so that a run is never half there.
    ARS_TRY_STATUS(writeFileAtomic(folder / kRunConfigFile, textOf(config, 2)));
    return writer;
}

Result<std::unique_ptr<RunWriter>> RunWriter::open(const fs::path& folder) {
    std::error_code failure;
    if (!fs::is_regular_file(folder / kRunConfigFile, failure)) {
        return makeError(ErrorCode::NotFound, folder.string(), "this is no run folder: there is no config.json in it");
    }
    std::unique_ptr<RunWriter> writer(new RunWriter);
    writer->folder_ = folder;
    ARS_TRY_STATUS(writer->lockFolder());
    ARS_TRY_STATUS(writer->takeOver());
    return writer;
}

/// After an owner that died: its status becomes failed, and what it had half written goes.
Status RunWriter::takeOver() {
    std::error_code ignored;
    for (const fs::path& parent : {folder_, folder_ / kRunCheckpointFolder, folder_ / kRunPreviewFolder}) {
        std::vector<fs::path> leftovers;
        for (fs::directory_iterator it(parent, ignored), end; !ignored && it != end; it.increment(ignored)) {
            const std::string name = it->path().filename().string();
            if (it->path().extension() == kPartialEnding || name.find(".tmp-") != std::string::npos) {
                leftovers.push_back(it->path());
            }
        }
        for (const fs::path& leftover : leftovers) fs::remove_all(leftover, ignored);
    }
    makeReserve(folder_);
    const auto text = readTextFile(folder_ / kRunStatusFile);
    const Json json = text ? Json::parse(*text, nullptr, false) : Json();
    auto status = runStatusFromJson(json.is_object() ? json : Json::object());
    if (!status) {
        RunStatus lost;
        lost.note = "the former status.json could not be read";
        return writeStatus(lost);
    }
    lastStatus_ = *status;
    if (!runStateNeedsProcess(status->state)) return {};
    logWarning("{}: process {} on {} ended without a word at step {}; taken over", folder_.string(), status->process,
               status->host, status->step);
    status->error = "the process ended without a word";
    status->note = fmt::format("it was {} at step {}", runStateName(status->state), status->step);
    status->state = RunState::Failed;
    return writeStatus(*status);
}

RunWriter::~RunWriter() { releaseRunLock(lock_); }

Status RunWriter::writeStatus(RunStatus status) {
    status.memoryBytes = processMemory("VmRSS:");
    status.peakMemoryBytes = processMemory("VmHWM:");
    status.process = runStateNeedsProcess(status.state) ? ::getpid() : 0;
    status.host = hostName();
    status.updatedUnixS = std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
    const std::lock_guard guard(statusMutex_);
    std::error_code ignored;
    if (!fs::is_directory(folder_, ignored)) {
        return makeError(ErrorCode::NotFound, folder_.string(), "the run folder was removed");
    }
    const std::string text = textOf(runStatusToJson(status), 2);
    Status written = writeFileAtomic(folder_ / kRunStatusFile, text);
    if (!written && fs::remove(folder_ / kReserveFile, ignored)) {
        written = writeFileAtomic(folder_ / kRunStatusFile, text);
    }
    if (written) lastStatus_ = std::move(status);
    return written;
}

RunStatus RunWriter::lastStatus() const {
    const std::lock_guard guard(statusMutex_);
    return lastStatus_;
}

Status RunWriter::appendMetrics(const MetricsRow& row) {
    const fs::path path = folder_ / kRunMetricsFile;
    const std::string line = textOf(metricsRowToJson(row), -1);
    const int descriptor = ::open(path.c_str(), O_WRONLY | O_APPEND | O_CREAT | O_CLOEXEC, 0666);
    if (descriptor < 0) {
        return makeError(ErrorCode::Io, path.string(), fmt::format("cannot be opened: {}", std::strerror(errno)));
    }
    const off_t before = ::lseek(descriptor, 0, SEEK_END);
    errno = ENOSPC; // a short write says nothing of itself
    const bool whole = ::write(descriptor, line.data(), line.size()) == static_cast<ssize_t>(line.size());
    const int number = errno;
    if (!whole) [[maybe_unused]]
        const int ignored = ::ftruncate(descriptor, before);
    ::close(descriptor);
    if (whole) return {};
    return makeError(ErrorCode::Io, path.string(),
                     fmt::format("the row of step {} cannot be written: {}", row.step, std::strerror(number)));
}

Status RunWriter::rewriteConfig(const nlohmann::json& config, std::int64_t step) {
    ARS_TRY(const std::string former, readTextFile(folder_ / kRunConfigFile));
    fs::path kept = folder_ / fmt::format("config.{}.json", step);
    std::error_code ignored;
    for (int i = 2; fs::exists(kept, ignored); ++i) kept = folder_ / fmt::format("config.{}-{}.json", step, i);
    ARS_TRY_STATUS(writeFileAtomic(kept, former));
    return writeFileAtomic(folder_ / kRunConfigFile, textOf(config, 2));
}

std::string RunWriter::intactCheckpoint() const {
    const auto entries = listCheckpoints(folder_);
    if (!entries || entries->empty()) return "there is no earlier checkpoint";
    return fmt::format("the checkpoint of step {} is intact", entries->back().step);
}

Status RunWriter::writeCheckpointFolder(std::int64_t step, const CheckpointPolicy& policy, const fs::path& temporary,
                                        const std::function<Status(const fs::path&)>& write) {
    std::error_code failure;
    fs::create_directories(temporary, failure);
    if (failure) {
        return makeError(ErrorCode::Io, temporary.string(), fmt::format("cannot be made: {}", failure.message()));
    }
    ARS_TRY_STATUS(write(temporary));
    const bool kept = policy.milestoneSteps > 0 && step % policy.milestoneSteps == 0;
    const Json mark{{"step", step}, {"kept", kept}, {"bytes", treeBytes(temporary)}};
    ARS_TRY_STATUS(writeFileAtomic(temporary / kCompleteFile, textOf(mark, 2)));
    ARS_TRY_STATUS(syncTree(temporary));
    // Rows up to this step must not be lost to a power cut that the checkpoint survives.
    if (fs::exists(folder_ / kRunMetricsFile, failure)) {
        const int descriptor = ::open((folder_ / kRunMetricsFile).c_str(), O_RDONLY | O_CLOEXEC);
        const bool synced = descriptor >= 0 && ::fsync(descriptor) == 0;
        if (descriptor >= 0) ::close(descriptor);
        if (!synced) return makeError(ErrorCode::Io, (folder_ / kRunMetricsFile).string(), "cannot be synced to disk");
    }
    fs::rename(temporary, temporary.parent_path() / stepName(step), failure);
    if (failure) {
        return makeError(ErrorCode::Io, temporary.string(),
                         fmt::format("cannot be put in place: {}", failure.message()));
    }
    return syncFolder(temporary.parent_path());
}

Status RunWriter::saveCheckpoint(std::int64_t step, const CheckpointPolicy& policy,
                                 const std::function<Status(const fs::path&)>& write) {
    const fs::path place = folder_ / kRunCheckpointFolder / stepName(step);
    ARS_TRY(const std::vector<CheckpointEntry> entries, listCheckpoints(folder_));
    for (const CheckpointEntry& entry : entries) {
        if (entry.step == step) return {};
    }
    std::error_code ignored;
    if (!entries.empty()) {
        const std::uint64_t wanted = treeBytes(entries.back().folder);
        const std::uint64_t available = fs::space(folder_, ignored).available;
        if (!ignored && available < wanted) {
            return makeError(ErrorCode::Io, place.string(),
                             fmt::format("not enough disk for {}, {} free on that volume; {}", formatBytes(wanted),
                                         formatBytes(available), intactCheckpoint()));
        }
    }
    fs::remove_all(place, ignored); // incomplete: not one of ours, or it would have been listed
    const fs::path temporary = place.string() + std::string(kPartialEnding);
    // An exception, too, must not leave it half written.
    Status saved =
        withoutExceptions<Status>("saving", [&] { return writeCheckpointFolder(step, policy, temporary, write); });
    if (!saved) {
        fs::remove_all(temporary, ignored);
        Error error = std::move(saved).error();
        error.message += "; " + intactCheckpoint();
        return error;
    }
    prune(policy);
    return {};
}

/// What cannot be removed is only named: it takes room, but the run is sound.
void RunWriter::prune(const CheckpointPolicy& policy) {
    const auto entries = listCheckpoints(folder_);
    if (!entries) return;
    const auto newest = static_cast<std::size_t>(std::max(policy.newest, 1));
    for (std::size_t i = 0; i + newest < entries->size(); ++i) {
        const CheckpointEntry& entry = (*entries)[i];
        if (entry.kept) continue;
        // Out of the list first, in one move, so that nobody opens one that is half removed.
        const fs::path doomed = entry.folder.string() + std::string(kPartialEnding);
        std::error_code failure;
        fs::rename(entry.folder, doomed, failure);
        if (!failure) fs::remove_all(doomed, failure);
        if (failure) logWarning("{}: cannot be removed: {}", entry.folder.string(), failure.message());
    }
}

Status RunWriter::truncateAfter(std::int64_t step) {
    ARS_TRY(const std::vector<CheckpointEntry> entries, listCheckpoints(folder_));
    // Newest first: if this is interrupted, what is left is still the run up to some step.
    for (auto entry = entries.rbegin(); entry != entries.rend() && entry->step > step; ++entry) {
        const fs::path doomed = entry->folder.string() + std::string(kPartialEnding);
        std::error_code failure;
        fs::rename(entry->folder, doomed, failure);
        if (failure) return removalError(entry->folder, failure);
        fs::remove_all(doomed, failure);
    }
    const fs::path metrics = folder_ / kRunMetricsFile;
    std::error_code ignored;
    if (!fs::exists(metrics, ignored)) return {};
    ARS_TRY(const std::uint64_t end, endOfMetrics(metrics, step));
    if (end == fs::file_size(metrics, ignored)) return {};
    return cutFile(metrics, end);
}

Status RunWriter::setAside(std::int64_t step) {
    const fs::path place = folder_ / kRunCheckpointFolder / stepName(step);
    fs::path aside = place.string() + ".broken";
    std::error_code failure;
    for (int i = 2; fs::exists(aside, failure); ++i) aside = fmt::format("{}.broken{}", place.string(), i);
    fs::rename(place, aside, failure);
    if (failure) {
        return makeError(ErrorCode::Io, place.string(), fmt::format("cannot be set aside: {}", failure.message()));
    }
    return syncFolder(place.parent_path());
}

std::optional<RunRequest> RunWriter::takeRequest() {
    const fs::path control = folder_ / kRunControlFile;
    const fs::path taken = control.string() + std::string(kPartialEnding);
    // One move: a request that comes in meanwhile is the next one, not lost.
    if (::rename(control.c_str(), taken.c_str()) != 0) return std::nullopt;
    const auto text = readTextFile(taken);
    std::error_code ignored;
    fs::remove(taken, ignored);
    const Json json = text ? Json::parse(*text, nullptr, false) : Json();
    const bool named = json.is_object() && json.contains("request") && json["request"].is_string();
    const auto request = named ? runRequestFromName(json["request"].get<std::string>()) : std::nullopt;
    if (!request) {
        logWarning("{}: no request that is known (pause, resume, save, stop, discard); left out", control.string());
        return std::nullopt;
    }
    const auto process = json.find("process");
    if (process != json.end() && *process != Json(::getpid())) {
        logWarning("{}: \"{}\" was meant for process {}; left out", control.string(), runRequestName(*request),
                   process->dump());
        return std::nullopt;
    }
    return request;
}

Status RunWriter::discard() {
    const std::lock_guard guard(statusMutex_);
    // The config first: from then on it is no run, whatever happens to the rest.
    std::error_code failure;
    fs::remove(folder_ / kRunConfigFile, failure);
    if (!failure) fs::remove_all(folder_, failure);
    if (failure) return removalError(folder_, failure);
    return {};
}

} // namespace ars
