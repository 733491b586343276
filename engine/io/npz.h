#pragma once

#include "engine/core/limits.h"
#include "engine/io/array.h"

#include <filesystem>
#include <map>

namespace ars {

/// Numpy's .npy, versions 1 to 3: C and Fortran order, every number type, either byte order, unicode and byte strings.
///
/// Booleans become 0 or 1. Byte strings ('S') that are not UTF-8 are taken as Latin-1; lone surrogates become U+FFFD.
/// No pickle: an object array is Unsupported with a message that says how to convert it; so are structured, date and
/// long double arrays. BadFile names the byte and what was expected; LimitExceeded when the decoded array (and what
/// decoding needs: twice the bytes for Fortran order, the strings of texts) would exceed limits.maxBytes.
Result<Array> readNpy(const std::filesystem::path& path, const ReadLimits& limits = defaultReadLimits());
Result<Array> parseNpy(std::span<const std::byte> file, const ReadLimits& limits = defaultReadLimits());

/// Numpy's .npz: a zip of .npy files, stored or deflated, zip64. Members of other names are ignored. Members that this
/// program does not handle (object arrays, encryption, other compression) do not spoil the others: they are kept as the
/// error that reading them gave. Damage (checksum, sizes, duplicate or overlapping members) is BadFile for the whole.
struct NpzFile {
    std::map<std::string, Array> arrays;     ///< by key, without ".npy"
    std::map<std::string, Error> unreadable; ///< by key

    /// Whether the file has the key, readable or not: an optional array that cannot be read is not an absent one.
    bool has(std::string_view key) const;
    /// NotFound lists the keys that there are; an unreadable key returns its own error.
    Result<const Array*> find(std::string_view key) const;
};

/// limits.maxBytes bounds the sum over all members.
Result<NpzFile> readNpz(const std::filesystem::path& path, const ReadLimits& limits = defaultReadLimits());
Result<NpzFile> parseNpz(std::span<const std::byte> file, const ReadLimits& limits = defaultReadLimits());

/// Name, type and shape of every member, in the file's order, without decoding the data, for `ars info` on large files.
struct NpzEntry {
    std::string key;
    DType dtype = DType::F32;
    std::vector<std::size_t> shape;
    std::uint64_t storedBytes = 0; ///< in the file, compressed
    std::string problem;           ///< why it cannot be read, or empty
};
Result<std::vector<NpzEntry>> listNpz(const std::filesystem::path& path,
                                      const ReadLimits& limits = defaultReadLimits());

/// BF16, which numpy does not have, is widened to float32. InvalidArgument when an array's bytes do not fit its shape
/// or a text is not UTF-8.
Status writeNpy(const std::filesystem::path& path, const Array& array);
Result<std::vector<std::byte>> encodeNpy(const Array& array);

using NamedArrays = std::vector<std::pair<std::string, Array>>;

struct NpzOptions {
    bool compress = true;    ///< deflate (numpy.savez_compressed), else stored (numpy.savez)
    bool forceZip64 = false; ///< 64-bit records even where 32 bits do; otherwise from 4 GiB or 65,535 members on
};

/// Keys in the order given; the same arrays give the same bytes (the date is fixed). InvalidArgument for an empty or
/// repeated key.
Status writeNpz(const std::filesystem::path& path, const NamedArrays& arrays, const NpzOptions& options);
Status writeNpz(const std::filesystem::path& path, const NamedArrays& arrays, bool compress = true);
Result<std::vector<std::byte>> encodeNpz(const NamedArrays& arrays, const NpzOptions& options = {});

} // namespace ars
