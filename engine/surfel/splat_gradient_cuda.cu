// GLM asks for CUDA_VERSION before anything else.
#include <cuda.h>
#include <cuda_runtime.h>

// GLM marks defaulted constructors for the device, which nvcc remarks on a hundred times.
#pragma nv_diag_suppress 20012

#include "engine/core/cuda_status.cuh"
#include "engine/surfel/splat_gradient_entries.h"

#include <cub/cub.cuh>

#include <fmt/format.h>

#include <bit>
#include <limits>

// Backward over contributor lists (splat_gradient_entries.h): a thread a pixel, a stable sort of the entries by surfel,
// a warp a surfel. Every sum is taken in a fixed order, so that the same input gives the same bits.
namespace ars::cuda {
namespace {

constexpr int kBlock = 256;

Status check(cudaError_t code) { return statusOf(code, "splat gradient"); }

template <typename T>
T* pointer(Buffer& buffer) {
    return static_cast<T*>(buffer.data());
}

unsigned blocksFor(std::size_t threads) { return static_cast<unsigned>((threads + kBlock - 1) / kBlock); }

__device__ std::size_t threadIndex() { return blockIdx.x * static_cast<std::size_t>(kBlock) + threadIdx.x; }

__global__ void projectKernel(EntryPass p) {
    const std::size_t surfel = threadIndex();
    if (surfel < p.surfels.count) projectForEntries(p, surfel);
}

template <SurfelKernel Kernel, DepthMode Depth>
__global__ void pixelKernel(EntryPass p) {
    const std::size_t pixel = threadIndex();
    if (pixel < p.pixels) backwardPixel<Kernel, Depth>(p, pixel);
}

/// One warp a surfel. Its lanes' sums meet in a tree, the same every time.
template <SurfelKernel Kernel, DepthMode Depth, int Stride>
__global__ void __launch_bounds__(kBlock) surfelKernel(EntryPass p) {
    const std::size_t surfel = threadIndex() / kEntryLanes;
    if (surfel >= p.surfels.count) return; // the whole warp
    const unsigned lane = threadIdx.x % kEntryLanes;
    const std::uint64_t begin = firstEntryOf(p, surfel), end = firstEntryOf(p, surfel + 1);
    if (begin == end) return;
    const ProjectedSurfel<float> row = p.rows[surfel];
    EntrySums<Stride> sums = sumEntries<Kernel, Depth, Stride>(p, row, begin + lane, end, kEntryLanes);
#pragma unroll
    for (int c = 0; c < EntrySums<Stride>::kCount; ++c) {
        for (int offset = kEntryLanes / 2; offset > 0; offset /= 2) {
            sums.values[c] += __shfl_xor_sync(0xffffffffu, sums.values[c], offset);
        }
    }
    if (lane == 0) finishEntries(p, surfel, sums);
}

template <SurfelKernel Kernel, DepthMode Depth, int Stride>
void launchSurfels(const EntryPass& p) {
    surfelKernel<Kernel, Depth, Stride><<<blocksFor(p.surfels.count * kEntryLanes), kBlock>>>(p);
}

template <SurfelKernel Kernel, DepthMode Depth>
void sumSurfels(const EntryPass& p) {
    switch (p.pictures.stride()) {
    case 0:
        return launchSurfels<Kernel, Depth, 0>(p);
    case 4:
        return launchSurfels<Kernel, Depth, 4>(p);
    case 8:
        return launchSurfels<Kernel, Depth, 8>(p);
    case 12:
        return launchSurfels<Kernel, Depth, 12>(p);
    case 16:
        return launchSurfels<Kernel, Depth, 16>(p);
    default:
        return launchSurfels<Kernel, Depth, 20>(p);
    }
}
static_assert(cpu::kMaxFeatures == 20);

/// The sorted copies of surfels and entries.
struct Sorted {
    std::uint32_t *surfels, *entries;
};

Status sortEntries(const EntryPass& p, Buffer& scratch, const Sorted& sorted) {
    const auto count = static_cast<int>(p.entryCount);
    const int bits = std::bit_width(p.surfels.count);
    // Stable: the entries of a surfel stay in the order of pixels.
    std::size_t bytes = 0;
    ARS_TRY_STATUS(check(cub::DeviceRadixSort::SortPairs(nullptr, bytes, p.listed, sorted.surfels, p.entries,
                                                         sorted.entries, count, 0, bits)));
    ARS_TRY_STATUS(growBuffer(scratch, p.surfels.device, bytes, "splat gradient: sorting"));
    return check(cub::DeviceRadixSort::SortPairs(scratch.data(), bytes, p.listed, sorted.surfels, p.entries,
                                                 sorted.entries, count, 0, bits));
}

template <SurfelKernel Kernel, DepthMode Depth>
Status queue(const EntryPass& p, Buffer& scratch, const Sorted& sorted) {
    projectKernel<<<blocksFor(p.surfels.count), kBlock>>>(p);
    pixelKernel<Kernel, Depth><<<blocksFor(p.pixels), kBlock>>>(p);
    ARS_TRY_STATUS(check(cudaGetLastError()));
    ARS_TRY_STATUS(sortEntries(p, scratch, sorted));
    sumSurfels<Kernel, Depth>(p);
    return check(cudaGetLastError());
}

/// Memory of the pass: everything but the gradients themselves.
Result<Sorted> growForPass(const SplatBackwardArguments& a, EntryPass& p) {
    SplatGradientWorkspace& w = *a.workspace;
    const Device device = a.surfels.device;
    const std::size_t n = a.surfels.count, entries = p.entryCount, word = sizeof(std::uint32_t);
    const auto stride = static_cast<std::size_t>(a.pictures.stride());
    ARS_TRY_STATUS(growBuffer(w.rows, device, n * sizeof(ProjectedSurfel<float>), "splat gradient: surfels"));
    ARS_TRY_STATUS(growBuffer(w.features, device, n * stride * word, "splat gradient: surfels"));
    ARS_TRY_STATUS(growBuffer(w.pixelGradients, device, p.pixels * (stride + 2) * word, "splat gradient: pixels"));
    for (Buffer* buffer : {&w.alphaGradients, &w.entryPixels, &w.entries, &w.sortedEntries, &w.sortedSurfels}) {
        ARS_TRY_STATUS(growBuffer(*buffer, device, entries * word, "splat gradient: pairs of a surfel and a pixel"));
    }
    p.rows = pointer<ProjectedSurfel<float>>(w.rows);
    p.features = pointer<float>(w.features);
    p.pixelGradients = pointer<float>(w.pixelGradients);
    p.alphaGradients = pointer<float>(w.alphaGradients);
    p.entryPixels = pointer<std::uint32_t>(w.entryPixels);
    p.entries = pointer<std::uint32_t>(w.entries);
    const Sorted sorted{pointer<std::uint32_t>(w.sortedSurfels), pointer<std::uint32_t>(w.sortedEntries)};
    p.sortedSurfels = sorted.surfels;
    p.sortedEntries = sorted.entries;
    return sorted;
}

/// One array of the results on both sides.
struct Output {
    float* host;
    float** device;
    std::size_t floats; ///< of all surfels
};

/// Room for all results in one piece of device memory, zeros; `list` says which part is whose.
Status growForOutputs(SplatBackwardArguments& a, const SurfelGradientArrays& host, std::vector<Output>& list) {
    const std::size_t n = a.surfels.count;
    list = {{host.means, &a.out.means, 3 * n},
            {host.rotations, &a.out.rotations, 4 * n},
            {host.scales, &a.out.scales, 2 * n},
            {host.opacities, &a.out.opacities, n}};
    for (int i = 0; i < kChannelCount; ++i) {
        if (!host.attributes[i]) continue;
        list.push_back({host.attributes[i], &a.out.attributes[i],
                        n * static_cast<std::size_t>(channelWidth(static_cast<Channel>(i)))});
    }
    std::size_t floats = 0;
    for (const Output& output : list) floats += output.floats;
    Buffer& buffer = a.workspace->outputs;
    ARS_TRY_STATUS(growBuffer(buffer, a.surfels.device, floats * sizeof(float), "splat gradient: results"));
    float* at = pointer<float>(buffer);
    for (const Output& output : list) {
        *output.device = at;
        at += output.floats;
    }
    return check(cudaMemsetAsync(buffer.data(), 0, floats * sizeof(float)));
}

} // namespace

Status splatBackward(const SplatBackwardArguments& a) {
    const ContributorLists& lists = *a.contributors;
    if (a.surfels.count == 0 || lists.entries == 0) return {};
    if (lists.entries > static_cast<std::uint64_t>(std::numeric_limits<std::int32_t>::max())) {
        return makeError(ErrorCode::LimitExceeded, "splat gradient",
                         fmt::format("{} pairs of a surfel and a pixel, at most {} are possible on CUDA", lists.entries,
                                     std::numeric_limits<std::int32_t>::max()));
    }
    ARS_TRY_STATUS(check(cudaSetDevice(a.surfels.device.index)));
    EntryPass p = entryPass(a);
    p.out = a.out;
    ARS_TRY(const Sorted sorted, growForPass(a, p));
    Buffer& scratch = a.workspace->sortScratch;
    if (a.params.kernel == SurfelKernel::RaySplat) {
        return queue<SurfelKernel::RaySplat, DepthMode::Exact>(p, scratch, sorted);
    }
    if (a.params.depth == DepthMode::Exact) {
        return queue<SurfelKernel::GaussianSurfel, DepthMode::Exact>(p, scratch, sorted);
    }
    return queue<SurfelKernel::GaussianSurfel, DepthMode::Linear>(p, scratch, sorted);
}

Status splatBackwardToHost(SplatBackwardArguments a, const SurfelGradientArrays& host) {
    if (a.surfels.count == 0 || a.contributors->entries == 0) return {};
    ARS_TRY_STATUS(check(cudaSetDevice(a.surfels.device.index)));
    std::vector<Output> outputs;
    ARS_TRY_STATUS(growForOutputs(a, host, outputs));
    ARS_TRY_STATUS(splatBackward(a));
    for (const Output& output : outputs) {
        ARS_TRY_STATUS(
            check(cudaMemcpy(output.host, *output.device, output.floats * sizeof(float), cudaMemcpyDeviceToHost)));
    }
    return {};
}

} // namespace ars::cuda
