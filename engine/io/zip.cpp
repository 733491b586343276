#include "engine/io/zip.h"

#include "engine/io/byte_reader.h"
#include "engine/io/utf8.h"

#include <zlib.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <set>

namespace ars {
namespace {

// Signatures and sizes of APPNOTE 4.3.
constexpr std::uint32_t kLocalSignature = 0x04034b50;
constexpr std::uint32_t kDirectorySignature = 0x02014b50;
constexpr std::uint32_t kEndSignature = 0x06054b50;
constexpr std::uint32_t kEnd64Signature = 0x06064b50;
constexpr std::uint32_t kLocator64Signature = 0x07064b50;
constexpr std::size_t kLocalBytes = 30;
constexpr std::size_t kDirectoryBytes = 46;
constexpr std::size_t kEndBytes = 22;
constexpr std::size_t kEnd64Bytes = 56;
constexpr std::size_t kLocator64Bytes = 20;

constexpr std::uint16_t kStored = 0;
constexpr std::uint16_t kDeflated = 8;
constexpr std::uint16_t kZip64Extra = 1;
constexpr std::uint16_t kFlagEncrypted = 1;
constexpr std::uint16_t kFlagUtf8 = 1 << 11;
constexpr std::uint32_t kIn64 = 0xFFFFFFFF; ///< "look in the zip64 field"
constexpr std::uint16_t kCountIn64 = 0xFFFF;

/// Deflate codes at best 258 bytes in two bits.
constexpr std::uint64_t kMaxDeflateRatio = 1032;
/// What zlib's counters hold; larger pieces go in turns.
constexpr std::size_t kMaxZlibPiece = 1u << 30;

Error badZip(std::uint64_t byte, std::string message) {
    return makeError(ErrorCode::BadFile, fmt::format("byte {}", byte), std::move(message));
}

/// zlib's CRC-32 carried on over `bytes`. zlib takes a null pointer, which an empty span may hold, for a new start.
uLong addToCrc(uLong crc, std::span<const std::byte> bytes) {
    if (bytes.empty()) return crc;
    return crc32_z(crc, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size());
}

/// Where the directory lies and what it should hold.
struct DirectoryEnd {
    std::uint64_t members = 0;
    std::uint64_t bytes = 0;
    std::uint64_t offset = 0;
    std::uint64_t position = 0; ///< of the end record itself; the directory lies before it
};

template <typename T>
T get(std::span<const std::byte> bytes, std::size_t offset) {
    T value;
    std::memcpy(&value, bytes.data() + offset, sizeof value);
    return value;
}

Result<DirectoryEnd> readEnd64(const ByteSource& source, std::uint64_t endPosition) {
    std::array<std::byte, kLocator64Bytes> locator{};
    if (endPosition < locator.size())
        return badZip(endPosition, "expected a zip64 locator before the zip's end record");
    ARS_TRY_STATUS(source.readAt(endPosition - locator.size(), locator, "the zip64 locator"));
    if (get<std::uint32_t>(locator, 0) != kLocator64Signature) {
        return badZip(endPosition - locator.size(), "expected the zip64 locator that the end record points to");
    }
    const auto position = get<std::uint64_t>(locator, 8);
    std::array<std::byte, kEnd64Bytes> record{};
    ARS_TRY_STATUS(source.readAt(position, record, "the zip64 end record"));
    if (get<std::uint32_t>(record, 0) != kEnd64Signature) return badZip(position, "expected the zip64 end record");
    if (get<std::uint32_t>(record, 16) != 0 || get<std::uint32_t>(record, 20) != 0) {
        return makeError(ErrorCode::Unsupported, "", "is one volume of a zip in several volumes");
    }
    return DirectoryEnd{get<std::uint64_t>(record, 32), get<std::uint64_t>(record, 40), get<std::uint64_t>(record, 48),
                        position};
}

/// Finds the end record: the last thing in the file but for a comment of at most 65,535 bytes.
Result<DirectoryEnd> findDirectory(const ByteSource& source) {
    const std::uint64_t tailBytes = std::min<std::uint64_t>(source.size(), kEndBytes + 0xFFFF);
    std::vector<std::byte> tail(static_cast<std::size_t>(tailBytes));
    const std::uint64_t tailStart = source.size() - tailBytes;
    ARS_TRY_STATUS(source.readAt(tailStart, tail, "the end of the zip"));
    for (std::size_t i = tail.size() < kEndBytes ? 0 : tail.size() - kEndBytes + 1; i-- > 0;) {
        const auto record = std::span<const std::byte>(tail).subspan(i);
        if (get<std::uint32_t>(record, 0) != kEndSignature) continue;
        if (kEndBytes + get<std::uint16_t>(record, 20) != record.size()) continue;
        if (get<std::uint16_t>(record, 4) != 0 || get<std::uint16_t>(record, 6) != 0) {
            return makeError(ErrorCode::Unsupported, "", "is one volume of a zip in several volumes");
        }
        const DirectoryEnd end{get<std::uint16_t>(record, 10), get<std::uint32_t>(record, 12),
                               get<std::uint32_t>(record, 16), tailStart + i};
        if (end.members == kCountIn64 || end.bytes == kIn64 || end.offset == kIn64) {
            return readEnd64(source, end.position);
        }
        return end;
    }
    return badZip(source.size(), "expected the zip's end record, found none: the file is cut short or is no zip");
}

/// Takes the 64-bit values that the 32-bit fields point to; they stand in this order, only where needed.
Status readZip64Extra(std::span<const std::byte> extra, std::uint64_t place, std::span<std::uint64_t* const> fields) {
    ByteReader reader(extra);
    while (reader.remaining() >= 4) {
        ARS_TRY(const auto id, reader.read<std::uint16_t>("an extra field"));
        ARS_TRY(const auto length, reader.read<std::uint16_t>("an extra field"));
        if (length > reader.remaining()) break;
        ARS_TRY(const auto body, reader.readBytes(length, "an extra field"));
        if (id != kZip64Extra) continue;
        ByteReader values(body);
        for (std::uint64_t* field : fields) {
            if (*field != kIn64) continue;
            if (values.remaining() < 8) return badZip(place, "expected a 64-bit size in the zip64 field, found none");
            ARS_TRY(*field, values.read<std::uint64_t>("a 64-bit size"));
        }
        return {};
    }
    for (const std::uint64_t* field : fields) {
        if (*field == kIn64) return badZip(place, "expected a zip64 field for a member of 4 GiB or more, found none");
    }
    return {};
}

/// A directory entry and where its local header lies.
struct Located {
    ZipEntry entry;
    std::string rawName;
    std::uint64_t headerOffset = 0;
};

Result<Located> readDirectoryEntry(ByteReader& reader, std::uint64_t directoryOffset) {
    const std::uint64_t place = directoryOffset + reader.position();
    ARS_TRY(const auto fixed, reader.readBytes(kDirectoryBytes, "a zip directory entry"));
    if (get<std::uint32_t>(fixed, 0) != kDirectorySignature) return badZip(place, "expected a zip directory entry");
    ARS_TRY(const auto name, reader.readBytes(get<std::uint16_t>(fixed, 28), "a member's name"));
    ARS_TRY(const auto extra, reader.readBytes(get<std::uint16_t>(fixed, 30), "a member's extra fields"));
    ARS_TRY_STATUS(reader.skip(get<std::uint16_t>(fixed, 32), "a member's comment"));
    Located located;
    located.rawName.assign(reinterpret_cast<const char*>(name.data()), name.size());
    ZipEntry& entry = located.entry;
    entry.name = utf8OrLatin1(located.rawName);
    entry.encrypted = (get<std::uint16_t>(fixed, 8) & kFlagEncrypted) != 0;
    entry.method = get<std::uint16_t>(fixed, 10);
    entry.crc = get<std::uint32_t>(fixed, 16);
    entry.packedBytes = get<std::uint32_t>(fixed, 20);
    entry.plainBytes = get<std::uint32_t>(fixed, 24);
    located.headerOffset = get<std::uint32_t>(fixed, 42);
    std::uint64_t* const fields[] = {&entry.plainBytes, &entry.packedBytes, &located.headerOffset};
    ARS_TRY_STATUS(readZip64Extra(extra, place, fields));
    return located;
}

/// Follows the entry to its local header, which says where the data begin.
Status locateData(const ByteSource& source, std::uint64_t directoryOffset, Located& located) {
    ZipEntry& entry = located.entry;
    std::array<std::byte, kLocalBytes> fixed{};
    if (located.headerOffset > directoryOffset || directoryOffset - located.headerOffset < kLocalBytes) {
        return badZip(located.headerOffset, "expected the member before the zip's directory");
    }
    ARS_TRY_STATUS(source.readAt(located.headerOffset, fixed, "a member's header"));
    if (get<std::uint32_t>(fixed, 0) != kLocalSignature) return badZip(located.headerOffset, "expected a zip member");
    std::string name(get<std::uint16_t>(fixed, 26), '\0');
    ARS_TRY_STATUS(
        source.readAt(located.headerOffset + kLocalBytes, std::as_writable_bytes(std::span(name)), "a member's name"));
    if (name != located.rawName || get<std::uint16_t>(fixed, 8) != entry.method) {
        return badZip(located.headerOffset, "the member's own header contradicts the zip's directory");
    }
    entry.dataOffset = located.headerOffset + kLocalBytes + name.size() + get<std::uint16_t>(fixed, 28);
    const std::uint64_t room = entry.dataOffset <= directoryOffset ? directoryOffset - entry.dataOffset : 0;
    if (entry.packedBytes > room || entry.dataOffset > directoryOffset) {
        return badZip(entry.dataOffset,
                      fmt::format("expected {} bytes before the zip's directory, found {}", entry.packedBytes, room));
    }
    if (entry.method == kStored && !entry.encrypted && entry.packedBytes != entry.plainBytes) {
        return badZip(entry.dataOffset, fmt::format("a stored member has {} bytes, but declares {}", entry.packedBytes,
                                                    entry.plainBytes));
    }
    if (entry.method == kDeflated && entry.plainBytes / kMaxDeflateRatio > entry.packedBytes) {
        return badZip(entry.dataOffset, fmt::format("{} deflated bytes cannot hold the {} bytes declared",
                                                    entry.packedBytes, entry.plainBytes));
    }
    return {};
}

Status checkDistinct(std::vector<Located>& members) {
    std::set<std::string_view> names;
    for (const Located& member : members) {
        if (names.insert(member.entry.name).second) continue;
        return makeError(ErrorCode::BadFile, member.entry.name, "the zip holds two members of this name");
    }
    std::vector<const Located*> byPlace;
    for (const Located& member : members) byPlace.push_back(&member);
    std::sort(byPlace.begin(), byPlace.end(),
              [](const Located* a, const Located* b) { return a->headerOffset < b->headerOffset; });
    for (std::size_t i = 1; i < byPlace.size(); ++i) {
        const ZipEntry& before = byPlace[i - 1]->entry;
        if (before.dataOffset + before.packedBytes <= byPlace[i]->headerOffset) continue;
        return badZip(byPlace[i]->headerOffset, fmt::format("the members \"{}\" and \"{}\" overlap: a zip bomb",
                                                            before.name, byPlace[i]->entry.name));
    }
    return {};
}

/// A member that lies in the archive as it is.
class StoredStream final : public ByteStream {
public:
    StoredStream(const ByteSource& source, const ZipEntry& entry)
        : ByteStream(entry.plainBytes), source_(source), offset_(entry.dataOffset), expectedCrc_(entry.crc) {}

protected:
    Status fill(std::span<std::byte> target, std::string_view what) override {
        ARS_TRY_STATUS(source_.readAt(offset_ + position(), target, what));
        crc_ = addToCrc(crc_, target);
        return {};
    }
    Status verify() override {
        if (crc_ == expectedCrc_) return {};
        return makeError(ErrorCode::BadFile, "",
                         fmt::format("is damaged: expected checksum {:08x}, found {:08x}", expectedCrc_, crc_));
    }

private:
    const ByteSource& source_;
    std::uint64_t offset_;
    uLong expectedCrc_;
    uLong crc_ = 0;
};

/// A deflated member. Packed bytes come through a small buffer, plain ones go straight to the reader's memory.
class DeflatedStream final : public ByteStream {
public:
    DeflatedStream(const ByteSource& source, const ZipEntry& entry)
        : ByteStream(entry.plainBytes), source_(source), packedPosition_(entry.dataOffset),
          packedLeft_(entry.packedBytes), expectedCrc_(entry.crc) {}
    ~DeflatedStream() override {
        if (started_) inflateEnd(&zlib_);
    }
    Status start() {
        // Negative: no zlib header around the deflate stream.
        if (inflateInit2(&zlib_, -MAX_WBITS) != Z_OK) {
            return makeError(ErrorCode::OutOfMemory, "", "no memory to unpack deflated data");
        }
        started_ = true;
        // A header is read first; most callers that want no more are content with this.
        return resize(4096);
    }

protected:
    Status fill(std::span<std::byte> target, std::string_view what) override {
        if (target.size() > kFewBytes) ARS_TRY_STATUS(resize(256 * 1024));
        for (std::size_t done = 0; done < target.size();) {
            const std::size_t piece = std::min(target.size() - done, kMaxZlibPiece);
            ARS_TRY_STATUS(unpack(target.subspan(done, piece), what));
            done += piece;
        }
        crc_ = addToCrc(crc_, target);
        return {};
    }
    Status verify() override {
        // The end mark may still be unread; asking for one byte more must give none.
        std::byte extra{};
        zlib_.next_out = reinterpret_cast<Bytef*>(&extra);
        zlib_.avail_out = 1;
        while (!ended_ && zlib_.avail_out == 1) ARS_TRY_STATUS(step("the end of deflated data"));
        if (zlib_.avail_out == 0) {
            return makeError(ErrorCode::BadFile, "",
                             fmt::format("unpacks to more than the {} bytes that the zip declares", size()));
        }
        if (packedLeft_ > 0 || zlib_.avail_in > 0) {
            return makeError(ErrorCode::BadFile, "",
                             fmt::format("{} bytes follow the end of the deflated data", packedLeft_ + zlib_.avail_in));
        }
        if (crc_ == expectedCrc_) return {};
        return makeError(ErrorCode::BadFile, "",
                         fmt::format("is damaged: expected checksum {:08x}, found {:08x}", expectedCrc_, crc_));
    }

private:
    static constexpr std::size_t kFewBytes = 65536;

