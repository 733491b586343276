#pragma once

#include "engine/core/error.h"
#include "engine/rig/body_model.h"
#include "engine/rig/template_mesh.h"

#include <glm/glm.hpp>

#include <cstdint>
#include <optional>
#include <vector>

namespace ars {

struct CanonicalMapOptions {
    int size = 1024;          ///< N: rows of the maps, even, 8 to 4096
    float halfExtentM = 1.0f; ///< the maps show +- this around the centre in x and y, metres
    /// Centre of the maps. Unset: of the canonical template's bounding box. An avatar gives that of its body.
    std::optional<glm::vec3> centerM;
};

/// Orthographic maps of a template in the canonical pose: the front one holds its nearest surface (largest z), the back
/// one its farthest (smallest z) at the same x and y, not mirrored, so both have one silhouette (avatar reference 2.1).
///
/// The two stand side by side as one picture of N rows and 2N columns, front left. Pixel (i, j) of either is centred at
///     x = cx + ((j + 1/2) 2/N - 1) e,   y = cy + (1 - (i + 1/2) 2/N) e,   e = halfExtentM,
/// and belongs to the mask when a triangle of either winding covers its centre. Every masked pixel is one point, and
/// one surfel of the avatar for ever, in the row-major order of the whole picture.
struct CanonicalMaps {
    int size = 0; ///< N
    float halfExtentM = 1.0f;
    glm::vec3 centerM{0.0f};

    std::vector<std::uint32_t> pixels;    ///< (P) row * 2N + column, increasing
    std::vector<std::uint32_t> triangles; ///< (P) of the template's mesh
    std::vector<glm::vec3> barycentrics;  ///< (P) of that triangle's corners, sum 1
    std::vector<glm::vec3> positions;     ///< (P) canonical, world axes, metres; x and y are exactly the pixel's
    std::vector<glm::vec3> normals;       ///< (P) canonical, unit length, interpolated from the vertices'
    std::vector<glm::vec2> uvs;           ///< (P), or empty where the mesh has none
    SkinWeights weights;                  ///< (P) interpolated, the 8 largest

    std::vector<glm::mat4> canonical; ///< (55) A_canonical,j

    std::size_t pointCount() const { return pixels.size(); }
    /// Pixels of the whole picture: N x 2N.
    std::size_t pixelCount() const { return 2 * static_cast<std::size_t>(size) * static_cast<std::size_t>(size); }
};

/// InvalidArgument: size or extent out of range, a template that does not validate or has no triangle; Unsupported when
/// nothing of it lies within the maps.
Result<CanonicalMaps> canonicalMaps(const TemplateMesh& templateMesh, const CanonicalMapOptions& options = {});

/// Centre of the bounding box of a body in the canonical pose.
glm::vec3 canonicalCenter(const BodyModel& body, const BodyShape& shape = {});

/// Every second row and column, from the first (the network's input is that much smaller than its output): maps of
/// half the size with the points at those pixels. The size must be even.
Result<CanonicalMaps> halvedMaps(const CanonicalMaps& maps);

/// (N, 2N) 1 where there is a point.
std::vector<std::uint8_t> mapMask(const CanonicalMaps& maps);

} // namespace ars
