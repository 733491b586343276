#include "engine/io/gltf_check.h"

#include "engine/io/byte_reader.h"
#include "engine/io/text_scanner.h"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <cctype>
#include <limits>
#include <new>
#include <system_error>

namespace ars {
namespace {

using nlohmann::json;

constexpr std::uint32_t kJsonChunk = 0x4e4f534a;
constexpr std::uint32_t kBinaryChunk = 0x004e4942;
/// What one JSON value costs as a tree in memory, twice (ours and tinygltf's), with the containers that hold it.
constexpr std::uint64_t kBytesPerValue = 256;

/// Members that are indices, counts or lengths wherever they stand.
constexpr std::string_view kWholeNumbers[] = {"buffer",        "bufferView",
                                              "byteOffset",    "byteLength",
                                              "byteStride",    "count",
                                              "componentType", "indices",
                                              "material",      "mesh",
                                              "mode",          "skin",
                                              "camera",        "node",
                                              "sampler",       "input",
                                              "output",        "source",
                                              "index",         "texCoord",
                                              "skeleton",      "inverseBindMatrices",
                                              "scene",         "target",
                                              "children",      "joints",
                                              "nodes",         "attributes",
                                              "targets"};

/// Extensions whose absence changes only how the surface looks; everything else that a file requires is refused.
constexpr std::string_view kHarmlessPrefixes[] = {"KHR_materials_", "KHR_lights_",  "KHR_xmp",
                                                  "KHR_texture_",   "EXT_texture_", "KHR_animation_pointer",
                                                  "EXT_lights_",    "VRM"};
constexpr std::string_view kUnderstood[] = {"KHR_mesh_quantization"};

Error bad(std::string place, std::string message) {
    return makeError(ErrorCode::BadFile, std::move(place), std::move(message));
}

/// Depth and number of values without a parser, so that a hostile text costs nothing.
Status checkJsonSize(std::string_view text, const ReadLimits& limits) {
    std::uint64_t values = 1, depth = 0;
    bool inString = false;
    for (std::size_t i = 0; i < text.size(); ++i) {
        const char c = text[i];
        if (inString) {
            if (c == '\\') {
                ++i;
            } else if (c == '"') {
                inString = false;
            }
        } else if (c == '"') {
            inString = true;
        } else if (c == '{' || c == '[') {
            ++values;
            if (++depth > limits.maxNesting) {
                return makeError(ErrorCode::LimitExceeded, "JSON",
                                 fmt::format("byte {}: nested deeper than {}", i, limits.maxNesting));
            }
        } else if (c == '}' || c == ']') {
            depth -= depth > 0;
        } else if (c == ',' || c == ':') {
            ++values;
        }
    }
    // The text is copied into strings of both trees.
    if (values > limits.maxBytes / kBytesPerValue || text.size() > limits.maxBytes / 4) {
        return makeError(ErrorCode::LimitExceeded, "JSON",
                         fmt::format("{} values in {} bytes of text need more memory than the limit of {} bytes",
                                     values, text.size(), limits.maxBytes));
    }
    return {};
}

/// A value as it may stand in a message.
std::string shown(const json& value) {
    if (value.is_structured()) return value.is_array() ? "a list" : "an object";
    if (value.is_string()) return "a text";
    return value.dump();
}

bool isWholeNumberKey(std::string_view key) {
    return std::find(std::begin(kWholeNumbers), std::end(kWholeNumbers), key) != std::end(kWholeNumbers);
}

Status checkWholeNumber(const json& value, std::string_view key, const std::string& place) {
    if (!value.is_number_unsigned()) {
        return bad(place, fmt::format("expected a whole number from 0, found {}", shown(value)));
    }
    // Lengths are 32 bits, as in the header of a .glb; indices go into an int.
    const bool isLength = key == "byteLength" || key == "byteOffset";
    const std::uint64_t most = isLength ? std::numeric_limits<std::uint32_t>::max() : std::numeric_limits<int>::max();
    if (value.get<std::uint64_t>() <= most) return {};
    return bad(place, fmt::format("expected at most {}, found {}", most, value.dump()));
}

/// Walks the tree; below `children`, `attributes` and the like every number is an index. The depth is bounded already.
Status checkNumbers(const json& value, std::string_view key, bool whole, const std::string& place) {
    if (value.is_object()) {
        for (const auto& [name, member] : value.items()) {
            if (name == "extras" || name == "extensions") continue;
            const std::string_view inner = name;
            // "target" is a number in a buffer view and an object in an animation channel, "indices" likewise.
            const bool wholeMember = isWholeNumberKey(inner) || (whole && (key == "attributes" || key == "targets"));
            ARS_TRY_STATUS(checkNumbers(member, inner, wholeMember, place + "." + name));
        }
        return {};
    }
    if (value.is_array()) {
        std::size_t i = 0;
        for (const json& member : value) {
            ARS_TRY_STATUS(checkNumbers(member, key, whole, fmt::format("{}[{}]", place, i++)));
        }
        return {};
    }
    return whole ? checkWholeNumber(value, key, place) : Status();
}

/// Top-level lists of objects. A skeleton brings helpers and meshes along, but not many times its own size.
Status checkLists(const json& root, const ReadLimits& limits) {
    const auto nodes = root.find("nodes");
    const std::uint64_t mostNodes = 16ull * limits.maxJoints;
    if (nodes != root.end() && nodes->is_array() && nodes->size() > mostNodes) {
        return makeError(ErrorCode::LimitExceeded, "nodes",
                         fmt::format("{} nodes, the limit is {}", nodes->size(), mostNodes));
    }
    for (const char* name : {"accessors", "animations", "buffers", "bufferViews", "cameras", "images", "materials",
                             "meshes", "nodes", "samplers", "scenes", "skins", "textures"}) {
        const auto found = root.find(name);
        if (found == root.end()) continue;
        if (!found->is_array()) return bad(name, fmt::format("expected a list, found {}", shown(*found)));
        for (std::size_t i = 0; i < found->size(); ++i) {
            if ((*found)[i].is_object()) continue;
            return bad(fmt::format("{}[{}]", name, i), fmt::format("expected an object, found {}", shown((*found)[i])));
        }
    }
    return {};
}

const json& listOf(const json& root, const char* name) {
    static const json kEmpty = json::array();
    const auto found = root.find(name);
    return found == root.end() ? kEmpty : *found;
}

std::uint64_t numberOf(const json& object, const char* name, std::uint64_t otherwise = 0) {
    const auto found = object.find(name);
    return found != object.end() && found->is_number_unsigned() ? found->get<std::uint64_t>() : otherwise;
}

std::string textOf(const json& object, const char* name) {
    const auto found = object.find(name);
    return found != object.end() && found->is_string() ? found->get<std::string>() : std::string();
}

Status checkAsset(const json& root) {
    const auto asset = root.find("asset");
    const std::string version = asset != root.end() && asset->is_object() ? textOf(*asset, "version") : "";
    if (version.empty()) return bad("asset.version", "expected a version such as \"2.0\", found none: not a glTF file");
    if (version.starts_with("2.")) return {};
    return makeError(ErrorCode::Unsupported, "asset.version",
                     fmt::format("expected glTF 2.x, found {}", quotedFound(version)));
}

bool isHarmless(const std::string& extension) {
    return std::any_of(std::begin(kHarmlessPrefixes), std::end(kHarmlessPrefixes),
                       [&](std::string_view prefix) { return extension.starts_with(prefix); });
}

/// Compression is named on its own: it is the refusal that people meet, and they can do something about it.
Status checkCompression(const json& root) {
    const auto has = [](const json& object, const char* name) {
        const auto extensions = object.find("extensions");
        return extensions != object.end() && extensions->is_object() && extensions->contains(name);
    };
    const json& meshes = listOf(root, "meshes");
    for (std::size_t m = 0; m < meshes.size(); ++m) {
        const json& primitives = listOf(meshes[m], "primitives");
        if (!primitives.is_array()) return bad(fmt::format("meshes[{}].primitives", m), "expected a list");
        for (std::size_t p = 0; p < primitives.size(); ++p) {
            if (!primitives[p].is_object() || !has(primitives[p], "KHR_draco_mesh_compression")) continue;
            return makeError(ErrorCode::Unsupported, fmt::format("meshes[{}].primitives[{}]", m, p),
                             "the mesh is compressed with Draco; export it again without compression");
        }
    }
    const json& views = listOf(root, "bufferViews");
    for (std::size_t i = 0; i < views.size(); ++i) {
        if (!has(views[i], "EXT_meshopt_compression") && !has(views[i], "KHR_meshopt_compression")) continue;
        return makeError(ErrorCode::Unsupported, fmt::format("bufferViews[{}]", i),
                         "the data is compressed with meshopt; export the file again without compression");
    }
    return {};
}

Status checkExtensions(const json& root, std::vector<std::string>& notes) {
    ARS_TRY_STATUS(checkCompression(root));
    const auto understood = [](const std::string& name) {
        return std::find(std::begin(kUnderstood), std::end(kUnderstood), name) != std::end(kUnderstood);
    };
    for (const json& entry : listOf(root, "extensionsRequired")) {
        const std::string name = entry.is_string() ? entry.get<std::string>() : "";
        if (understood(name) || isHarmless(name)) continue;
        return makeError(ErrorCode::Unsupported, "extensionsRequired",
                         fmt::format("the file cannot be read without the extension {}", quotedFound(name)));
    }
    for (const json& entry : listOf(root, "extensionsUsed")) {
        const std::string name = entry.is_string() ? entry.get<std::string>() : "";
        if (!understood(name)) notes.push_back(fmt::format("the extension {} is ignored", quotedFound(name)));
    }
    return {};
}

bool isDataUri(std::string_view uri) { return uri.substr(0, 5) == "data:"; }

Status checkExternalBuffer(const std::filesystem::path& folder, const std::string& uri, std::uint64_t length,
                           const std::string& place) {
    const auto path = resolveGltfUri(folder, uri);
    if (!path) {
        return makeError(ErrorCode::NotFound, place,
                         fmt::format("the file {} is not in the folder of this one", quotedFound(uri)));
    }
    std::error_code failure;
    const std::uintmax_t size = std::filesystem::file_size(*path, failure);
    if (failure) {
        return makeError(ErrorCode::NotFound, place, fmt::format("the file {} is missing", quotedFound(uri)));
    }
    if (size == length) return {};
    return bad(place, fmt::format("expected {} bytes in {}, the file has {}", length, quotedFound(uri), size));
}

Status checkBuffers(const json& root, const GltfParts& parts, const std::filesystem::path& folder,
                    const ReadLimits& limits) {
    const json& buffers = listOf(root, "buffers");
    std::uint64_t total = 0;
    for (std::size_t i = 0; i < buffers.size(); ++i) {
        const std::string place = fmt::format("buffers[{}]", i);
        const std::uint64_t length = numberOf(buffers[i], "byteLength");
        if (length == 0) return bad(place, "expected a byteLength above 0");
        total += length;
        if (total > limits.maxBytes) {
            return makeError(ErrorCode::LimitExceeded, place,
                             fmt::format("{} bytes of buffers, the limit is {}", total, limits.maxBytes));
        }
        const std::string uri = textOf(buffers[i], "uri");
        if (uri.empty()) {
            const std::uint64_t held = parts.binary ? parts.binary->size() : 0;
            if (i > 0 || !parts.binary) return bad(place, "has neither a uri nor a binary chunk");
            if (length > held) {
                return bad(place, fmt::format("expected {} bytes, the binary chunk has {}", length, held));
            }
        } else if (isDataUri(uri)) {
            // Base64 needs four characters for three bytes.
            if (length <= uri.size()) continue;
            return bad(place, fmt::format("expected {} bytes, its data: uri has {} characters", length, uri.size()));
        } else {
            ARS_TRY_STATUS(checkExternalBuffer(folder, uri, length, place));
        }
    }
    return {};
}

Status checkBufferViews(const json& root) {
    const json& buffers = listOf(root, "buffers");
    const json& views = listOf(root, "bufferViews");
    for (std::size_t i = 0; i < views.size(); ++i) {
        const std::string place = fmt::format("bufferViews[{}]", i);
        const std::uint64_t buffer = numberOf(views[i], "buffer", std::numeric_limits<std::uint64_t>::max());
        if (buffer >= buffers.size()) {
            return bad(place, fmt::format("names a buffer that does not exist, the file has {}", buffers.size()));
        }
        const std::uint64_t offset = numberOf(views[i], "byteOffset"), length = numberOf(views[i], "byteLength");
        const std::uint64_t held = numberOf(buffers[buffer], "byteLength");
        if (length == 0) return bad(place, "expected a byteLength above 0");
        if (offset + length > held) {
            return bad(place,
                       fmt::format("bytes {} to {} of buffer {}, which has {}", offset, offset + length, buffer, held));
        }
    }
    return {};
}

Status checkImages(const json& root, const std::filesystem::path& folder, std::vector<std::string>& notes) {
    const json& images = listOf(root, "images");
    for (std::size_t i = 0; i < images.size(); ++i) {
        const std::string uri = textOf(images[i], "uri");
        if (uri.empty() || isDataUri(uri)) continue;
        const auto path = resolveGltfUri(folder, uri);
        std::error_code ignored;
        if (path && std::filesystem::is_regular_file(*path, ignored)) continue;
        notes.push_back(fmt::format("images[{}]: the file {} is not in the folder of this one", i, quotedFound(uri)));
    }
    return {};
}

std::string percentDecoded(std::string_view uri) {
    std::string text;
    for (std::size_t i = 0; i < uri.size(); ++i) {
        const bool isEscape = uri[i] == '%' && i + 2 < uri.size() &&
                              std::isxdigit(static_cast<unsigned char>(uri[i + 1])) &&
                              std::isxdigit(static_cast<unsigned char>(uri[i + 2]));
        if (isEscape) {
            text += static_cast<char>(std::stoi(std::string(uri.substr(i + 1, 2)), nullptr, 16));
            i += 2;
        } else {
            text += uri[i];
        }
    }
    return text;
}

Status checkParsed(const json& root, const GltfParts& parts, const std::filesystem::path& folder,
                   const ReadLimits& limits, std::vector<std::string>& notes) {
    if (!root.is_object()) return bad("JSON", fmt::format("expected an object, found {}", shown(root)));
    ARS_TRY_STATUS(checkAsset(root));
    ARS_TRY_STATUS(checkLists(root, limits));
    ARS_TRY_STATUS(checkExtensions(root, notes));
    for (const auto& [name, member] : root.items()) {
        if (name == "extras" || name == "extensions" || name == "asset") continue;
        // Among the lists of the root, `nodes` and `meshes` hold objects; only "scene" is itself an index.
        ARS_TRY_STATUS(checkNumbers(member, name, name == "scene", name));
    }
    ARS_TRY_STATUS(checkBuffers(root, parts, folder, limits));
    ARS_TRY_STATUS(checkBufferViews(root));
    return checkImages(root, folder, notes);
}

} // namespace

Result<GltfParts> splitGltf(std::span<const std::byte> bytes) {
    GltfParts parts;
    const auto* text = reinterpret_cast<const char*>(bytes.data());
    if (bytes.size() < 4 || std::string_view(text, 4) != "glTF") {
        parts.json = std::string_view(text, bytes.size());
        if (parts.json.starts_with("\xef\xbb\xbf")) parts.json.remove_prefix(3); // a byte order mark
        TextScanner scanner(parts.json);
        scanner.skipSpace();
        if (scanner.remaining() == 0 || parts.json[scanner.position()] != '{') {
            return bad("", "expected \"glTF\" or a JSON object at the start: not a glTF file");
        }
        return parts;
    }
    parts.isBinary = true;
    ByteReader reader(bytes);
    ARS_TRY_STATUS(reader.skip(4, "the word glTF"));
    ARS_TRY(const auto version, reader.read<std::uint32_t>("the version"));
    if (version != 2) {
        return makeError(ErrorCode::Unsupported, "", fmt::format("expected binary glTF version 2, found {}", version));
    }
    ARS_TRY(const auto length, reader.read<std::uint32_t>("the file length"));
    if (length > bytes.size() || length < 20) {
        return bad("", fmt::format("expected {} bytes as its header says, the file has {}", length, bytes.size()));
    }
    ByteReader chunks(bytes.first(length));
    ARS_TRY_STATUS(chunks.skip(12, "the header"));
    ARS_TRY(const auto jsonLength, chunks.read<std::uint32_t>("the length of the JSON chunk"));
    ARS_TRY(const auto jsonType, chunks.read<std::uint32_t>("the type of the JSON chunk"));
    if (jsonType != kJsonChunk) return bad("byte 16", fmt::format("expected a JSON chunk, found type {:#x}", jsonType));
    ARS_TRY(const auto jsonBytes, chunks.readBytes(jsonLength, "the JSON chunk"));
    parts.json = std::string_view(reinterpret_cast<const char*>(jsonBytes.data()), jsonBytes.size());
    while (!chunks.atEnd()) {
        ARS_TRY(const auto chunkLength, chunks.read<std::uint32_t>("the length of a chunk"));
        ARS_TRY(const auto chunkType, chunks.read<std::uint32_t>("the type of a chunk"));
        ARS_TRY(const auto chunk, chunks.readBytes(chunkLength, "a chunk"));
        if (chunkType == kBinaryChunk && !parts.binary) parts.binary = chunk;
    }
    return parts;
}

Status checkGltfJson(const GltfParts& parts, const std::filesystem::path& folder, const ReadLimits& limits,
                     std::vector<std::string>& notes) {
    ARS_TRY_STATUS(checkJsonSize(parts.json, limits));
    try {
        return checkParsed(json::parse(parts.json), parts, folder, limits, notes);
    } catch (const json::parse_error& error) {
        return bad("JSON", fmt::format("byte {}: {}", error.byte, quotedFound(error.what())));
    } catch (const std::bad_alloc&) {
        return makeError(ErrorCode::OutOfMemory, "JSON", fmt::format("no memory for {} bytes", parts.json.size()));
    } catch (const std::exception& error) {
        return bad("JSON", error.what());
    }
}

std::optional<std::filesystem::path> resolveGltfUri(const std::filesystem::path& folder, std::string_view uri) {
    if (folder.empty()) return std::nullopt;
    const std::filesystem::path relative = percentDecoded(uri);
    if (relative.empty() || relative.is_absolute()) return std::nullopt;
    if (relative.native().find('\0') != std::string::npos) return std::nullopt;
    std::error_code failure;
    // Links are followed first: one that leads out of the folder must not pass.
    const auto base = std::filesystem::weakly_canonical(folder / ".", failure);
    if (failure) return std::nullopt;
    const auto path = std::filesystem::weakly_canonical(base / relative, failure);
    if (failure) return std::nullopt;
    const auto inside = path.lexically_relative(base);
    if (inside.empty() || *inside.begin() == ".." || *inside.begin() == ".") return std::nullopt;
    return path;
}

} // namespace ars
