#include "engine/core/file.h"

#include "engine/core/buffer.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstdlib>
#include <cstring>

namespace ars {
namespace fs = std::filesystem;
namespace {

/// Closes a descriptor at the end of a scope.
struct Descriptor {
    int value = -1;
    ~Descriptor() {
        if (value >= 0) ::close(value);
    }
};

Error systemError(const fs::path& path, std::string_view what, int number) {
    const ErrorCode code = number == ENOENT ? ErrorCode::NotFound : ErrorCode::Io;
    if (number == ENOENT) return makeError(code, path.string(), fmt::format("{}: no such file", what));
    if (number == EISDIR) return makeError(code, path.string(), fmt::format("{}: this is a folder", what));
    return makeError(code, path.string(), fmt::format("{}: {}", what, std::strerror(number)));
}

Status openForReading(const fs::path& path, Descriptor& descriptor, std::uint64_t& bytes) {
    descriptor.value = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
    if (descriptor.value < 0) return systemError(path, "cannot be opened", errno);
    struct stat info{};
    if (::fstat(descriptor.value, &info) != 0) return systemError(path, "cannot be read", errno);
    if (S_ISDIR(info.st_mode)) return systemError(path, "cannot be read", EISDIR);
    if (!S_ISREG(info.st_mode)) {
        return makeError(ErrorCode::Io, path.string(), "cannot be read: this is not a regular file");
    }
    bytes = static_cast<std::uint64_t>(info.st_size);
    return {};
}

Result<std::size_t> readUpTo(const fs::path& path, int descriptor, void* target, std::size_t count) {
    std::size_t done = 0;
    while (done < count) {
        const ssize_t got = ::read(descriptor, static_cast<char*>(target) + done, count - done);
        if (got < 0) {
            if (errno == EINTR) continue;
            return systemError(path, "cannot be read", errno);
        }
        if (got == 0) break;
        done += static_cast<std::size_t>(got);
    }
    return done;
}

template <typename Container>
Status readInto(const fs::path& path, const ReadLimits& limits, Container& content) {
    Descriptor descriptor;
    std::uint64_t bytes = 0;
    ARS_TRY_STATUS(openForReading(path, descriptor, bytes));
    if (bytes > limits.maxFileBytes || bytes > limits.maxBytes) {
        return makeError(ErrorCode::LimitExceeded, path.string(),
                         fmt::format("the file has {}, the limit is {}", formatBytes(bytes),
                                     formatBytes(std::min(limits.maxFileBytes, limits.maxBytes))));
    }
    try {
        content.resize(static_cast<std::size_t>(bytes));
    } catch (const std::bad_alloc&) {
        return makeError(ErrorCode::OutOfMemory, path.string(),
                         fmt::format("not enough memory for {} of file", formatBytes(bytes)));
    }
    ARS_TRY(const std::size_t got, readUpTo(path, descriptor.value, content.data(), content.size()));
    content.resize(got); // the file may have become shorter since
    return {};
}

Status syncFolder(const fs::path& folder) {
    const Descriptor descriptor{::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC)};
    // Some network file systems refuse to sync a folder; the rename itself is done by then.
    if (descriptor.value >= 0) ::fsync(descriptor.value);
    return {};
}

} // namespace

Result<std::vector<std::byte>> readFile(const fs::path& path, const ReadLimits& limits) {
    std::vector<std::byte> content;
    ARS_TRY_STATUS(readInto(path, limits, content));
    return content;
}

Result<std::string> readTextFile(const fs::path& path, const ReadLimits& limits) {
    std::string content;
    ARS_TRY_STATUS(readInto(path, limits, content));
    return content;
}

Result<std::vector<std::byte>> readFileHead(const fs::path& path, std::size_t count) {
    Descriptor descriptor;
    std::uint64_t bytes = 0;
    ARS_TRY_STATUS(openForReading(path, descriptor, bytes));
    std::vector<std::byte> head(static_cast<std::size_t>(std::min<std::uint64_t>(bytes, count)));
    ARS_TRY(const std::size_t got, readUpTo(path, descriptor.value, head.data(), head.size()));
    head.resize(got);
    return head;
}