    /// A larger buffer for what is still to come; what is in it stays.
    Status resize(std::size_t bytes) {
        if (buffer_.size() >= bytes) return {};
        ARS_TRY(std::vector<std::byte> larger, allocateBytes(bytes, "a read buffer"));
        if (zlib_.avail_in > 0) std::memcpy(larger.data(), zlib_.next_in, zlib_.avail_in);
        buffer_ = std::move(larger);
        zlib_.next_in = reinterpret_cast<Bytef*>(buffer_.data());
        return {};
    }

    Status unpack(std::span<std::byte> target, std::string_view what) {
        zlib_.next_out = reinterpret_cast<Bytef*>(target.data());
        zlib_.avail_out = static_cast<uInt>(target.size());
        while (zlib_.avail_out > 0) {
            if (ended_) {
                return makeError(ErrorCode::BadFile, fmt::format("byte {}", position()),
                                 fmt::format("expected {} bytes of {}, the deflated data end {} short", target.size(),
                                             what, zlib_.avail_out));
            }
            ARS_TRY_STATUS(step(what));
        }
        return {};
    }

    /// One call of inflate, with packed bytes at hand.
    Status step(std::string_view what) {
        if (zlib_.avail_in == 0) {
            const auto piece = static_cast<std::size_t>(std::min<std::uint64_t>(packedLeft_, buffer_.size()));
            if (piece == 0) {
                return makeError(ErrorCode::BadFile, fmt::format("byte {}", position()),
                                 fmt::format("the deflated data end within {}", what));
            }
            ARS_TRY_STATUS(source_.readAt(packedPosition_, std::span(buffer_).first(piece), what));
            packedPosition_ += piece;
            packedLeft_ -= piece;
            zlib_.next_in = reinterpret_cast<Bytef*>(buffer_.data());
            zlib_.avail_in = static_cast<uInt>(piece);
        }
        const int code = inflate(&zlib_, Z_NO_FLUSH);
        ended_ = code == Z_STREAM_END;
        if (ended_ || code == Z_OK || code == Z_BUF_ERROR) return {};
        if (code == Z_MEM_ERROR) return makeError(ErrorCode::OutOfMemory, "", "no memory to unpack deflated data");
        return makeError(
            ErrorCode::BadFile, fmt::format("byte {}", position()),
            fmt::format("the deflated data are damaged within {} ({})", what, zlib_.msg ? zlib_.msg : "unknown code"));
    }

