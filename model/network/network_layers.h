#pragma once

#include <ATen/core/Tensor.h>

namespace ars {

/// Learned tensors of one layer and the operations on them; only the network's own files include this.

/// Rate of the mapping layers relative to the others ("lr_mul"): weights are stored that much larger.
inline constexpr double kMappingRate = 0.01;

/// Equalised convolution: effective weight W / sqrt(in k k); the bias belongs to the activation after it. Mapping
/// layers (out, in) use the same struct.
struct ConvolutionLayer {
    at::Tensor weight; ///< (out, in, k, k)
    at::Tensor bias;   ///< (out), or undefined
};

/// Weight and what makes its styles: s = modulation W / sqrt(styleSize) style + bias.
struct ModulatedLayer {
    at::Tensor weight;      ///< (1, out, in, k, k)
    at::Tensor styleWeight; ///< (in, styleSize)
    at::Tensor styleBias;   ///< (in)
};

struct StyledLayer {
    ModulatedLayer modulated;
    at::Tensor strength; ///< (1) of the noise
    at::Tensor bias;     ///< (out)
};

/// ToRGB: a modulated 1x1 convolution to subbands, not demodulated.
struct ColorLayer {
    ModulatedLayer modulated;
    at::Tensor bias; ///< (1, 4 C, 1, 1)
};

/// Effective weight of `count` inputs from `first`, channels last; equalised by all inputs of the layer.
at::Tensor scaledWeight(const at::Tensor& weight, std::int64_t first, std::int64_t count);
at::Tensor convolve(const ConvolutionLayer& layer, const at::Tensor& x, int stride, int padding);
/// Effective weight under a style vector (styleSize).
at::Tensor modulate(const ModulatedLayer& layer, const at::Tensor& style, bool demodulate, bool transposed);

} // namespace ars
