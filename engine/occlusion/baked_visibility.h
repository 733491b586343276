#pragma once

#include "engine/core/parameters.h"
#include "engine/occlusion/direction_grid.h"
#include "engine/occlusion/spherical_harmonics_math.h"
#include "engine/occlusion/surface_points.h"

#include <cstdint>
#include <memory>

namespace ars {

/// Parameters of visibility baked into a grid of spherical harmonics (comparison method 5, GS-IR).
struct BakedVisibilityParams {
    int resolution = 160;      ///< grid vertices along each side [2 .. 512]
    glm::vec3 centerM{0.0f};   ///< centre of the box, metres (not a row of the parameter table)
    float boundM = 1.5f;       ///< half side of the box, metres
    float thresholdM = 0.4f;   ///< nearer surfaces block a direction, metres
    float nearM = 0.01f;       ///< still nearer ones do not (the near plane of the original's pictures), metres
    int rows = 24;             ///< latitudes of the directions of a bake [4 .. 256]; twice as many longitudes
    float normalShift = 0.01f; ///< a query is moved by this share of bound/resolution along its normal [0 .. 2]
    int samples = 256;         ///< cosine-distributed directions that a query averages [1 .. 4096]

    bool operator==(const BakedVisibilityParams&) const = default;
};

const ParameterTable<BakedVisibilityParams>& bakedVisibilityParameters();

/// A function over the sphere by its spherical harmonics of degree <= 3.
struct VisibilityHarmonics {
    float values[kHarmonicCount] = {};
};

/// c_lm = sum over directions of visible Y_lm dw. @param visible  (directions) 0 or 1
VisibilityHarmonics projectVisibility(const DirectionGrid& grid, std::span<const std::uint8_t> visible);

/// Ambient occlusion about a unit normal: the mean of the series, clamped to [0, 1] at every sample, over
/// cosine-distributed directions (what GGX importance sampling at roughness 1 gives).
float occlusionFromHarmonics(const VisibilityHarmonics& harmonics, const glm::vec3& unitNormal, int samples = 256);

/// Visibility of the canonical body, baked once: at the grid vertices around the surface, a mask over directions (1
/// where nothing lies between `nearM` and `thresholdM`) projected on spherical harmonics of degree <= 3. The original
/// renders six depth pictures of the Gaussians at each vertex; here the same distances come from rays against the
/// canonical mesh.
///
/// It does not follow the pose: ask it at canonical positions with canonical normals. The reach is fixed at bake time;
/// the radii of a query are not used. Host only, deterministic for any number of threads; queries are safe from many
/// threads.
class BakedVisibility {
public:
    /// InvalidArgument as checkOccluderMesh, for parameters out of range, and for a mesh wholly outside the box.
    static Result<BakedVisibility> bake(std::span<const glm::vec3> verticesM, std::span<const glm::uvec3> triangles,
                                        const BakedVisibilityParams& params = {});

    /// Grid vertices that were baked: the corners of the cells that the surface touches.
    std::size_t bakedCount() const;
    double bakeMilliseconds() const;

    /// AO in [0, 1] at canonical points; points outside the box are moved to its border. InvalidArgument when lengths
    /// differ.
    Status atPoints(const OcclusionQuery& points, std::span<float> occlusion) const;

private:
    BakedVisibility() = default;
    struct State;
    std::shared_ptr<const State> state_;
};

} // namespace ars
