#include "engine/capture/picture_header.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <string>
#include <string_view>
#include <system_error>

namespace ars {
namespace fs = std::filesystem;
namespace {

constexpr std::string_view kPngSignature = "\x89PNG\r\n\x1a\n";
constexpr std::uint64_t kTailBytes = 64 << 10;
constexpr int kMaxSegments = 4096;

/// A file of which a few bytes here and there are read.
class FileBytes {
public:
    FileBytes(const fs::path& path, std::uint64_t size) : stream_(path, std::ios::binary), size_(size) {}
    bool opened() const { return stream_.is_open(); }
    std::uint64_t size() const { return size_; }
    /// Up to `count` bytes from `offset`; fewer at the end of the file.
    std::string at(std::uint64_t offset, std::uint64_t count) {
        if (offset >= size_) return {};
        std::string bytes(static_cast<std::size_t>(std::min(count, size_ - offset)), '\0');
        stream_.clear();
        stream_.seekg(static_cast<std::streamoff>(offset));
        stream_.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
        bytes.resize(static_cast<std::size_t>(std::max<std::streamsize>(stream_.gcount(), 0)));
        return bytes;
    }

private:
    std::ifstream stream_;
    std::uint64_t size_;
};

unsigned byteAt(const std::string& bytes, std::size_t i) { return static_cast<unsigned char>(bytes[i]); }

/// Whether the marker starts a frame, which holds the size: SOF0 to SOF15 without DHT, JPG and DAC.
bool startsFrame(unsigned marker) {
    return marker >= 0xC0 && marker <= 0xCF && marker != 0xC4 && marker != 0xC8 && marker != 0xCC;
}

Result<PictureHeader> jpegHeader(FileBytes& file, const std::string& place) {
    std::uint64_t offset = 2;
    for (int segment = 0; segment < kMaxSegments; ++segment) {
        const std::string head = file.at(offset, 9);
        if (head.size() < 9 || byteAt(head, 0) != 0xFF) break;
        const unsigned marker = byteAt(head, 1);
        if (marker == 0xFF) { // fill bytes before a marker
            ++offset;
            continue;
        }
        if (startsFrame(marker)) {
            PictureHeader header;
            header.height = static_cast<int>(byteAt(head, 5) << 8 | byteAt(head, 6));
            header.width = static_cast<int>(byteAt(head, 7) << 8 | byteAt(head, 8));
            return header;
        }
        if (marker == 0xD9 || marker == 0xDA) break; // pixels or the end before any size
        offset += 2 + (byteAt(head, 2) << 8 | byteAt(head, 3));
    }
    return makeError(ErrorCode::BadFile, place, "is a broken JPEG: no picture size in it");
}

Result<PictureHeader> pngHeader(FileBytes& file, const std::string& place) {
    const std::string head = file.at(0, 26);
    if (head.size() < 26 || head.compare(12, 4, "IHDR") != 0) {
        return makeError(ErrorCode::BadFile, place, "is a broken PNG: it does not begin with its header");
    }
    const auto number = [&](std::size_t at) {
        return byteAt(head, at) << 24 | byteAt(head, at + 1) << 16 | byteAt(head, at + 2) << 8 | byteAt(head, at + 3);
    };
    PictureHeader header;
    constexpr unsigned kMost = 1u << 30; // the sizes that readers accept are far below
    header.width = static_cast<int>(std::min(number(16), kMost));
    header.height = static_cast<int>(std::min(number(20), kMost));
    header.alpha = byteAt(head, 25) == 4 || byteAt(head, 25) == 6;
    return header;
}

} // namespace

Result<PictureHeader> readPictureHeader(const fs::path& path) {
    const std::string place = path.string();
    std::error_code failure;
    const std::uint64_t size = fs::file_size(path, failure);
    if (failure) {
        const bool absent = failure == std::errc::no_such_file_or_directory;
        return makeError(absent ? ErrorCode::NotFound : ErrorCode::Io, place,
                         fmt::format("cannot be opened: {}", failure.message()));
    }
    if (size == 0) return makeError(ErrorCode::BadFile, place, "is empty, expected a picture");
    errno = 0;
    FileBytes file(path, size);
    if (!file.opened()) {
        return makeError(ErrorCode::Io, place, fmt::format("cannot be opened: {}", std::strerror(errno)));
    }
    const std::string head = file.at(0, kPngSignature.size());
    const bool png = head == kPngSignature;
    if (!png && (head.size() < 3 || head.compare(0, 3, "\xFF\xD8\xFF") != 0)) {
        return makeError(ErrorCode::BadFile, place, "is no JPEG or PNG picture");
    }
    ARS_TRY(const PictureHeader header, png ? pngHeader(file, place) : jpegHeader(file, place));
    const std::string tail = file.at(size - std::min(size, kTailBytes), kTailBytes);
    const std::string_view end = png ? std::string_view("IEND") : std::string_view("\xFF\xD9");
    if (tail.rfind(end) == std::string::npos) {
        return makeError(ErrorCode::BadFile, place,
                         fmt::format("is truncated: the {} has no end", png ? "PNG" : "JPEG"));
    }
    return header;
}

} // namespace ars
