#pragma once

#include "engine/core/buffer.h"
#include "engine/core/camera.h"
#include "engine/core/error.h"
#include "engine/surfel/gbuffer.h"
#include "engine/surfel/splat.h"
#include "engine/surfel/splat_math.h"
#include "engine/surfel/splat_tile.h"
#include "engine/surfel/surfels.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>

namespace ars {

/// One blended channel: where its floats come from and where among a surfel's features they go.
struct FeatureSource {
    const float* data = nullptr; ///< (surfels, width), or null for the normal, which the projection gives
    int width = 0;
    int offset = 0;
    bool turned = false; ///< brought from world to camera space
    bool unit = false;   ///< the blended value is brought to unit length
    Channel channel = Channel::Opacity;
};

/// What is blended besides depth, in the order in which it lies in memory.
struct FeatureLayout {
    FeatureSource sources[cpu::kMaxFeatureChannels];
    int count = 0;  ///< sources
    int floats = 0; ///< of one surfel
    int stride = 0; ///< floats, filled up to a multiple of 4
};

/// The layout of the channels that blend an attribute. Pointers are those of the surfels' device.
FeatureLayout featureLayout(const SurfelView& surfels, const ChannelSet& channels);

/// A surfel's features in memory order, zeros behind.
/// @return false when one of them is not finite
ARS_HD inline bool packFeatures(const FeatureLayout& layout, std::size_t surfel, const glm::vec3& normalCamera,
                                const glm::mat3& rotation, float* features) {
    float finite = 0.0f;
    for (int i = 0; i < layout.count; ++i) {
        const FeatureSource& source = layout.sources[i];
        float* to = features + source.offset;
        if (source.width == 1) {
            to[0] = source.data[surfel];
            finite += 0.0f * to[0];
            continue;
        }
        glm::vec3 value = normalCamera;
        if (source.data) {
            const float* from = source.data + 3 * surfel;
            value = {from[0], from[1], from[2]};
            if (source.turned) value = rotation * value;
        }
        to[0] = value.x;
        to[1] = value.y;
        to[2] = value.z;
        finite += 0.0f * value.x + 0.0f * value.y + 0.0f * value.z;
    }
    for (int c = layout.floats; c < layout.stride; ++c) features[c] = 0.0f;
    return isFiniteNumber(finite);
}

/// Tiles that a surfel may reach, both ends included. A side has at most 2,048.
struct TileRect {
    std::uint16_t x0 = 0, y0 = 0, x1 = 0, y1 = 0;
};

ARS_HD inline TileRect tilesOf(const PixelRect& rect) {
    return {static_cast<std::uint16_t>(rect.x0 / kTileSide), static_cast<std::uint16_t>(rect.y0 / kTileSide),
            static_cast<std::uint16_t>(rect.x1 / kTileSide), static_cast<std::uint16_t>(rect.y1 / kTileSide)};
}

/// Whether a surfel reaches tile (x, y).
template <SurfelKernel Kernel>
ARS_HD inline bool reachesTile(const ProjectedSurfel<float>& surfel, int x, int y) {
    const float left = static_cast<float>(x * kTileSide) + 0.5f, top = static_cast<float>(y * kTileSide) + 0.5f;
    const float side = static_cast<float>(kTileSide - 1);
    return reachesRect<Kernel>(surfel, left, top, left + side, top + side);
}

/// World position = origin + depth (perX x + perY y + atZero) for the image position (x, y).
struct PointMap {
    glm::vec3 origin{}, perX{}, perY{}, atZero{};
};
PointMap pointMap(const Camera& camera);

/// What both devices are given, checked; the pictures have their memory.
struct SplatArguments {
    SplatParams params;
    SurfelView surfels;
    SplatView<float> view;
    PointMap points;
    FeatureLayout features;
    GBuffer* gbuffer = nullptr;
    SplatWorkspace::Memory* memory = nullptr;
    ContributorLists* contributors = nullptr;
    SplatStats* stats = nullptr;

    int tilesX() const { return (view.camera.width + kTileSide - 1) / kTileSide; }
    int tilesY() const { return (view.camera.height + kTileSide - 1) / kTileSide; }
    std::size_t tileCount() const { return static_cast<std::size_t>(tilesX()) * static_cast<std::size_t>(tilesY()); }
};

/// Makes a buffer of at least `bytes` on `device`; keeps it where it is large enough already.
Status growBuffer(Buffer& buffer, const Device& device, std::size_t bytes, std::string_view owner);

/// Things of the CUDA path that are no Buffer; defined in splat_cuda.cu.
struct CudaSplatState;
struct CudaSplatStateDelete {
    void operator()(CudaSplatState* state) const;
};

struct SplatWorkspace::Memory {
    CpuPath path = CpuPath::Best;
    // By slot: visible surfels in the order of their indices, on the host with gaps between blocks.
    Buffer rows, features, rects, surfelOfSlot;
    // Depth order: host (key << 32 | slot) twice; CUDA keys and slots twice.
    Buffer order, orderScratch, slots, slotsScratch;
    Buffer blocks;         ///< host: per block of surfels; CUDA: counters of the frame
    Buffer histograms;     ///< host: of sorting and of binning
    Buffer tilesPerSurfel; ///< CUDA: tiles of each surfel, in depth order
    Buffer tileStarts, instances, tileKeys, instancesScratch, tileKeysScratch, sortScratch;
    Buffer tileCounts; ///< blended pairs and foreground pixels of each tile
    Buffer contributorCounts;
    std::unique_ptr<CudaSplatState, CudaSplatStateDelete> cuda;
};

namespace cpu {
Status splat(const SplatArguments& arguments);
TileFunctions tileFunctionsOf(CpuPath path);
} // namespace cpu

namespace cuda {
/// Queued on the default stream of the surfels' device; waits only for statistics or contributors.
Status splat(const SplatArguments& arguments);
bool lastFrameIncomplete(const CudaSplatState& state);
} // namespace cuda

} // namespace ars
