#include "engine/core/log.h"

#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <deque>
#include <map>
#include <mutex>

namespace ars {
namespace {

constexpr std::size_t kKeptRecords = 4096;

LogLevel initialLevel() {
    const char* text = std::getenv("ARS_LOG");
    const std::string_view name = text ? text : "";
    for (LogLevel level : {LogLevel::Debug, LogLevel::Info, LogLevel::Warning, LogLevel::Error}) {
        if (name == logLevelName(level)) return level;
    }
    return LogLevel::Info;
}

struct LogState {
    std::mutex mutex;
    std::map<int, LogSink> sinks;
    std::deque<LogRecord> recent;
    std::uint64_t nextIndex = 0;
    int nextHandle = 1;
    bool toStderr = true;
    std::chrono::steady_clock::time_point start = std::chrono::steady_clock::now();
    std::shared_ptr<spdlog::logger> console;

    LogState() {
        console = std::make_shared<spdlog::logger>("ars", std::make_shared<spdlog::sinks::stderr_color_sink_mt>());
        console->set_pattern("%^%l%$: %v");
        console->set_level(spdlog::level::trace);
        console->flush_on(spdlog::level::trace);
    }
};

// Never destroyed: threads may still log while the program ends.
LogState& state() {
    static auto* instance = new LogState;
    return *instance;
}

std::atomic<LogLevel>& level() {
    static std::atomic<LogLevel> value{initialLevel()};
    return value;
}

spdlog::level::level_enum consoleLevel(LogLevel value) {
    switch (value) {
    case LogLevel::Debug:
        return spdlog::level::debug;
    case LogLevel::Info:
        return spdlog::level::info;
    case LogLevel::Warning:
        return spdlog::level::warn;
    case LogLevel::Error:
        return spdlog::level::err;
    }
    return spdlog::level::info;
}

} // namespace

std::string_view logLevelName(LogLevel value) {
    switch (value) {
    case LogLevel::Debug:
        return "debug";
    case LogLevel::Info:
        return "info";
    case LogLevel::Warning:
        return "warning";
    case LogLevel::Error:
        return "error";
    }
    return "info";
}

int addLogSink(LogSink sink) {
    LogState& log = state();
    const std::lock_guard lock(log.mutex);
    log.sinks.emplace(log.nextHandle, std::move(sink));
    return log.nextHandle++;
}

void removeLogSink(int handle) {
    LogState& log = state();
    const std::lock_guard lock(log.mutex);
    log.sinks.erase(handle);
}

void setLogLevel(LogLevel value) { level().store(value); }

LogLevel logLevel() { return level().load(std::memory_order_relaxed); }

void setLogToStderr(bool enabled) {
    LogState& log = state();
    const std::lock_guard lock(log.mutex);
    log.toStderr = enabled;
}

std::vector<LogRecord> recentLog(std::size_t count) {
    LogState& log = state();
    const std::lock_guard lock(log.mutex);
    const std::size_t take = std::min(count, log.recent.size());
    return {log.recent.end() - static_cast<std::ptrdiff_t>(take), log.recent.end()};
}

void logText(LogLevel value, std::string text) {
    if (value < logLevel()) return;
    LogState& log = state();
    const std::lock_guard lock(log.mutex);
    const double timeS = std::chrono::duration<double>(std::chrono::steady_clock::now() - log.start).count();
    log.recent.push_back({value, timeS, log.nextIndex++, std::move(text)});
    if (log.recent.size() > kKeptRecords) log.recent.pop_front();
    const LogRecord& record = log.recent.back();
    if (log.toStderr) log.console->log(consoleLevel(value), "{}", record.text);
    for (const auto& [handle, sink] : log.sinks) sink(record);
}

} // namespace ars
