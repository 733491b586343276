#include "engine/io/byte_source.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <new>
#include <stdexcept>
#include <system_error>

namespace ars {
namespace {

Error systemError(int number, std::string_view action) {
    const ErrorCode code = number == ENOENT ? ErrorCode::NotFound : ErrorCode::Io;
    return makeError(code, "", fmt::format("cannot {}: {}", action, std::generic_category().message(number)));
}

Error tooShort(std::uint64_t offset, std::uint64_t wanted, std::uint64_t found, std::string_view what) {
    return makeError(ErrorCode::BadFile, fmt::format("byte {}", offset),
                     fmt::format("expected {} bytes of {}, the file ends after {}", wanted, what, found));
}

} // namespace

Status ByteSource::readAt(std::uint64_t offset, std::span<std::byte> target, std::string_view what) const {
    const std::uint64_t there = offset < size() ? size() - offset : 0;
    if (target.size() > there) return tooShort(offset, target.size(), there, what);
    if (target.empty()) return {};
    return fill(offset, target, what);
}

Status MemorySource::fill(std::uint64_t offset, std::span<std::byte> target, std::string_view) const {
    std::memcpy(target.data(), bytes_.data() + offset, target.size());
    return {};
}

Result<std::unique_ptr<FileSource>> FileSource::open(const std::filesystem::path& path, const ReadLimits& limits) {
    // Non-blocking, so that a named pipe without a writer is refused instead of waited for.
    const int descriptor = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (descriptor < 0) return systemError(errno, "open the file");
    struct stat info{};
    if (::fstat(descriptor, &info) != 0) {
        const int number = errno;
        ::close(descriptor);
        return systemError(number, "read the file's size");
    }
    std::unique_ptr<FileSource> source(new FileSource(descriptor, static_cast<std::uint64_t>(info.st_size)));
    if (S_ISDIR(info.st_mode)) return makeError(ErrorCode::Io, "", "is a folder, expected a file");
    if (!S_ISREG(info.st_mode)) return makeError(ErrorCode::Io, "", "is no regular file");
    if (source->size() > limits.maxFileBytes) {
        return makeError(ErrorCode::LimitExceeded, "",
                         fmt::format("the file has {} bytes, the limit is {}", source->size(), limits.maxFileBytes));
    }
    return source;
}

FileSource::~FileSource() { ::close(descriptor_); }

Status FileSource::fill(std::uint64_t offset, std::span<std::byte> target, std::string_view what) const {
    std::size_t done = 0;
    while (done < target.size()) {
        const ssize_t got =
            ::pread(descriptor_, target.data() + done, target.size() - done, static_cast<off_t>(offset + done));
        if (got < 0 && errno == EINTR) continue;
        if (got < 0) return systemError(errno, fmt::format("read {}", what));
        // The file was cut short since it was opened.
        if (got == 0) return tooShort(offset, target.size(), done, what);
        done += static_cast<std::size_t>(got);
    }
    return {};
}

Status ByteStream::read(std::span<std::byte> target, std::string_view what) {
    if (target.size() > remaining()) return tooShort(position_, target.size(), remaining(), what);
    if (target.empty()) return {};
    ARS_TRY_STATUS(fill(target, what));
    position_ += target.size();
    return {};
}

Status ByteStream::finish() {
    if (remaining() > 0) {
        return makeError(ErrorCode::BadFile, fmt::format("byte {}", position_),
                         fmt::format("{} bytes follow the end of the data", remaining()));
    }
    return verify();
}

Status appendBytes(std::vector<std::byte>& memory, std::span<const std::byte> bytes) {
    try {
        memory.insert(memory.end(), bytes.begin(), bytes.end());
    } catch (const std::exception&) { // bad_alloc or length_error
        return makeError(ErrorCode::OutOfMemory, "",
                         fmt::format("no memory for {} bytes", memory.size() + bytes.size()));
    }
    return {};
}

Result<std::vector<std::byte>> allocateBytes(std::uint64_t bytes, std::string_view what) {
    try {
        return std::vector<std::byte>(static_cast<std::size_t>(bytes));
    } catch (const std::exception&) { // bad_alloc or length_error
        return makeError(ErrorCode::OutOfMemory, "", fmt::format("no memory for the {} bytes of {}", bytes, what));
    }
}

} // namespace ars
