#pragma once

#include "engine/core/error.h"
#include "engine/core/progress.h"
#include "engine/io/mesh.h"

#include <glm/glm.hpp>

#include <cstdint>
#include <vector>

namespace ars {

struct SurfaceSampleOptions {
    std::size_t maxSamples = 150000;
    float spacingM = 0.0f; ///< least distance of neighbours; 0: as small as maxSamples allows
    std::uint32_t seed = 1;
};

/// Points spread evenly over a mesh.
struct SurfaceSamples {
    std::vector<std::uint32_t> triangles; ///< increasing, so that neighbours in the list mostly lie near one another
    std::vector<glm::vec3> barycentrics;
    float spacingM = 0.0f; ///< no two of one sheet are closer
};

/// Poisson-disk samples of a mesh's surface by dart throwing from a dense, stratified set of candidates: no
/// two of one sheet are closer than the spacing, and hardly a point is farther from all of them. Points of different
/// connected parts, or of surfaces that face away from one another, do not push each other off.
///
/// InvalidArgument for no samples or a negative spacing, and for a mesh without area; LimitExceeded where the spacing
/// asked for needs more than maxSamples, with the spacing that would do. The same seed gives the same samples.
Result<SurfaceSamples> sampleSurface(const TriangleMesh& mesh, const SurfaceSampleOptions& options,
                                     const ProgressFunction& progress = {});

/// Number of the connected part of every triangle, from 0; corners at the same place count as joined, so texture seams
/// do not part a surface.
std::vector<std::uint32_t> connectedParts(const TriangleMesh& mesh);

} // namespace ars
