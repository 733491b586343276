#pragma once

#include "engine/io/byte_source.h"

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace ars {

/// One member of a zip archive, as its directory describes it.
struct ZipEntry {
    std::string name; ///< UTF-8; names that are not UTF-8 are taken as Latin-1
    std::uint16_t method = 0;
    bool encrypted = false;
    std::uint32_t crc = 0;
    std::uint64_t packedBytes = 0; ///< in the file
    std::uint64_t plainBytes = 0;  ///< as declared; a member never gives more
    std::uint64_t dataOffset = 0;  ///< in the file
    /// Unsupported when the member is encrypted or compressed with something else than deflate.
    Status readable() const;
};

/// The directory of a zip archive (PKWARE APPNOTE 6.3, zip64 included), read over zlib so that every size is compared
/// with the file's length before memory is taken and members are unpacked straight to where they are wanted.
///
/// BadFile for damage: sizes beyond the file, members that overlap (the trick of zip bombs), a name that appears twice,
/// a declared size that deflate cannot reach. Unsupported for archives in several volumes.
Result<std::vector<ZipEntry>> readZipDirectory(const ByteSource& source);

/// The member's bytes, unpacked as they are read. Fails as ZipEntry::readable. `source` must outlive the stream;
/// streams of one source may run on several threads.
Result<std::unique_ptr<ByteStream>> openZipEntry(const ByteSource& source, const ZipEntry& entry);

/// Writes an archive front to back. The same calls give the same bytes: every date is 1980-01-01.
class ZipWriter {
public:
    ZipWriter(ByteSink sink, bool compress, bool forceZip64)
        : sink_(std::move(sink)), compress_(compress), forceZip64_(forceZip64) {}

    /// One member whose content is `pieces` one after another. `name` is UTF-8.
    Status add(const std::string& name, std::span<const std::span<const std::byte>> pieces);
    /// The directory; nothing may be added after it.
    Status finish();

private:
    struct Written {
        std::string name;
        std::uint16_t method;
        std::uint32_t crc;
        std::uint64_t packedBytes;
        std::uint64_t plainBytes;
        std::uint64_t offset;
    };
    Status put(std::span<const std::byte> bytes);
    Status put(const std::string& bytes);
    std::string localHeader(const Written& member) const;
    std::string directoryHeader(const Written& member) const;
    std::string directoryEnd(std::uint64_t directoryOffset) const;

    ByteSink sink_;
    bool compress_;
    bool forceZip64_;
    std::uint64_t position_ = 0;
    std::vector<Written> members_;
};

} // namespace ars
