#pragma once

#include "engine/core/error.h"
#include "engine/core/limits.h"
#include "engine/io/gltf.h"
#include "engine/io/mesh.h"
#include "engine/rig/skinning.h"

#include <cstddef>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

namespace ars {

/// What a file says of itself, before any body helps: `weights` empty when it has none.
struct LoadedTemplate {
    TriangleMesh mesh;
    SkinWeights weights;
    std::vector<glm::vec3> joints;
    std::vector<GltfMaterial> materials;
    std::vector<GltfImage> images;
    std::vector<std::string> notes;
};

/// Reads a glTF, glb, npz, PLY or OBJ mesh, told by its content. With `ignoreWeights` those of the file are left aside.
/// Errors as readTemplate says; the mesh has at least one triangle.
Result<LoadedTemplate> loadTemplate(std::span<const std::byte> bytes, const std::filesystem::path& folder,
                                    bool ignoreWeights, const ReadLimits& limits);

/// One plain material for each of the mesh's material names.
std::vector<GltfMaterial> plainMaterials(const TriangleMesh& mesh);

} // namespace ars
