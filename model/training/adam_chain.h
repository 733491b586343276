#pragma once

#include <ATen/core/Tensor.h>

namespace ars {

/// Numbers of one step of Adam: rate and second moment with their bias corrections.
struct AdamCoefficients {
    float beta1, beta2, rate, secondScale;
};

/// Added to the root of the second moment.
inline constexpr double kAdamEpsilon = 1e-8;

namespace chains {

/// Adam's step by LibTorch's operators, for tensors that are not in host memory: m and v take g in, x follows. Without
/// autograd, in place.
void adamStep(at::Tensor x, const at::Tensor& g, at::Tensor m, at::Tensor v, const AdamCoefficients& c);

} // namespace chains
} // namespace ars
