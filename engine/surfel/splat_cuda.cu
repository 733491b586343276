// GLM asks for CUDA_VERSION before anything else.
#include <cuda.h>
#include <cuda_runtime.h>

// GLM marks defaulted constructors for the device, which nvcc remarks on a hundred times.
#pragma nv_diag_suppress 20012

#include "engine/core/cuda_status.cuh"
#include "engine/surfel/splat_cuda_tile.cuh"
#include "engine/surfel/splat_kernels.h"

#include <cub/cub.cuh>

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <limits>

// The mirror of splat_cpu.cpp: the same functions per surfel, tile and pixel. A frame is queued without asking the
// device for anything: the number of surfel-tile pairs stays there, memory for them is planned from the frame before.
namespace ars {

struct CudaSplatState {
    int device = 0;
    cudaEvent_t done = nullptr;              ///< recorded behind the copy of the counters
    cuda::FrameCounters* counters = nullptr; ///< page-locked host memory
    bool queued = false;                     ///< a frame was queued, so that `done` means something
    std::uint64_t planned = 0;               ///< room for instances in the last frame
    std::uint64_t known = 0;                 ///< instances of the last frame that is known to have ended
};

void CudaSplatStateDelete::operator()(CudaSplatState* state) const {
    if (!state) return;
    int before = 0;
    cudaGetDevice(&before);
    cudaSetDevice(state->device);
    // The copy into the page-locked memory may still be on its way.
    if (state->done) cudaEventSynchronize(state->done);
    if (state->done) cudaEventDestroy(state->done);
    if (state->counters) cudaFreeHost(state->counters);
    cudaSetDevice(before);
    (void)cudaGetLastError(); // nobody is told, so nobody else shall be blamed
    delete state;
}

namespace cuda {
namespace {

constexpr int kBlock = 256;
constexpr std::uint32_t kHidden = 0xffffffffu; ///< depth key of surfels that are left out: behind all others

Status check(cudaError_t code) { return statusOf(code, "splat"); }

template <typename T>
T* pointer(Buffer& buffer) {
    return static_cast<T*>(buffer.data());
}

__global__ void projectKernel(DeviceFrame f) {
    __shared__ unsigned int fates[kSurfelFateCount];
    if (threadIdx.x < kSurfelFateCount) fates[threadIdx.x] = 0;
    __syncthreads();
    const std::size_t i = blockIdx.x * static_cast<std::size_t>(kBlock) + threadIdx.x;
    if (i < f.count) {
        ProjectedSurfel<float> row;
        glm::vec3 normal;
        PixelRect rect;
        SurfelFate fate = projectSurfel(f.view, f.surfels.means[i], f.surfels.rotations + 4 * i, f.surfels.scales[i],
                                        f.surfels.opacities[i], row, normal, rect);
        if (fate == SurfelFate::Visible &&
            !packFeatures(f.features, i, normal, f.view.camera.rotation,
                          f.featureRows + i * static_cast<std::size_t>(f.features.stride))) {
            fate = SurfelFate::NotFinite;
        }
        atomicAdd(&fates[static_cast<int>(fate)], 1u);
        const bool visible = fate == SurfelFate::Visible;
        f.keys[i] = visible ? __float_as_uint(row.depth) : kHidden;
        f.slots[i] = static_cast<std::uint32_t>(i);
        if (visible) {
            f.rows[i] = row;
            f.rects[i] = tilesOf(rect);
        }
    }
    __syncthreads();
    if (threadIdx.x < kSurfelFateCount && fates[threadIdx.x] > 0) {
        atomicAdd(&f.counters->fates[threadIdx.x], static_cast<unsigned long long>(fates[threadIdx.x]));
    }
}

/// Calls visit(tile) for each tile that the surfel reaches; the same tiles in the same order every time.
template <SurfelKernel Kernel, typename Visit>
__device__ void visitTiles(const DeviceFrame& f, std::uint32_t slot, Visit visit) {
    const ProjectedSurfel<float> row = f.rows[slot];
    const TileRect rect = f.rects[slot];
    const bool single = rect.x0 == rect.x1 && rect.y0 == rect.y1;
    for (int y = rect.y0; y <= rect.y1; ++y) {
        for (int x = rect.x0; x <= rect.x1; ++x) {
            if (single || reachesTile<Kernel>(row, x, y)) visit(static_cast<std::uint32_t>(y * f.tilesX + x));
        }
    }
}

template <SurfelKernel Kernel>
__global__ void countTilesKernel(DeviceFrame f) {
    const std::size_t k = blockIdx.x * static_cast<std::size_t>(kBlock) + threadIdx.x;
    if (k >= f.count) return;
    unsigned long long tiles = 0;
    if (f.sortedKeys[k] != kHidden) visitTiles<Kernel>(f, f.sortedSlots[k], [&](std::uint32_t) { ++tiles; });
    f.tileCounts[k] = tiles;
}

/// Writes (tile, slot) in depth order; what has no room is left out, the farthest first.
template <SurfelKernel Kernel>
__global__ void emitKernel(DeviceFrame f) {
    const std::size_t k = blockIdx.x * static_cast<std::size_t>(kBlock) + threadIdx.x;
    if (k >= f.count) return;
    unsigned long long at = f.offsets[k];
    if (k + 1 == f.count) f.counters->instances = at + f.tileCounts[k];
    if (f.tileCounts[k] == 0) return;
    const std::uint32_t slot = f.sortedSlots[k];
    visitTiles<Kernel>(f, slot, [&](std::uint32_t tile) {
        if (at < f.planned) {
            f.tileKeys[at] = tile;
            f.instances[at] = slot;
        }
        ++at;
    });
}

/// tileStarts[t]: the first instance of tile t or a later one. Unused places hold a key behind all tiles.
__global__ void tileStartsKernel(DeviceFrame f) {
    const std::uint32_t tiles = static_cast<std::uint32_t>(f.tilesX) * static_cast<std::uint32_t>(f.tilesY);
    const std::uint32_t tile = blockIdx.x * kBlock + threadIdx.x;
    if (tile > tiles) return;
    unsigned long long low = 0, high = f.planned;
    while (low < high) {
        const unsigned long long middle = low + (high - low) / 2;
        if (f.sortedTileKeys[middle] < tile) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    f.tileStarts[tile] = low;
}

Result<CudaSplatState*> stateOf(SplatWorkspace::Memory& m, const Device& device) {
    if (m.cuda && m.cuda->device == device.index) return m.cuda.get();
    m.cuda.reset();
    std::unique_ptr<CudaSplatState, CudaSplatStateDelete> state(new CudaSplatState);
    state->device = device.index;
    ARS_TRY_STATUS(check(cudaEventCreateWithFlags(&state->done, cudaEventDisableTiming)));
    ARS_TRY_STATUS(check(cudaMallocHost(reinterpret_cast<void**>(&state->counters), sizeof(FrameCounters))));
    *state->counters = {};
    m.cuda = std::move(state); // whole, or not at all
    return m.cuda.get();
}

/// Room for instances: a quarter more than the last known frame had.
std::uint64_t plannedInstances(CudaSplatState& state, std::size_t surfels) {
    if (state.queued && isFinished(state.done)) state.known = state.counters->instances;
    const std::uint64_t guess = state.known > 0 ? state.known + state.known / 4 + 65536
                                                : std::max<std::uint64_t>(1u << 20, 4 * std::uint64_t(surfels));
    return std::min<std::uint64_t>(guess, std::numeric_limits<std::int32_t>::max());
}

Status growForSurfels(const SplatArguments& a, SplatWorkspace::Memory& m) {
    const Device device = a.surfels.device;
    const std::size_t n = a.surfels.count, word = sizeof(std::uint32_t), wide = sizeof(std::uint64_t);
    ARS_TRY_STATUS(growBuffer(m.rows, device, n * sizeof(ProjectedSurfel<float>), "splat: projected surfels"));
    ARS_TRY_STATUS(growBuffer(m.features, device, n * static_cast<std::size_t>(a.features.stride) * sizeof(float),
                              "splat: surfel features"));
    ARS_TRY_STATUS(growBuffer(m.rects, device, n * sizeof(TileRect), "splat: tile rectangles"));
    for (Buffer* buffer : {&m.order, &m.orderScratch, &m.slots, &m.slotsScratch}) {
        ARS_TRY_STATUS(growBuffer(*buffer, device, n * word, "splat: depth order"));
    }
    ARS_TRY_STATUS(growBuffer(m.tilesPerSurfel, device, n * wide, "splat: tile counts"));
    ARS_TRY_STATUS(growBuffer(m.histograms, device, n * wide, "splat: tile counts"));
    ARS_TRY_STATUS(growBuffer(m.tileStarts, device, (a.tileCount() + 1) * wide, "splat: tile lists"));
    return growBuffer(m.blocks, device, sizeof(FrameCounters), "splat: counts");
}

Status growForInstances(const SplatArguments& a, SplatWorkspace::Memory& m, std::uint64_t planned) {
    for (Buffer* buffer : {&m.tileKeys, &m.tileKeysScratch, &m.instances, &m.instancesScratch}) {
        ARS_TRY_STATUS(
            growBuffer(*buffer, a.surfels.device, planned * sizeof(std::uint32_t), "splat: surfels of tiles"));
    }
    return {};
}

float* pictureOf(GBuffer& gbuffer, Channel channel) {
    return gbuffer.channels.has(channel) ? gbuffer[channel].view().data : nullptr;
}

DeviceFrame deviceFrame(const SplatArguments& a, SplatWorkspace::Memory& m, std::uint64_t planned) {
    DeviceFrame f = {};
    f.view = a.view;
    f.surfels = a.surfels;
    f.features = a.features;
    f.points = a.points;
    f.count = static_cast<std::uint32_t>(a.surfels.count);
    f.tilesX = a.tilesX();
    f.tilesY = a.tilesY();
    f.rows = pointer<ProjectedSurfel<float>>(m.rows);
    f.featureRows = pointer<float>(m.features);
    f.rects = pointer<TileRect>(m.rects);
    f.keys = pointer<std::uint32_t>(m.order);
    f.sortedKeys = pointer<std::uint32_t>(m.orderScratch);
    f.slots = pointer<std::uint32_t>(m.slots);
    f.sortedSlots = pointer<std::uint32_t>(m.slotsScratch);
    f.tileCounts = pointer<unsigned long long>(m.tilesPerSurfel);
    f.offsets = pointer<unsigned long long>(m.histograms);
    f.tileKeys = pointer<std::uint32_t>(m.tileKeys);
    f.sortedTileKeys = pointer<std::uint32_t>(m.tileKeysScratch);
    f.instances = pointer<std::uint32_t>(m.instances);
    f.sortedInstances = pointer<std::uint32_t>(m.instancesScratch);
    f.planned = planned;
    f.tileStarts = pointer<unsigned long long>(m.tileStarts);
    f.counters = pointer<FrameCounters>(m.blocks);
    f.opacity = pictureOf(*a.gbuffer, Channel::Opacity);
    f.depth = pictureOf(*a.gbuffer, Channel::Depth);
    f.position = pictureOf(*a.gbuffer, Channel::Position);
    for (int i = 0; i < a.features.count; ++i) {
        const FeatureSource& source = a.features.sources[i];
        f.outputs[i] = {pictureOf(*a.gbuffer, source.channel), source.width, source.offset, source.unit};
    }
    f.outputCount = a.features.count;
    return f;
}

/// Runs a CUB operation, called as run(scratch, bytes): the first time it only says how much scratch it needs.
template <typename Run>
Status withScratch(SplatWorkspace::Memory& m, const Device& device, Run run) {
    std::size_t bytes = 0;
    ARS_TRY_STATUS(check(run(nullptr, bytes)));
    ARS_TRY_STATUS(growBuffer(m.sortScratch, device, bytes, "splat: sorting"));
    return check(run(m.sortScratch.data(), bytes));
}

template <SurfelKernel Kernel>
Status sortSurfels(const SplatArguments& a, SplatWorkspace::Memory& m, const DeviceFrame& f) {
    const auto n = static_cast<int>(f.count);
    const auto blocks = static_cast<unsigned>((a.surfels.count + kBlock - 1) / kBlock);
    const Device device = a.surfels.device;
    projectKernel<<<blocks, kBlock>>>(f);
    ARS_TRY_STATUS(check(cudaGetLastError()));
    // Both sorts are stable: equal depths keep the order of indices, the surfels of a tile that of depth.
    ARS_TRY_STATUS(withScratch(m, device, [&](void* scratch, std::size_t& bytes) {
        return cub::DeviceRadixSort::SortPairs(scratch, bytes, f.keys, f.sortedKeys, f.slots, f.sortedSlots, n);
    }));
    countTilesKernel<Kernel><<<blocks, kBlock>>>(f);
    ARS_TRY_STATUS(check(cudaGetLastError()));
    ARS_TRY_STATUS(withScratch(m, device, [&](void* scratch, std::size_t& bytes) {
        return cub::DeviceScan::ExclusiveSum(scratch, bytes, f.tileCounts, f.offsets, n);
    }));
    // Places that stay empty sort behind the last tile.
    ARS_TRY_STATUS(check(cudaMemsetAsync(f.tileKeys, 0xff, f.planned * sizeof(std::uint32_t))));
    emitKernel<Kernel><<<blocks, kBlock>>>(f);
    ARS_TRY_STATUS(check(cudaGetLastError()));
    const int bits = std::bit_width(a.tileCount());
    ARS_TRY_STATUS(withScratch(m, device, [&](void* scratch, std::size_t& bytes) {
        return cub::DeviceRadixSort::SortPairs(scratch, bytes, f.tileKeys, f.sortedTileKeys, f.instances,
                                               f.sortedInstances, static_cast<int>(f.planned), 0, bits);
    }));
    return {};
}

/// Queues a frame up to and with its pictures.
Status queueFrame(const SplatArguments& a, SplatWorkspace::Memory& m, CudaSplatState& state, DeviceFrame& f) {
    ARS_TRY_STATUS(check(cudaMemsetAsync(f.counters, 0, sizeof(FrameCounters))));
    if (f.count == 0) {
        ARS_TRY_STATUS(check(cudaMemsetAsync(f.tileStarts, 0, (a.tileCount() + 1) * sizeof(std::uint64_t))));
    } else {
        if (a.params.kernel == SurfelKernel::RaySplat) {
            ARS_TRY_STATUS(sortSurfels<SurfelKernel::RaySplat>(a, m, f));
        } else {
            ARS_TRY_STATUS(sortSurfels<SurfelKernel::GaussianSurfel>(a, m, f));
        }
        // The sentinels are cut to the bits that were sorted only inside the sort; as numbers they stay behind all
        // tiles.
        tileStartsKernel<<<static_cast<unsigned>(a.tileCount() / kBlock + 1), kBlock>>>(f);
        ARS_TRY_STATUS(check(cudaGetLastError()));
    }
    blendTiles(f, a.params.kernel, a.params.depth);
    ARS_TRY_STATUS(check(cudaGetLastError()));
    ARS_TRY_STATUS(check(cudaMemcpyAsync(state.counters, f.counters, sizeof(FrameCounters), cudaMemcpyDeviceToHost)));
    ARS_TRY_STATUS(check(cudaEventRecord(state.done)));
    state.queued = true;
    state.planned = f.planned;
    return {};
}

/// Scans the counts, makes room, and runs the tiles once more to write the lists. Waits twice.
Status listContributors(const SplatArguments& a, SplatWorkspace::Memory& m, DeviceFrame& f) {
    const Device device = a.surfels.device;
    const std::size_t pixels = a.gbuffer->pictures[0].view().pixelCount();
    ContributorLists& lists = *a.contributors;
    ARS_TRY_STATUS(growBuffer(lists.starts, device, (pixels + 1) * sizeof(std::uint64_t), "splat: contributor lists"));
    auto* starts = pointer<unsigned long long>(lists.starts);
    ARS_TRY_STATUS(check(cudaMemsetAsync(starts, 0, sizeof(std::uint64_t))));
    ARS_TRY_STATUS(withScratch(m, device, [&](void* scratch, std::size_t& bytes) {
        return cub::DeviceScan::InclusiveSum(scratch, bytes, f.contributorCounts, starts + 1, static_cast<int>(pixels));
    }));
    std::uint64_t sum = 0;
    ARS_TRY_STATUS(check(cudaMemcpy(&sum, starts + pixels, sizeof sum, cudaMemcpyDeviceToHost)));
    ARS_TRY_STATUS(growBuffer(lists.surfels, device, sum * sizeof(std::uint32_t), "splat: contributor lists"));
    ARS_TRY_STATUS(growBuffer(lists.weights, device, sum * sizeof(float), "splat: contributor lists"));
    lists.entries = sum;
    f.contributorStarts = starts;
    f.contributorSurfels = pointer<std::uint32_t>(lists.surfels);
    f.contributorWeights = pointer<float>(lists.weights);
    launchTiles<0, Task::List>(f, a.params.kernel, a.params.depth);
    return check(cudaGetLastError());
}

void gatherStats(const SplatArguments& a, const FrameCounters& counters) {
    SplatStats& stats = *a.stats;
    stats = {};
    stats.surfels = a.surfels.count;
    for (std::size_t i = 0; i < kSurfelFateCount; ++i) stats.fates[i] = counters.fates[i];
    stats.instances = counters.instances;
    stats.blended = counters.blended;
    stats.foreground = counters.foreground;
}

} // namespace

Status splat(const SplatArguments& a) {
    SplatWorkspace::Memory& m = *a.memory;
    const Device device = a.surfels.device;
    ARS_TRY_STATUS(check(cudaSetDevice(device.index)));
    ARS_TRY(CudaSplatState * state, stateOf(m, device));
    ARS_TRY_STATUS(growForSurfels(a, m));
    const std::size_t pixels = a.gbuffer->pictures[0].view().pixelCount();
    if (a.contributors) {
        ARS_TRY_STATUS(
            growBuffer(m.contributorCounts, device, pixels * sizeof(std::uint64_t), "splat: contributor lists"));
    }
    const bool waits = a.contributors || a.stats;
    std::uint64_t planned = plannedInstances(*state, a.surfels.count);
    DeviceFrame frame;
    for (;;) {
        ARS_TRY_STATUS(growForInstances(a, m, planned));
        frame = deviceFrame(a, m, planned);
        if (a.contributors) frame.contributorCounts = pointer<unsigned long long>(m.contributorCounts);
        ARS_TRY_STATUS(queueFrame(a, m, *state, frame));
        if (!waits) return {};
        ARS_TRY_STATUS(check(cudaEventSynchronize(state->done)));
        state->known = state->counters->instances;
        if (state->known <= planned) break;
        // Someone waits anyway: the frame is made again, whole.
        planned = state->known;
        if (planned > static_cast<std::uint64_t>(std::numeric_limits<std::int32_t>::max())) {
            return makeError(
                ErrorCode::LimitExceeded, "splat",
                fmt::format("{} pairs of a surfel and a tile, at most {} are possible; try fewer surfels or "
                            "a smaller picture",
                            planned, std::numeric_limits<std::int32_t>::max()));
        }
    }
    if (a.stats) gatherStats(a, *state->counters);
    if (a.contributors) {
        ARS_TRY_STATUS(listContributors(a, m, frame));
        ARS_TRY_STATUS(check(cudaDeviceSynchronize()));
    }
    return {};
}

bool lastFrameIncomplete(const CudaSplatState& state) {
    return state.queued && isFinished(state.done) && state.counters->instances > state.planned;
}

} // namespace cuda
} // namespace ars
