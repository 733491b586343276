#include "engine/scene/run_folder.h"

#include "engine/core/file.h"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <chrono>
#include <cmath>
#include <limits>
#include <utility>

namespace ars {
namespace fs = std::filesystem;
namespace {

using Json = nlohmann::json;

constexpr std::array<std::string_view, 5> kRequestNames{"pause", "resume", "save", "stop", "discard"};
constexpr std::uint64_t kMaxSmallFile = 16u << 20; // status, configuration, control: a few kilobytes in truth

Error badFile(std::string place, std::string message) {
    return makeError(ErrorCode::BadFile, std::move(place), std::move(message));
}

Result<Json> readJson(const fs::path& path) {
    ReadLimits limits = defaultReadLimits();
    limits.maxFileBytes = kMaxSmallFile;
    ARS_TRY(const std::string text, readTextFile(path, limits));
    Json json = Json::parse(text, nullptr, false);
    if (json.is_discarded()) return badFile(path.string(), "expected JSON, found something else or a part of it");
    return json;
}

Json numberToJson(double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); }

/// Keys of one object, each read once. The first that is wrong is the error; missing ones keep their value.
class ObjectReader {
public:
    explicit ObjectReader(const Json& object) : object_(object) {
        if (!object.is_object()) fail("", "an object", object);
    }
    void text(const char* key, std::string& value) {
        const Json* json = find(key);
        if (!json) return;
        if (!json->is_string()) return fail(key, "text", *json);
        value = json->get<std::string>();
    }
    void number(const char* key, double& value) {
        const Json* json = find(key);
        if (!json) return;
        if (!json->is_number() && !json->is_null()) return fail(key, "a number", *json);
        value = json->is_null() ? std::numeric_limits<double>::quiet_NaN() : json->get<double>();
    }
    template <typename Integer>
    void whole(const char* key, Integer& value) {
        const Json* json = find(key);
        if (!json) return;
        const bool fits = json->is_number_unsigned()
                              ? json->get<std::uint64_t>() <= std::uint64_t(std::numeric_limits<Integer>::max())
                              : json->is_number_integer() && json->get<std::int64_t>() >= 0;
        if (!fits) return fail(key, "a whole number of at least 0", *json);
        value = json->get<Integer>();
    }
    void numbers(const char* key, std::map<std::string, double>& values) {
        const Json* json = find(key);
        if (!json) return;
        if (!json->is_object()) return fail(key, "an object", *json);
        ObjectReader reader(*json);
        for (const auto& item : json->items()) reader.number(item.key().c_str(), values[item.key()]);
        if (!reader.status()) error_ = atPlace(reader.status().error(), key);
    }
    const Status& status() const { return error_; }

private:
    const Json* find(const char* key) const {
        if (!error_ || !object_.is_object()) return nullptr;
        const auto found = object_.find(key);
        return found == object_.end() ? nullptr : &*found;
    }
    void fail(const char* key, const char* expected, const Json& found) {
        error_ = badFile(key, fmt::format("expected {}, found {}", expected, found.type_name()));
    }

    const Json& object_;
    Status error_;
};

/// The lock's state without taking it: F_OFD_GETLK needs no lock of its own, so that asking never refuses an owner.
bool lockHeld(const fs::path& path) {
    const int descriptor = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
    if (descriptor < 0) return false;
    struct flock lock{};
    lock.l_type = F_WRLCK;
    lock.l_whence = SEEK_SET;
    const bool asked = ::fcntl(descriptor, F_OFD_GETLK, &lock) == 0;
    ::close(descriptor);
    return asked && lock.l_type != F_UNLCK;
}

std::optional<std::int64_t> stepOfName(const std::string& name) {
    std::int64_t step = 0;
    const auto [end, failure] = std::from_chars(name.data(), name.data() + name.size(), step);
    if (failure != std::errc() || end != name.data() + name.size() || step < 0) return std::nullopt;
    return step;
}

Result<RunStatus> statusAsWritten(const fs::path& folder) {
    const fs::path path = folder / kRunStatusFile;
    ARS_TRY(const Json json, readJson(path));
    auto status = runStatusFromJson(json);
    if (!status) return atPlace(std::move(status).error(), path.string());
    return status;
}

} // namespace

std::string_view runStateName(RunState state) { return kRunStateNames[static_cast<std::size_t>(state)]; }

