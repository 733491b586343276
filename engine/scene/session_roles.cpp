#include "engine/capture/calibration.h"
#include "engine/core/file.h"
#include "engine/frame/buffer_catalogue.h"
#include "engine/io/exr.h"
#include "engine/io/file_recognition.h"
#include "engine/io/npz.h"
#include "engine/scene/run_folder.h"
#include "engine/scene/session.h"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <array>
#include <cstring>
#include <fstream>
#include <set>
#include <system_error>

namespace ars {
namespace fs = std::filesystem;
namespace {

using Json = nlohmann::ordered_json;

/// Projects and calibrations are far below this; as a tree JSON takes some twenty times its bytes.
constexpr std::uint64_t kMostJsonBytes = 64ull << 20;
constexpr std::uint32_t kMostChunkBytes = 1u << 30;
constexpr std::string_view kDocumentKey = "ars";

Error unsupported(const fs::path& path, std::string message) {
    return makeError(ErrorCode::Unsupported, path.string(), std::move(message));
}

bool contains(const std::vector<std::string>& list, std::string_view text) {
    return std::find(list.begin(), list.end(), text) != list.end();
}

Result<Json> parseJson(const fs::path& path, std::string_view text) {
    Json json = Json::parse(text, nullptr, false);
    if (json.is_discarded()) return makeError(ErrorCode::BadFile, path.string(), "is no sound JSON");
    return json;
}

Result<FileRole> roleOfFolder(const fs::path& path) {
    std::error_code ignored;
    if (fs::exists(path / "calibration_full.json", ignored)) return FileRole::Capture;
    if (looksLikeTrainedAvatar(path)) return looksLikeRunFolder(path) ? FileRole::Run : FileRole::Avatar;
    static const std::set<std::string> kFaces{"px", "posx", "nx", "negx", "py", "posy",
                                              "ny", "negy", "pz", "posz", "nz", "negz"};
    for (fs::directory_iterator i(path, ignored), end; !ignored && i != end; i.increment(ignored)) {
        if (kFaces.count(i->path().stem().string()) > 0) return FileRole::Light; // its reader names a missing face
    }
    return unsupported(path, "expected a capture (calibration_full.json), six faces of a light (px, nx, py, ny, pz, "
                             "nz), a trained avatar (avatar.json) or a training run (config.json and status.json), "
                             "found a folder with none of them");
}

Result<FileRole> roleOfNpz(const fs::path& path) {
    auto entries = listNpz(path);
    if (!entries) return std::move(entries).error();
    std::vector<std::string> keys;
    for (const NpzEntry& entry : *entries) keys.push_back(entry.key);
    for (const char* key : {"v_template", "J_regressor", "kintree_table"}) {
        if (contains(keys, key)) return FileRole::Avatar;
    }
    for (const char* key : {"global_orient", "body_pose", "poses", "root_orient", "pose_body"}) {
        if (contains(keys, key)) return FileRole::Clip;
    }
    if (contains(keys, "v") && contains(keys, "f")) return FileRole::Avatar;
    std::string found;
    for (std::size_t i = 0; i < std::min<std::size_t>(keys.size(), 6); ++i) found += (i ? ", " : "") + keys[i];
    return unsupported(path, fmt::format("expected the keys of a body (v_template), a motion (poses, body_pose) or a "
                                         "mesh (v, f), found {}",
                                         keys.empty() ? "an empty archive" : found));
}

Result<FileRole> roleOfGltfJson(const fs::path& path, const Json& json) {
    const auto count = [&](const char* key) {
        const auto found = json.find(key);
        return found != json.end() && found->is_array() ? found->size() : 0;
    };
    if (count("meshes") > 0) return FileRole::Avatar;
    if (count("animations") > 0) return FileRole::Clip;
    return unsupported(path, "the glTF has neither a mesh nor an animation");
}

/// The JSON of a .glb is its first chunk.
Result<FileRole> roleOfGlb(const fs::path& path) {
    std::ifstream file(path, std::ios::binary);
    std::array<char, 20> head{};
    file.read(head.data(), head.size());
    std::uint32_t length = 0;
    std::memcpy(&length, head.data() + 12, sizeof(length));
    std::error_code failure;
    const std::uint64_t bytes = fs::file_size(path, failure);
    if (!file || failure || length > std::min<std::uint64_t>(kMostChunkBytes, bytes) ||
        std::memcmp(head.data() + 16, "JSON", 4) != 0) {
        return makeError(ErrorCode::BadFile, path.string(), "the glb is truncated: expected its JSON chunk");
    }
    std::string text(length, '\0');
    if (!file.read(text.data(), static_cast<std::streamsize>(length))) {
        return makeError(ErrorCode::BadFile, path.string(), "the glb is truncated within its JSON chunk");
    }
    ARS_TRY(const Json json, parseJson(path, text));
    return roleOfGltfJson(path, json);
}

Result<FileRole> roleOfJson(const fs::path& path, bool gltf) {
    const bool project = path.extension() == ".ars";
    ReadLimits limits = defaultReadLimits();
    limits.maxFileBytes = std::min(limits.maxFileBytes, kMostJsonBytes);
    ARS_TRY(const std::string text, readTextFile(path, limits));
    ARS_TRY(const Json json, parseJson(path, text));
    if (gltf) return roleOfGltfJson(path, json);
    if (json.is_object()) {
        const auto program = json.find("program");
        if (project || (program != json.end() && *program == "ars")) return FileRole::Project;
        if (json.contains("rotations")) return FileRole::PoseFile;
        if (looksLikeCalibration(json) || (json.contains("K") && json.contains("width"))) return FileRole::Capture;
    }
    return unsupported(path, "sound JSON, but no project, pose, calibration or camera of this program");
}

/// Layers that this program writes; pictures that have them are buffers, not light.
bool isBufferLayer(const std::string& layer) {
    static constexpr std::array<std::string_view, 14> kLayers{
        "radiance",   "albedo", "roughness", "normal",  "depth",   "position", "ao",
        "importance", "radius", "bone",      "opacity", "diffuse", "specular", "radius_plus"};
    return std::find(kLayers.begin(), kLayers.end(), layer) != kLayers.end();
}

/// Lights that the program generates say so under the same key as pictures do; only documents name an avatar.
bool isDocument(const std::string& text) {
    const auto json = nlohmann::json::parse(text, nullptr, false);
    return json.is_object() && json.contains("avatar");
}

Result<FileRole> roleOfExr(const fs::path& path) {
    auto info = listExr(path);
    if (!info) return std::move(info).error();
    if (info->parts.empty()) return makeError(ErrorCode::BadFile, path.string(), "the file has no picture");
    for (const ExrPartInfo& part : info->parts) {
        const auto found = part.textAttributes.find(std::string(kDocumentKey));
        if (found != part.textAttributes.end() && isDocument(found->second)) return FileRole::PictureOfOurs;
    }
    const ExrPartInfo& part = info->parts.front();
    const auto& layers = info->layers;
    if (std::any_of(layers.begin(), layers.end(), isBufferLayer)) return FileRole::ComparePicture;
    const bool colour = std::any_of(part.channels.begin(), part.channels.end(), [](const ExrChannelInfo& channel) {
        const std::size_t dot = channel.name.rfind('.');
        const std::string letter = dot == std::string::npos ? channel.name : channel.name.substr(dot + 1);
        return letter == "R" || letter == "r" || letter == "Y";
    });
    const int width = part.displayWindow.width(), height = part.displayWindow.height();
    const bool latLong = width == 2 * height;
    const bool strip = width == 6 * height || height == 6 * width;
    return colour && (latLong || strip) ? FileRole::Light : FileRole::ComparePicture;
}

/// Whether a PNG has a text chunk with the document; pixels are passed over.
bool carriesDocument(const fs::path& path) {
    std::ifstream file(path, std::ios::binary);
    file.seekg(8);
    while (file) {
        std::array<unsigned char, 8> head{};
        if (!file.read(reinterpret_cast<char*>(head.data()), head.size())) return false;
        const std::uint32_t length = (std::uint32_t{head[0]} << 24) | (std::uint32_t{head[1]} << 16) |
                                     (std::uint32_t{head[2]} << 8) | std::uint32_t{head[3]};
        const std::string_view type(reinterpret_cast<const char*>(head.data()) + 4, 4);
        std::uint32_t read = 0;
        if (type == "tEXt" || type == "zTXt" || type == "iTXt") {
            std::array<char, 4> keyword{};
            read = std::min<std::uint32_t>(length, keyword.size());
            file.read(keyword.data(), read);
            if (read == keyword.size() && std::string_view(keyword.data(), 3) == kDocumentKey && keyword[3] == '\0') {
                return true;
            }
        }
        if (type == "IEND") return false;
        file.seekg(static_cast<std::streamoff>(length - read) + 4, std::ios::cur);
    }
    return false;
}

Result<FileRole> roleOfForeign(const fs::path& path, const FileRecognition& file) {
    if (file.name == "MP4 video" && documentFromPicture(path).ok()) return FileRole::PictureOfOurs;
    return unsupported(path, file.advice.empty()
                                 ? fmt::format("this is a {}, which this program does not read", file.name)
                                 : fmt::format("this is a {}; {}", file.name, file.advice));
}

} // namespace

Result<FileRole> Session::roleOf(const fs::path& path) {
    std::error_code ignored;
    if (fs::is_directory(path, ignored)) return roleOfFolder(path);
    ARS_TRY(const FileRecognition file, recogniseFile(path));
    switch (file.format) {
    case FileFormat::Npy:
    case FileFormat::Bvh:
        return FileRole::Clip;
    case FileFormat::Npz:
        return roleOfNpz(path);
    case FileFormat::Glb:
        return roleOfGlb(path);
    case FileFormat::Gltf:
        return roleOfJson(path, true);
    case FileFormat::Json:
        return roleOfJson(path, false);
    case FileFormat::Obj:
    case FileFormat::Ply:
        return FileRole::Avatar;
    case FileFormat::Hdr:
        return FileRole::Light;
    case FileFormat::Exr:
        return roleOfExr(path);
    case FileFormat::Png:
        return carriesDocument(path) ? FileRole::PictureOfOurs : FileRole::ComparePicture;
    case FileFormat::Jpeg:
        return FileRole::ComparePicture;
    case FileFormat::Foreign:
        return roleOfForeign(path, file);
    case FileFormat::Empty:
        return makeError(ErrorCode::BadFile, path.string(), "the file is empty");
    case FileFormat::Safetensors:
    case FileFormat::Text:
    case FileFormat::Unknown:
        break;
    }
    if (path.extension() == ".ars") {
        return makeError(ErrorCode::BadFile, path.string(),
                         fmt::format("expected a project (JSON), found a {}", file.name));
    }
    return unsupported(path, fmt::format("expected an avatar, a light, a motion, a pose, a capture, a picture or a "
                                         "project, found a {}",
                                         file.name));
}

} // namespace ars
