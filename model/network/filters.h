#pragma once

#include <ATen/core/Tensor.h>

namespace ars {

/// The parts of a StyleUNet that are no convolution with learned weights, as functions of autograd
/// (docs/math/network.md). All work on (1, C, H, W), float or double, and give channels-last tensors; inputs in another
/// layout are copied. In host memory each makes one pass where a chain of library operators would make five to ten, and
/// the same numbers come out whatever the number of threads; on other devices that chain is taken (filter_chains.h).

/// Blurs by outer([1, 3, 3, 1]) / 64 after putting `before` zeros above and left and `after` below and right: side
/// H + before + after - 3.
at::Tensor blur(const at::Tensor& x, int before, int after);

/// Halves the size: blur with one zero around, every second pixel.
at::Tensor blurDownsample(const at::Tensor& x);

/// What is added before the leaky ReLU; undefined ones are left out.
struct ActivationTerms {
    at::Tensor bias{};     ///< (C)
    at::Tensor noise{};    ///< (1, 1, H, W), carries no gradient
    at::Tensor strength{}; ///< (1), of the noise
    at::Tensor other{};    ///< (1, C, H, W): the other half of a split convolution
};

/// sqrt(2) leakyRelu(x + other + strength noise + bias), slope 0.2.
at::Tensor activate(const at::Tensor& x, const ActivationTerms& terms);

/// The same of 4 blur(x) with one zero around: what follows a transposed convolution; (2 h + 1)^2 becomes (2 h)^2.
at::Tensor blurActivate(const at::Tensor& x, const ActivationTerms& terms);

/// For networks that do not train: leakyRelu(x + other + noise + bias) whose gain is in weights and terms already,
/// without autograd, into x's own memory unless `blurred` (4 blur(x) first). x and other are channels last, float or
/// bfloat16; bias and noise float, strength unused.
at::Tensor activateFolded(const at::Tensor& x, const ActivationTerms& terms, bool blurred);

/// Inverse Haar transform of subbands (1, 4 C, H, W), plus `previous` (1, C, H, W) at twice its size where it is
/// defined: (1, C, 2 H, 2 W). Subbands lie as LL of all channels, then LH, HL, HH.
at::Tensor addSubbands(const at::Tensor& subbands, const at::Tensor& previous);

/// Weights of a modulated convolution (avatar reference 1.5): w' = W s / sqrt(in k k) along the inputs; with
/// `demodulate` each output's filter has unit norm. W (1, out, in, k, k), s (in); gives (out, in, k, k), with
/// `transposed` (in, out, k, k).
at::Tensor modulatedWeight(const at::Tensor& weight, const at::Tensor& style, bool demodulate, bool transposed);

/// Rows of two pictures (1, C, H, W) beside one another, (P, C): pixel row 2 W + column, front on the left.
at::Tensor gatherSides(const at::Tensor& front, const at::Tensor& back, const at::Tensor& pixels);

} // namespace ars
