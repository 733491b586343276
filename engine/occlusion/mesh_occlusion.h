#pragma once

#include "engine/core/camera.h"
#include "engine/core/image_view.h"
#include "engine/core/parameters.h"
#include "engine/occlusion/surface_points.h"

#include <cstdint>
#include <memory>

namespace ars {

/// Parameters of ambient occlusion by rays against a mesh (comparison method 3 of the paper's occlusion figure).
struct MeshOcclusionParams {
    int rays = 256;        ///< cosine-distributed rays a point [1 .. 65536]
    float offsetM = 1e-3f; ///< a ray starts this far along the normal, metres
    float sinkM = 0.02f;   ///< how deep a point may lie under the mesh's outer side and still see out, metres

    bool operator==(const MeshOcclusionParams&) const = default;
};

const ParameterTable<MeshOcclusionParams>& meshOcclusionParameters();

/// Ambient occlusion by ray casting (Embree) against a posed mesh: the fraction of cosine-distributed rays that hit
/// nothing within the radius. Both sides of a triangle occlude.
///
/// Splatted surfels may lie a little under the mesh that they stand for. A ray that starts there leaves through the
/// inner side of its own sheet, which is no occlusion: hits on a triangle's inner side that lie less than `sinkM` above
/// the tangent plane of the point are passed through. A convex body therefore stays unoccluded for any ray direction,
/// as no part of it rises over its tangent plane. "Inner" relies on triangles that wind counter-clockwise seen from
/// outside.
///
/// Host only. Queries are safe from many threads and give the same numbers for any number of threads; update is not
/// safe beside a query.
class MeshOcclusion {
public:
    MeshOcclusion(MeshOcclusion&&) noexcept;
    MeshOcclusion& operator=(MeshOcclusion&&) noexcept;
    ~MeshOcclusion();

    /// Copies the mesh and builds the tree. InvalidArgument for a mesh without triangles, indices out of range or
    /// vertices that are not finite; Unavailable or OutOfMemory when Embree says so.
    static Result<MeshOcclusion> build(std::span<const glm::vec3> verticesM, std::span<const glm::uvec3> triangles);
    /// The same triangles with moved vertices: refits the tree. InvalidArgument for another number of vertices or ones
    /// that are not finite; the old mesh stays then.
    Status update(std::span<const glm::vec3> verticesM);

    std::size_t vertexCount() const;
    std::size_t triangleCount() const;
    /// Wall time of the last build or update, milliseconds.
    double buildMilliseconds() const;

    /// Unoccluded fraction in [0, 1] at world points. The turn of the rays about the normal depends on the index of the
    /// point alone. A radius that is not positive sees no occluder: 1.
    /// @param occlusion  (P) receives 1 - occluded fraction, every element is written
    /// @return InvalidArgument when lengths differ or a parameter is out of range.
    Status atPoints(const MeshOcclusionParams& params, const OcclusionQuery& points, std::span<float> occlusion) const;

    /// Unoccluded fraction per pixel; empty pixels are 1. Pictures as for collectPixelPoints; `occlusion` has 1
    /// channel.
    Status atPixels(const MeshOcclusionParams& params, const Camera& camera, ImageView<const float> positionM,
                    ImageView<const float> normalView, ImageView<const float> radiusM, ImageView<const float> opacity,
                    ImageView<float> occlusion) const;

    /// Whether something of either side lies on the open segment (nearM, farM) of each ray.
    /// @param originsM, directions  (R); directions of unit length
    /// @param blocked               (R) receives 0 or 1; 0 for a ray that is not finite
    Status blockedRays(std::span<const glm::vec3> originsM, std::span<const glm::vec3> directions, float nearM,
                       float farM, std::span<std::uint8_t> blocked) const;

private:
    MeshOcclusion();
    struct State;
    std::unique_ptr<State> state_;
};

} // namespace ars
