#pragma once

#include "engine/core/camera.h"
#include "engine/core/error.h"
#include "engine/core/image_view.h"

#include <glm/glm.hpp>

#include <cstddef>
#include <span>
#include <string_view>
#include <vector>

namespace ars {

/// Where the comparison methods are asked for ambient occlusion: P points of a surface, in host memory.
///
/// All arrays in the space of the mesh that the method was built from (world for MeshOcclusion and
/// RasterisedVisibility, canonical for BakedVisibility). A point or normal that is not finite, or a normal of length 0,
/// has no answer; it counts as unoccluded, 1.
struct OcclusionQuery {
    std::span<const glm::vec3> pointsM; ///< (P) metres
    std::span<const glm::vec3> normals; ///< (P) outward; any length, made unit inside
    std::span<const float> radiiM;      ///< (P) how far an occluder may be, metres; empty: any distance
};

/// Whether the point is finite and the normal finite and not 0.
bool hasAnswer(const glm::vec3& pointM, const glm::vec3& normal);

/// InvalidArgument naming the array when the lengths of points, normals, radii (unless empty) and answers differ.
Status checkOcclusionQuery(const OcclusionQuery& points, std::size_t answers, std::string_view place);

/// The pixels of a G-buffer that show something, as surface points in world space.
struct PixelPoints {
    std::vector<std::size_t> pixels; ///< row-major pixel of each point
    std::vector<glm::vec3> pointsM;  ///< world, metres
    std::vector<glm::vec3> normals;  ///< world, unit length
    std::vector<float> radiiM;       ///< empty without a radius map
    int width = 0;
    int height = 0;

    OcclusionQuery points() const { return {pointsM, normals, radiiM}; }
};

/// The points under the pixels whose opacity reaches kMinOpacity and whose position and normal are finite and whose
/// normal is not 0.
///
/// Pictures in host memory, (height, width, channels) of the camera's size, as the splatter writes them.
/// @param positionM   3 channels, world space
/// @param normalView  3 channels, camera space; turned into world space here
/// @param radiusM     1 channel, metres; empty (no data): any distance
/// @param opacity     1 channel in [0, 1]
/// @return InvalidArgument naming the picture whose size or channels differ.
Result<PixelPoints> collectPixelPoints(const Camera& camera, ImageView<const float> positionM,
                                       ImageView<const float> normalView, ImageView<const float> radiusM,
                                       ImageView<const float> opacity);

/// Writes one value per point to its pixel and 1 (unoccluded) everywhere else, as the screen-space operator does for
/// empty pixels. `picture` has 1 channel. InvalidArgument when sizes differ.
Status scatterToPixels(const PixelPoints& points, std::span<const float> values, ImageView<float> picture);

/// What the comparison methods ask of a mesh: at least one triangle, indices in range, finite vertices. InvalidArgument
/// naming the triangle or vertex.
Status checkOccluderMesh(std::span<const glm::vec3> verticesM, std::span<const glm::uvec3> triangles,
                         std::string_view place);

} // namespace ars
