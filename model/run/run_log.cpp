#include "model/run/run_log.h"

#include "engine/core/log.h"
#include "engine/scene/run_folder.h"

#include <fmt/chrono.h>
#include <fmt/format.h>

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <ctime>

namespace ars {
namespace {

bool sameFile(int a, int b) {
    struct stat first{};
    struct stat second{};
    return ::fstat(a, &first) == 0 && ::fstat(b, &second) == 0 && first.st_ino == second.st_ino &&
           first.st_dev == second.st_dev;
}

} // namespace

RunLog::RunLog(const std::filesystem::path& folder) {
    descriptor_ = ::open((folder / kRunLogFile).c_str(), O_WRONLY | O_APPEND | O_CREAT | O_CLOEXEC, 0666);
    if (descriptor_ < 0 || sameFile(descriptor_, STDERR_FILENO)) return;
    sink_ = addLogSink([this](const LogRecord& record) {
        if (record.level >= LogLevel::Warning) line(fmt::format("{}: {}", logLevelName(record.level), record.text));
    });
}

RunLog::~RunLog() {
    if (sink_ != 0) removeLogSink(sink_);
    close();
}

void RunLog::line(std::string_view text) {
    const std::lock_guard guard(mutex_);
    if (descriptor_ < 0) return;
    std::tm now{};
    const std::time_t seconds = std::time(nullptr);
    ::gmtime_r(&seconds, &now);
    const std::string line = fmt::format("{:%Y-%m-%d %H:%M:%S}Z {}\n", now, text);
    [[maybe_unused]] const ssize_t ignored = ::write(descriptor_, line.data(), line.size());
}

void RunLog::close() {
    const std::lock_guard guard(mutex_);
    if (descriptor_ >= 0) ::close(descriptor_);
    descriptor_ = -1;
}

} // namespace ars
