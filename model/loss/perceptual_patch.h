#pragma once

#include "model/tensors.h"

#include <cstdint>

namespace ars {

/// A square of a picture, pixels; it may reach beyond the picture.
struct PictureSquare {
    std::int64_t x = 0, y = 0, side = 0;

    bool operator==(const PictureSquare&) const = default;
};

/// The square about the person: its side is the longer of the bounding box of `inside` (height, width, 1; above 0.5 is
/// the person), its centre the box's, to a pixel. The square about the whole picture where there is nobody.
PictureSquare personSquare(const at::Tensor& inside);

/// The square of `picture` (height, width, 3) as (size, size, 3): what reaches beyond the picture is `background` (3);
/// bilinear where the side is another (pixel centres at one half). Differentiable in the picture.
at::Tensor perceptualPatch(const at::Tensor& picture, const PictureSquare& square, std::int64_t size,
                           const at::Tensor& background);

} // namespace ars
