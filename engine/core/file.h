#pragma once

#include "engine/core/error.h"
#include "engine/core/limits.h"

#include <cstddef>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

namespace ars {

/// A whole file in memory. NotFound, Io (permission, a folder), LimitExceeded; the path is the error's place.
Result<std::vector<std::byte>> readFile(const std::filesystem::path& path,
                                        const ReadLimits& limits = defaultReadLimits());

/// The same as text; no check of its encoding.
Result<std::string> readTextFile(const std::filesystem::path& path, const ReadLimits& limits = defaultReadLimits());

/// The first `count` bytes, or fewer when the file is shorter.
Result<std::vector<std::byte>> readFileHead(const std::filesystem::path& path, std::size_t count);

/// Writes a file so that at every moment either the old content or the whole new content stands under `path`: bytes go
/// to a temporary name beside it, are synced, and renamed over it by commit(). Without commit() nothing changes.
class AtomicFile {
public:
    /// Creates missing parent folders. The error's place is `path`.
    static Result<AtomicFile> open(const std::filesystem::path& path);
    AtomicFile(AtomicFile&& other) noexcept;
    AtomicFile& operator=(AtomicFile&& other) noexcept;
    ~AtomicFile();

    /// Io with the bytes wanted and the bytes free when the disk is full.
    Status write(std::span<const std::byte> bytes);
    Status write(std::string_view text);
    Status commit();

    /// Where the bytes lie until commit(), for libraries that insist on opening a path themselves.
    const std::filesystem::path& temporaryPath() const { return temporary_; }

private:
    AtomicFile() = default;
    void discard() noexcept;

    std::filesystem::path path_;
    std::filesystem::path temporary_;
    int descriptor_ = -1;
};

/// AtomicFile in one call.
Status writeFileAtomic(const std::filesystem::path& path, std::span<const std::byte> bytes);
Status writeFileAtomic(const std::filesystem::path& path, std::string_view text);

/// Folder of the resources that ship with the program: ARS_RESOURCES, else `resources` beside or above the executable.
Result<std::filesystem::path> resourceFolder();

} // namespace ars
