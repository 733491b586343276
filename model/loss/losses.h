#pragma once

#include "engine/core/camera.h"
#include "engine/core/error.h"
#include "model/operators/surfel_operators.h"
#include "model/tensors.h"

#include <glm/glm.hpp>

#include <span>
#include <vector>

/// The terms of the paper's loss (supplement, Detailed Training Losses; docs/math/losses.md). Every function gives a
/// scalar float tensor that autograd differentiates; pictures are (height, width, channels), weights are the caller's.
namespace ars {

/// Mean |a - b| over the pixels where `mask` (height, width, 1) is 1, or over all when undefined; channels averaged.
at::Tensor l1Loss(const at::Tensor& picture, const at::Tensor& target, const at::Tensor& mask = {});

/// L_reg: mean over surfels of |offset|^2 (paper), or of |offset| (Animatable Gaussians); metres. (P, 3)
at::Tensor offsetLoss(const at::Tensor& offsets, bool squared = true);

/// Unit camera-space normals of the depth picture, facing the camera: four neighbours, area-weighted cross products;
/// zero where the pixel or a neighbour has opacity below kMinOpacity (rendering reference 1.7). Differentiable in
/// depth.
at::Tensor depthNormals(const at::Tensor& depth, const at::Tensor& opacity, const Camera& camera);
/// L_cons: mean of 1 - N . N_D over pixels that have both.
at::Tensor depthNormalLoss(const at::Tensor& normal, const at::Tensor& depth, const at::Tensor& opacity,
                           const Camera& camera);
/// L_curv: mean over foreground pixels of the L1 norm of sum_4 (n_j - n_c) over neighbours in the foreground.
at::Tensor curvatureLoss(const at::Tensor& normal, const at::Tensor& opacity);

/// Canonical neighbours of every surfel whose normals L_nd compares: K nearest, pairs farther than
/// `maxSpacings` times the median nearest distance left out.
struct NeighbourPairs {
    at::Tensor first;    ///< (M) int64
    at::Tensor second;   ///< (M) int64
    at::Tensor farthest; ///< (M) float: distance of the first's farthest of its K neighbours, canonical, metres
};
NeighbourPairs canonicalNeighbours(std::span<const glm::vec3> canonical, int neighbours = 8, float maxSpacings = 3.0f);
/// L_nd over the pairs `chosen` (int64 indices into them; all when undefined):
/// mean of w (1 - |n_i . n_j|), w = exp(-|mu_i - mu_j|^2 / sigma_i^2) detached, sigma_i the canonical distance
/// from the pair's first to its farthest neighbour (NeighbourPairs::farthest).
/// @param normals (N, 3) posed surfel normals: third axis of the posed rotations
at::Tensor normalDeformationLoss(const NeighbourPairs& pairs, const at::Tensor& means, const at::Tensor& normals,
                                 const at::Tensor& chosen = {});
/// Third axis of unit quaternions (N, 4) -> (N, 3).
at::Tensor normalsOfRotations(const at::Tensor& rotations);

/// Mean absolute difference of horizontal and vertical neighbours that both lie in the foreground (opacity above 0.5).
at::Tensor totalVariation(const at::Tensor& picture, const at::Tensor& opacity);
/// Of a cube (6, side, side, 3), within faces.
at::Tensor lightTotalVariation(const at::Tensor& texels);
/// L_light: mean over texels of (1/3) sum_i |l_i - mean(l)|.
at::Tensor whiteLightLoss(const at::Tensor& texels);

/// w_cons at a share of the training: start + (end - start) min(2 t, 1).
double consistencyWeight(double start, double end, double progress);

} // namespace ars
