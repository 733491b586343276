#pragma once

#include "engine/core/error.h"

#include <chrono>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace ars {

/// How a child ended and what it said.
struct ProcessResult {
    int exitCode = 0; ///< 128 + signal when a signal ended it
    bool timedOut = false;
    std::string output; ///< standard output
    std::string errors; ///< standard error
};

struct ProcessOptions {
    std::vector<std::pair<std::string, std::string>> environment{}; ///< added to this process's own
    std::filesystem::path workingFolder{};                          ///< empty: this process's own
    std::string input{};                                            ///< given on standard input
    std::chrono::milliseconds timeout{0};                           ///< 0: none; then SIGTERM, and SIGKILL 2 s later
    std::size_t maxOutputBytes = 64u << 20;                         ///< of each stream; more is dropped
};

/// Runs a program (looked up on PATH, no shell) to its end. NotFound when it does not exist.
Result<ProcessResult> runProcess(const std::vector<std::string>& command, const ProcessOptions& options = {});

/// A child that is fed on its standard input piece by piece, e.g. a video encoder.
class FedProcess {
public:
    /// Options' input and timeout are not used. NotFound when the program does not exist.
    static Result<FedProcess> start(const std::vector<std::string>& command, const ProcessOptions& options = {});
    FedProcess(FedProcess&& other) noexcept;
    FedProcess& operator=(FedProcess&& other) noexcept;
    ~FedProcess(); ///< ends the child by SIGKILL unless finish() was called

    /// Hands the bytes over and returns when the child has taken them. Io, with the end of what it said, when it has
    /// closed its input.
    Status write(std::span<const std::byte> bytes);
    /// Closes the child's input and waits for its end.
    Result<ProcessResult> finish();

private:
    FedProcess() = default;
    void drain(int timeoutMs, bool toTheEnd);
    void close();

    int id_ = -1;
    int input_ = -1;
    int output_ = -1;
    int errors_ = -1;
    std::size_t maxOutputBytes_ = 0;
    ProcessResult result_;
};

/// A child that goes on beside this process, e.g. a training run that outlives the window.
class ChildProcess {
public:
    /// Both streams go to `logFile` (appended). With `detached` it gets a session of its own and survives us.
    static Result<ChildProcess> start(const std::vector<std::string>& command, const std::filesystem::path& logFile,
                                      bool detached, const ProcessOptions& options = {});
    ChildProcess(ChildProcess&& other) noexcept;
    ChildProcess& operator=(ChildProcess&& other) noexcept;
    ~ChildProcess(); ///< never kills; an attached child is reaped if it has ended

    int id() const { return id_; }
    bool running();
    /// Exit code once it has ended (128 + signal), else nothing.
    std::optional<int> exitCode();
    Status signal(int number);
    /// Waits up to `timeout`; true when it has ended.
    bool wait(std::chrono::milliseconds timeout);

private:
    ChildProcess() = default;
    int id_ = -1;
    bool reaped_ = false;
    int code_ = 0;
};

} // namespace ars
