#pragma once

#include "engine/core/limits.h"
#include "engine/io/array.h"
#include "engine/io/byte_source.h"

namespace ars {

/// How numpy stored one array: the fixed start and the dictionary of a .npy file.
struct NpyHeader {
    enum class Kind { Number, UnicodeText, ByteText };
    Kind kind = Kind::Number;
    DType dtype = DType::F32;
    std::size_t itemBytes = 4; ///< of one element in the file
    bool bigEndian = false;
    bool fortranOrder = false;
    std::vector<std::size_t> shape;
    std::size_t count = 0;       ///< elements
    std::uint64_t dataBytes = 0; ///< count * itemBytes, follows the header
    /// The most memory that decoding takes at any moment, the array itself included, bytes.
    std::uint64_t decodeBytes() const;
};

/// Reads the header and checks that exactly its data follow in `stream`. Unsupported for objects and other types that
/// Array has not, BadFile for everything that numpy would not write.
Result<NpyHeader> readNpyHeader(ByteStream& stream);

/// Reads the data behind the header and finishes the stream. The caller has compared decodeBytes() with its limit.
Result<Array> readNpyData(const NpyHeader& header, ByteStream& stream);

/// LimitExceeded when decoding `bytes` ("<what> needs 9 bytes, the limit is 8").
Status checkDecodeLimit(std::uint64_t bytes, std::string_view what, const ReadLimits& limits);

/// A .npy file in two parts, so that the numbers need not be copied: `payload` points into `array` or `converted`.
struct EncodedNpy {
    std::string header;
    std::vector<std::byte> converted; ///< texts and widened types
    std::span<const std::byte> payload;
};
/// `array` must outlive the result.
Result<EncodedNpy> encodeNpyParts(const Array& array);

/// Unsupported or BadFile with what a file is that starts with `head` instead of `expected` (a pickle, a zip, ...).
Error notNumpy(std::span<const std::byte> head, std::string_view expected);

} // namespace ars
