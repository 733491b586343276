#pragma once

#include "engine/core/error.h"
#include "engine/core/limits.h"
#include "engine/core/progress.h"

#include <filesystem>
#include <span>
#include <vector>

namespace ars {

/// Principal components of the position maps of the training poses (avatar reference 3). Poses that lie far from them
/// are drawn towards them before a network sees them.
struct PosePca {
    std::vector<float> mean;       ///< (D)
    std::vector<float> components; ///< (K, D) row-major, orthonormal rows
    std::vector<float> deviations; ///< (K) standard deviations over the poses (n - 1), falling
    int poses = 0;                 ///< n, of the fit
    float trainingDistance = 0.0f; ///< largest distance (see PcaProjection) of a training pose

    std::size_t dimension() const { return mean.size(); }
    int componentCount() const { return static_cast<int>(deviations.size()); }
};

/// Exact PCA of n samples of D numbers by the n x n Gram matrix. At most min(components, n - 1) components; those that
/// explain nothing are left out.
///
/// @param samples n rows, each a pose's values; they are read in place and must all have D numbers
/// @return InvalidArgument for no rows, rows of different length, numbers that are not finite, components < 1
Result<PosePca> fitPosePca(std::span<const std::vector<float>> samples, int components = 20,
                           const ProgressFunction& progress = {});

/// How a pose lies among the training poses.
struct PcaProjection {
    std::vector<float> coefficients; ///< (K) after the clamp
    float largestDeviation = 0.0f;   ///< largest |c_k| / sigma_k before the clamp
    int clamped = 0;                 ///< components that were clamped
    float distance = 0.0f;           ///< root mean square of (values - projection) x sqrt(3): per point, metres
    /// How far outside the training poses: distance beyond the largest of a training pose, metres; 0 within.
    float outOfRange = 0.0f;
};

/// Replaces `values` (D) by its projection: coefficients clamped to +- `sigmas` standard deviations.
/// InvalidArgument when the sizes differ or sigmas is not positive.
Result<PcaProjection> projectPose(const PosePca& pca, std::span<float> values, float sigmas = 2.0f);

/// pca.safetensors of an avatar. readPosePca: BadFile for missing tensors, shapes that do not fit together and numbers
/// that are not finite or deviations that are not positive.
Status writePosePca(const std::filesystem::path& path, const PosePca& pca);
Result<PosePca> readPosePca(const std::filesystem::path& path, const ReadLimits& limits = defaultReadLimits());

} // namespace ars
