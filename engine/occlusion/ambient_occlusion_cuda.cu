// GLM asks for CUDA_VERSION before anything else.
#include <cuda.h>
#include <cuda_runtime.h>

// GLM marks defaulted constructors for the device, which nvcc remarks on a hundred times.
#pragma nv_diag_suppress 20012

#include "engine/core/cuda_status.cuh"
#include "engine/occlusion/ambient_occlusion_kernels.h"

namespace ars::cuda {
namespace {

constexpr int kWarp = 32;
constexpr int kBlockX = 32, kBlockY = 8; ///< of the kernel that looks at every pixel
constexpr int kMarchBlock = 256;
constexpr int kPixelsPerTake = 4; ///< a warp takes this many pixels from the queue at a time
constexpr unsigned int kAllLanes = 0xffffffffu;

/// Pads the depth, writes 1 to all pixels, and lists those that must be marched. One thread for each padded pixel.
__global__ void listPixels(const OcclusionArguments a) {
    const int column = blockIdx.x * kBlockX + threadIdx.x;
    const int row = blockIdx.y * kBlockY + threadIdx.y;
    const bool padded = column < a.march.stride && row < a.march.height + 2 * kOcclusionBorder;
    const int x = column - kOcclusionBorder, y = row - kOcclusionBorder;
    const bool inside = x >= 0 && y >= 0 && x < a.march.width && y < a.march.height;
    const std::size_t at =
        inside ? static_cast<std::size_t>(y) * static_cast<std::size_t>(a.march.width) + static_cast<std::size_t>(x)
               : 0;
    bool march = false;
    if (padded) {
        float z = 0.0f;
        if (inside) {
            z = filteredPosition(a.march, column, row, a.params.median, [&a](int c, int r) {
                    return a.depthAt(c, r);
                }).z;
        }
        a.paddedDepth[static_cast<std::size_t>(row) * static_cast<std::size_t>(a.march.stride) +
                      static_cast<std::size_t>(column)] = z > kOcclusionNearest ? z : emptyDepth<float>();
        if (inside) {
            for (int k = 0; k < a.radii; ++k) a.occlusion[k][at] = 1.0f;
            march = z > kOcclusionNearest;
        }
    }
    // One addition for each warp; the order of the list does not change any pixel's result.
    const unsigned int wanted = __ballot_sync(kAllLanes, march);
    const int lane = static_cast<int>(threadIdx.x) % kWarp;
    unsigned int first = 0;
    if (lane == 0 && wanted != 0) first = atomicAdd(&a.pixels[0], static_cast<unsigned int>(__popc(wanted)));
    first = __shfl_sync(kAllLanes, first, 0);
    if (march) a.pixels[2 + first + __popc(wanted & ((1u << lane) - 1u))] = static_cast<unsigned int>(at);
}

/// Occluded weight of one direction at every radius.
struct RayWeights {
    float occluded[kMaxOcclusionRadii] = {};
    float total = 0.0f;
};

/// One pixel by one warp: its lanes share the directions.
__device__ void addDirection(const OcclusionArguments& a, const OcclusionPixel& pixel,
                             const OcclusionReach<float>* reach, const float* azimuths, const float* angles, int t,
                             int i, RayWeights& sums) {
    const int padded = roundedToLanes(pixel.grid.azimuths);
    const glm::vec3 azimuth = __ldg(azimuths + i) * pixel.tangent + __ldg(azimuths + padded + i) * pixel.bitangent;
    const float sine = __ldg(angles + t), cosine = __ldg(angles + pixel.grid.polarAngles + t);
    const float weight = __ldg(angles + 2 * pixel.grid.polarAngles + t);
    const glm::vec3 direction = rayDirection(azimuth, pixel.pole, sine, cosine);
    sums.total += weight;
    for (int k = 0; k < a.radii; ++k) {
        if (!(reach[k].length > 0.0f)) continue;
        if (rayIsHidden(a.march, a.paddedDepth, pixel.origin, direction, reach[k])) sums.occluded[k] += weight;
    }
}

__device__ float warpSum(float value) {
    for (int offset = kWarp / 2; offset > 0; offset /= 2) value += __shfl_xor_sync(kAllLanes, value, offset);
    return value;
}

/// False when a refinement has all directions of this pixel already.
__device__ bool marchPixel(const OcclusionArguments& a, const OcclusionPixel& pixel, const OcclusionReach<float>* reach,
                           int lane, RayWeights& sums) {
    const float* azimuths = a.tables.azimuths(pixel.grid.azimuths);
    const float* angles = a.tables.polarAngles(pixel.grid.polarAngles);
    const int n = pixel.grid.azimuths;
    if (!a.subset) {
        const int directions = n * pixel.grid.polarAngles;
        for (int d = lane; d < directions; d += kWarp)
            addDirection(a, pixel, reach, azimuths, angles, d / n, d % n, sums);
        return true;
    }
    const OcclusionSubsets subsets = occlusionSubsets(pixel.grid, a.params.interactiveDirections);
    if (a.sums && a.pass >= subsets.count()) return false;
    const OcclusionSubset subset = occlusionSubset(subsets, a.pass);
    // A row of a subset has at most kOcclusionLanes azimuths, so a warp takes two rows at a time.
    for (int row = lane / kOcclusionLanes;; row += kWarp / kOcclusionLanes) {
        const int t = subset.row + row * subsets.rowStride;
        if (t >= pixel.grid.polarAngles) break;
        const int i = occlusionResidue(subsets, subset, t) + lane % kOcclusionLanes * subsets.azimuthStride;
        if (i < n) addDirection(a, pixel, reach, azimuths, angles, t, i, sums);
    }
    return true;
}

__device__ void writePixel(const OcclusionArguments& a, std::size_t at, int lane) {
    const int y = static_cast<int>(at / static_cast<std::size_t>(a.march.width));
    const int x = static_cast<int>(at % static_cast<std::size_t>(a.march.width));
    OcclusionPixel pixel;
    if (!occlusionPixel(a, x + kOcclusionBorder, y + kOcclusionBorder, pixel)) return; // it holds 1 already
    OcclusionReach<float> reach[kMaxOcclusionRadii];
    bool usable = false;
    for (int k = 0; k < a.radii; ++k) {
        const float radius = a.radius[k][at];
        if (!usableRadius(radius)) continue;
        reach[k] = occlusionReach(a.march, radius, pixel.position.z);
        usable = true;
    }
    if (!usable) return;
    RayWeights sums;
    marchPixel(a, pixel, reach, lane, sums);
    const float total = warpSum(sums.total);
    for (int k = 0; k < a.radii; ++k) {
        float occluded = warpSum(sums.occluded[k]);
        if (lane != 0 || !(reach[k].length > 0.0f)) continue;
        float weight = total;
        if (a.sums) {
            float* so = a.sums + 2 * at;
            occluded += a.pass > 0 ? so[0] : 0.0f;
            weight += a.pass > 0 ? so[1] : 0.0f;
            so[0] = occluded;
            so[1] = weight;
        }
        a.occlusion[k][at] = occlusionFromWeights(occluded, weight, a.params.strength);
    }
}

/// Warps take pixels from the list until it is empty: neighbours with 16 times the directions do not hold up the
/// others.
__global__ void marchPixels(const OcclusionArguments a) {
    const int lane = static_cast<int>(threadIdx.x) % kWarp;
    const unsigned int count = a.pixels[0];
    for (;;) {
        unsigned int first = 0;
        if (lane == 0) first = atomicAdd(&a.pixels[1], static_cast<unsigned int>(kPixelsPerTake));
        first = __shfl_sync(kAllLanes, first, 0);
        if (first >= count) return;
        for (unsigned int p = first; p < first + kPixelsPerTake && p < count; ++p) {
            writePixel(a, a.pixels[2 + p], lane);
            __syncwarp();
        }
    }
}

Status cudaStatus(cudaError_t code) { return statusOf(code, "occlusion"); }

/// Warps that fill the device; asked for once for each device.
Result<int> residentBlocks(int index) {
    int processors = 0, perProcessor = 0;
    ARS_TRY_STATUS(cudaStatus(cudaDeviceGetAttribute(&processors, cudaDevAttrMultiProcessorCount, index)));
    ARS_TRY_STATUS(
        cudaStatus(cudaOccupancyMaxActiveBlocksPerMultiprocessor(&perProcessor, marchPixels, kMarchBlock, 0)));
    return processors * (perProcessor > 0 ? perProcessor : 1);
}

} // namespace

Status ambientOcclusion(const OcclusionArguments& arguments, int index) {
    ARS_TRY_STATUS(cudaStatus(cudaSetDevice(index)));
    ARS_TRY(const int blocks, residentBlocks(index));
    ARS_TRY_STATUS(cudaStatus(cudaMemsetAsync(arguments.pixels, 0, 2 * sizeof(unsigned int))));
    const dim3 block(kBlockX, kBlockY);
    const dim3 grid(static_cast<unsigned int>((arguments.march.stride + kBlockX - 1) / kBlockX),
                    static_cast<unsigned int>((arguments.march.height + 2 * kOcclusionBorder + kBlockY - 1) / kBlockY));
    listPixels<<<grid, block>>>(arguments);
    ARS_TRY_STATUS(cudaStatus(cudaGetLastError()));
    marchPixels<<<static_cast<unsigned int>(blocks), kMarchBlock>>>(arguments);
    return cudaStatus(cudaGetLastError());
}

} // namespace ars::cuda
