#include "engine/io/mesh.h"

#include <cmath>

namespace ars {
namespace {

template <typename Vector>
Status checkFinite(const std::vector<Vector>& vectors, std::string_view what) {
    for (std::size_t i = 0; i < vectors.size(); ++i) {
        for (int k = 0; k < Vector::length(); ++k) {
            if (std::isfinite(vectors[i][k])) continue;
            return makeError(ErrorCode::InvalidArgument, fmt::format("vertex {}", i),
                             fmt::format("number {} of its {} is {}", k, what, vectors[i][k]));
        }
    }
    return {};
}

Status checkLength(std::size_t length, std::size_t expected, std::string_view what, std::string_view perWhat) {
    if (length == 0 || length == expected) return {};
    return makeError(ErrorCode::InvalidArgument, "",
                     fmt::format("{} {} for {} {}, expected one each or none", length, what, expected, perWhat));
}

} // namespace

std::vector<glm::vec3> vertexNormals(const std::vector<glm::vec3>& positions,
                                     const std::vector<glm::uvec3>& triangles) {
    // Sums in double: thin triangles beside large ones would lose their share.
    std::vector<glm::dvec3> sums(positions.size(), glm::dvec3(0));
    for (const glm::uvec3& t : triangles) {
        const glm::dvec3 a(positions[t.x]), b(positions[t.y]), c(positions[t.z]);
        const glm::dvec3 twiceArea = glm::cross(b - a, c - a);
        for (int corner = 0; corner < 3; ++corner) sums[t[corner]] += twiceArea;
    }
    std::vector<glm::vec3> normals(positions.size(), glm::vec3(0));
    for (std::size_t i = 0; i < sums.size(); ++i) {
        const double length = glm::length(sums[i]);
        if (length > 0) normals[i] = glm::vec3(sums[i] / length);
    }
    return normals;
}

Status validateMesh(const TriangleMesh& mesh) {
    const std::size_t vertices = mesh.positions.size();
    ARS_TRY_STATUS(checkLength(mesh.normals.size(), vertices, "normals", "vertices"));
    ARS_TRY_STATUS(checkLength(mesh.uvs.size(), vertices, "texture coordinates", "vertices"));
    ARS_TRY_STATUS(checkLength(mesh.colors.size(), vertices, "colours", "vertices"));
    ARS_TRY_STATUS(checkLength(mesh.sourceVertices.size(), vertices, "source vertices", "vertices"));
    ARS_TRY_STATUS(checkLength(mesh.materials.size(), mesh.triangles.size(), "material indices", "triangles"));
    ARS_TRY_STATUS(checkFinite(mesh.positions, "position"));
    ARS_TRY_STATUS(checkFinite(mesh.normals, "normal"));
    ARS_TRY_STATUS(checkFinite(mesh.uvs, "texture coordinate"));
    ARS_TRY_STATUS(checkFinite(mesh.colors, "colour"));
    for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
        for (int corner = 0; corner < 3; ++corner) {
            if (mesh.triangles[i][corner] < vertices) continue;
            return makeError(ErrorCode::InvalidArgument, fmt::format("triangle {}", i),
                             fmt::format("names vertex {}, the mesh has {}", mesh.triangles[i][corner], vertices));
        }
    }
    const auto names = static_cast<std::int64_t>(mesh.materialNames.size());
    for (std::size_t i = 0; i < mesh.materials.size(); ++i) {
        if (names == 0 || (mesh.materials[i] >= -1 && mesh.materials[i] < names)) continue;
        return makeError(ErrorCode::InvalidArgument, fmt::format("triangle {}", i),
                         fmt::format("names material {}, the mesh has {}", mesh.materials[i], names));
    }
    return {};
}

} // namespace ars