std::optional<RunState> runStateFromName(std::string_view name) {
    for (std::size_t i = 0; i < kRunStateNames.size(); ++i) {
        if (kRunStateNames[i] == name) return static_cast<RunState>(i);
    }
    return std::nullopt;
}

bool runStateNeedsProcess(RunState state) { return state >= RunState::Loading && state <= RunState::Stopping; }

bool runStateMayFollow(RunState from, RunState to) {
    using enum RunState;
    if (from == to) return true;
    switch (to) {
    case Idle:
        return from == Stopping;
    case Loading:
        return from == Idle || from == Finished || from == Failed;
    case Running:
        return from == Loading || from == Saving || from == Paused;
    case Pausing:
        return from == Running;
    case Paused:
        return from == Pausing || from == Saving;
    case Saving:
        return from == Running || from == Paused;
    case Stopping:
        return from == Loading || from == Running || from == Paused;
    case Finished:
        return from == Running || from == Saving;
    case Failed:
        return runStateNeedsProcess(from);
    }
    return false;
}

nlohmann::json runStatusToJson(const RunStatus& status) {
    Json losses = Json::object();
    for (const auto& [name, value] : status.losses) losses[name] = numberToJson(value);
    return {{"state", runStateName(status.state)},
            {"stage", status.stage},
            {"step", status.step},
            {"total_steps", status.totalSteps},
            {"step_ms", numberToJson(status.stepMs)},
            {"eta_s", numberToJson(status.etaS)},
            {"memory_bytes", status.memoryBytes},
            {"peak_memory_bytes", status.peakMemoryBytes},
            {"losses", std::move(losses)},
            {"error", status.error},
            {"note", status.note},
            {"process", status.process},
            {"host", status.host},
            {"updated_unix_s", numberToJson(status.updatedUnixS)},
            {"checkpoint", status.checkpoint}};
}

Result<RunStatus> runStatusFromJson(const nlohmann::json& json) {
    RunStatus status;
    ObjectReader reader(json);
    std::string state;
    reader.text("state", state);
    reader.text("stage", status.stage);
    reader.whole("step", status.step);
    reader.whole("total_steps", status.totalSteps);
    reader.number("step_ms", status.stepMs);
    reader.number("eta_s", status.etaS);
    reader.whole("memory_bytes", status.memoryBytes);
    reader.whole("peak_memory_bytes", status.peakMemoryBytes);
    reader.numbers("losses", status.losses);
    reader.text("error", status.error);
    reader.text("note", status.note);
    reader.whole("process", status.process);
    reader.text("host", status.host);
    reader.number("updated_unix_s", status.updatedUnixS);
    reader.text("checkpoint", status.checkpoint);
    ARS_TRY_STATUS(reader.status());
    const std::optional<RunState> known = runStateFromName(state);
    if (!known) return badFile("state", fmt::format("expected the name of a state, found \"{}\"", state));
    status.state = *known;
    return status;
}

nlohmann::json metricsRowToJson(const MetricsRow& row) {
    Json json{{"step", row.step}, {"stage", row.stage}};
    for (const auto& [name, value] : row.values) json[name] = numberToJson(value);
    return json;
}

Result<MetricsRow> metricsRowFromJson(const nlohmann::json& json) {
    MetricsRow row;
    ObjectReader reader(json);
    reader.whole("step", row.step);
    reader.text("stage", row.stage);
    ARS_TRY_STATUS(reader.status());
    if (!json.contains("step")) return badFile("step", "expected a whole number, found nothing");
    for (const auto& item : json.items()) {
        if (item.key() != "step" && item.key() != "stage") reader.number(item.key().c_str(), row.values[item.key()]);
    }
    ARS_TRY_STATUS(reader.status());
    return row;
}

std::string_view runRequestName(RunRequest request) { return kRequestNames[static_cast<std::size_t>(request)]; }

std::optional<RunRequest> runRequestFromName(std::string_view name) {
    for (std::size_t i = 0; i < kRequestNames.size(); ++i) {
        if (kRequestNames[i] == name) return static_cast<RunRequest>(i);
    }
    return std::nullopt;
}

bool holdsRun(const fs::path& folder) {
    std::error_code ignored;
    return fs::is_regular_file(folder / kRunConfigFile, ignored);
}

bool looksLikeRunFolder(const fs::path& folder) { return holdsRun(folder) && statusAsWritten(folder).ok(); }

