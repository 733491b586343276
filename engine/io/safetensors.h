#pragma once

#include "engine/core/limits.h"
#include "engine/io/array.h"

#include <filesystem>
#include <map>

namespace ars {

/// A .safetensors file (https://huggingface.co/docs/safetensors): eight bytes of header length, a JSON header, and the
/// tensors' bytes one after another, C order, little endian.
struct SafetensorsFile {
    std::map<std::string, Array> tensors;
    std::map<std::string, std::string> metadata; ///< "__metadata__" of the header

    /// NotFound lists the tensors that there are.
    Result<const Array*> find(std::string_view name) const;
};

/// BadFile when the header is longer than 100 MB or the file, is no JSON of the expected form, names something twice,
/// or when the tensors' ranges overlap, leave gaps, or do not match type and shape. Unsupported names an element type
/// that Array has not (8-bit floats and smaller). LimitExceeded beyond limits.maxBytes.
Result<SafetensorsFile> readSafetensors(const std::filesystem::path& path,
                                        const ReadLimits& limits = defaultReadLimits());
Result<SafetensorsFile> parseSafetensors(std::span<const std::byte> file,
                                         const ReadLimits& limits = defaultReadLimits());

/// What the header says of one tensor.
struct SafetensorsEntry {
    std::string name;
    std::string storedType; ///< as in the file: "F32", "F8_E4M3"
    DType dtype = DType::F32;
    std::vector<std::size_t> shape;
    std::uint64_t begin = 0; ///< first byte, counted from the end of the header
    std::uint64_t end = 0;   ///< one past the last byte
    std::string problem;     ///< why it cannot be read (element type), or empty
};
struct SafetensorsIndex {
    std::vector<SafetensorsEntry> entries; ///< in the order of their bytes
    std::map<std::string, std::string> metadata;
    std::uint64_t dataOffset = 0; ///< where the tensors begin in the file
};

/// The header alone, checked against the file's length; no tensor is read.
Result<SafetensorsIndex> listSafetensors(const std::filesystem::path& path,
                                         const ReadLimits& limits = defaultReadLimits());

/// Tensors are laid out by falling element size, then by name, so that each is aligned; the same file gives the same
/// bytes. InvalidArgument for types that the format has not (complex128, text), the name "__metadata__", names that are
/// not UTF-8, and arrays whose bytes do not fit their shape.
Status writeSafetensors(const std::filesystem::path& path, const SafetensorsFile& file);
Result<std::vector<std::byte>> encodeSafetensors(const SafetensorsFile& file);

} // namespace ars
