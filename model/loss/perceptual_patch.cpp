#include "model/loss/perceptual_patch.h"

#include <ATen/ATen.h>

#include <algorithm>
#include <array>

namespace ars {
namespace {

/// First and one past the last index of the pixels that are set along an axis.
std::array<std::int64_t, 2> extent(const at::Tensor& set, std::int64_t axis) {
    const at::Tensor places = set.any(1 - axis).nonzero().squeeze(1);
    if (places.numel() == 0) return {0, set.size(axis)};
    return {places[0].item<std::int64_t>(), places[-1].item<std::int64_t>() + 1};
}

} // namespace

PictureSquare personSquare(const at::Tensor& inside) {
    const at::Tensor set = inside.squeeze(2) > 0.5;
    const auto [top, bottom] = extent(set, 0);
    const auto [left, right] = extent(set, 1);
    const std::int64_t side = std::max(bottom - top, right - left);
    return {(left + right - side) / 2, (top + bottom - side) / 2, side};
}

at::Tensor perceptualPatch(const at::Tensor& picture, const PictureSquare& square, std::int64_t size,
                           const at::Tensor& background) {
    const std::int64_t height = picture.size(0), width = picture.size(1);
    // Relative to the background, so that what is added around is 0. Negative padding cuts.
    const std::array<std::int64_t, 6> padding{
        0, 0, -square.x, square.x + square.side - width, -square.y, square.y + square.side - height};
    at::Tensor patch = at::constant_pad_nd(picture - background, padding, 0.0) + background;
    if (square.side == size) return patch;
    patch = at::upsample_bilinear2d(patch.permute({2, 0, 1}).unsqueeze(0), at::IntArrayRef{size, size}, false);
    return patch.squeeze(0).permute({1, 2, 0});
}

} // namespace ars
