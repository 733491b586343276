#include "engine/scene/run_monitor.h"

#include <fmt/format.h>

#include <sys/resource.h>

#include <charconv>
#include <deque>
#include <fstream>
#include <mutex>
#include <sstream>
#include <system_error>

namespace ars {
namespace fs = std::filesystem;
namespace {

/// So that a window, and whatever else a person does, goes before a training that takes hours.
constexpr int kTrainingNiceness = 5;

struct Program {
    std::mutex mutex;
    fs::path path;
};

Program& program() {
    static Program made;
    return made;
}

std::string trimmed(const std::string& line) {
    constexpr const char* kBlank = " \t\r";
    const std::size_t begin = line.find_first_not_of(kBlank);
    if (begin == std::string::npos) return {};
    return line.substr(begin, line.find_last_not_of(kBlank) - begin + 1);
}

/// A value may hold "#": only one that begins the line, or stands behind a blank, begins a comment.
std::string withoutComment(const std::string& line) {
    for (std::size_t at = line.find('#'); at != std::string::npos; at = line.find('#', at + 1)) {
        if (at == 0 || line[at - 1] == ' ' || line[at - 1] == '\t') return trimmed(line.substr(0, at));
    }
    return trimmed(line);
}

Status checkStart(const TrainingStart& start) {
    std::error_code ignored;
    if (start.run.empty()) return makeError(ErrorCode::InvalidArgument, "run", "choose a folder for the run");
    if (runOwned(start.run)) {
        return makeError(ErrorCode::InvalidArgument, start.run.string(), "a process works on this run already");
    }
    if (start.resume) {
        // As ars train asks: a damaged status.json is no reason not to go on.
        if (holdsRun(start.run)) return {};
        return makeError(ErrorCode::InvalidArgument, start.run.string(), "there is no run here that could go on");
    }
    if (start.capture.empty())
        return makeError(ErrorCode::InvalidArgument, "capture", "choose a capture to learn from");
    if (!fs::exists(start.capture, ignored)) {
        return makeError(ErrorCode::NotFound, start.capture.string(), "there is no such capture");
    }
    if (looksLikeRunFolder(start.run)) {
        return makeError(ErrorCode::InvalidArgument, start.run.string(),
                         "there is a run in this folder already; resume it or choose another folder");
    }
    return {};
}

/// A thread by its id; one that is as nice already stays so.
void makeNice(id_t thread) {
    if (::getpriority(PRIO_PROCESS, thread) < kTrainingNiceness) {
        ::setpriority(PRIO_PROCESS, thread, kTrainingNiceness);
    }
}

/// Threads inherit from the one that starts them, so the first one is enough unless the process was quicker than we
/// are.
void makeProcessNice(int process) {
    makeNice(static_cast<id_t>(process));
    std::error_code failure;
    for (fs::directory_iterator it(fmt::format("/proc/{}/task", process), failure), end; !failure && it != end;
         it.increment(failure)) {
        const std::string name = it->path().filename().string();
        id_t thread = 0;
        if (std::from_chars(name.data(), name.data() + name.size(), thread).ec == std::errc()) makeNice(thread);
    }
}

} // namespace

fs::path trainingProgram() {
    const std::lock_guard lock(program().mutex);
    if (!program().path.empty()) return program().path;
    std::error_code failure;
    const fs::path self = fs::read_symlink("/proc/self/exe", failure);
    return failure ? fs::path("ars") : self;
}

void setTrainingProgram(fs::path path) {
    const std::lock_guard lock(program().mutex);
    program().path = std::move(path);
}

std::vector<std::string> trainingCommand(const TrainingStart& start) {
    std::vector<std::string> command{trainingProgram().string(), "train", "--run", start.run.string()};
    const auto add = [&command](const char* option, const std::string& value) {
        if (!value.empty()) command.insert(command.end(), {option, value});
    };
    add("--capture", start.capture.string());
    add("--preset", start.preset);
    for (const std::string& setting : start.settings) add("--set", setting);
    if (start.resume) command.push_back("--resume");
    return command;
}

Result<std::vector<std::string>> parseSettingLines(const std::string& text) {
    std::vector<std::string> settings;
    std::istringstream lines(text);
    for (std::string line; std::getline(lines, line);) {
        line = withoutComment(line);
        if (line.empty()) continue;
        const std::size_t equal = line.find('=');
        if (equal == std::string::npos || equal == 0) {
            return makeError(ErrorCode::InvalidArgument, "settings",
                             fmt::format("expected lines of name=value, found \"{}\"", line));
        }
        settings.push_back(trimmed(line.substr(0, equal)) + "=" + trimmed(line.substr(equal + 1)));
    }
    return settings;
}

Result<ChildProcess> startTraining(const TrainingStart& start) {
    ARS_TRY_STATUS(checkStart(start));
    std::error_code failure;
    fs::create_directories(start.run, failure);
    if (failure) return makeError(ErrorCode::Io, start.run.string(), "cannot be made: " + failure.message());
    ARS_TRY(ChildProcess child, ChildProcess::start(trainingCommand(start), start.run / kRunLogFile, true));
    makeProcessNice(child.id());
    return child;
}

std::string endOfLog(const fs::path& run, std::size_t lines) {
    std::ifstream file(run / kRunLogFile);
    std::deque<std::string> last;
    for (std::string line; std::getline(file, line);) {
        if (trimmed(line).empty()) continue;
        last.push_back(trimmed(line));
        if (last.size() > lines) last.pop_front();
    }
    std::string text;
    for (const std::string& line : last) text += (text.empty() ? "" : "\n") + line;
    return text;
}

} // namespace ars
