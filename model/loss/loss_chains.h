#pragma once

#include <ATen/core/Tensor.h>

/// Parts of losses as chains of LibTorch's operators, differentiated by LibTorch, for tensors that are not in host
/// memory: what is too large to be brought there, and what is no loss by itself.
namespace ars::chains {

/// Guards LPIPS's division by the length of a pixel's features.
inline constexpr double kLengthGuard = 1e-10;

/// normalsOfRotations().
at::Tensor normalsOfRotations(const at::Tensor& rotations);

/// One layer's term of LPIPS: 1/P sum_p sum_c w_c (f_c / (|f| + e) - g_c / (|g| + e))^2.
/// @param ours, theirs  f and g, (1, C, H, W)
/// @param weights       (C)
at::Tensor featureDistance(const at::Tensor& ours, const at::Tensor& theirs, const at::Tensor& weights);

} // namespace ars::chains
