#pragma once

#include "engine/io/mesh.h"
#include "engine/rig/skinning.h"

#include <glm/glm.hpp>

#include <cstdint>
#include <span>
#include <vector>

namespace ars {

/// Points on a triangle mesh: triangle and weights of its corners. Both lists have P entries; indices are in range.
struct SurfacePoints {
    std::span<const std::uint32_t> triangles;
    std::span<const glm::vec3> barycentrics;
};

/// Skinning weights at the points: those of the corners blended, the 8 largest kept and normalised (P).
SkinWeights interpolatedWeights(const TriangleMesh& mesh, const SkinWeights& vertexWeights,
                                const SurfacePoints& points);

/// Unit normals at the points from those of the corners. Where that is zero, or lies behind the triangle as its winding
/// (counter-clockwise seen from outside) says, the triangle's own normal stands in; a triangle without area gives +z.
std::vector<glm::vec3> interpolatedNormals(const TriangleMesh& mesh, std::span<const glm::vec3> positions,
                                           std::span<const glm::vec3> vertexNormals, const SurfacePoints& points);

/// The mesh's own normals where it has them, else area-weighted ones.
std::vector<glm::vec3> smoothNormals(const TriangleMesh& mesh);

} // namespace ars
