#pragma once

#include <cstddef>
#include <cstdint>

namespace ars {

/// How one surfel spreads over the picture.
enum class SurfelKernel {
    GaussianSurfel, ///< affine projection of the disc plus a low-pass of 0.3 px^2 (Dai et al. 2024); one-sided
    RaySplat,       ///< exact meeting of ray and disc with a screen-space low-pass (2DGS, Huang et al. 2024); two-sided
};

/// Depth of a surfel at a pixel, for the Gaussian Surfel kernel. The ray splat's is always exact.
enum class DepthMode {
    Linear, ///< first-order expansion of the disc's plane about its centre (as published)
    Exact,  ///< where the pixel's ray meets the disc's plane
    /// Mean depth of the widened disc at the pixel: the plane's slope where the disc is larger than a pixel, less where
    /// the low-pass made it so. A disc seen almost edge-on then keeps to itself, and outlines stay where they are.
    Filtered,
};

/// What became of a surfel.
enum class SurfelFate : std::uint8_t {
    Visible,        ///< reaches a pixel of the picture
    NotFinite,      ///< a number of it, or of its projection in float, is not finite
    Degenerate,     ///< a scale <= 0, or a quaternion without length
    Transparent,    ///< opacity below 1/255
    TooNear,        ///< less than 0.01 m before the camera, or behind it
    BackFacing,     ///< seen from behind (Gaussian Surfel kernel)
    Grazing,        ///< seen edge-on, within about half a degree
    OutsidePicture, ///< its footprint misses every pixel centre of the picture
};
inline constexpr std::size_t kSurfelFateCount = 8;

/// Side of the square tiles in which surfels are sorted, and of the sub-tiles in which they are blended, pixels.
inline constexpr int kTileSide = 16;
inline constexpr int kSubtileSide = 4;

} // namespace ars