    const ByteSource& source_;
    std::uint64_t packedPosition_;
    std::uint64_t packedLeft_;
    uLong expectedCrc_;
    uLong crc_ = 0;
    z_stream zlib_{};
    bool started_ = false;
    bool ended_ = false;
    std::vector<std::byte> buffer_;
};

/// Deflates pieces into `packed`.
Status deflatePieces(std::span<const std::span<const std::byte>> pieces, std::vector<std::byte>& packed) {
    z_stream zlib{};
    if (deflateInit2(&zlib, Z_DEFAULT_COMPRESSION, Z_DEFLATED, -MAX_WBITS, 8, Z_DEFAULT_STRATEGY) != Z_OK) {
        return makeError(ErrorCode::OutOfMemory, "", "no memory to deflate");
    }
    const std::unique_ptr<z_stream, int (*)(z_stream*)> guard(&zlib, deflateEnd);
    std::vector<std::byte> buffer(256 * 1024);
    const auto drain = [&](int flush) -> Status {
        int code = Z_OK;
        do {
            zlib.next_out = reinterpret_cast<Bytef*>(buffer.data());
            zlib.avail_out = static_cast<uInt>(buffer.size());
            code = deflate(&zlib, flush);
            ARS_TRY_STATUS(appendBytes(packed, std::span(buffer).first(buffer.size() - zlib.avail_out)));
        } while (zlib.avail_out == 0 || (flush == Z_FINISH && code == Z_OK));
        return {};
    };
    for (const auto& piece : pieces) {
        for (std::size_t done = 0; done < piece.size();) {
            const std::size_t count = std::min(piece.size() - done, kMaxZlibPiece);
            // zlib does not write to its input; its type predates const.
            zlib.next_in = reinterpret_cast<Bytef*>(const_cast<std::byte*>(piece.data() + done));
            zlib.avail_in = static_cast<uInt>(count);
            ARS_TRY_STATUS(drain(Z_NO_FLUSH));
            done += count;
        }
    }
    return drain(Z_FINISH);
}

template <typename T>
void append(std::string& text, T value) {
    text.append(reinterpret_cast<const char*>(&value), sizeof value);
}

constexpr std::uint16_t kVersionPlain = 20; ///< deflate
constexpr std::uint16_t kVersion64 = 45;
constexpr std::uint16_t kFirstDay = (0 << 9) | (1 << 5) | 1; ///< 1980-01-01

std::uint16_t nameFlags(const std::string& name) {
    const bool ascii = std::all_of(name.begin(), name.end(), [](char c) { return static_cast<signed char>(c) >= 0; });
    return ascii ? 0 : kFlagUtf8;
}

std::uint32_t field32(std::uint64_t value, bool in64) { return in64 ? kIn64 : static_cast<std::uint32_t>(value); }

} // namespace

Status ZipEntry::readable() const {
    if (encrypted) return makeError(ErrorCode::Unsupported, "", "is encrypted; save the file without a password");
    if (method == kStored || method == kDeflated) return {};
    return makeError(ErrorCode::Unsupported, "",
                     fmt::format("is compressed with zip method {}, expected 0 (stored) or 8 (deflate)", method));
}

Result<std::vector<ZipEntry>> readZipDirectory(const ByteSource& source) {
    ARS_TRY(const DirectoryEnd end, findDirectory(source));
    if (end.offset > end.position || end.bytes > end.position - end.offset) {
        return badZip(end.position,
                      fmt::format("the zip's directory of {} bytes at byte {} does not lie before its end "
                                  "record",
                                  end.bytes, end.offset));
    }
    if (end.members > end.bytes / kDirectoryBytes) {
        return badZip(end.position,
                      fmt::format("a zip directory of {} bytes cannot name {} members", end.bytes, end.members));
    }
    ARS_TRY(std::vector<std::byte> directory, allocateBytes(end.bytes, "the zip's directory"));
    ARS_TRY_STATUS(source.readAt(end.offset, directory, "the zip's directory"));
    ByteReader reader(directory);
    std::vector<Located> members;
    for (std::uint64_t i = 0; i < end.members; ++i) {
        auto located = readDirectoryEntry(reader, end.offset);
        if (!located) return atPlace(std::move(located).error(), "zip directory");
        if (Status found = locateData(source, end.offset, *located); !found) {
            return atPlace(std::move(found).error(), located->entry.name);
        }
        members.push_back(*std::move(located));
    }
    if (!reader.atEnd()) {
        return badZip(
            end.offset + reader.position(),
            fmt::format("{} bytes follow the {} members of the zip's directory", reader.remaining(), end.members));
    }
    ARS_TRY_STATUS(checkDistinct(members));
    std::vector<ZipEntry> entries;
    for (Located& member : members) entries.push_back(std::move(member.entry));
    return entries;
}

Result<std::unique_ptr<ByteStream>> openZipEntry(const ByteSource& source, const ZipEntry& entry) {
    ARS_TRY_STATUS(entry.readable());
    if (entry.method == kStored) return std::unique_ptr<ByteStream>(new StoredStream(source, entry));
    auto stream = std::make_unique<DeflatedStream>(source, entry);
    ARS_TRY_STATUS(stream->start());
    return std::unique_ptr<ByteStream>(std::move(stream));
}

Status ZipWriter::put(std::span<const std::byte> bytes) {
    position_ += bytes.size();
    return sink_(bytes);
}

Status ZipWriter::put(const std::string& bytes) { return put(std::as_bytes(std::span(bytes))); }

Status ZipWriter::add(const std::string& name, std::span<const std::span<const std::byte>> pieces) {
    if (name.size() > 0xFFFF) {
        return makeError(ErrorCode::InvalidArgument, "",
                         fmt::format("expected a member name of at most 65535 bytes, found {}", name.size()));
    }
    Written member{name, kStored, 0, 0, 0, position_};
    uLong crc = 0;
    for (const auto& piece : pieces) {
        crc = addToCrc(crc, piece);
        member.plainBytes += piece.size();
    }
    member.crc = static_cast<std::uint32_t>(crc);
    member.packedBytes = member.plainBytes;
    if (!compress_) {
        ARS_TRY_STATUS(put(localHeader(member)));
        for (const auto& piece : pieces) ARS_TRY_STATUS(put(piece));
    } else {
        std::vector<std::byte> packed;
        ARS_TRY_STATUS(deflatePieces(pieces, packed));
        member.method = kDeflated;
        member.packedBytes = packed.size();
        ARS_TRY_STATUS(put(localHeader(member)));
        ARS_TRY_STATUS(put(packed));
    }
    members_.push_back(std::move(member));
    return {};
}

std::string ZipWriter::localHeader(const Written& member) const {
    const bool in64 = forceZip64_ || std::max(member.plainBytes, member.packedBytes) >= kIn64;
    std::string header;
    append(header, kLocalSignature);
    append(header, in64 ? kVersion64 : kVersionPlain);
    append(header, nameFlags(member.name));
    append(header, member.method);
    append(header, std::uint16_t{0}); // midnight
    append(header, kFirstDay);
    append(header, member.crc);
    append(header, field32(member.packedBytes, in64));
    append(header, field32(member.plainBytes, in64));
    append(header, static_cast<std::uint16_t>(member.name.size()));
    append(header, static_cast<std::uint16_t>(in64 ? 20 : 0));
    header += member.name;
    if (in64) {
        append(header, kZip64Extra);
        append(header, std::uint16_t{16});
        append(header, member.plainBytes);
        append(header, member.packedBytes);
    }
    return header;
}

std::string ZipWriter::directoryHeader(const Written& member) const {
    const bool in64 = forceZip64_ || std::max({member.plainBytes, member.packedBytes, member.offset}) >= kIn64;
    std::string header;
    append(header, kDirectorySignature);
    append(header, in64 ? kVersion64 : kVersionPlain); // made by: no particular system, so no permissions
    append(header, in64 ? kVersion64 : kVersionPlain);
    append(header, nameFlags(member.name));
    append(header, member.method);
    append(header, std::uint16_t{0});
    append(header, kFirstDay);
    append(header, member.crc);
    append(header, field32(member.packedBytes, in64));
    append(header, field32(member.plainBytes, in64));
    append(header, static_cast<std::uint16_t>(member.name.size()));
    append(header, static_cast<std::uint16_t>(in64 ? 28 : 0));
    append(header, std::uint16_t{0}); // comment
    append(header, std::uint16_t{0}); // volume
    append(header, std::uint16_t{0}); // internal attributes
    append(header, std::uint32_t{0}); // external attributes
    append(header, field32(member.offset, in64));
    header += member.name;
    if (in64) {
        append(header, kZip64Extra);
        append(header, std::uint16_t{24});
        append(header, member.plainBytes);
        append(header, member.packedBytes);
        append(header, member.offset);
    }
    return header;
}

std::string ZipWriter::directoryEnd(std::uint64_t directoryOffset) const {
    const std::uint64_t bytes = position_ - directoryOffset;
    const std::uint64_t count = members_.size();
    const bool in64 = forceZip64_ || count >= kCountIn64 || bytes >= kIn64 || directoryOffset >= kIn64;
    std::string end;
    if (in64) {
        append(end, kEnd64Signature);
        append(end, std::uint64_t{kEnd64Bytes - 12}); // what follows this field
        append(end, kVersion64);
        append(end, kVersion64);
        append(end, std::uint32_t{0});
        append(end, std::uint32_t{0});
        append(end, count);
        append(end, count);
        append(end, bytes);
        append(end, directoryOffset);
        append(end, kLocator64Signature);
        append(end, std::uint32_t{0});
        append(end, position_);
        append(end, std::uint32_t{1});
    }
    const auto count16 = in64 ? kCountIn64 : static_cast<std::uint16_t>(count);
    append(end, kEndSignature);
    append(end, std::uint16_t{0});
    append(end, std::uint16_t{0});
    append(end, count16);
    append(end, count16);
    append(end, field32(bytes, in64));
    append(end, field32(directoryOffset, in64));
    append(end, std::uint16_t{0});
    return end;
}

Status ZipWriter::finish() {
    const std::uint64_t directoryOffset = position_;
    for (const Written& member : members_) ARS_TRY_STATUS(put(directoryHeader(member)));
    return put(directoryEnd(directoryOffset));
}

} // namespace ars
