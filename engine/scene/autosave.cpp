#include "engine/core/file.h"
#include "engine/core/log.h"
#include "engine/scene/json_archive.h"
#include "engine/scene/project.h"

#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <condition_variable>
#include <csignal>
#include <fstream>
#include <mutex>
#include <random>
#include <thread>

namespace ars {
namespace fs = std::filesystem;

namespace {

using Clock = std::chrono::steady_clock;

constexpr std::string_view kPrefix = "autosave-";
constexpr std::string_view kSuffix = ".ars";
constexpr std::int64_t kLatestMs = 9'000'000'000'000; ///< the clock counts nanoseconds, up to the year 2262

/// First line of a small file of the system; empty where there is none.
std::string firstLine(const fs::path& path) {
    std::ifstream stream(path);
    std::string line;
    std::getline(stream, line);
    return line;
}

/// A process as one boot of this machine knows it: its number may be used again, with another start.
struct ProcessMark {
    std::int64_t id = 0;
    std::string start; ///< ticks since the boot; empty: there is no such process
    std::string boot;

    bool operator==(const ProcessMark&) const = default;
};

ProcessMark processMark(std::int64_t id) {
    ProcessMark mark{id, "", firstLine("/proc/sys/kernel/random/boot_id")};
    const std::string stat = firstLine(fmt::format("/proc/{}/stat", id));
    // "PID (any name) STATE ...": the state is the third field, the start the twenty-second.
    const std::size_t nameEnd = stat.rfind(") ");
    if (nameEnd == std::string::npos) return mark;
    std::vector<std::string> fields;
    std::size_t begin = nameEnd + 2;
    while (begin < stat.size()) {
        const std::size_t end = std::min(stat.find(' ', begin), stat.size());
        fields.push_back(stat.substr(begin, end - begin));
        begin = end + 1;
    }
    constexpr std::size_t kStart = 19;
    // A dead process keeps its number until its parent has asked for it.
    if (fields.size() <= kStart || fields[0] == "Z" || fields[0] == "X") return mark;
    mark.start = fields[kStart];
    return mark;
}

bool stillRuns(const ProcessMark& mark) { return !mark.start.empty() && processMark(mark.id) == mark; }

fs::path autosavePath(const fs::path& folder) {
    std::random_device random;
    return folder / fmt::format("{}{}-{:08x}{}", kPrefix, ::getpid(), random(), kSuffix);
}

/// A whole document with its paths absolute; who saved it, and when, stands beside.
std::string autosaveText(const Document& document, const fs::path& project) {
    const ProcessMark mark = processMark(::getpid());
    const auto now = std::chrono::system_clock::now().time_since_epoch();
    detail::Json json = documentToJson(document);
    json["recovery"] = detail::Json{{"project", detail::textToJson(project.string())},
                                    {"process", mark.id},
                                    {"process_start", mark.start},
                                    {"boot", mark.boot},
                                    {"saved_ms", std::chrono::duration_cast<std::chrono::milliseconds>(now).count()}};
    return json.dump();
}

/// What stands beside the document of an autosaved file.
struct RecoveryMark {
    ProcessMark process;
    fs::path project;
    std::int64_t savedMs = 0;
};

std::optional<RecoveryMark> readMark(const detail::Json& json) {
    const auto found = json.find("recovery");
    if (found == json.end() || !found->is_object()) return std::nullopt;
    const auto text = [&](const char* key) {
        const auto value = found->find(key);
        return value == found->end() ? std::nullopt : detail::textFromJson(*value);
    };
    const auto number = [&](const char* key) -> std::optional<std::int64_t> {
        const auto value = found->find(key);
        if (value == found->end() || !value->is_number_integer()) return std::nullopt;
        return value->get<std::int64_t>();
    };
    const auto project = text("project"), start = text("process_start"), boot = text("boot");
    const auto process = number("process"), saved = number("saved_ms");
    if (!project || !start || !boot || !process || !saved) return std::nullopt;
    if (*saved < 0 || *saved > kLatestMs) return std::nullopt;
    return RecoveryMark{{*process, *start, *boot}, *project, *saved};
}

bool isAutosave(const fs::path& path) {
    const std::string name = path.filename().string();
    return name.size() > kPrefix.size() + kSuffix.size() && name.rfind(kPrefix, 0) == 0 &&
           name.compare(name.size() - kSuffix.size(), kSuffix.size(), kSuffix) == 0;
}

/// The process in "autosave-PID-RANDOM.ars.tmp-PID-N", which a process that is killed while it writes leaves behind.
std::optional<std::int64_t> unfinishedBy(const fs::path& path) {
    const std::string name = path.filename().string();
    const std::size_t mark = name.find(std::string(kSuffix) + ".tmp-");
    if (name.rfind(kPrefix, 0) != 0 || mark == std::string::npos) return std::nullopt;
    std::int64_t id = 0;
    const auto parsed = std::from_chars(name.data() + kPrefix.size(), name.data() + mark, id);
    return parsed.ec == std::errc() ? std::optional(id) : std::nullopt;
}

void moveAside(const fs::path& file, const Error& error) {
    fs::path aside = file;
    aside += ".broken";
    std::error_code failure;
    fs::rename(file, aside, failure);
    logWarning("{}: left by a crash, but cannot be read; {}", error.describe(),
               failure ? "it stays where it is" : "it was renamed to " + aside.filename().string());
}

/// Whether nothing would be lost without the file: its document is in the project, or is the one that windows open
/// with.
bool standsElsewhere(const Document& document, const fs::path& project) {
    if (project.empty()) return document == newDocument();
    const auto saved = readProject(project);
    return saved && *saved == document;
}

/// Nothing: the file's process runs, or what it holds stands elsewhere, too.
Result<std::optional<Recovery>> readRecovery(const fs::path& file) {
    ARS_TRY(const std::string text, readTextFile(file));
    const auto json = detail::parseJsonText(text);
    if (!json) return atPlace(json.error(), file.string());
    const std::optional<RecoveryMark> mark = readMark(*json);
    if (!mark) {
        return makeError(ErrorCode::BadFile, file.string(),
                         "recovery: expected project, process, process_start, boot and saved_ms");
    }
    if (stillRuns(mark->process)) return std::optional<Recovery>();
    auto document = documentFromJson(*json);
    if (!document) return atPlace(std::move(document).error(), file.string());
    if (standsElsewhere(*document, mark->project)) {
        std::error_code ignored;
        fs::remove(file, ignored);
        return std::optional<Recovery>();
    }
    const std::chrono::system_clock::time_point saved{std::chrono::milliseconds(mark->savedMs)};
    return std::optional(Recovery{file, mark->project, saved, std::move(*document)});
}

} // namespace

struct Autosave::State {
    struct Work {
        Document document;
        fs::path project;
    };

