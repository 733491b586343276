#include "engine/core/parallel.h"
#include "engine/surfel/splat_cpu_lists.h"
#include "engine/surfel/splat_gradient_kernels.h"
#include "engine/surfel/splat_gradient_tile.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <mutex>
#include <type_traits>

// Backward on the host: the forward pass's tiles once more (splat_gradient_cpu_tile.h), what each tile passes to each
// of its surfels, and the sums of these over a surfel's tiles, in the order of tiles.
namespace ars::cpu {
namespace {

constexpr std::size_t kTilePixels = static_cast<std::size_t>(kTileSide) * kTileSide;

/// A surfel in one tile.
struct Instance {
    std::uint32_t index; ///< among all tiles' instances
    std::uint32_t tile;
};

struct Pass {
    const SplatBackwardArguments* arguments = nullptr;
    GradientPictures pictures; ///< with columns in eights
    TileLists lists;
    GradientTileJob job;
    std::size_t tiles = 0;
    std::size_t capacity = 0; ///< instances of the fullest tile
    int falloffTerms = 0;

    std::size_t instances() const { return static_cast<std::size_t>(lists.tileStarts[tiles]); }
};

GradientTileFunction tileFunctionOf(CpuPath wanted) {
    const std::vector<CpuPath> paths = availableCpuPaths(); // the best last
    const CpuPath path =
        wanted == CpuPath::Best || std::find(paths.begin(), paths.end(), wanted) == paths.end() ? paths.back() : wanted;
    const GradientTileFunction function = path == CpuPath::Avx512 ? avx512GradientTile()
                                          : path == CpuPath::Avx2 ? avx2GradientTile()
                                                                  : nullptr;
    return function ? function : portableGradientTile();
}

/// The forward pass's tiles. A surfel must be left out here where it was left out there.
Result<TileLists> listForwardTiles(const SplatBackwardArguments& a) {
    const FeatureLayout splatted = featureLayout(a.surfels, a.splatted);
    SplatArguments forward;
    forward.params = a.params;
    forward.surfels = a.surfels;
    forward.view = a.view;
    forward.features = a.pictures.layout;
    forward.memory = &a.workspace->tiles.memory();
    return listTiles(forward, splatted);
}

Status prepare(const SplatBackwardArguments& a, Pass& pass) {
    pass.arguments = &a;
    ARS_TRY(pass.lists, listForwardTiles(a));
    GradientTileJob& job = pass.job;
    job.kernel = a.params.kernel;
    job.depthMode = a.params.depth;
    job.width = a.view.camera.width;
    job.height = a.view.camera.height;
    job.tilesX = (job.width + kTileSide - 1) / kTileSide;
    job.depth = a.pictures.depth;
    job.rows = pass.lists.rows;
    job.features = pass.lists.features;
    job.featureStride = a.pictures.stride();
    job.instances = pass.lists.instances;
    job.tileStarts = pass.lists.tileStarts;
    for (int i = 0; i < a.pictures.layout.count; ++i) {
        const FeatureSource& source = a.pictures.layout.sources[i];
        const float attached = a.pictures.detached[i] ? 0.0f : 1.0f;
        std::fill_n(job.attached + source.offset, source.width, attached);
        if (source.unit) job.unitOffsets[job.unitCount++] = source.offset;
    }
    pass.falloffTerms = a.params.kernel == SurfelKernel::GaussianSurfel ? kFalloffTerms<SurfelKernel::GaussianSurfel>
                                                                        : kFalloffTerms<SurfelKernel::RaySplat>;
    job.terms = pass.falloffTerms + (job.depth ? kDepthTerms : 0);
    job.featureColumns = (job.featureStride + kColumns - 1) / kColumns * kColumns;
    job.columns = kColumns * job.terms + job.featureColumns;
    pass.pictures = a.pictures;
    pass.pictures.columns = job.featureColumns;
    job.pixelStride = pass.pictures.pixelStride();

    pass.tiles =
        static_cast<std::size_t>(job.tilesX) * static_cast<std::size_t>((job.height + kTileSide - 1) / kTileSide);
    for (std::size_t t = 0; t < pass.tiles; ++t) {
        pass.capacity = std::max<std::size_t>(pass.capacity, job.tileStarts[t + 1] - job.tileStarts[t]);
    }
    if (pass.instances() > 0xffffffffu) {
        return makeError(ErrorCode::LimitExceeded, "splat gradient",
                         fmt::format("{} pairs of a surfel and a tile, at most 2^32 - 1 are possible; try fewer "
                                     "surfels or a smaller picture",
                                     pass.instances()));
    }
    Buffer& sums = a.workspace->instanceSums;
    ARS_TRY_STATUS(growBuffer(sums, {}, pass.instances() * static_cast<std::size_t>(job.columns) * sizeof(float),
                              "splat gradient: surfels of tiles"));
    job.sums = static_cast<float*>(sums.data());
    return {};
}

/// The memory of one thread, cut into a tile's arrays; called with null to learn how much that is.
std::size_t cutTileMemory(const Pass& pass, std::byte* memory, GradientTile& tile) {
    std::size_t used = 0;
    const auto cut = [&](auto*& array, std::size_t count) {
        if (memory) array = reinterpret_cast<std::remove_reference_t<decltype(array)>>(memory + used);
        used += (count * sizeof *array + 63) / 64 * 64;
    };
    tile.capacity = pass.capacity;
    cut(tile.pixels, kTilePixels * static_cast<std::size_t>(pass.job.pixelStride));
    cut(tile.rows, pass.capacity);
    cut(tile.lists, 16 * pass.capacity);
    cut(tile.kept, pass.capacity);
    cut(tile.weights, 16 * pass.capacity);
    cut(tile.after, 16 * pass.capacity);
    cut(tile.terms, 16 * pass.capacity * static_cast<std::size_t>(pass.job.terms));
    return used;
}

/// The gradients of a tile's pixels, sub-tile by sub-tile; 0 outside the picture and where nothing was blended.
void gatherPixels(const Pass& pass, const GradientTile& tile) {
    const GradientPictures& p = pass.pictures;
    const auto stride = static_cast<std::size_t>(p.pixelStride());
    float lengths[kMaxFeatureChannels];
    std::fill(std::begin(lengths), std::end(lengths), 1.0f);
    std::memset(tile.pixels, 0, kTilePixels * stride * sizeof(float));
    const int x0 = kTileSide * static_cast<int>(tile.tile % static_cast<std::uint32_t>(pass.job.tilesX));
    const int y0 = kTileSide * static_cast<int>(tile.tile / static_cast<std::uint32_t>(pass.job.tilesX));
    for (int y = y0; y < std::min(y0 + kTileSide, p.height); ++y) {
        for (int x = x0; x < std::min(x0 + kTileSide, p.width); ++x) {
            const std::size_t pixel =
                static_cast<std::size_t>(y) * static_cast<std::size_t>(p.width) + static_cast<std::size_t>(x);
            if (!(*p.value(Channel::Opacity, pixel) > 0.0f)) continue;
            const int column = x - x0, row = y - y0;
            const int subtile = row / kSubtileSide * (kTileSide / kSubtileSide) + column / kSubtileSide;
            const int lane = row % kSubtileSide * kSubtileSide + column % kSubtileSide;
            sumGradients(p, pixel, lengths, tile.pixels + static_cast<std::size_t>(16 * subtile + lane) * stride);
        }
    }
}

/// Memory of tiles for whichever thread wants it next.
class TileMemory {
public:
    TileMemory(std::vector<Buffer>& free, std::size_t bytes) : free_(free), bytes_(bytes) {}

