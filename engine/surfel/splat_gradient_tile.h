#pragma once

#include "engine/surfel/splat_pixel_math.h"
#include "engine/surfel/splat_tile.h"

#include <cstdint>

namespace ars::cpu {

/// Floats of one result of a term or of eight features.
inline constexpr int kColumns = 8;

/// The backward pass over tiles, ready to run. As TileJob it needs no other header and has no functions.
struct GradientTileJob {
    SurfelKernel kernel = SurfelKernel::GaussianSurfel;
    DepthMode depthMode = DepthMode::Linear;
    int width = 0, height = 0, tilesX = 0;
    bool depth = false; ///< a gradient of depth or position came

    const ProjectedSurfel<float>* rows = nullptr; ///< by slot
    const float* features = nullptr;              ///< (slots, featureStride)
    int featureStride = 0;                        ///< a multiple of 4
    const std::uint32_t* instances = nullptr;     ///< slots, tile by tile, front to back
    const std::uint64_t* tileStarts = nullptr;    ///< (tiles + 1)

    float attached[kMaxFeatures] = {}; ///< 1 where the gradient of a feature reaches geometry, 0 where not
    int unitOffsets[kMaxFeatureChannels] = {};
    int unitCount = 0; ///< channels brought to unit length, their first features

    /// What comes out, (instances, columns): moments about the tile's centre of each term (in eights, the last two
    /// empty), then sums of w dL/dSum of the features.
    float* sums = nullptr;

    int terms = 0;          ///< terms of falloff and depth
    int featureColumns = 0; ///< featureStride filled up to eights
    int columns = 0;        ///< floats of an instance's sums: kColumns terms + featureColumns
    int pixelStride = 0;    ///< floats of a pixel's gradients: features (featureColumns), depth, opacity
};

/// One tile with its memory.
struct GradientTile {
    std::uint32_t tile = 0;
    /// (16 sub-tiles, 16 pixels, pixelStride): dL/d of the pixels' sums; unit channels not yet divided by |sum|.
    float* pixels = nullptr;
    // For as many instances as the fullest tile has.
    ProjectedSurfel<float>* rows = nullptr;
    std::uint32_t* lists = nullptr; ///< (16, instances)
    std::uint32_t* kept = nullptr;  ///< (instances)
    float* weights = nullptr;       ///< (instances, 16); aligned to 64 bytes
    float* after = nullptr;         ///< (instances, 16); aligned to 64 bytes
    float* terms = nullptr;         ///< (terms, instances, 16); aligned to 64 bytes
    std::uint64_t capacity = 0;     ///< instances that the memory is for
};

using GradientTileFunction = void (*)(const GradientTileJob& job, const GradientTile& tile);

GradientTileFunction portableGradientTile();
/// Null where this build has no such path.
GradientTileFunction avx2GradientTile();
GradientTileFunction avx512GradientTile();

} // namespace ars::cpu
