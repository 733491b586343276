#include "model/network/network_layers.h"

#include "model/network/filters.h"

#include <ATen/ATen.h>

#include <cmath>

namespace ars {

at::Tensor scaledWeight(const at::Tensor& weight, std::int64_t first, std::int64_t count) {
    const double scale = 1 / std::sqrt(static_cast<double>(weight.size(1) * weight.size(2) * weight.size(3)));
    const at::Tensor part = count == weight.size(1) ? weight : weight.narrow(1, first, count);
    return (part * scale).contiguous(at::MemoryFormat::ChannelsLast);
}

at::Tensor convolve(const ConvolutionLayer& layer, const at::Tensor& x, int stride, int padding) {
    return at::conv2d(x, scaledWeight(layer.weight, 0, layer.weight.size(1)), {}, stride, padding);
}

at::Tensor modulate(const ModulatedLayer& layer, const at::Tensor& style, bool demodulate, bool transposed) {
    const double scale = 1 / std::sqrt(static_cast<double>(style.numel()));
    const at::Tensor styles = at::mv(layer.styleWeight, style) * scale + layer.styleBias;
    return modulatedWeight(layer.weight, styles, demodulate, transposed);
}

} // namespace ars
