#pragma once

#include "engine/core/error.h"

#include <glm/glm.hpp>

#include <cstdint>
#include <span>
#include <vector>

namespace ars {

/// Root of the mean squared distance to the `neighbors` nearest other points, metres: what Gaussian splatting starts
/// its scales from (Kerbl et al. 2023). Points at the same place count as neighbours at distance 0; never below
/// kMinNeighborDistanceM. Fewer points than asked for: all others; a single point gets kMinNeighborDistanceM.
/// InvalidArgument for numbers that are not finite, naming the point, and for neighbors < 1.
inline constexpr float kMinNeighborDistanceM = 3.1622776e-4f; // square 1e-7
Result<std::vector<float>> neighborDistances(std::span<const glm::vec3> points, int neighbors = 3);

/// Indices (N, neighbors) of the nearest other points, nearest first, equal distances by index; rows are filled up with
/// the point itself where there are not enough. Errors as above.
Result<std::vector<std::uint32_t>> nearestNeighbors(std::span<const glm::vec3> points, int neighbors);

} // namespace ars
