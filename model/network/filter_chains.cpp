#include "model/network/filter_chains.h"

#include "model/network/filter_kernels.h"

#include <ATen/ATen.h>

#include <cmath>
#include <vector>

// What a filter does stands in filter_kernels.h; constants are its own.
namespace ars::chains {
namespace {

constexpr auto kLast = at::MemoryFormat::ChannelsLast;

/// `count` rows (axis 2) or columns (axis 3) from `first` on.
at::Tensor part(const at::Tensor& x, std::int64_t axis, std::int64_t first, std::int64_t count) {
    return x.slice(axis, first, first + count);
}

/// outer (x0 + x3) + inner (x1 + x2) along an axis.
at::Tensor fourTaps(const at::Tensor& x, std::int64_t axis, double outer, double inner) {
    const std::int64_t count = x.size(axis) - 3;
    return (part(x, axis, 0, count) + part(x, axis, 3, count)) * outer +
           (part(x, axis, 1, count) + part(x, axis, 2, count)) * inner;
}

/// a b a b ... along an axis: (..., n, ...) twice to (..., 2 n, ...).
at::Tensor interleaved(const at::Tensor& a, const at::Tensor& b, std::int64_t axis) {
    return at::stack({a, b}, axis + 1).flatten(axis, axis + 1);
}

/// Doubles an axis of a picture: zeros between and [1, 3, 3, 1] / 4.
at::Tensor doubled(const at::Tensor& x, std::int64_t axis) {
    const std::vector<std::int64_t> padding =
        axis == 3 ? std::vector<std::int64_t>{1, 1} : std::vector<std::int64_t>{0, 0, 1, 1};
    const at::Tensor padded = at::constant_pad_nd(x, padding);
    const std::int64_t count = x.size(axis);
    const at::Tensor middle = x * 0.75;
    return interleaved(middle + part(padded, axis, 0, count) * 0.25, middle + part(padded, axis, 2, count) * 0.25,
                       axis);
}

} // namespace

at::Tensor blur(const at::Tensor& x, int before, int after, double gain) {
    TORCH_CHECK(x.dim() == 4 && x.size(0) == 1, "blur: expected (1, C, H, W), found ", x.sizes());
    const std::int64_t b = before, a = after;
    const at::Tensor padded = at::constant_pad_nd(x, {b, a, b, a});
    return fourTaps(fourTaps(padded, 2, gain / 64, gain * 3 / 64), 3, 1, 3).contiguous(kLast);
}

at::Tensor activate(const at::Tensor& x, const ActivationTerms& terms) {
    at::Tensor shift = terms.bias.reshape({1, -1, 1, 1});
    if (terms.noise.defined()) {
        shift = shift + (terms.strength.defined() ? terms.strength * terms.noise : terms.noise);
    }
    at::Tensor sum = x + shift;
    if (terms.other.defined()) sum = sum + terms.other;
    return (at::leaky_relu(sum, kernels::kSlope) * kernels::kGain).contiguous(kLast);
}

at::Tensor blurActivate(const at::Tensor& x, const ActivationTerms& terms) {
    return chains::activate(chains::blur(x, 1, 1, 4), terms);
}

at::Tensor addSubbands(const at::Tensor& subbands, const at::Tensor& previous) {
    TORCH_CHECK(subbands.dim() == 4 && subbands.size(0) == 1 && subbands.size(1) % 4 == 0,
                "subbands: expected (1, 4 C, H, W), found ", subbands.sizes());
    const std::vector<at::Tensor> bands = subbands.chunk(4, 1);
    const at::Tensor sum = bands[0] + bands[1], difference = bands[0] - bands[1];
    const at::Tensor sums = bands[2] + bands[3], differences = bands[2] - bands[3];
    const at::Tensor upper = interleaved(sum + sums, sum - sums, 3) * 0.5;
    const at::Tensor lower = interleaved(difference + differences, difference - differences, 3) * 0.5;
    at::Tensor image = interleaved(upper, lower, 2);
    if (previous.defined()) {
        TORCH_CHECK(2 * previous.size(2) == image.size(2) && 2 * previous.size(3) == image.size(3),
                    "subbands: the image before is of another size");
        image = image + doubled(doubled(previous, 2), 3);
    }
    return image.contiguous(kLast);
}

at::Tensor modulatedWeight(const at::Tensor& weight, const at::Tensor& style, bool demodulate, bool transposed) {
    TORCH_CHECK(weight.dim() == 5 && weight.size(0) == 1 && style.numel() == weight.size(2),
                "modulation: ", weight.sizes(), " with ", style.numel(), " styles");
    const double scale = 1 / std::sqrt(static_cast<double>(weight.size(2) * weight.size(3) * weight.size(4)));
    at::Tensor result = weight.squeeze(0) * (style.reshape({1, -1, 1, 1}) * scale);
    if (demodulate) result = result * (result.square().sum({1, 2, 3}, true) + 1e-8).rsqrt();
    return transposed ? result.transpose(0, 1).contiguous() : result.contiguous(kLast);
}

at::Tensor gatherSides(const at::Tensor& front, const at::Tensor& back, const at::Tensor& pixels) {
    TORCH_CHECK(front.sizes() == back.sizes() && front.size(0) == 1, "gather: sides of different sizes");
    const at::Tensor both = at::cat({front, back}, 3);
    return both.permute({0, 2, 3, 1}).reshape({-1, both.size(1)}).index({pixels});
}

} // namespace ars::chains