Result<RunStatus> readRunStatus(const fs::path& folder) {
    ARS_TRY(RunStatus status, statusAsWritten(folder));
    if (!runStateNeedsProcess(status.state) || runOwned(folder)) return status;
    // The owner may have ended properly between the two looks: its last word stands before it lets the lock go.
    ARS_TRY(status, statusAsWritten(folder));
    if (!runStateNeedsProcess(status.state) || runOwned(folder)) return status;
    status.error = "the process ended without a word";
    status.note = fmt::format("it was {} at step {}", runStateName(status.state), status.step);
    status.state = RunState::Failed;
    status.process = 0;
    status.etaS = 0;
    return status;
}

Result<nlohmann::json> readRunConfig(const fs::path& folder) { return readJson(folder / kRunConfigFile); }

Result<std::vector<CheckpointEntry>> listCheckpoints(const fs::path& folder) {
    const fs::path parent = folder / kRunCheckpointFolder;
    std::vector<CheckpointEntry> entries;
    std::error_code failure;
    if (!fs::exists(parent, failure)) return entries;
    for (fs::directory_iterator it(parent, failure), end; !failure && it != end; it.increment(failure)) {
        const std::optional<std::int64_t> step = stepOfName(it->path().filename().string());
        if (!step) continue;
        const auto mark = readJson(it->path() / "complete.json");
        if (!mark || !mark->is_object() || mark->value("step", Json()) != Json(*step)) continue;
        const auto kept = mark->find("kept");
        entries.push_back({*step, it->path(), kept != mark->end() && kept->is_boolean() && kept->get<bool>()});
    }
    if (failure) {
        return makeError(ErrorCode::Io, parent.string(), fmt::format("cannot be read: {}", failure.message()));
    }
    std::sort(entries.begin(), entries.end(),
              [](const CheckpointEntry& a, const CheckpointEntry& b) { return a.step < b.step; });
    return entries;
}

std::vector<fs::path> listPreviews(const fs::path& folder) {
    std::vector<std::pair<std::int64_t, fs::path>> found;
    std::error_code failure;
    for (fs::directory_iterator it(folder / kRunPreviewFolder, failure), end; !failure && it != end;
         it.increment(failure)) {
        const std::string name = it->path().filename().string();
        const std::string extension = it->path().extension().string();
        if (extension != ".png" && extension != ".jpg" && extension != ".exr") continue;
        const auto step = stepOfName(name.substr(0, name.find_first_not_of("0123456789")));
        if (step) found.emplace_back(*step, it->path());
    }
    std::sort(found.begin(), found.end());
    std::vector<fs::path> paths;
    for (auto& entry : found) paths.push_back(std::move(entry.second));
    return paths;
}

bool runOwned(const fs::path& folder) {
    return lockHeld(folder / kRunLockFile) || runOwnerElsewhere(folder).process > 0;
}

RunOwner readRunOwner(const fs::path& folder) {
    RunOwner owner;
    const auto json = readJson(folder / kRunLockFile);
    if (!json) return owner;
    ObjectReader reader(*json);
    reader.whole("process", owner.process);
    reader.text("host", owner.host);
    return owner;
}

RunOwner runOwnerElsewhere(const fs::path& folder) {
    const auto status = statusAsWritten(folder);
    if (!status || !runStateNeedsProcess(status->state)) return {};
    if (status->host.empty() || status->host == hostName()) return {}; // here the lock tells
    const double now = std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
    const bool fresh = std::abs(now - status->updatedUnixS) < kFreshStatusS; // false for no number
    return fresh ? RunOwner{status->process, status->host} : RunOwner();
}

std::string hostName() {
    std::array<char, 256> name{};
    if (::gethostname(name.data(), name.size() - 1) != 0) return "unknown";
    return name.data();
}

Status requestOfRun(const fs::path& folder, RunRequest request) {
    if (!looksLikeRunFolder(folder)) {
        return makeError(ErrorCode::NotFound, folder.string(), "this is no run folder");
    }
    if (!runOwned(folder)) {
        return makeError(ErrorCode::Unavailable, folder.string(),
                         fmt::format("no process works on this run, so nobody can {} it", runRequestName(request)));
    }
    Json json{{"request", runRequestName(request)}};
    // Addressed to one process, so that a successor does not obey what was meant for it.
    if (const RunOwner owner = readRunOwner(folder); owner.process > 0) json["process"] = owner.process;
    return writeFileAtomic(folder / kRunControlFile, json.dump() + "\n");
}

} // namespace ars
