#pragma once

#include "engine/surfel/splat_pixel_math.h"

#include <cstdint>

namespace ars::cpu {

/// Floats of one surfel that are blended besides depth, at most: N, C, A, roughness, R, R+, R-, I, Q. A multiple of 4.
inline constexpr int kMaxFeatures = 20;
inline constexpr int kMaxFeatureChannels = 9;

/// Where one blended channel goes.
struct FeatureOutput {
    float* data = nullptr; ///< picture of `width` floats a pixel
    int width = 0;         ///< 1 or 3
    int offset = 0;        ///< first of its floats in a surfel's features
    bool unit = false;     ///< brought to unit length instead of divided by opacity
};

/// A frame ready to be blended: everything sorted, pointers into the workspace and the pictures. No type of it needs
/// another header, so that the files compiled per instruction set share no inline functions.
struct TileJob {
    SurfelKernel kernel = SurfelKernel::GaussianSurfel;
    DepthMode depthMode = DepthMode::Linear;
    int width = 0, height = 0, tilesX = 0;

    const ProjectedSurfel<float>* rows = nullptr; ///< by slot
    const float* features = nullptr;              ///< (slots, featureStride)
    const std::uint32_t* surfelOfSlot = nullptr;
    int featureStride = 0;                     ///< floats blended; a multiple of 4, the last ones may be padding
    const std::uint32_t* instances = nullptr;  ///< slots, tile by tile, front to back
    const std::uint64_t* tileStarts = nullptr; ///< (tiles + 1)

    float* opacity = nullptr;
    float* depth = nullptr;
    float* position = nullptr;
    float pointOrigin[3] = {}, pointPerX[3] = {}, pointPerY[3] = {},
          pointAtZero[3] = {}; ///< world = origin + depth ray
    FeatureOutput outputs[kMaxFeatureChannels];
    int outputCount = 0;

    std::uint64_t* blended = nullptr;    ///< (tiles) pairs of a surfel and a pixel
    std::uint64_t* foreground = nullptr; ///< (tiles) pixels

    std::uint64_t* contributorCounts = nullptr;       ///< (pixels), optional
    const std::uint64_t* contributorStarts = nullptr; ///< (pixels): where to write the lists
    std::uint32_t* contributorSurfels = nullptr;
    float* contributorWeights = nullptr;
};

/// blend: all pictures of tiles [begin, end), with counts of contributors where they are asked for.
/// list: writes the contributors of these tiles and nothing else.
struct TileFunctions {
    void (*blend)(const TileJob& job, std::uint32_t begin, std::uint32_t end) = nullptr;
    void (*list)(const TileJob& job, std::uint32_t begin, std::uint32_t end) = nullptr;
};

TileFunctions portableTileFunctions();
/// Empty where this build has no such path. Whether the processor has it is for the caller to ask.
TileFunctions avx2TileFunctions();
TileFunctions avx512TileFunctions();

} // namespace ars::cpu