    Result<Buffer> take() {
        Buffer buffer;
        {
            const std::lock_guard lock(mutex_);
            if (!free_.empty()) {
                buffer = std::move(free_.back());
                free_.pop_back();
            }
        }
        ARS_TRY_STATUS(growBuffer(buffer, {}, bytes_, "splat gradient: a tile"));
        return buffer;
    }
    void give(Buffer buffer) {
        const std::lock_guard lock(mutex_);
        free_.push_back(std::move(buffer));
    }
    void fail(Error error) {
        const std::lock_guard lock(mutex_);
        if (status_) status_ = std::move(error);
    }
    Status status() const { return status_; }

private:
    std::mutex mutex_;
    std::vector<Buffer>& free_;
    std::size_t bytes_;
    Status status_;
};

Status backwardTiles(const Pass& pass) {
    SplatGradientWorkspace& w = *pass.arguments->workspace;
    const GradientTileFunction function = tileFunctionOf(w.tiles.memory().path);
    GradientTile sizes;
    TileMemory memory(w.tileMemory, cutTileMemory(pass, nullptr, sizes));
    parallelRanges(pass.tiles, 4, [&](std::size_t begin, std::size_t end) {
        if (pass.job.tileStarts[begin] == pass.job.tileStarts[end]) return;
        Result<Buffer> buffer = memory.take();
        if (!buffer) return memory.fail(std::move(buffer).error());
        GradientTile tile;
        cutTileMemory(pass, static_cast<std::byte*>(buffer->data()), tile);
        for (std::size_t t = begin; t < end; ++t) {
            if (pass.job.tileStarts[t] == pass.job.tileStarts[t + 1]) continue;
            tile.tile = static_cast<std::uint32_t>(t);
            gatherPixels(pass, tile);
            function(pass.job, tile);
        }
        memory.give(std::move(*buffer));
    });
    return memory.status();
}

/// Instances by slot, those of a slot in the order of tiles.
Status sortInstances(const Pass& pass) {
    SplatGradientWorkspace& w = *pass.arguments->workspace;
    const std::size_t slots = pass.arguments->surfels.count;
    ARS_TRY_STATUS(growBuffer(w.slotStarts, {}, (slots + 2) * sizeof(std::uint32_t), "splat gradient: surfels"));
    ARS_TRY_STATUS(
        growBuffer(w.slotInstances, {}, pass.instances() * sizeof(Instance), "splat gradient: surfels of tiles"));
    // starts[s + 2] counts, then starts[s + 1] runs from the slot's first place to its end.
    auto* starts = static_cast<std::uint32_t*>(w.slotStarts.data());
    auto* sorted = static_cast<Instance*>(w.slotInstances.data());
    std::fill(starts, starts + slots + 2, 0u);
    for (std::size_t i = 0; i < pass.instances(); ++i) ++starts[pass.lists.instances[i] + 2];
    for (std::size_t s = 2; s < slots + 2; ++s) starts[s] += starts[s - 1];
    for (std::size_t tile = 0; tile < pass.tiles; ++tile) {
        for (std::uint64_t i = pass.lists.tileStarts[tile]; i < pass.lists.tileStarts[tile + 1]; ++i) {
            sorted[starts[pass.lists.instances[i] + 1]++] = {static_cast<std::uint32_t>(i),
                                                             static_cast<std::uint32_t>(tile)};
        }
    }
    return {};
}

void backwardSurfel(const Pass& pass, std::size_t slot) {
    const SplatBackwardArguments& a = *pass.arguments;
    const GradientTileJob& job = pass.job;
    const auto* starts = static_cast<const std::uint32_t*>(a.workspace->slotStarts.data());
    const auto* instances = static_cast<const Instance*>(a.workspace->slotInstances.data());
    if (starts[slot] == starts[slot + 1]) return;
    const ProjectedSurfel<float>& row = job.rows[slot];
    constexpr int kMaxTerms = kFalloffTerms<SurfelKernel::RaySplat> + kDepthTerms;
    float moments[kMaxTerms][kMoments] = {}, features[kMaxFeatures + kColumns] = {};
    for (std::uint32_t k = starts[slot]; k < starts[slot + 1]; ++k) {
        const auto tilesX = static_cast<std::uint32_t>(job.tilesX);
        const float x = static_cast<float>(instances[k].tile % tilesX * kTileSide + kTileSide / 2) - row.u;
        const float y = static_cast<float>(instances[k].tile / tilesX * kTileSide + kTileSide / 2) - row.v;
        const float* sums =
            job.sums + static_cast<std::size_t>(instances[k].index) * static_cast<std::size_t>(job.columns);
        for (int t = 0; t < job.terms; ++t, sums += kColumns) {
            float shifted[kMoments];
            shiftMoments(x, y, sums, shifted);
            for (int m = 0; m < kMoments; ++m) moments[t][m] += shifted[m];
        }
        for (int c = 0; c < job.featureColumns; ++c) features[c] += sums[c];
    }
    ProjectedGradient<float> g;
    if (a.params.kernel == SurfelKernel::GaussianSurfel) {
        falloffGradient<SurfelKernel::GaussianSurfel>(row, moments, g);
    } else {
        falloffGradient<SurfelKernel::RaySplat>(row, moments, g);
    }
    if (job.depth) depthGradient(row, moments + pass.falloffTerms, g);
    finishSurfel(a.view, a.surfels, pass.pictures.layout, pass.lists.surfelOfSlot[slot], row, g, features, a.out);
}

} // namespace

Status splatBackward(const SplatBackwardArguments& a) {
    if (a.surfels.count == 0) return {};
    Pass pass;
    ARS_TRY_STATUS(prepare(a, pass));
    ARS_TRY_STATUS(backwardTiles(pass));
    ARS_TRY_STATUS(sortInstances(pass));
    parallelFor(a.surfels.count, [&](std::size_t slot) { backwardSurfel(pass, slot); }, 128);
    return {};
}

} // namespace ars::cpu
