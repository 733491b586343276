#pragma once

#include "engine/core/error.h"
#include "engine/core/limits.h"

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <span>
#include <string_view>
#include <vector>

namespace ars {

/// Bytes at any place of a file or of memory, so that one reader serves both and a large file need not be in memory.
class ByteSource {
public:
    virtual ~ByteSource() = default;
    virtual std::uint64_t size() const = 0;
    /// Fills `target` from `offset`. BadFile ("byte 12: expected 4 bytes of <what>, the file ends after 2") unless all
    /// of it is there. May be called from several threads at once.
    Status readAt(std::uint64_t offset, std::span<std::byte> target, std::string_view what) const;

protected:
    virtual Status fill(std::uint64_t offset, std::span<std::byte> target, std::string_view what) const = 0;
};

/// A view of bytes that the caller keeps alive.
class MemorySource final : public ByteSource {
public:
    explicit MemorySource(std::span<const std::byte> bytes) : bytes_(bytes) {}
    std::uint64_t size() const override { return bytes_.size(); }

protected:
    Status fill(std::uint64_t offset, std::span<std::byte> target, std::string_view what) const override;

private:
    std::span<const std::byte> bytes_;
};

/// A regular file, held open. The place of the errors is left to the caller.
class FileSource final : public ByteSource {
public:
    /// NotFound, Io (permission, a folder), LimitExceeded beyond limits.maxFileBytes.
    static Result<std::unique_ptr<FileSource>> open(const std::filesystem::path& path, const ReadLimits& limits);
    ~FileSource() override;
    FileSource(const FileSource&) = delete;
    FileSource& operator=(const FileSource&) = delete;
    std::uint64_t size() const override { return size_; }

protected:
    Status fill(std::uint64_t offset, std::span<std::byte> target, std::string_view what) const override;

private:
    FileSource(int descriptor, std::uint64_t size) : descriptor_(descriptor), size_(size) {}
    int descriptor_;
    std::uint64_t size_;
};

/// Bytes one after another with a known end: a file, or a zip member as it is unpacked.
class ByteStream {
public:
    virtual ~ByteStream() = default;
    std::uint64_t size() const { return size_; }
    std::uint64_t position() const { return position_; }
    std::uint64_t remaining() const { return size_ - position_; }
    /// Fills `target`; BadFile when the stream ends before or is damaged.
    Status read(std::span<std::byte> target, std::string_view what);
    /// BadFile unless every byte was read, nothing follows, and checksums agree.
    Status finish();

protected:
    explicit ByteStream(std::uint64_t size) : size_(size) {}
    virtual Status fill(std::span<std::byte> target, std::string_view what) = 0;
    virtual Status verify() { return {}; }

private:
    std::uint64_t size_;
    std::uint64_t position_ = 0;
};

/// A whole source from its first byte to its last.
class SourceStream final : public ByteStream {
public:
    explicit SourceStream(const ByteSource& source) : ByteStream(source.size()), source_(source) {}

protected:
    Status fill(std::span<std::byte> target, std::string_view what) override {
        return source_.readAt(position(), target, what);
    }

private:
    const ByteSource& source_;
};

/// Receives the bytes of a file that is being written, in order.
using ByteSink = std::function<Status(std::span<const std::byte>)>;

/// Adds `bytes` to `memory`; OutOfMemory rather than an exception.
Status appendBytes(std::vector<std::byte>& memory, std::span<const std::byte> bytes);

/// `bytes` of fresh memory, zeroed; OutOfMemory ("<what> needs N bytes") rather than an exception.
Result<std::vector<std::byte>> allocateBytes(std::uint64_t bytes, std::string_view what);

} // namespace ars
