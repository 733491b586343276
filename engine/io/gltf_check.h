#pragma once

#include "engine/core/error.h"
#include "engine/core/limits.h"

#include <cstddef>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace ars {

/// The two parts of a glTF file in memory.
struct GltfParts {
    std::string_view json;
    bool isBinary = false;                            ///< a .glb
    std::optional<std::span<const std::byte>> binary; ///< the BIN chunk of a .glb, where it has one
};

/// Finds the chunks of a .glb, or takes the whole file as JSON. BadFile for lengths that do not fit, with the byte.
Result<GltfParts> splitGltf(std::span<const std::byte> bytes);

/// What must hold before the JSON goes to tinygltf, which recurses into it, turns numbers into int unchecked and reads
/// image bytes without a look at the buffer's end: bounded depth and number of values, whole numbers where indices and
/// lengths stand, buffer views inside buffers, no compressed or unknown required extension, other files only in
/// `folder`. `notes` receives a sentence for each thing that will be left out.
Status checkGltfJson(const GltfParts& parts, const std::filesystem::path& folder, const ReadLimits& limits,
                     std::vector<std::string>& notes);

/// The path of a file that a glTF in `folder` refers to by `uri` (percent-decoded), or nothing when the reference is
/// absolute, leads out of the folder (also by a link), or `folder` is empty.
std::optional<std::filesystem::path> resolveGltfUri(const std::filesystem::path& folder, std::string_view uri);

} // namespace ars
