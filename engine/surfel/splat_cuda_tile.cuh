#pragma once

#include "engine/surfel/splat_kernels.h"

#include <cuda_runtime.h>

/// Blending of the tiles on CUDA, the mirror of splat_cpu_tile.h; included by splat_cuda.cu alone.
namespace ars::cuda {

/// What a frame counts, on the device.
struct FrameCounters {
    unsigned long long fates[kSurfelFateCount];
    unsigned long long instances;
    unsigned long long blended;
    unsigned long long foreground;
};

namespace {

constexpr int kPixels = kTileSide * kTileSide; ///< threads of a tile
constexpr int kStaged = 128;                   ///< surfels of a tile in shared memory at once
constexpr int kWarpWidth = 8, kWarpHeight = 4; ///< pixels of a warp

/// All that kernels are given, by value.
struct DeviceFrame {
    SplatView<float> view;
    SurfelView surfels;
    FeatureLayout features;
    PointMap points;
    std::uint32_t count;
    int tilesX, tilesY;
    ProjectedSurfel<float>* rows;
    float* featureRows;
    TileRect* rects;
    std::uint32_t *keys, *sortedKeys, *slots, *sortedSlots;
    unsigned long long *tileCounts, *offsets; ///< per place in the depth order
    std::uint32_t *tileKeys, *sortedTileKeys, *instances, *sortedInstances;
    unsigned long long planned;
    unsigned long long* tileStarts;
    FrameCounters* counters;
    float *opacity, *depth, *position;
    cpu::FeatureOutput outputs[cpu::kMaxFeatureChannels];
    int outputCount;
    unsigned long long* contributorCounts; ///< null unless asked for
    const unsigned long long* contributorStarts;
    std::uint32_t* contributorSurfels;
    float* contributorWeights;
};

/// The surfels of a tile that are looked at together.
template <int Stride>
struct Staged {
    ProjectedSurfel<float> rows[kStaged];
    float features[kStaged][Stride > 0 ? Stride : 1];
    std::uint32_t slots[kStaged];
};

template <int Stride>
__device__ void stage(const DeviceFrame& f, unsigned long long begin, int count, Staged<Stride>& staged) {
    for (int k = static_cast<int>(threadIdx.x); k < count; k += kPixels) {
        const std::uint32_t slot = f.sortedInstances[begin + k];
        staged.slots[k] = slot;
        staged.rows[k] = f.rows[slot];
    }
    if constexpr (Stride > 0) {
        for (int i = static_cast<int>(threadIdx.x); i < count * Stride; i += kPixels) {
            const std::uint32_t slot = f.sortedInstances[begin + i / Stride];
            staged.features[i / Stride][i % Stride] =
                f.featureRows[static_cast<std::size_t>(slot) * Stride + i % Stride];
        }
    }
    __syncthreads();
}

template <int Stride>
struct Pixel {
    int x, y;
    bool live, inside;
    float transmittance = 1.0f, opacity = 0.0f, depth = 0.0f;
    float sums[Stride > 0 ? Stride : 1] = {};
    unsigned int blended = 0;
};

template <int Stride>
__device__ void writePixel(const DeviceFrame& f, const Pixel<Stride>& pixel) {
    const std::size_t at = static_cast<std::size_t>(pixel.y) * static_cast<std::size_t>(f.view.camera.width) +
                           static_cast<std::size_t>(pixel.x);
    const bool covered = pixel.opacity > kMinOpacity;
    const float scale = covered ? 1.0f / pixel.opacity : 0.0f;
    const float depth = pixel.depth * scale;
    f.opacity[at] = pixel.opacity;
    if (f.depth) f.depth[at] = depth;
    if (f.position) {
        const float u = static_cast<float>(pixel.x) + 0.5f, v = static_cast<float>(pixel.y) + 0.5f;
        const glm::vec3 ray = f.points.perX * u + f.points.perY * v + f.points.atZero;
        const glm::vec3 point = covered ? f.points.origin + depth * ray : glm::vec3(0.0f);
        for (int k = 0; k < 3; ++k) f.position[3 * at + static_cast<std::size_t>(k)] = point[k];
    }
    // Indices into `sums` must be known when this is compiled, or the sums leave the registers.
#pragma unroll
    for (int c = 0; c < Stride; ++c) {
        for (int i = 0; i < f.outputCount; ++i) {
            const cpu::FeatureOutput& output = f.outputs[i];
            if (output.offset != c) continue;
            float* to = output.data + at * static_cast<std::size_t>(output.width);
            if (output.width == 1) {
                to[0] = pixel.sums[c] * scale;
                continue;
            }
            const float x = pixel.sums[c], y = pixel.sums[c + 1 < Stride ? c + 1 : c];
            const float z = pixel.sums[c + 2 < Stride ? c + 2 : c];
            float by = scale;
            if (output.unit) {
                const float square = x * x + y * y + z * z;
                by = covered && square > 1e-20f ? 1.0f / sqrtf(square) : 0.0f;
            }
            to[0] = x * by;
            to[1] = y * by;
            to[2] = z * by;
        }
    }
}

enum class Task { Blend, List };

/// One block a tile, one thread a pixel, one warp an 8x4 part of the tile that passes over surfels that miss it.
template <SurfelKernel Kernel, DepthMode Depth, int Stride, Task What>
__global__ void __launch_bounds__(kPixels) tileKernel(DeviceFrame f) {
    __shared__ Staged<Stride> staged;
    const int tile = static_cast<int>(blockIdx.x);
    const int warp = static_cast<int>(threadIdx.x) / 32, lane = static_cast<int>(threadIdx.x) % 32;
    const int left = (tile % f.tilesX) * kTileSide + (warp % 2) * kWarpWidth;
    const int top = (tile / f.tilesX) * kTileSide + (warp / 2) * kWarpHeight;
    Pixel<Stride> pixel;
    pixel.x = left + lane % kWarpWidth;
    pixel.y = top + lane / kWarpWidth;
    pixel.inside = pixel.x < f.view.camera.width && pixel.y < f.view.camera.height;
    pixel.live = pixel.inside;
    const std::size_t at = static_cast<std::size_t>(pixel.y) * static_cast<std::size_t>(f.view.camera.width) +
                           static_cast<std::size_t>(pixel.x);
    unsigned long long cursor = 0, listEnd = 0;
    if (What == Task::List && pixel.inside) {
        cursor = f.contributorStarts[at];
        listEnd = f.contributorStarts[at + 1];
    }
    const float x = static_cast<float>(pixel.x) + 0.5f, y = static_cast<float>(pixel.y) + 0.5f;
    const float rectX = static_cast<float>(left) + 0.5f, rectY = static_cast<float>(top) + 0.5f;

    const unsigned long long end = f.tileStarts[tile + 1];
    for (unsigned long long begin = f.tileStarts[tile]; begin < end; begin += kStaged) {
        // Also the barrier that keeps the last batch until every thread is done with it.
        if (__syncthreads_or(pixel.live) == 0) break;
        const int count = static_cast<int>(end - begin < kStaged ? end - begin : kStaged);
        stage<Stride>(f, begin, count, staged);
        for (int first = 0; first < count; first += 32) {
            if (__ballot_sync(0xffffffffu, pixel.live) == 0) break;
            const bool reaches =
                first + lane < count &&
                reachesRect<Kernel>(staged.rows[first + lane], rectX, rectY, rectX + static_cast<float>(kWarpWidth - 1),
                                    rectY + static_cast<float>(kWarpHeight - 1));
            for (unsigned int mask = __ballot_sync(0xffffffffu, reaches); mask != 0; mask &= mask - 1) {
                const int k = first + __ffs(static_cast<int>(mask)) - 1;
                const ProjectedSurfel<float>& row = staged.rows[k];
                const float dx = x - row.u, dy = y - row.v;
                const float weight = blendWeight(log2AlphaAt<Kernel>(row, dx, dy), pixel.transmittance, pixel.live);
                if (weight == 0.0f) continue;
                ++pixel.blended;
                if constexpr (What == Task::List) {
                    // The counts come from another kernel, whose compiler may have rounded a cut-off otherwise.
                    if (cursor == listEnd) continue;
                    f.contributorSurfels[cursor] = staged.slots[k];
                    f.contributorWeights[cursor++] = weight;
                } else {
                    pixel.opacity += weight;
                    pixel.depth += weight * depthAt<Kernel, Depth>(row, dx, dy);
#pragma unroll
                    for (int c = 0; c < Stride; ++c) pixel.sums[c] += weight * staged.features[k][c];
                }
            }
        }
    }
    if constexpr (What == Task::List) {
        for (; cursor < listEnd; ++cursor) { // room that was counted and not needed
            f.contributorSurfels[cursor] = f.count;
            f.contributorWeights[cursor] = 0.0f;
        }
    }
    if constexpr (What == Task::Blend) {
        if (pixel.inside) {
            writePixel(f, pixel);
            if (f.contributorCounts) f.contributorCounts[at] = pixel.blended;
        }
        unsigned int blended = pixel.blended;
        for (int offset = 16; offset > 0; offset /= 2) blended += __shfl_xor_sync(0xffffffffu, blended, offset);
        const int foreground = __popc(__ballot_sync(0xffffffffu, pixel.opacity > kMinOpacity));
        if (lane == 0 && blended > 0) {
            atomicAdd(&f.counters->blended, static_cast<unsigned long long>(blended));
            atomicAdd(&f.counters->foreground, static_cast<unsigned long long>(foreground));
        }
    }
}

template <int Stride, Task What>
void launchTiles(const DeviceFrame& f, SurfelKernel kernel, DepthMode depth) {
    const auto tiles = static_cast<unsigned>(f.tilesX) * static_cast<unsigned>(f.tilesY);
    if (kernel == SurfelKernel::RaySplat) {
        tileKernel<SurfelKernel::RaySplat, DepthMode::Exact, Stride, What><<<tiles, kPixels>>>(f);
    } else if (depth == DepthMode::Exact) {
        tileKernel<SurfelKernel::GaussianSurfel, DepthMode::Exact, Stride, What><<<tiles, kPixels>>>(f);
    } else {
        tileKernel<SurfelKernel::GaussianSurfel, DepthMode::Linear, Stride, What><<<tiles, kPixels>>>(f);
    }
}

void blendTiles(const DeviceFrame& f, SurfelKernel kernel, DepthMode depth) {
    switch (f.features.stride) {
    case 0:
        return launchTiles<0, Task::Blend>(f, kernel, depth);
    case 4:
        return launchTiles<4, Task::Blend>(f, kernel, depth);
    case 8:
        return launchTiles<8, Task::Blend>(f, kernel, depth);
    case 12:
        return launchTiles<12, Task::Blend>(f, kernel, depth);
    case 16:
        return launchTiles<16, Task::Blend>(f, kernel, depth);
    default:
        return launchTiles<20, Task::Blend>(f, kernel, depth);
    }
}

} // namespace
} // namespace ars::cuda
