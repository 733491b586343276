#include "engine/core/process.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <thread>

extern char** environ; // NOLINT: POSIX

namespace ars {
namespace {

using Clock = std::chrono::steady_clock;

struct Pipe {
    int readEnd = -1;
    int writeEnd = -1;
    ~Pipe() {
        closeRead();
        closeWrite();
    }
    Status open() {
        int ends[2];
        if (::pipe2(ends, O_CLOEXEC) != 0) {
            return makeError(ErrorCode::Io, "", fmt::format("no pipe for a child process: {}", std::strerror(errno)));
        }
        readEnd = ends[0];
        writeEnd = ends[1];
        return {};
    }
    void closeRead() {
        if (readEnd >= 0) ::close(std::exchange(readEnd, -1));
    }
    void closeWrite() {
        if (writeEnd >= 0) ::close(std::exchange(writeEnd, -1));
    }
};

int exitCodeOf(int status) { return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status); }

std::vector<char*> pointers(std::vector<std::string>& texts) {
    std::vector<char*> result;
    for (std::string& text : texts) result.push_back(text.data());
    result.push_back(nullptr);
    return result;
}

std::vector<std::string> childEnvironment(const ProcessOptions& options) {
    std::vector<std::string> result;
    for (char** entry = environ; *entry; ++entry) {
        const std::string_view text = *entry;
        const bool replaced =
            std::any_of(options.environment.begin(), options.environment.end(), [&](const auto& pair) {
                return text.starts_with(pair.first) && text.size() > pair.first.size() &&
                       text[pair.first.size()] == '=';
            });
        if (!replaced) result.emplace_back(text);
    }
    for (const auto& [name, value] : options.environment) result.push_back(name + "=" + value);
    return result;
}

/// Starts a program with the three streams on the given descriptors; returns its id.
Result<int> spawn(const std::vector<std::string>& command, const ProcessOptions& options,
                  const std::array<int, 3>& streams, bool newSession) {
    if (command.empty()) return makeError(ErrorCode::InvalidArgument, "", "a child process needs a command");
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    for (int i = 0; i < 3; ++i) posix_spawn_file_actions_adddup2(&actions, streams[i], i);
    if (!options.workingFolder.empty()) posix_spawn_file_actions_addchdir_np(&actions, options.workingFolder.c_str());
    posix_spawnattr_t attributes;
    posix_spawnattr_init(&attributes);
    sigset_t none, defaults;
    sigemptyset(&none);
    sigemptyset(&defaults);
    for (int number : {SIGINT, SIGTERM, SIGPIPE}) sigaddset(&defaults, number);
    posix_spawnattr_setsigmask(&attributes, &none);
    posix_spawnattr_setsigdefault(&attributes, &defaults);
    short flags = POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF;
    if (newSession) flags = static_cast<short>(flags | POSIX_SPAWN_SETSID);
    posix_spawnattr_setflags(&attributes, flags);

    std::vector<std::string> arguments = command;
    std::vector<std::string> environment = childEnvironment(options);
    pid_t id = -1;
    const int failure = ::posix_spawnp(&id, command[0].c_str(), &actions, &attributes, pointers(arguments).data(),
                                       pointers(environment).data());
    posix_spawn_file_actions_destroy(&actions);
    posix_spawnattr_destroy(&attributes);
    if (failure == ENOENT) {
        return makeError(ErrorCode::NotFound, command[0], "no such program (or working folder)");
    }
    if (failure != 0) {
        return makeError(ErrorCode::Io, command[0], fmt::format("cannot be started: {}", std::strerror(failure)));
    }
    return id;
}

/// Moves bytes between us and the child until it has closed both streams or the time is up; true when in time.
bool exchange(Pipe& input, Pipe& output, Pipe& errors, const ProcessOptions& options, ProcessResult& result,
              Clock::time_point deadline, bool hasDeadline) {
    std::size_t written = 0;
    std::array<char, 65536> chunk;
    auto drain = [&](Pipe& pipe, std::string& text) {
        const ssize_t got = ::read(pipe.readEnd, chunk.data(), chunk.size());
        if (got > 0) {
            const std::size_t room = options.maxOutputBytes - std::min(options.maxOutputBytes, text.size());
            text.append(chunk.data(), std::min(room, static_cast<std::size_t>(got)));
        } else if (got == 0 || errno != EINTR) {
            pipe.closeRead();
        }
    };
    if (options.input.empty()) input.closeWrite();
    while (output.readEnd >= 0 || errors.readEnd >= 0) {
        int wait = -1;
        if (hasDeadline) {
            const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(deadline - Clock::now()).count();
            if (left <= 0) return false;
            wait = static_cast<int>(std::min<long long>(left, 1000));
        }
        std::array<pollfd, 3> polled{pollfd{output.readEnd, POLLIN, 0}, pollfd{errors.readEnd, POLLIN, 0},
                                     pollfd{input.writeEnd, POLLOUT, 0}};
        if (::poll(polled.data(), polled.size(), wait) < 0 && errno != EINTR) return true;
        if (polled[0].revents) drain(output, result.output);
        if (polled[1].revents) drain(errors, result.errors);
        if (input.writeEnd >= 0 && polled[2].revents) {
            const ssize_t put = ::write(input.writeEnd, options.input.data() + written, options.input.size() - written);
            if (put > 0) written += static_cast<std::size_t>(put);
            if (put <= 0 || written == options.input.size()) input.closeWrite();
        }
    }
    return true;
}

/// A child that closes its streams early makes our write fail with EPIPE; the signal would end this program.
void ignoreBrokenPipes() {
    static const auto once = ::signal(SIGPIPE, SIG_IGN);
    (void)once;
}

/// Reaps the child: at its end, or at the deadline with SIGTERM and, 2 s later, SIGKILL. Returns the wait status.
int waitForEnd(int id, bool inTime, bool hasDeadline, Clock::time_point deadline, bool& timedOut) {
    int status = 0;
    auto endsBefore = [&](Clock::time_point limit) {
        while (::waitpid(id, &status, WNOHANG) == 0) {
            if (Clock::now() >= limit) return false;
            std::this_thread::sleep_for(std::chrono::milliseconds(2));
        }
        return true;
    };
    if (!hasDeadline) {
        while (::waitpid(id, &status, 0) < 0 && errno == EINTR) {
        }
        return status;
    }
    // The streams may be closed while the program goes on.
    if (inTime && endsBefore(deadline)) return status;
    timedOut = true;
    ::kill(id, SIGTERM);
    if (endsBefore(Clock::now() + std::chrono::seconds(2))) return status;
    ::kill(id, SIGKILL);
    ::waitpid(id, &status, 0);
    return status;
}

} // namespace

