#include "engine/core/parallel.h"
#include "engine/surfel/splat_cpu_lists.h"
#include "engine/surfel/splat_kernels.h"

#include <algorithm>
#include <bit>
#include <cstring>

namespace ars::cpu {
namespace {

constexpr std::size_t kBlock = 1024; ///< surfels projected by one thread at a time
constexpr unsigned kDigitBits = 11;
constexpr std::size_t kDigits = 1u << kDigitBits;
constexpr int kMaskSide = 8; ///< rectangles of up to 8x8 tiles remember which of them are reached

/// Tiles of a surfel, together because both are read at once and in a random order.
struct TileReach {
    TileRect rect;
    std::uint64_t mask; ///< of rectangles of up to 8x8 tiles: which are reached, row by row in steps of kMaskSide bits
};

struct BlockResult {
    std::uint64_t fates[kSurfelFateCount];
    std::uint32_t minKey, maxKey;
};

/// Typed pointers into the workspace.
struct Frame {
    ProjectedSurfel<float>* rows;
    float* features;
    TileReach* reach;
    std::uint32_t* surfelOfSlot;
    std::uint64_t* order;
    std::uint64_t* orderScratch;
    BlockResult* blocks;
    std::size_t blockCount;
    std::size_t visible = 0;
    const FeatureLayout* alsoFinite = nullptr; ///< attributes that are not blended but must be finite as well
};

template <typename T>
T* pointer(Buffer& buffer) {
    return static_cast<T*>(buffer.data());
}

Result<Frame> prepareFrame(const SplatArguments& a) {
    SplatWorkspace::Memory& m = *a.memory;
    const Device host;
    const std::size_t n = a.surfels.count, blockCount = (n + kBlock - 1) / kBlock;
    ARS_TRY_STATUS(growBuffer(m.rows, host, n * sizeof(ProjectedSurfel<float>), "splat: projected surfels"));
    ARS_TRY_STATUS(growBuffer(m.features, host, n * static_cast<std::size_t>(a.features.stride) * sizeof(float),
                              "splat: surfel features"));
    ARS_TRY_STATUS(growBuffer(m.rects, host, n * sizeof(TileReach), "splat: tile rectangles"));
    ARS_TRY_STATUS(growBuffer(m.surfelOfSlot, host, n * sizeof(std::uint32_t), "splat: surfel indices"));
    ARS_TRY_STATUS(growBuffer(m.order, host, n * sizeof(std::uint64_t), "splat: depth order"));
    ARS_TRY_STATUS(growBuffer(m.orderScratch, host, n * sizeof(std::uint64_t), "splat: depth order"));
    ARS_TRY_STATUS(growBuffer(m.blocks, host, blockCount * sizeof(BlockResult), "splat: counts"));
    return Frame{pointer<ProjectedSurfel<float>>(m.rows),
                 pointer<float>(m.features),
                 pointer<TileReach>(m.rects),
                 pointer<std::uint32_t>(m.surfelOfSlot),
                 pointer<std::uint64_t>(m.order),
                 pointer<std::uint64_t>(m.orderScratch),
                 pointer<BlockResult>(m.blocks),
                 blockCount};
}

/// Whether the attributes of a layout are finite; those without data are not asked.
bool attributesAreFinite(const FeatureLayout& layout, std::size_t surfel) {
    float finite = 0.0f;
    for (int i = 0; i < layout.count; ++i) {
        const FeatureSource& source = layout.sources[i];
        if (!source.data) continue;
        const auto width = static_cast<std::size_t>(source.width);
        for (std::size_t c = surfel * width; c < (surfel + 1) * width; ++c) finite += 0.0f * source.data[c];
    }
    return isFiniteNumber(finite);
}

bool fitsMask(const TileRect& rect) { return rect.x1 - rect.x0 < kMaskSide && rect.y1 - rect.y0 < kMaskSide; }

template <SurfelKernel Kernel>
std::uint64_t tileMask(const ProjectedSurfel<float>& row, const TileRect& rect) {
    if (rect.x0 == rect.x1 && rect.y0 == rect.y1) return 1;
    if (!fitsMask(rect)) return 0;
    std::uint64_t mask = 0;
    for (int y = rect.y0; y <= rect.y1; ++y) {
        for (int x = rect.x0; x <= rect.x1; ++x) {
            const bool reached = reachesTile<Kernel>(row, x, y);
            mask |= static_cast<std::uint64_t>(reached) << ((y - rect.y0) * kMaskSide + (x - rect.x0));
        }
    }
    return mask;
}

/// Projects surfels [begin, end); the visible ones fill slots from `begin` on.
void projectBlock(const SplatArguments& a, const Frame& frame, std::size_t begin, std::size_t end) {
    BlockResult result{{}, 0xffffffffu, 0};
    const auto stride = static_cast<std::size_t>(a.features.stride);
    const glm::mat3 rotation = a.view.camera.rotation;
    std::size_t slot = begin;
    for (std::size_t i = begin; i < end; ++i) {
        ProjectedSurfel<float> row;
        glm::vec3 normal;
        PixelRect rect;
        SurfelFate fate = projectSurfel(a.view, a.surfels.means[i], a.surfels.rotations + 4 * i, a.surfels.scales[i],
                                        a.surfels.opacities[i], row, normal, rect);
        if (fate == SurfelFate::Visible &&
            !packFeatures(a.features, i, normal, rotation, frame.features + slot * stride)) {
            fate = SurfelFate::NotFinite;
        }
        if (fate == SurfelFate::Visible && frame.alsoFinite && !attributesAreFinite(*frame.alsoFinite, i)) {
            fate = SurfelFate::NotFinite;
        }
        ++result.fates[static_cast<std::size_t>(fate)];
        if (fate != SurfelFate::Visible) continue;
        const std::uint32_t key = std::bit_cast<std::uint32_t>(row.depth); // positive floats order as their bits do
        result.minKey = std::min(result.minKey, key);
        result.maxKey = std::max(result.maxKey, key);
        frame.rows[slot] = row;
        const TileRect tiles = tilesOf(rect);
        frame.reach[slot] = {tiles, a.params.kernel == SurfelKernel::RaySplat
                                        ? tileMask<SurfelKernel::RaySplat>(row, tiles)
                                        : tileMask<SurfelKernel::GaussianSurfel>(row, tiles)};
        frame.surfelOfSlot[slot] = static_cast<std::uint32_t>(i);
        frame.orderScratch[slot] = static_cast<std::uint64_t>(key) << 32 | slot;
        ++slot;
    }
    frame.blocks[begin / kBlock] = result;
}

void project(const SplatArguments& a, Frame& frame) {
    const std::size_t n = a.surfels.count;
    parallelFor(
        frame.blockCount, [&](std::size_t b) { projectBlock(a, frame, b * kBlock, std::min(n, (b + 1) * kBlock)); }, 1);
    // The blocks' lists end to end, in the order of the surfels.
    for (std::size_t b = 0; b < frame.blockCount; ++b) {
        const std::size_t found = frame.blocks[b].fates[static_cast<std::size_t>(SurfelFate::Visible)];
        std::memcpy(frame.order + frame.visible, frame.orderScratch + b * kBlock, found * sizeof(std::uint64_t));
        frame.visible += found;
    }
}

/// One stable counting pass over `bits` of the keys. Chunks count for themselves and then write where all earlier
/// chunks and smaller digits have left room, so that the order does not depend on the threads.
void sortPass(const std::uint64_t* from, std::uint64_t* to, std::size_t n, unsigned shift, std::uint64_t base,
              std::size_t chunks, std::uint32_t* counts) {
    const std::size_t size = (n + chunks - 1) / chunks;
    auto digit = [&](std::uint64_t value) { return ((value - base) >> shift) & (kDigits - 1); };
    parallelFor(
        chunks,
        [&](std::size_t c) {
            std::uint32_t* mine = counts + c * kDigits;
            std::fill(mine, mine + kDigits, 0u);
            for (std::size_t i = c * size; i < std::min(n, (c + 1) * size); ++i) ++mine[digit(from[i])];
        },
        1);
    std::uint32_t sum = 0;
    for (std::size_t d = 0; d < kDigits; ++d) {
        for (std::size_t c = 0; c < chunks; ++c) {
            const std::uint32_t count = counts[c * kDigits + d];
            counts[c * kDigits + d] = sum;
            sum += count;
        }
    }
    parallelFor(
        chunks,
        [&](std::size_t c) {
            std::uint32_t* mine = counts + c * kDigits;
            for (std::size_t i = c * size; i < std::min(n, (c + 1) * size); ++i) to[mine[digit(from[i])]++] = from[i];
        },
        1);
}

/// Sorts by depth; equal depths stay in the order of their indices.
Status sortByDepth(const SplatArguments& a, Frame& frame) {
    const std::size_t n = frame.visible;
    std::uint32_t least = 0xffffffffu, most = 0;
    for (std::size_t b = 0; b < frame.blockCount; ++b) {
        least = std::min(least, frame.blocks[b].minKey);
        most = std::max(most, frame.blocks[b].maxKey);
    }
    if (n < 2 || least == most) return {};
    const std::size_t chunks = n < 32768 ? 1 : std::min<std::size_t>(64, n / 16384);
    Buffer& counts = a.memory->histograms;
    ARS_TRY_STATUS(growBuffer(counts, {}, chunks * kDigits * sizeof(std::uint32_t), "splat: depth order"));
    // A body fills a small part of all depths: only the bits in which its keys differ from the least are sorted.
    const unsigned bits = static_cast<unsigned>(std::bit_width(most - least));
    const std::uint64_t base = static_cast<std::uint64_t>(least) << 32;
    for (unsigned done = 0; done < bits; done += kDigitBits) {
        sortPass(frame.order, frame.orderScratch, n, 32 + done, base, chunks, pointer<std::uint32_t>(counts));
        std::swap(frame.order, frame.orderScratch);
    }
    return {};
}

/// Calls visit(tile) for each tile that the surfel in `slot` reaches.
template <SurfelKernel Kernel, typename Visit>
void visitTiles(const Frame& frame, std::uint32_t slot, int tilesX, Visit&& visit) {
    const TileRect rect = frame.reach[slot].rect;
    const auto row = static_cast<std::size_t>(tilesX);
    const std::size_t corner = rect.y0 * row + rect.x0;
    if (fitsMask(rect)) {
        for (std::uint64_t mask = frame.reach[slot].mask; mask != 0; mask &= mask - 1) {
            const auto bit = static_cast<std::size_t>(std::countr_zero(mask));
            visit(corner + bit / kMaskSide * row + bit % kMaskSide);
        }
        return;
    }
    for (int y = rect.y0; y <= rect.y1; ++y) {
        for (int x = rect.x0; x <= rect.x1; ++x) {
            if (reachesTile<Kernel>(frame.rows[slot], x, y)) {
                visit(static_cast<std::size_t>(y) * row + static_cast<std::size_t>(x));
            }
        }
    }
}

/// The stable counting sort by tile (reference 6.2-3).
template <SurfelKernel Kernel>
Status binByTile(const SplatArguments& a, const Frame& frame) {
    SplatWorkspace::Memory& m = *a.memory;
    const std::size_t n = frame.visible, tiles = a.tileCount();
    std::size_t chunks = std::clamp<std::size_t>(n / 2048, 1, 16);
    while (chunks > 1 && chunks * tiles > (1u << 22)) chunks /= 2;
    const std::size_t size = (n + chunks - 1) / chunks;
    ARS_TRY_STATUS(growBuffer(m.histograms, {}, chunks * tiles * sizeof(std::uint64_t), "splat: tile counts"));
    ARS_TRY_STATUS(growBuffer(m.tileStarts, {}, (tiles + 1) * sizeof(std::uint64_t), "splat: tile lists"));
    auto* counts = pointer<std::uint64_t>(m.histograms);
    auto* starts = pointer<std::uint64_t>(m.tileStarts);
    constexpr std::size_t kAhead = 16; // in depth order, memory is visited at random
    // Calls visit(tile, slot) for the surfels of one chunk of the depth order.
    auto visitChunk = [&](std::size_t c, auto visit) {
        for (std::size_t k = c * size; k < std::min(n, (c + 1) * size); ++k) {
            const auto slot = static_cast<std::uint32_t>(frame.order[k]);
            __builtin_prefetch(frame.reach + static_cast<std::uint32_t>(frame.order[std::min(n - 1, k + kAhead)]));
            visitTiles<Kernel>(frame, slot, a.tilesX(), [&](std::size_t tile) { visit(tile, slot); });
        }
    };
    parallelFor(
        chunks,
        [&](std::size_t c) {
            std::uint64_t* mine = counts + c * tiles;
            std::fill(mine, mine + tiles, 0ull);
            visitChunk(c, [&](std::size_t tile, std::uint32_t) { ++mine[tile]; });
        },
        1);
    std::uint64_t sum = 0;
    for (std::size_t tile = 0; tile < tiles; ++tile) {
        starts[tile] = sum;
        for (std::size_t c = 0; c < chunks; ++c) {
            const std::uint64_t count = counts[c * tiles + tile];
            counts[c * tiles + tile] = sum;
            sum += count;
        }
    }
    starts[tiles] = sum;
    ARS_TRY_STATUS(growBuffer(m.instances, {}, sum * sizeof(std::uint32_t), "splat: surfels of tiles"));
    auto* instances = pointer<std::uint32_t>(m.instances);
    parallelFor(
        chunks,
        [&](std::size_t c) {
            std::uint64_t* next = counts + c * tiles;
            visitChunk(c, [&](std::size_t tile, std::uint32_t slot) { instances[next[tile]++] = slot; });
        },
        1);
    return {};
}

float* pictureOf(GBuffer& gbuffer, Channel channel) {
    return gbuffer.channels.has(channel) ? gbuffer[channel].view().data : nullptr;
}

TileJob tileJob(const SplatArguments& a, const Frame& frame) {
    SplatWorkspace::Memory& m = *a.memory;
    TileJob job;
    job.kernel = a.params.kernel;
    job.depthMode = a.params.depth;
    job.width = a.view.camera.width;
    job.height = a.view.camera.height;
    job.tilesX = a.tilesX();
    job.rows = frame.rows;
    job.features = frame.features;
    job.surfelOfSlot = frame.surfelOfSlot;
    job.featureStride = a.features.stride;
    job.instances = pointer<std::uint32_t>(m.instances);
    job.tileStarts = pointer<std::uint64_t>(m.tileStarts);
    job.opacity = pictureOf(*a.gbuffer, Channel::Opacity);
    job.depth = pictureOf(*a.gbuffer, Channel::Depth);
    job.position = pictureOf(*a.gbuffer, Channel::Position);
    for (int k = 0; k < 3; ++k) {
        job.pointOrigin[k] = a.points.origin[k];
        job.pointPerX[k] = a.points.perX[k];
        job.pointPerY[k] = a.points.perY[k];
        job.pointAtZero[k] = a.points.atZero[k];
    }
    for (int i = 0; i < a.features.count; ++i) {
        const FeatureSource& source = a.features.sources[i];
        job.outputs[i] = {pictureOf(*a.gbuffer, source.channel), source.width, source.offset, source.unit};
    }
    job.outputCount = a.features.count;
    job.blended = pointer<std::uint64_t>(m.tileCounts);
    job.foreground = job.blended + a.tileCount();
    return job;
}

/// Blends tiles in parallel. Rows of tiles are too few pieces, single tiles too many on large pictures.
void runTiles(const TileJob& job, std::size_t tiles, void (*function)(const TileJob&, std::uint32_t, std::uint32_t)) {
    parallelRanges(tiles, 4, [&](std::size_t begin, std::size_t end) {
        function(job, static_cast<std::uint32_t>(begin), static_cast<std::uint32_t>(end));
    });
}

/// Counts are there: makes room for the lists and fills them.
Status listContributors(const SplatArguments& a, TileJob& job, const TileFunctions& functions) {
    const std::size_t pixels = a.gbuffer->pictures[0].view().pixelCount();
    ContributorLists& lists = *a.contributors;
    ARS_TRY_STATUS(growBuffer(lists.starts, {}, (pixels + 1) * sizeof(std::uint64_t), "splat: contributor lists"));
    auto* starts = pointer<std::uint64_t>(lists.starts);
    std::uint64_t sum = 0;
    for (std::size_t p = 0; p < pixels; ++p) {
        starts[p] = sum;
        sum += job.contributorCounts[p];
    }
    starts[pixels] = sum;
    ARS_TRY_STATUS(growBuffer(lists.surfels, {}, sum * sizeof(std::uint32_t), "splat: contributor lists"));
    ARS_TRY_STATUS(growBuffer(lists.weights, {}, sum * sizeof(float), "splat: contributor lists"));
    lists.entries = sum;
    job.contributorStarts = starts;
    job.contributorSurfels = pointer<std::uint32_t>(lists.surfels);
    job.contributorWeights = pointer<float>(lists.weights);
    runTiles(job, a.tileCount(), functions.list);
    return {};
}

void gatherStats(const SplatArguments& a, const Frame& frame, const TileJob& job) {
    SplatStats& stats = *a.stats;
    stats = {};
    stats.surfels = a.surfels.count;
    for (std::size_t b = 0; b < frame.blockCount; ++b) {
        for (std::size_t f = 0; f < kSurfelFateCount; ++f) stats.fates[f] += frame.blocks[b].fates[f];
    }
    stats.instances = job.tileStarts[a.tileCount()];
    for (std::size_t tile = 0; tile < a.tileCount(); ++tile) {
        stats.blended += job.blended[tile];
        stats.foreground += job.foreground[tile];
    }
}

/// All that comes before blending.
Result<Frame> sortIntoTiles(const SplatArguments& a, const FeatureLayout* alsoFinite = nullptr) {
    ARS_TRY(Frame frame, prepareFrame(a));
    frame.alsoFinite = alsoFinite;
    project(a, frame);
    ARS_TRY_STATUS(sortByDepth(a, frame));
    if (a.params.kernel == SurfelKernel::RaySplat) {
        ARS_TRY_STATUS(binByTile<SurfelKernel::RaySplat>(a, frame));
    } else {
        ARS_TRY_STATUS(binByTile<SurfelKernel::GaussianSurfel>(a, frame));
    }
    return frame;
}

} // namespace

Result<TileLists> listTiles(const SplatArguments& a, const FeatureLayout& alsoFinite) {
    ARS_TRY(const Frame frame, sortIntoTiles(a, &alsoFinite));
    return TileLists{frame.rows, frame.features, frame.surfelOfSlot, pointer<std::uint32_t>(a.memory->instances),
                     pointer<std::uint64_t>(a.memory->tileStarts)};
}

Status splat(const SplatArguments& a) {
    SplatWorkspace::Memory& m = *a.memory;
    ARS_TRY(const Frame frame, sortIntoTiles(a));
    ARS_TRY_STATUS(growBuffer(m.tileCounts, {}, 2 * a.tileCount() * sizeof(std::uint64_t), "splat: tile counts"));
    TileJob job = tileJob(a, frame);
    if (a.contributors) {
        const std::size_t pixels = a.gbuffer->pictures[0].view().pixelCount();
        ARS_TRY_STATUS(growBuffer(m.contributorCounts, {}, pixels * sizeof(std::uint64_t), "splat: contributor lists"));
        job.contributorCounts = pointer<std::uint64_t>(m.contributorCounts);
    }
    const TileFunctions functions = tileFunctionsOf(m.path);
    runTiles(job, a.tileCount(), functions.blend);
    if (a.contributors) ARS_TRY_STATUS(listContributors(a, job, functions));
    if (a.stats) gatherStats(a, frame, job);
    return {};
}

} // namespace ars::cpu