    fs::path file;
    std::chrono::milliseconds interval;
    std::mutex mutex;
    std::condition_variable changed;
    std::optional<Work> waiting;
    std::optional<Error> error;
    std::optional<std::uint64_t> version; ///< of the last copy
    bool writing = false;
    bool hurry = false; ///< without waiting for the interval
    bool stop = false;
    std::thread thread;

    void run();
    void keepError(const Error& failure);

private:
    std::string lastFailure; ///< what went wrong in the last attempt; empty: nothing
};

/// A full disk is told once, not with every attempt.
void Autosave::State::keepError(const Error& failure) {
    const std::string text = failure.describe();
    if (text == lastFailure) return;
    lastFailure = text;
    logWarning("autosave: {}", text);
    error = failure;
}

void Autosave::State::run() {
    std::unique_lock lock(mutex);
    Clock::time_point next = Clock::now();
    while (true) {
        changed.wait(lock, [this] { return stop || waiting; });
        if (!stop) changed.wait_until(lock, next, [this] { return stop || hurry; });
        if (stop) return;
        Work work = std::move(*waiting);
        waiting.reset();
        writing = true;
        lock.unlock();
        // Before writing: the interval is the longest time that is lost, whatever the disk takes.
        next = Clock::now() + interval;
        Status written;
        try {
            written = writeFileAtomic(file, autosaveText(work.document, work.project));
        } catch (const std::exception& failure) {
            written = makeError(ErrorCode::Internal, file.string(), fmt::format("not saved: {}", failure.what()));
        }
        lock.lock();
        writing = false;
        if (written) {
            lastFailure.clear();
        } else {
            keepError(written.error());
            // Kept for the next time, unless there is something newer.
            if (!waiting && !hurry) waiting = std::move(work);
        }
        changed.notify_all();
    }
}

Autosave::Autosave(fs::path folder, std::chrono::milliseconds interval) : state_(std::make_unique<State>()) {
    state_->file = autosavePath(folder);
    state_->interval = interval;
    state_->thread = std::thread([state = state_.get()] {
        sigset_t all; // signals are for the threads that expect them
        sigfillset(&all);
        pthread_sigmask(SIG_BLOCK, &all, nullptr);
        state->run();
    });
}

Autosave::~Autosave() {
    {
        const std::lock_guard lock(state_->mutex);
        state_->stop = true;
    }
    state_->changed.notify_all();
    state_->thread.join();
    std::error_code ignored;
    fs::remove(state_->file, ignored);
}

void Autosave::update(const Document& document, std::uint64_t version, const fs::path& project) {
    {
        const std::lock_guard lock(state_->mutex);
        if (state_->version == version) return;
        state_->version = version;
        state_->waiting = State::Work{document, project};
    }
    state_->changed.notify_all();
}

void Autosave::flush() {
    std::unique_lock lock(state_->mutex);
    state_->hurry = true;
    state_->changed.notify_all();
    state_->changed.wait(lock, [this] { return !state_->waiting && !state_->writing; });
    state_->hurry = false;
}

std::optional<Error> Autosave::takeError() {
    const std::lock_guard lock(state_->mutex);
    return std::exchange(state_->error, std::nullopt);
}

std::vector<Recovery> findRecoveries(const fs::path& folder) {
    std::vector<fs::path> files;
    std::error_code failure;
    for (fs::directory_iterator entry(folder, failure), end; !failure && entry != end; entry.increment(failure)) {
        const fs::path path = entry->path();
        std::error_code ignored;
        if (isAutosave(path)) {
            files.push_back(path);
        } else if (const auto process = unfinishedBy(path); process && processMark(*process).start.empty()) {
            fs::remove(path, ignored);
        }
    }
    std::vector<Recovery> recoveries;
    for (const fs::path& file : files) {
        auto recovery = readRecovery(file);
        if (!recovery && recovery.error().code == ErrorCode::NotFound) continue; // another window took it meanwhile
        if (!recovery) {
            moveAside(file, recovery.error());
        } else if (*recovery) {
            recoveries.push_back(std::move(**recovery));
        }
    }
    std::sort(recoveries.begin(), recoveries.end(),
              [](const Recovery& a, const Recovery& b) { return a.saved > b.saved; });
    return recoveries;
}

void discardRecovery(const Recovery& recovery) {
    std::error_code failure;
    fs::remove(recovery.file, failure);
    if (failure) logWarning("{}: cannot be removed: {}", recovery.file.string(), failure.message());
}

} // namespace ars
