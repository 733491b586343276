#pragma once

#include "engine/surfel/splat_kernels.h"

#include <cstdint>

namespace ars::cpu {

/// A frame before it is blended; pointers into the workspace.
struct TileLists {
    const ProjectedSurfel<float>* rows = nullptr; ///< by slot; slots are less than the number of surfels
    const float* features = nullptr;              ///< (slots, stride)
    const std::uint32_t* surfelOfSlot = nullptr;
    const std::uint32_t* instances = nullptr;  ///< slots, tile by tile, front to back
    const std::uint64_t* tileStarts = nullptr; ///< (tiles + 1)
};

/// The surfels of each tile, as splat() lists them; needs no pictures.
/// @param alsoFinite  attributes that are not blended but leave a surfel out all the same where they are not finite
Result<TileLists> listTiles(const SplatArguments& arguments, const FeatureLayout& alsoFinite);

} // namespace ars::cpu
