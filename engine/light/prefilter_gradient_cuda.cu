// GLM asks for CUDA_VERSION before anything else.
#include <cuda.h>
#include <cuda_runtime.h>

// GLM marks defaulted constructors for the device, which nvcc remarks on a hundred times.
#pragma nv_diag_suppress 20012

#include "engine/core/cuda_status.cuh"
#include "engine/light/prefilter_gradient_kernels.h"

namespace ars::cuda {
namespace {

constexpr int kBlock = 128;
constexpr int kWarp = 32;
/// As in the forward filters: levels with fewer texels take a warp for each.
constexpr std::size_t kThreadPerTexel = 200000;

/// Sums over the lanes of one texel in a fixed tree; every lane gets the sum.
template <int Lanes>
__device__ float sumLanes(float value) {
    if constexpr (Lanes > 1) {
        for (int step = Lanes / 2; step > 0; step /= 2) value += __shfl_xor_sync(0xffffffffu, value, step);
    }
    return value;
}

template <int Lanes>
__device__ glm::vec3 sumLanes(const glm::vec3& value) {
    return {sumLanes<Lanes>(value.x), sumLanes<Lanes>(value.y), sumLanes<Lanes>(value.z)};
}

/// Texel and lane of a thread. Whole warps leave together where there is no such texel: Lanes divides both the block
/// and a warp, and a texel's lanes share it.
template <int Lanes>
__device__ bool placeOf(const AdjointArguments& a, std::size_t& texel, int& lane) {
    const std::size_t thread = blockIdx.x * static_cast<std::size_t>(kBlock) + threadIdx.x;
    texel = thread / Lanes;
    lane = static_cast<int>(thread % Lanes);
    return texel < a.texels();
}

template <int Lanes>
__global__ void specularScalesKernel(AdjointArguments a, float* scales) {
    std::size_t texel = 0;
    int lane = 0;
    if (!placeOf<Lanes>(a, texel, lane)) return;
    const float sum = sumLanes<Lanes>(specularWeightsPart(a, texel, lane, Lanes));
    if (lane == 0) scales[texel] = sum > 0.0f ? 1.0f / sum : 0.0f;
}

template <int Lanes>
__global__ void specularAdjointKernel(AdjointArguments a) {
    std::size_t texel = 0;
    int lane = 0;
    if (!placeOf<Lanes>(a, texel, lane)) return;
    const glm::vec3 sum = sumLanes<Lanes>(specularAdjointPart(a, texel, lane, Lanes));
    if (lane == 0) writeAdjoint(a, texel, sum);
}

__global__ void diffuseAdjointKernel(AdjointArguments a) {
    std::size_t texel = 0;
    int lane = 0;
    if (!placeOf<kWarp>(a, texel, lane)) return;
    const glm::vec3 sum = sumLanes<kWarp>(diffuseAdjointPart(a, texel, lane, kWarp));
    if (lane == 0) writeAdjoint(a, texel, sum);
}

__global__ void averageBackwardKernel(const float* smaller, float* larger, std::size_t width, std::size_t count) {
    const std::size_t i = blockIdx.x * static_cast<std::size_t>(kBlock) + threadIdx.x;
    if (i < count) addAverageBackward(smaller, larger, width, i / width, i % width);
}

Status cudaStatus(cudaError_t code) { return statusOf(code, "light gradient"); }

unsigned blocksFor(std::size_t threads) { return static_cast<unsigned>((threads + kBlock - 1) / kBlock); }

} // namespace

Status averagePoolBackward(ImageView<const float> smaller, ImageView<float> larger, int index) {
    ARS_TRY_STATUS(cudaStatus(cudaSetDevice(index)));
    const std::size_t count = larger.pixelCount();
    averageBackwardKernel<<<blocksFor(count), kBlock>>>(smaller.data, larger.data,
                                                        static_cast<std::size_t>(larger.width), count);
    return cudaStatus(cudaGetLastError());
}

Status specularScales(const AdjointArguments& arguments, float* scales, int index) {
    ARS_TRY_STATUS(cudaStatus(cudaSetDevice(index)));
    const std::size_t texels = arguments.texels();
    if (texels >= kThreadPerTexel) {
        specularScalesKernel<1><<<blocksFor(texels), kBlock>>>(arguments, scales);
    } else {
        specularScalesKernel<kWarp><<<blocksFor(kWarp * texels), kBlock>>>(arguments, scales);
    }
    return cudaStatus(cudaGetLastError());
}

Status filterSpecularAdjoint(const AdjointArguments& arguments, int index) {
    ARS_TRY_STATUS(cudaStatus(cudaSetDevice(index)));
    const std::size_t texels = arguments.texels();
    if (texels >= kThreadPerTexel) {
        specularAdjointKernel<1><<<blocksFor(texels), kBlock>>>(arguments);
    } else {
        specularAdjointKernel<kWarp><<<blocksFor(kWarp * texels), kBlock>>>(arguments);
    }
    return cudaStatus(cudaGetLastError());
}

Status filterDiffuseAdjoint(const AdjointArguments& arguments, int index) {
    ARS_TRY_STATUS(cudaStatus(cudaSetDevice(index)));
    diffuseAdjointKernel<<<blocksFor(kWarp * arguments.texels()), kBlock>>>(arguments);
    return cudaStatus(cudaGetLastError());
}

} // namespace ars::cuda