Result<ProcessResult> runProcess(const std::vector<std::string>& command, const ProcessOptions& options) {
    ignoreBrokenPipes();
    Pipe input, output, errors;
    ARS_TRY_STATUS(input.open());
    ARS_TRY_STATUS(output.open());
    ARS_TRY_STATUS(errors.open());
    // A blocking write of more than the pipe holds would stop us from reading what the child says meanwhile.
    ::fcntl(input.writeEnd, F_SETFL, O_NONBLOCK);
    ARS_TRY(const int id, spawn(command, options, {input.readEnd, output.writeEnd, errors.writeEnd}, false));
    input.closeRead();
    output.closeWrite();
    errors.closeWrite();

    ProcessResult result;
    const bool hasDeadline = options.timeout.count() > 0;
    const auto deadline = Clock::now() + options.timeout;
    const bool inTime = exchange(input, output, errors, options, result, deadline, hasDeadline);
    const int status = waitForEnd(id, inTime, hasDeadline, deadline, result.timedOut);
    result.exitCode = exitCodeOf(status);
    return result;
}

Result<FedProcess> FedProcess::start(const std::vector<std::string>& command, const ProcessOptions& options) {
    ignoreBrokenPipes();
    Pipe input, output, errors;
    ARS_TRY_STATUS(input.open());
    ARS_TRY_STATUS(output.open());
    ARS_TRY_STATUS(errors.open());
    // Non-blocking, so that what the child says is read while it is being fed; else both could wait for ever.
    ::fcntl(input.writeEnd, F_SETFL, O_NONBLOCK);
    ARS_TRY(const int id, spawn(command, options, {input.readEnd, output.writeEnd, errors.writeEnd}, false));
    FedProcess child;
    child.id_ = id;
    child.input_ = std::exchange(input.writeEnd, -1);
    child.output_ = std::exchange(output.readEnd, -1);
    child.errors_ = std::exchange(errors.readEnd, -1);
    child.maxOutputBytes_ = options.maxOutputBytes;
    return child;
}

FedProcess::FedProcess(FedProcess&& other) noexcept { *this = std::move(other); }

FedProcess& FedProcess::operator=(FedProcess&& other) noexcept {
    std::swap(id_, other.id_);
    std::swap(input_, other.input_);
    std::swap(output_, other.output_);
    std::swap(errors_, other.errors_);
    std::swap(maxOutputBytes_, other.maxOutputBytes_);
    std::swap(result_, other.result_);
    return *this;
}

FedProcess::~FedProcess() {
    if (id_ > 0) {
        ::kill(id_, SIGKILL);
        ::waitpid(id_, nullptr, 0);
    }
    close();
}

