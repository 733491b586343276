#include "engine/io/npz.h"

#include "engine/core/file.h"
#include "engine/core/parallel.h"
#include "engine/io/npy.h"
#include "engine/io/utf8.h"
#include "engine/io/zip.h"

#include <algorithm>
#include <array>
#include <limits>
#include <optional>
#include <set>

namespace ars {
namespace {

constexpr std::string_view kSuffix = ".npy";

bool isArrayName(std::string_view name) { return name.ends_with(kSuffix); }

std::string keyOf(const std::string& name) { return name.substr(0, name.size() - kSuffix.size()); }

/// The members of a zip that are named like arrays. BadFile where the file is no zip or has only other members.
Result<std::vector<ZipEntry>> arrayMembers(const ByteSource& source) {
    std::array<std::byte, 6> start{};
    const auto there = static_cast<std::size_t>(std::min<std::uint64_t>(start.size(), source.size()));
    const std::span<std::byte> head = std::span(start).first(there);
    ARS_TRY_STATUS(source.readAt(0, head, "the start of an .npz file"));
    if (there < 2 || start[0] != std::byte{'P'} || start[1] != std::byte{'K'}) return notNumpy(head, ".npz");
    ARS_TRY(std::vector<ZipEntry> entries, readZipDirectory(source));
    const std::size_t all = entries.size();
    std::erase_if(entries, [](const ZipEntry& entry) { return !isArrayName(entry.name); });
    if (entries.empty() && all > 0) {
        return makeError(ErrorCode::BadFile, "",
                         fmt::format("is a zip of {} members, expected at least one .npy among them", all));
    }
    return entries;
}

/// One member on its way to an array.
struct Member {
    const ZipEntry* entry = nullptr;
    std::optional<NpyHeader> header;
    std::optional<Array> array;
    std::optional<Error> error;
};

void readMemberHeader(const ByteSource& source, Member& member) {
    const auto read = [&]() -> Result<NpyHeader> {
        ARS_TRY(const auto stream, openZipEntry(source, *member.entry));
        return readNpyHeader(*stream);
    };
    auto header = read();
    if (header) {
        member.header = *std::move(header);
    } else {
        member.error = atPlace(std::move(header).error(), member.entry->name);
    }
}

void readMemberData(const ByteSource& source, Member& member) {
    const auto read = [&]() -> Result<Array> {
        ARS_TRY(const auto stream, openZipEntry(source, *member.entry));
        ARS_TRY(const NpyHeader header, readNpyHeader(*stream));
        return readNpyData(header, *stream);
    };
    auto array = read();
    if (array) {
        member.array = *std::move(array);
    } else {
        member.error = atPlace(std::move(array).error(), member.entry->name);
    }
}

/// A member of a kind that we do not handle spoils nothing; a damaged one makes the whole file suspect.
bool spoilsFile(const Error& error) { return error.code != ErrorCode::Unsupported; }

/// Opens every member and reads its header; the first error that spoils the file, if any.
Result<std::vector<Member>> readHeaders(const ByteSource& source, const std::vector<ZipEntry>& entries) {
    std::vector<Member> members(entries.size());
    for (std::size_t i = 0; i < entries.size(); ++i) {
        members[i].entry = &entries[i];
        readMemberHeader(source, members[i]);
        if (members[i].error && spoilsFile(*members[i].error)) return *std::move(members[i].error);
    }
    return members;
}

Status checkLimit(const std::vector<Member>& members, const ReadLimits& limits) {
    std::uint64_t total = 0;
    for (const Member& member : members) {
        if (!member.header) continue;
        const std::uint64_t bytes = member.header->decodeBytes();
        if (Status fits = checkDecodeLimit(bytes, "the array", limits); !fits) {
            return atPlace(std::move(fits).error(), member.entry->name);
        }
        total += std::min(bytes, std::numeric_limits<std::uint64_t>::max() - total);
    }
    return checkDecodeLimit(total, "the file's arrays together", limits);
}

Result<NpzFile> decodeNpz(const ByteSource& source, const ReadLimits& limits) {
    ARS_TRY(const std::vector<ZipEntry> entries, arrayMembers(source));
    ARS_TRY(std::vector<Member> members, readHeaders(source, entries));
    ARS_TRY_STATUS(checkLimit(members, limits));
    parallelFor(
        members.size(),
        [&](std::size_t i) {
            if (members[i].header) readMemberData(source, members[i]);
        },
        1);
    NpzFile file;
    for (Member& member : members) {
        std::string key = keyOf(member.entry->name);
        if (member.error && spoilsFile(*member.error)) return *std::move(member.error);
        if (member.error) {
            file.unreadable.emplace(std::move(key), *std::move(member.error));
        } else {
            file.arrays.emplace(std::move(key), *std::move(member.array));
        }
    }
    return file;
}

Status encodeMembers(const NamedArrays& arrays, const NpzOptions& options, ByteSink sink) {
    ZipWriter writer(std::move(sink), options.compress, options.forceZip64);
    std::set<std::string_view> keys;
    for (const auto& [key, array] : arrays) {
        if (key.empty() || !isUtf8(key) || !keys.insert(key).second) {
            return makeError(ErrorCode::InvalidArgument, key, "expected distinct, non-empty UTF-8 keys");
        }
        auto encoded = encodeNpyParts(array);
        if (!encoded) return atPlace(std::move(encoded).error(), key);
        const std::span<const std::byte> pieces[] = {std::as_bytes(std::span(encoded->header)), encoded->payload};
        ARS_TRY_STATUS(writer.add(key + std::string(kSuffix), pieces));
    }
    return writer.finish();
}

} // namespace

bool NpzFile::has(std::string_view key) const {
    const std::string name(key);
    return arrays.contains(name) || unreadable.contains(name);
}

Result<const Array*> NpzFile::find(std::string_view key) const {
    const std::string name(key);
    if (const auto found = arrays.find(name); found != arrays.end()) return &found->second;
    if (const auto found = unreadable.find(name); found != unreadable.end()) return found->second;
    std::string keys;
    constexpr std::size_t kMostNamed = 32;
    std::size_t named = 0;
    for (const auto& [other, array] : arrays) {
        if (named++ == kMostNamed) break;
        keys += (keys.empty() ? "" : ", ") + other;
    }
    if (arrays.size() > kMostNamed) keys += fmt::format(" and {} more", arrays.size() - kMostNamed);
    return makeError(ErrorCode::NotFound, "",
                     fmt::format("expected the array \"{}\", found {}", key, keys.empty() ? "no arrays" : keys));
}

Result<NpzFile> parseNpz(std::span<const std::byte> file, const ReadLimits& limits) {
    return decodeNpz(MemorySource(file), limits);
}

Result<NpzFile> readNpz(const std::filesystem::path& path, const ReadLimits& limits) {
    auto source = FileSource::open(path, limits);
    if (!source) return atPlace(std::move(source).error(), path.string());
    auto file = decodeNpz(**source, limits);
    if (!file) return atPlace(std::move(file).error(), path.string());
    return file;
}

Result<std::vector<NpzEntry>> listNpz(const std::filesystem::path& path, const ReadLimits& limits) {
    const auto list = [&](const ByteSource& source) -> Result<std::vector<NpzEntry>> {
        ARS_TRY(const std::vector<ZipEntry> entries, arrayMembers(source));
        ARS_TRY(const std::vector<Member> members, readHeaders(source, entries));
        std::vector<NpzEntry> listed;
        for (const Member& member : members) {
            NpzEntry& entry = listed.emplace_back();
            entry.key = keyOf(member.entry->name);
            entry.storedBytes = member.entry->packedBytes;
            if (member.error) entry.problem = member.error->message;
            if (!member.header) continue;
            entry.dtype = member.header->dtype;
            entry.shape = member.header->shape;
        }
        return listed;
    };
    auto source = FileSource::open(path, limits);
    if (!source) return atPlace(std::move(source).error(), path.string());
    auto entries = list(**source);
    if (!entries) return atPlace(std::move(entries).error(), path.string());
    return entries;
}

Result<std::vector<std::byte>> encodeNpz(const NamedArrays& arrays, const NpzOptions& options) {
    std::vector<std::byte> file;
    const auto sink = [&file](std::span<const std::byte> bytes) { return appendBytes(file, bytes); };
    ARS_TRY_STATUS(encodeMembers(arrays, options, sink));
    return file;
}

Status writeNpz(const std::filesystem::path& path, const NamedArrays& arrays, const NpzOptions& options) {
    ARS_TRY(AtomicFile file, AtomicFile::open(path));
    // AtomicFile names the path in its errors; ours name the key, and the path is added here.
    bool diskFailed = false;
    const auto sink = [&](std::span<const std::byte> bytes) {
        Status written = file.write(bytes);
        diskFailed = !written.ok();
        return written;
    };
    if (Status encoded = encodeMembers(arrays, options, sink); !encoded) {
        return diskFailed ? std::move(encoded).error() : atPlace(std::move(encoded).error(), path.string());
    }
    return file.commit();
}

Status writeNpz(const std::filesystem::path& path, const NamedArrays& arrays, bool compress) {
    return writeNpz(path, arrays, NpzOptions{compress, false});
}

} // namespace ars
