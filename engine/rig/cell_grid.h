#pragma once

#include "engine/core/error.h"

#include <glm/glm.hpp>

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

namespace ars {

/// A box of cubic cells with values at the cell centres: cell (i,j,k) covers origin + [i,i+1) x [j,j+1) x [k,k+1) cells
/// and its value stands at origin + (i + 1/2, j + 1/2, k + 1/2) cells. x varies fastest, then y, z; the channels of one
/// cell lie together.
struct CellGrid {
    glm::ivec3 size{0};      ///< cells along x, y, z
    glm::vec3 originM{0.0f}; ///< lower corner of the box, metres
    float cellM = 0.0f;      ///< edge of a cell, metres
    int channels = 0;
    std::vector<float> values;       ///< (z, y, x, channels)
    std::vector<std::uint8_t> fixed; ///< (z, y, x): 1 where the values are given

    std::size_t cellCount() const {
        return static_cast<std::size_t>(size.x) * static_cast<std::size_t>(size.y) * static_cast<std::size_t>(size.z);
    }
    std::size_t cellIndex(int i, int j, int k) const {
        return (static_cast<std::size_t>(k) * static_cast<std::size_t>(size.y) + static_cast<std::size_t>(j)) *
                   static_cast<std::size_t>(size.x) +
               static_cast<std::size_t>(i);
    }
    glm::vec3 centerM(int i, int j, int k) const { return originM + cellM * (glm::vec3(i, j, k) + 0.5f); }
};

/// What a solve did.
struct HarmonicSolve {
    int cycles = 0;        ///< multigrid cycles on the finest level
    float residual = 0.0f; ///< largest |mean of the neighbours - value| over the free cells
};

/// Fills the free cells with the solution of Laplace's equation (7-point stencil, no flow through the box), the fixed
/// ones held. Multigrid V-cycles from a nested start until the residual is below `tolerance` or stops falling.
///
/// `keepGoing`, if given, is called after every cycle; false ends the solve with Cancelled, the grid unchanged.
/// InvalidArgument when sizes do not fit or nothing is fixed. Takes about 20 floats per cell beside the grid.
Result<HarmonicSolve> solveHarmonic(CellGrid& grid, float tolerance = 1e-6f,
                                    const std::function<bool()>& keepGoing = {});

/// Trilinear value of every channel at a point; outside the outermost centres the nearest value counts.
void sampleGrid(const CellGrid& grid, const glm::vec3& pointM, std::span<float> values);

} // namespace ars