void FedProcess::close() {
    for (int* end : {&input_, &output_, &errors_}) {
        if (*end >= 0) ::close(std::exchange(*end, -1));
    }
}

/// Reads what the child has said; waits until it says something, takes input, or the time is up.
void FedProcess::drain(int timeoutMs, bool toTheEnd) {
    std::array<char, 65536> chunk;
    auto take = [&](int& end, std::string& text) {
        const ssize_t got = ::read(end, chunk.data(), chunk.size());
        if (got > 0) {
            text.append(chunk.data(), static_cast<std::size_t>(got));
            // Of a long report the end matters.
            if (text.size() > maxOutputBytes_) text.erase(0, text.size() - maxOutputBytes_);
        } else if (got == 0 || errno != EINTR) {
            ::close(std::exchange(end, -1));
        }
    };
    do {
        std::array<pollfd, 3> polled{pollfd{output_, POLLIN, 0}, pollfd{errors_, POLLIN, 0},
                                     pollfd{toTheEnd ? -1 : input_, POLLOUT, 0}};
        if (::poll(polled.data(), polled.size(), timeoutMs) < 0 && errno != EINTR) return;
        if (output_ >= 0 && polled[0].revents) take(output_, result_.output);
        if (errors_ >= 0 && polled[1].revents) take(errors_, result_.errors);
    } while (toTheEnd && (output_ >= 0 || errors_ >= 0));
}

Status FedProcess::write(std::span<const std::byte> bytes) {
    std::size_t written = 0;
    while (written < bytes.size()) {
        const ssize_t put = ::write(input_, bytes.data() + written, bytes.size() - written);
        if (put > 0) {
            written += static_cast<std::size_t>(put);
        } else if (put < 0 && errno != EAGAIN && errno != EINTR) {
            drain(100, false);
            const std::size_t tail = std::min<std::size_t>(result_.errors.size(), 400);
            return makeError(ErrorCode::Io, "",
                             fmt::format("a child process stopped reading: {}",
                                         result_.errors.substr(result_.errors.size() - tail)));
        } else {
            drain(1000, false);
        }
    }
    return {};
}

Result<ProcessResult> FedProcess::finish() {
    if (input_ >= 0) ::close(std::exchange(input_, -1));
    drain(-1, true);
    int status = 0;
    while (::waitpid(id_, &status, 0) < 0 && errno == EINTR) {
    }
    id_ = -1;
    result_.exitCode = exitCodeOf(status);
    close();
    return std::move(result_);
}

Result<ChildProcess> ChildProcess::start(const std::vector<std::string>& command, const std::filesystem::path& logFile,
                                         bool detached, const ProcessOptions& options) {
    Pipe streams; // only owns the two descriptors
    streams.readEnd = ::open("/dev/null", O_RDONLY | O_CLOEXEC);
    streams.writeEnd = ::open(logFile.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666);
    if (streams.writeEnd < 0) {
        return makeError(ErrorCode::Io, logFile.string(), fmt::format("cannot be written: {}", std::strerror(errno)));
    }
    ARS_TRY(const int id, spawn(command, options, {streams.readEnd, streams.writeEnd, streams.writeEnd}, detached));
    ChildProcess child;
    child.id_ = id;
    return child;
}

ChildProcess::ChildProcess(ChildProcess&& other) noexcept { *this = std::move(other); }

ChildProcess& ChildProcess::operator=(ChildProcess&& other) noexcept {
    id_ = std::exchange(other.id_, -1);
    reaped_ = other.reaped_;
    code_ = other.code_;
    return *this;
}

ChildProcess::~ChildProcess() {
    if (id_ > 0) running();
}

bool ChildProcess::running() {
    if (id_ <= 0 || reaped_) return false;
    int status = 0;
    const pid_t got = ::waitpid(id_, &status, WNOHANG);
    if (got == 0) return true;
    reaped_ = true;
    code_ = got == id_ ? exitCodeOf(status) : -1;
    return false;
}

std::optional<int> ChildProcess::exitCode() {
    if (running()) return std::nullopt;
    return code_;
}

Status ChildProcess::signal(int number) {
    if (!running()) return makeError(ErrorCode::NotFound, "", "the child process has already ended");
    if (::kill(id_, number) != 0) {
        return makeError(ErrorCode::Io, "", fmt::format("cannot signal process {}: {}", id_, std::strerror(errno)));
    }
    return {};
}

bool ChildProcess::wait(std::chrono::milliseconds timeout) {
    const auto deadline = Clock::now() + timeout;
    while (running()) {
        if (Clock::now() >= deadline) return false;
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    return true;
}

} // namespace ars
