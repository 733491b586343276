#pragma once

#include "engine/core/error.h"
#include "engine/core/limits.h"

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>

namespace ars {

/// What a file is made of. What it means (a body, a motion) is for those who read it.
enum class FileFormat {
    Empty,
    Npy,
    Npz,
    Safetensors,
    Exr,
    Hdr,
    Png,
    Jpeg,
    Ply,
    Obj,
    Glb,  ///< glTF in its binary form
    Gltf, ///< glTF as JSON
    Bvh,
    Json,
    Text,
    Foreign, ///< a known format that this program does not read; FileRecognition says which
    Unknown,
};

/// "npz", "exr"...: short, lower case.
std::string_view fileFormatName(FileFormat format);

struct FileRecognition {
    FileFormat format = FileFormat::Unknown;
    std::string name;   ///< for people: "OpenEXR picture", "MP4 video"
    std::string advice; ///< Foreign only: what can be done with it; may be empty
    std::uint64_t bytes = 0;
};

/// Tells a file's format by its content: magic numbers where the format has one, else structure (the keywords of an
/// OBJ, the keys of a JSON object, the members of a zip). The name plays no part. A broken file is recognised as far as
/// its beginning allows; whether it is sound is for its reader to say. NotFound and Io when it cannot be opened.
Result<FileRecognition> recogniseFile(const std::filesystem::path& path,
                                      const ReadLimits& limits = defaultReadLimits());

/// The same from memory.
FileRecognition recogniseBytes(std::span<const std::byte> bytes);

/// Whether files of this format go by the extension of `path` (".JPG" is as good as ".jpeg"). True where the path has
/// none, or one that no known format claims.
bool extensionFits(const std::filesystem::path& path, const FileRecognition& file);

} // namespace ars
