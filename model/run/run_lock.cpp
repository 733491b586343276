#include "model/run/run_lock.h"

#include "engine/scene/run_folder.h"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <ctime>

namespace ars {
namespace fs = std::filesystem;
namespace {

Error systemError(const fs::path& path, std::string_view what) {
    return makeError(ErrorCode::Io, path.string(), fmt::format("{}: {}", what, std::strerror(errno)));
}

Error ownedError(const fs::path& path) {
    const RunOwner owner = readRunOwner(path.parent_path());
    const std::string who =
        owner.process > 0 ? fmt::format("process {} on {}", owner.process, owner.host) : std::string("another process");
    return makeError(ErrorCode::Unavailable, path.parent_path().string(),
                     fmt::format("{} works on this run; stop it first", who));
}

/// Whether the locked file is still the one that stands under the name: a run may be discarded while we open it.
bool stillNamed(int descriptor, const fs::path& path) {
    struct stat ours{};
    struct stat named{};
    return ::fstat(descriptor, &ours) == 0 && ::stat(path.c_str(), &named) == 0 && ours.st_ino == named.st_ino &&
           ours.st_dev == named.st_dev;
}

Status writeOwner(int descriptor, const fs::path& path) {
    const nlohmann::json owner{{"process", ::getpid()}, {"host", hostName()}, {"since_unix_s", std::time(nullptr)}};
    const std::string text = owner.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace) + "\n";
    const bool written = ::ftruncate(descriptor, 0) == 0 &&
                         ::pwrite(descriptor, text.data(), text.size(), 0) == static_cast<ssize_t>(text.size());
    if (!written) return systemError(path, "cannot be written");
    return {};
}

Status syncPath(const fs::path& path, int flags) {
    const int descriptor = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | flags);
    if (descriptor < 0) return systemError(path, "cannot be synced");
    const int failed = ::fsync(descriptor);
    const int number = errno;
    ::close(descriptor);
    errno = number;
    // Some network file systems refuse to sync a folder (EINVAL); the names are theirs to keep then.
    if (failed != 0 && number != EINVAL) return systemError(path, "cannot be written to disk");
    return {};
}

} // namespace

Result<int> takeRunLock(const fs::path& path) {
    // Where locks stay on one machine this one would be granted, and the owner's name written over.
    if (runOwnerElsewhere(path.parent_path()).process > 0) return ownedError(path);
    for (int attempt = 0; attempt < 10; ++attempt) {
        const int descriptor = ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666);
        if (descriptor < 0) return systemError(path, "cannot be opened");
        struct flock lock{};
        lock.l_type = F_WRLCK;
        lock.l_whence = SEEK_SET;
        if (::fcntl(descriptor, F_OFD_SETLK, &lock) != 0) {
            const bool owned = errno == EAGAIN || errno == EACCES;
            Error error = owned ? ownedError(path) : systemError(path, "cannot be locked");
            ::close(descriptor);
            return error;
        }
        if (!stillNamed(descriptor, path)) {
            ::close(descriptor);
            continue;
        }
        if (Status written = writeOwner(descriptor, path); !written) {
            ::close(descriptor);
            return std::move(written).error();
        }
        return descriptor;
    }
    return makeError(ErrorCode::Io, path.string(), "cannot be locked: it is made and removed all the time");
}

void releaseRunLock(int descriptor) {
    if (descriptor < 0) return;
    [[maybe_unused]] const int ignored = ::ftruncate(descriptor, 0);
    ::close(descriptor);
}

Status syncFolder(const fs::path& folder) { return syncPath(folder, O_DIRECTORY); }

Status syncTree(const fs::path& folder) {
    std::error_code failure;
    for (fs::recursive_directory_iterator it(folder, failure), end; !failure && it != end; it.increment(failure)) {
        ARS_TRY_STATUS(syncPath(it->path(), it->is_directory() ? O_DIRECTORY : 0));
    }
    if (failure) {
        return makeError(ErrorCode::Io, folder.string(), fmt::format("cannot be read: {}", failure.message()));
    }
    return syncFolder(folder);
}

} // namespace ars
