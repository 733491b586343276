#include "engine/rig/template_file.h"

#include "engine/io/npz.h"
#include "engine/io/obj.h"
#include "engine/io/ply.h"
#include "engine/rig/gltf_rig.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <utility>

namespace ars {
namespace {

enum class FileKind { Gltf, Npz, Ply, Obj, Unknown };

bool startsWith(std::span<const std::byte> bytes, std::string_view magic) {
    return bytes.size() >= magic.size() &&
           std::equal(magic.begin(), magic.end(), reinterpret_cast<const char*>(bytes.data()));
}

/// Some line begins with a vertex.
bool looksLikeObj(std::string_view text) {
    if (text.substr(0, 4096).find('\0') != std::string_view::npos) return false;
    for (std::size_t line = 0; line < text.size();) {
        const std::string_view rest = text.substr(line);
        if (rest.size() > 2 && rest[0] == 'v' && (rest[1] == ' ' || rest[1] == '\t')) return true;
        const std::size_t end = rest.find('\n');
        if (end == std::string_view::npos) return false;
        line += end + 1;
    }
    return false;
}

FileKind recognise(std::span<const std::byte> bytes) {
    if (startsWith(bytes, "glTF")) return FileKind::Gltf;
    if (startsWith(bytes, "PK\x03\x04") || startsWith(bytes, "PK\x05\x06")) return FileKind::Npz;
    if (startsWith(bytes, "ply\n") || startsWith(bytes, "ply\r")) return FileKind::Ply;
    const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    const std::size_t first = text.find_first_not_of(" \t\r\n\xef\xbb\xbf");
    if (first != std::string_view::npos && text[first] == '{') return FileKind::Gltf;
    return looksLikeObj(text) ? FileKind::Obj : FileKind::Unknown;
}

// ---- npz ----

Result<std::vector<glm::vec3>> readPoints(const NpzFile& file, std::string_view key) {
    ARS_TRY(const Array* array, file.find(key));
    const std::array<std::size_t, 2> shape = {kAnySize, 3};
    ARS_TRY_STATUS(requireShape(*array, key, shape));
    ARS_TRY(const std::vector<float> numbers, array->toFloat());
    std::vector<glm::vec3> points(numbers.size() / 3);
    for (std::size_t i = 0; i < points.size(); ++i) {
        points[i] = {numbers[3 * i], numbers[3 * i + 1], numbers[3 * i + 2]};
        if (!std::isfinite(points[i].x) || !std::isfinite(points[i].y) || !std::isfinite(points[i].z)) {
            return makeError(ErrorCode::BadFile, fmt::format("{}[{}]", key, i), "the position is not finite");
        }
    }
    return points;
}

/// Indices (F,3), each below `limit`.
Result<std::vector<glm::uvec3>> readIndices(const NpzFile& file, std::string_view key, std::size_t limit,
                                            std::string_view what) {
    ARS_TRY(const Array* array, file.find(key));
    const std::array<std::size_t, 2> shape = {kAnySize, 3};
    ARS_TRY_STATUS(requireShape(*array, key, shape));
    ARS_TRY(const std::vector<std::int64_t> numbers, array->toInt64());
    std::vector<glm::uvec3> indices(numbers.size() / 3);
    for (std::size_t n = 0; n < numbers.size(); ++n) {
        if (numbers[n] < 0 || static_cast<std::uint64_t>(numbers[n]) >= limit) {
            return makeError(ErrorCode::BadFile, fmt::format("{}[{}]", key, n / 3),
                             fmt::format("{} {} does not exist, the file has {}", what, numbers[n], limit));
        }
        indices[n / 3][static_cast<int>(n % 3)] = static_cast<std::uint32_t>(numbers[n]);
    }
    return indices;
}

/// The SMPL-X joint of each column of weights.
Result<std::vector<int>> readJointColumns(const NpzFile& file, std::size_t columns) {
    std::vector<int> joints(columns);
    if (!file.has("joint_names")) {
        if (columns != kSmplxJointCount) {
            return makeError(
                ErrorCode::BadFile, "weights",
                fmt::format("{} joints and no joint_names, expected the {} of SMPL-X", columns, kSmplxJointCount));
        }
        for (std::size_t j = 0; j < columns; ++j) joints[j] = static_cast<int>(j);
        return joints;
    }
    ARS_TRY(const Array* names, file.find("joint_names"));
    if (names->dtype != DType::Text || names->texts.size() != columns) {
        return makeError(ErrorCode::BadFile, "joint_names",
                         fmt::format("{}, expected one text for each of {} joints", names->describe(), columns));
    }
    std::vector<bool> taken(kSmplxJointCount, false);
    for (std::size_t j = 0; j < columns; ++j) {
        joints[j] = smplxJointIndex(names->texts[j]);
        if (joints[j] < 0) {
            return makeError(ErrorCode::Unsupported, fmt::format("joint_names[{}]", j),
                             fmt::format("\"{}\" is not a joint of SMPL-X", names->texts[j]));
        }
        if (taken[static_cast<std::size_t>(joints[j])]) {
            return makeError(ErrorCode::BadFile, fmt::format("joint_names[{}]", j),
                             fmt::format("\"{}\" is there twice", names->texts[j]));
        }
        taken[static_cast<std::size_t>(joints[j])] = true;
    }
    return joints;
}

/// Texture coordinates per corner: vertices are split where they have several. `uv` counts from the bottom left, as in
/// OBJ and Blender.
Status applyUvs(const NpzFile& file, TriangleMesh& mesh) {
    ARS_TRY(const Array* array, file.find("uv"));
    const std::array<std::size_t, 2> shape = {kAnySize, 2};
    ARS_TRY_STATUS(requireShape(*array, "uv", shape));
    ARS_TRY(const std::vector<float> numbers, array->toFloat());
    const std::size_t count = numbers.size() / 2;
    std::vector<glm::uvec3> corners = mesh.triangles;
    if (file.has("uv_f")) {
        ARS_TRY(corners, readIndices(file, "uv_f", count, "texture coordinate"));
        if (corners.size() != mesh.triangles.size()) {
            return makeError(ErrorCode::BadFile, "uv_f",
                             fmt::format("{} rows, expected {} as in f", corners.size(), mesh.triangles.size()));
        }
    } else if (count != mesh.positions.size()) {
        return makeError(ErrorCode::BadFile, "uv",
                         fmt::format("{} rows and no uv_f, expected {} as in v", count, mesh.positions.size()));
    }
    std::vector<glm::vec3> positions;
    std::vector<std::int32_t> sources;
    std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> known;
    for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
        for (int corner = 0; corner < 3; ++corner) {
            const std::uint32_t vertex = mesh.triangles[t][corner], uv = corners[t][corner];
            const auto [at, isNew] = known.try_emplace({vertex, uv}, static_cast<std::uint32_t>(positions.size()));
            if (isNew) {
                positions.push_back(mesh.positions[vertex]);
                sources.push_back(static_cast<std::int32_t>(vertex));
                mesh.uvs.emplace_back(numbers[2 * uv], 1.0f - numbers[2 * uv + 1]);
            }
            mesh.triangles[t][corner] = at->second;
        }
    }
    mesh.positions = std::move(positions);
    mesh.sourceVertices = std::move(sources);
    return {};
}

Status applyMaterials(const NpzFile& file, TriangleMesh& mesh) {
    ARS_TRY(const Array* array, file.find("material"));
    ARS_TRY(const std::vector<std::int64_t> numbers, array->toInt64());
    if (array->shape.size() != 1 || numbers.size() != mesh.triangles.size()) {
        return makeError(
            ErrorCode::BadFile, "material",
            fmt::format("{}, expected one number for each of {} triangles", array->describe(), mesh.triangles.size()));
    }
    constexpr std::int64_t kMaxMaterials = 65536;
    std::int64_t count = 0;
    for (std::size_t t = 0; t < numbers.size(); ++t) {
        if (numbers[t] < -1 || numbers[t] >= kMaxMaterials) {
            return makeError(ErrorCode::BadFile, fmt::format("material[{}]", t),
                             fmt::format("{} is not a material index", numbers[t]));
        }
        count = std::max(count, numbers[t] + 1);
        mesh.materials.push_back(static_cast<std::int32_t>(numbers[t]));
    }
    if (file.has("material_names")) {
        ARS_TRY(const Array* names, file.find("material_names"));
        mesh.materialNames = names->texts;
    }
    for (std::int64_t i = static_cast<std::int64_t>(mesh.materialNames.size()); i < count; ++i) {
        mesh.materialNames.push_back(fmt::format("material_{}", i));
    }
    return {};
}

/// Weights (N, columns) of the file's own vertices, in SMPL-X's order.
Status applyWeights(const NpzFile& file, std::size_t fileVertices, LoadedTemplate& loaded) {
    ARS_TRY(const Array* array, file.find("weights"));
    const std::array<std::size_t, 2> shape = {fileVertices, kAnySize};
    ARS_TRY_STATUS(requireShape(*array, "weights", shape));
    const std::size_t columns = array->shape[1];
    ARS_TRY(const std::vector<int> jointOfColumn, readJointColumns(file, columns));
    ARS_TRY(const std::vector<float> dense, array->toFloat());
    Result<SkinWeights> sparse = sparseWeights(dense, fileVertices, columns);
    if (!sparse) return atPlace(std::move(sparse).error(), "weights");
    const TriangleMesh& mesh = loaded.mesh;
    for (std::size_t v = 0; v < mesh.positions.size(); ++v) {
        const std::size_t source = mesh.sourceVertices.empty() ? v : static_cast<std::size_t>(mesh.sourceVertices[v]);
        for (std::size_t i = source * kMaxInfluences; i < (source + 1) * kMaxInfluences; ++i) {
            const bool used = sparse->weights[i] > 0.0f;
            loaded.weights.weights.push_back(sparse->weights[i]);
            loaded.weights.joints.push_back(used ? static_cast<std::uint16_t>(jointOfColumn[sparse->joints[i]])
                                                 : std::uint16_t{0});
        }
    }
    if (!file.has("joints")) return {};
    ARS_TRY(const std::vector<glm::vec3> joints, readPoints(file, "joints"));
    if (joints.size() != columns || columns != kSmplxJointCount) {
        return makeError(ErrorCode::BadFile, "joints",
                         fmt::format("{} positions for {} columns of weights, expected {}", joints.size(), columns,
                                     kSmplxJointCount));
    }
    loaded.joints.resize(columns);
    for (std::size_t j = 0; j < columns; ++j) loaded.joints[static_cast<std::size_t>(jointOfColumn[j])] = joints[j];
    return {};
}

Result<LoadedTemplate> loadNpz(std::span<const std::byte> bytes, const ReadLimits& limits) {
    ARS_TRY(const NpzFile file, parseNpz(bytes, limits));
    LoadedTemplate loaded;
    ARS_TRY(loaded.mesh.positions, readPoints(file, "v"));
    const std::size_t fileVertices = loaded.mesh.positions.size();
    ARS_TRY(loaded.mesh.triangles, readIndices(file, "f", fileVertices, "vertex"));
    if (file.has("uv")) ARS_TRY_STATUS(applyUvs(file, loaded.mesh));
    if (file.has("material")) ARS_TRY_STATUS(applyMaterials(file, loaded.mesh));
    if (file.has("weights")) ARS_TRY_STATUS(applyWeights(file, fileVertices, loaded));
    loaded.materials = plainMaterials(loaded.mesh);
    return loaded;
}

// ---- the other kinds ----

Result<LoadedTemplate> loadGltf(std::span<const std::byte> bytes, const std::filesystem::path& folder,
                                bool ignoreWeights, const ReadLimits& limits) {
    ARS_TRY(const GltfDocument document, parseGltf(bytes, folder, limits));
    LoadedTemplate loaded;
    loaded.materials = document.materials;
    loaded.images = document.images;
    const bool skinned = std::any_of(document.nodes.begin(), document.nodes.end(),
                                     [](const GltfNode& node) { return node.mesh >= 0 && node.skin >= 0; });
    if (!skinned) {
        ARS_TRY(loaded.mesh, staticMeshFromGltf(document, limits));
        return loaded;
    }
    ARS_TRY(RiggedMesh rig, rigFromGltf(document, limits));
    loaded.mesh = std::move(rig.mesh);
    loaded.notes = std::move(rig.notes);
    if (ignoreWeights) return loaded;
    if (!rig.isSmplx) {
        return makeError(ErrorCode::Unsupported, "",
                         fmt::format("its skeleton of {} joints (\"{}\", ...) is not SMPL-X's; a template needs the 55 "
                                     "SMPL-X joints by name, or its own weights left aside, so that they are diffused "
                                     "from the body",
                                     rig.skeleton.jointCount(), rig.skeleton.names.front()));
    }
    loaded.weights = std::move(rig.weights);
    loaded.joints = std::move(rig.skeleton.restPositions);
    return loaded;
}

} // namespace