Result<AtomicFile> AtomicFile::open(const fs::path& path) {
    static std::atomic<unsigned> counter{0};
    AtomicFile file;
    file.path_ = path;
    std::error_code failure;
    const fs::path folder = path.has_parent_path() ? path.parent_path() : fs::path(".");
    fs::create_directories(folder, failure);
    if (failure) {
        return makeError(ErrorCode::Io, path.string(), fmt::format("cannot make its folder: {}", failure.message()));
    }
    file.temporary_ = path;
    file.temporary_ += fmt::format(".tmp-{}-{}", ::getpid(), counter++);
    file.descriptor_ = ::open(file.temporary_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (file.descriptor_ < 0) return systemError(path, "cannot be written", errno);
    return file;
}

AtomicFile::AtomicFile(AtomicFile&& other) noexcept { *this = std::move(other); }

AtomicFile& AtomicFile::operator=(AtomicFile&& other) noexcept {
    if (this != &other) {
        discard();
        path_ = std::move(other.path_);
        temporary_ = std::move(other.temporary_);
        descriptor_ = std::exchange(other.descriptor_, -1);
    }
    return *this;
}

AtomicFile::~AtomicFile() { discard(); }

void AtomicFile::discard() noexcept {
    if (descriptor_ < 0) return;
    ::close(descriptor_);
    ::unlink(temporary_.c_str());
    descriptor_ = -1;
}

Status AtomicFile::write(std::span<const std::byte> bytes) {
    std::size_t done = 0;
    while (done < bytes.size()) {
        const ssize_t put = ::write(descriptor_, bytes.data() + done, bytes.size() - done);
        if (put < 0) {
            if (errno == EINTR) continue;
            const int number = errno;
            if (number == ENOSPC) {
                std::error_code ignored;
                const fs::space_info space =
                    fs::space(temporary_.parent_path().empty() ? "." : temporary_.parent_path(), ignored);
                return makeError(ErrorCode::Io, path_.string(),
                                 fmt::format("disk full: {} still to write, {} free on that volume; what stood under "
                                             "this name is unchanged",
                                             formatBytes(bytes.size() - done), formatBytes(space.available)));
            }
            return systemError(path_, "cannot be written", number);
        }
        done += static_cast<std::size_t>(put);
    }
    return {};
}

Status AtomicFile::write(std::string_view text) {
    return write(std::as_bytes(std::span<const char>(text.data(), text.size())));
}

Status AtomicFile::commit() {
    if (descriptor_ < 0) return makeError(ErrorCode::Internal, path_.string(), "committed twice");
    // A library may have written to the temporary path through a descriptor of its own: syncing ours syncs the file.
    if (::fsync(descriptor_) != 0) return systemError(path_, "cannot be written to disk", errno);
    if (::close(std::exchange(descriptor_, -1)) != 0) {
        ::unlink(temporary_.c_str());
        return systemError(path_, "cannot be written to disk", errno);
    }
    if (::rename(temporary_.c_str(), path_.c_str()) != 0) {
        const int number = errno;
        ::unlink(temporary_.c_str());
        return systemError(path_, "cannot be put in place", number);
    }
    return syncFolder(path_.has_parent_path() ? path_.parent_path() : fs::path("."));
}

Status writeFileAtomic(const fs::path& path, std::span<const std::byte> bytes) {
    ARS_TRY(AtomicFile file, AtomicFile::open(path));
    ARS_TRY_STATUS(file.write(bytes));
    return file.commit();
}

Status writeFileAtomic(const fs::path& path, std::string_view text) {
    return writeFileAtomic(path, std::as_bytes(std::span<const char>(text.data(), text.size())));
}

Result<fs::path> resourceFolder() {
    std::vector<fs::path> candidates;
    if (const char* text = std::getenv("ARS_RESOURCES")) candidates.emplace_back(text);
    std::error_code failure;
    fs::path folder = fs::read_symlink("/proc/self/exe", failure).parent_path();
    // build/PRESET/bin/ars in a checkout, bin/ars beside share/ars when installed.
    candidates.push_back(folder / "../share/ars/resources");
    for (int up = 0; up < 5 && !folder.empty(); ++up, folder = folder.parent_path()) {
        candidates.push_back(folder / "resources");
    }
    for (const fs::path& candidate : candidates) {
        if (fs::is_directory(candidate, failure)) return fs::weakly_canonical(candidate, failure);
    }
    return makeError(ErrorCode::NotFound, "resources",
                     "the folder of resources was not found beside the program; set ARS_RESOURCES to it");
}

} // namespace ars
