#pragma once

#include "engine/core/error.h"

#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string_view>

namespace ars {

/// A cursor over bytes that never reads outside them: every reader of a binary format stands on it.
/// Little endian; the machine must be too.
static_assert(std::endian::native == std::endian::little);

class ByteReader {
public:
    explicit ByteReader(std::span<const std::byte> bytes) : bytes_(bytes) {}

    std::size_t position() const { return position_; }
    std::size_t size() const { return bytes_.size(); }
    std::size_t remaining() const { return bytes_.size() - position_; }
    bool atEnd() const { return position_ == bytes_.size(); }

    /// BadFile ("byte 12: expected 4 bytes of <what>, the file ends after 2") unless `count` more bytes are there.
    Status require(std::uint64_t count, std::string_view what) const {
        if (count <= remaining()) return {};
        return makeError(ErrorCode::BadFile, fmt::format("byte {}", position_),
                         fmt::format("expected {} bytes of {}, the file ends after {}", count, what, remaining()));
    }
    Status seek(std::uint64_t position, std::string_view what) {
        if (position > bytes_.size()) {
            return makeError(ErrorCode::BadFile, fmt::format("byte {}", position_),
                             fmt::format("{} lies at byte {}, the file has {}", what, position, bytes_.size()));
        }
        position_ = static_cast<std::size_t>(position);
        return {};
    }
    Status skip(std::uint64_t count, std::string_view what) {
        ARS_TRY_STATUS(require(count, what));
        position_ += static_cast<std::size_t>(count);
        return {};
    }
    template <typename T>
    Result<T> read(std::string_view what) {
        static_assert(std::is_trivially_copyable_v<T>);
        ARS_TRY_STATUS(require(sizeof(T), what));
        T value;
        std::memcpy(&value, bytes_.data() + position_, sizeof(T));
        position_ += sizeof(T);
        return value;
    }
    Result<std::span<const std::byte>> readBytes(std::uint64_t count, std::string_view what) {
        ARS_TRY_STATUS(require(count, what));
        const auto piece = bytes_.subspan(position_, static_cast<std::size_t>(count));
        position_ += static_cast<std::size_t>(count);
        return piece;
    }
    /// A line without its end ("\n" or "\r\n"); BadFile when no byte is left.
    Result<std::string_view> readLine(std::string_view what) {
        ARS_TRY_STATUS(require(1, what));
        const char* begin = reinterpret_cast<const char*>(bytes_.data()) + position_;
        std::string_view rest(begin, remaining());
        const std::size_t end = rest.find('\n');
        std::string_view line = rest.substr(0, end);
        position_ += end == std::string_view::npos ? rest.size() : end + 1;
        if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
        return line;
    }

private:
    std::span<const std::byte> bytes_;
    std::size_t position_ = 0;
};

} // namespace ars
