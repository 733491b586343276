#pragma once

#include "engine/core/error.h"

#include <glm/glm.hpp>

#include <cstdint>
#include <string>
#include <vector>

namespace ars {

/// A triangle mesh as files hold it: positions in the file's own unit and axes (glTF: metres, y up), normals as given.
/// Attributes are per vertex; a vertex that has several texture coordinates in the file is split.
struct TriangleMesh {
    std::string name;
    std::vector<glm::vec3> positions;
    std::vector<glm::vec3> normals; ///< empty, or one per position
    std::vector<glm::vec2> uvs;     ///< empty, or one per position; (0,0) is the top left of the texture (glTF)
    std::vector<glm::vec4> colors;  ///< empty, or one per position; linear RGBA
    std::vector<glm::uvec3> triangles;
    std::vector<std::int32_t> materials; ///< empty, or one material per triangle; -1 has none
    std::vector<std::string> materialNames;
    std::vector<std::int32_t> sourceVertices; ///< empty, or the file's own vertex index of each (split) vertex
};

/// Area-weighted vertex normals, unit length; (0,0,0) where no triangle of any area touches a vertex. Indices must be
/// in range (validateMesh).
std::vector<glm::vec3> vertexNormals(const std::vector<glm::vec3>& positions, const std::vector<glm::uvec3>& triangles);

/// InvalidArgument when a vertex or material index is out of range, an attribute has the wrong length, or a number is
/// not finite; names the first vertex or triangle. Every mesh that a reader gives passes.
Status validateMesh(const TriangleMesh& mesh);

} // namespace ars