std::vector<GltfMaterial> plainMaterials(const TriangleMesh& mesh) {
    std::vector<GltfMaterial> materials;
    for (const std::string& name : mesh.materialNames) {
        GltfMaterial material;
        material.name = name;
        material.metallicFactor = 0.0f;
        material.roughnessFactor = 0.5f;
        materials.push_back(std::move(material));
    }
    return materials;
}

Result<LoadedTemplate> loadTemplate(std::span<const std::byte> bytes, const std::filesystem::path& folder,
                                    bool ignoreWeights, const ReadLimits& limits) {
    LoadedTemplate loaded;
    switch (recognise(bytes)) {
    case FileKind::Gltf: {
        ARS_TRY(loaded, loadGltf(bytes, folder, ignoreWeights, limits));
        break;
    }
    case FileKind::Npz: {
        ARS_TRY(loaded, loadNpz(bytes, limits));
        break;
    }
    case FileKind::Ply: {
        ARS_TRY(const PlyFile file, parsePly(bytes, limits));
        ARS_TRY(loaded.mesh, meshFromPly(file));
        break;
    }
    case FileKind::Obj: {
        ARS_TRY(ObjFile file, parseObj(bytes, limits));
        loaded.mesh = std::move(file.mesh);
        loaded.materials = plainMaterials(loaded.mesh);
        break;
    }
    case FileKind::Unknown:
        return makeError(ErrorCode::Unsupported, "",
                         "not a template: expected a glTF, glb, npz, PLY or OBJ mesh by its content");
    }
    if (loaded.mesh.triangles.empty()) return makeError(ErrorCode::BadFile, "", "the mesh has no triangles");
    if (ignoreWeights) {
        loaded.weights = {};
        loaded.joints.clear();
    }
    return loaded;
}

} // namespace ars
