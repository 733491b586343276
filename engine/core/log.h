#pragma once

#include <fmt/format.h>

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace ars {

enum class LogLevel { Debug, Info, Warning, Error };

std::string_view logLevelName(LogLevel level);

/// One line of the log.
struct LogRecord {
    LogLevel level;
    double timeS;        ///< seconds since the program started
    std::uint64_t index; ///< counts every record of this run, from 0
    std::string text;
};

using LogSink = std::function<void(const LogRecord&)>;

/// Takes part in every following record until it is removed. Called on the thread that logs, one record at a time;
/// it must not log. Returns a handle for removeLogSink.
int addLogSink(LogSink sink);
void removeLogSink(int handle);

/// Lines below this level are dropped. Default Info; the environment's ARS_LOG=debug|info|warning|error overrides it.
void setLogLevel(LogLevel level);
LogLevel logLevel();

/// Whether records also go to standard error (they do, until a window owns the log).
void setLogToStderr(bool enabled);

/// The newest `count` records, oldest first, of the last 4,096 kept for a window that opens late or a failure report.
std::vector<LogRecord> recentLog(std::size_t count = 4096);

void logText(LogLevel level, std::string text);

template <typename... Args>
void logDebug(fmt::format_string<Args...> format, Args&&... args) {
    if (logLevel() <= LogLevel::Debug) logText(LogLevel::Debug, fmt::format(format, std::forward<Args>(args)...));
}
template <typename... Args>
void logInfo(fmt::format_string<Args...> format, Args&&... args) {
    if (logLevel() <= LogLevel::Info) logText(LogLevel::Info, fmt::format(format, std::forward<Args>(args)...));
}
template <typename... Args>
void logWarning(fmt::format_string<Args...> format, Args&&... args) {
    if (logLevel() <= LogLevel::Warning) logText(LogLevel::Warning, fmt::format(format, std::forward<Args>(args)...));
}
template <typename... Args>
void logError(fmt::format_string<Args...> format, Args&&... args) {
    logText(LogLevel::Error, fmt::format(format, std::forward<Args>(args)...));
}

} // namespace ars
