#pragma once

#include "model/network/filters.h"

/// The functions of filters.h as chains of LibTorch's operators, differentiated by LibTorch: slower on the host, but
/// they run wherever the tensors lie. filters.h takes them for tensors that are not in host memory.
namespace ars::chains {

/// gain blur(x); blur()'s gain is 1.
at::Tensor blur(const at::Tensor& x, int before, int after, double gain);
at::Tensor activate(const at::Tensor& x, const ActivationTerms& terms);
at::Tensor blurActivate(const at::Tensor& x, const ActivationTerms& terms);
at::Tensor addSubbands(const at::Tensor& subbands, const at::Tensor& previous);
at::Tensor modulatedWeight(const at::Tensor& weight, const at::Tensor& style, bool demodulate, bool transposed);
at::Tensor gatherSides(const at::Tensor& front, const at::Tensor& back, const at::Tensor& pixels);

} // namespace ars::chains
