#pragma once

#include "engine/core/error.h"
#include "engine/core/limits.h"
#include "engine/core/progress.h"
#include "engine/rig/skinning.h"

#include <glm/glm.hpp>

#include <cstdint>
#include <span>
#include <vector>

namespace ars {

/// How weights spread from a body to a mesh around it (avatar reference 2.4).
struct DiffusionOptions {
    int resolution = 128;     ///< cells along the longest side of the box [16..512]
    float boxScale = 1.1f;    ///< the box is the common bounding box, grown on every side by (boxScale - 1) / 2 of its
                              ///< longest side
    float fixedBandM = 0.04f; ///< cells up to here take the weights of the closest skin, except between two limbs;
                              ///< cells within one cell edge always do, metres
    float surfaceBlendM = 0.008f; ///< at the surface a point takes the body's weights directly, at this distance the
                                  ///< grid's, in between a smooth mixture; 0: the grid's everywhere, metres
    float tolerance = 1e-5f;      ///< residual of the solve
};

/// What came of it, for the user to judge.
struct DiffusionReport {
    glm::ivec3 gridSize{0};
    float cellM = 0.0f;
    int channels = 0; ///< joints that move anything
    std::size_t fixedCells = 0;
    int cycles = 0;                ///< the most that a block of joints needed
    float residual = 0.0f;         ///< the largest of any block
    float maxBodyDistanceM = 0.0f; ///< of any point to the body
    float meanBodyDistanceM = 0.0f;
};

/// Skinning weights at `points` (N) diffused from a body surface: cells near the surface are fixed to the barycentric
/// weights of the closest surface point, Laplace's equation fills the rest, points sample it trilinearly at cell
/// centres; clipped to [0,1], normalised, cut to the 8 largest. Laplace's solution alone would let weights fade from
/// the skin on (by a tenth at 2 cm), so the fixed band reaches as far as cloth hangs, with gaps where the closest skin
/// jumps from one limb to another. Points and body must be in the same pose.
///
/// Joints are solved in blocks of 8, side by side while that takes less than 1 GiB, so memory is about 30 floats per
/// cell and thread, and J floats per point. `progress` is called from the threads that work, one call at a time.
/// @param joints number J of joints that `bodyWeights` may name
/// @return InvalidArgument for sizes that do not fit, points that are not finite and options out of range;
///         LimitExceeded, Cancelled
Result<SkinWeights> diffuseWeights(std::span<const glm::vec3> bodyVertices, std::span<const glm::uvec3> bodyTriangles,
                                   const SkinWeights& bodyWeights, int joints, std::span<const glm::vec3> points,
                                   const DiffusionOptions& options = {}, const ProgressFunction& progress = {},
                                   DiffusionReport* report = nullptr, const ReadLimits& limits = defaultReadLimits());

} // namespace ars
