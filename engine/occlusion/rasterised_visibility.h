#pragma once

#include "engine/core/parameters.h"
#include "engine/occlusion/direction_grid.h"
#include "engine/occlusion/surface_points.h"

#include <cstdint>
#include <memory>

namespace ars {

/// Parameters of visibility by rasterising the mesh from every texel of a light (comparison method 4, RAGA).
struct RasterisedVisibilityParams {
    int rows = 16;              ///< latitudes of the grid of directions [2 .. 64]; twice as many longitudes
    float pixelsPerMetre = 240; ///< of the orthographic pictures [1 .. 10000]
    int maxSide = 2048;         ///< largest side of such a picture; larger meshes get fewer pixels a metre [16 .. 8192]
    int neighbourhood = 30;     ///< vertices that smoothing looks at, itself among them; 1: no smoothing [1 .. 255]

    bool operator==(const RasterisedVisibilityParams&) const = default;
};

const ParameterTable<RasterisedVisibilityParams>& rasterisedVisibilityParameters();

/// Visibility of every vertex of a posed mesh from 512 directions, each by one orthographic z-buffer: a vertex is
/// visible where any pixel shows one of its triangles. Smoothed over neighbourhoods of 30 vertices gathered breadth
/// first (median, median, mean), stored in 8 bits. Vertices at exactly one place, as texture seams split them, count as
/// one. Unlimited reach: the radii of a query are not used.
///
/// Ambient occlusion at a point: sum over directions of V max(n.w, 0) dw / pi, with V from the three nearest vertices
/// weighted by inverse distance (InteractRAGA, scene/env_map.py and scene/gaussian_model.py).
///
/// Host only, deterministic for any number of threads; queries are safe from many threads. A pose needs a new build.
class RasterisedVisibility {
public:
    /// InvalidArgument as checkOccluderMesh and for parameters out of range; LimitExceeded beyond 4 GiB of visibility.
    static Result<RasterisedVisibility> build(std::span<const glm::vec3> verticesM,
                                              std::span<const glm::uvec3> triangles,
                                              const RasterisedVisibilityParams& params = {});

    const DirectionGrid& directions() const;
    /// (V, directions) row-major, 255 is visible. Vertices without a triangle are 0 and never asked.
    std::span<const std::uint8_t> visibility() const;
    /// (V) AO at the vertices with their area-weighted normals; 1 where there is no normal.
    std::span<const float> vertexOcclusion() const;
    double buildMilliseconds() const;

    /// AO in [0, 1] at world points, with the normals of the query. InvalidArgument when lengths differ.
    Status atPoints(const OcclusionQuery& points, std::span<float> occlusion) const;

private:
    RasterisedVisibility() = default;
    struct State;
    std::shared_ptr<const State> state_;
};

} // namespace ars
