#pragma once

#include "engine/core/buffer.h"
#include "engine/core/error.h"
#include "engine/io/array.h"

#include <glm/glm.hpp>

#include <cstdint>
#include <span>
#include <vector>

namespace ars {

/// Influences a point at most has; more in a file are cut to the largest and renormalised.
inline constexpr int kMaxInfluences = 8;

/// Sparse skinning weights of N points: kMaxInfluences joints each, largest first, weights sum to 1, unused ones 0.
struct SkinWeights {
    std::vector<std::uint16_t> joints; ///< (N, 8)
    std::vector<float> weights;        ///< (N, 8)

    std::size_t pointCount() const { return weights.size() / kMaxInfluences; }
};

/// From a dense (N, J) row-major matrix. Rows are clipped at 0, cut to the 8 largest and normalised; BadFile (row, sum)
/// for a row without positive weight or with a number that is not finite.
Result<SkinWeights> sparseWeights(std::span<const float> dense, std::size_t points, std::size_t joints);

/// Back to a dense (N, J) matrix.
std::vector<float> denseWeights(const SkinWeights& weights, std::size_t joints);

/// Linear blend skinning: x = sum_j w_j A_j [x_rest; 1] (avatar reference 5.5).
///
/// @param matrices  A_j, joint matrices, rest model space to posed world space
/// @param restPoints (N) metres
/// @param points    receives (N); may alias restPoints
/// @return InvalidArgument when sizes differ or a joint index is out of range
Status skinPoints(std::span<const glm::mat4> matrices, const SkinWeights& weights,
                  std::span<const glm::vec3> restPoints, std::span<glm::vec3> points);

/// The same plus normals, turned by the orthonormalised (polar) rotation of the blended matrix, so that they stay unit
/// length and are not sheared.
Status skinPointsAndNormals(std::span<const glm::mat4> matrices, const SkinWeights& weights,
                            std::span<const glm::vec3> restPoints, std::span<const glm::vec3> restNormals,
                            std::span<glm::vec3> points, std::span<glm::vec3> normals);

/// The blended, orthonormalised rotation of each point (w,x,y,z), which turns surfels.
Status skinRotations(std::span<const glm::mat4> matrices, const SkinWeights& weights, std::span<glm::quat> rotations);

/// Device twin of skinPointsAndNormals over Buffers that all lie on one device: matrices (J) mat4, joints (N,8) u16,
/// weights (N,8) f32, points/normals (N) vec3 tightly packed. `restNormals` and `normals` may both be null.
Status skinOnDevice(const Buffer& matrices, const Buffer& joints, const Buffer& weights, const Buffer& restPoints,
                    const Buffer* restNormals, Buffer& points, Buffer* normals, std::size_t pointCount);

} // namespace ars
