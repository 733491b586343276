// GLM asks for CUDA_VERSION before anything else.
#include <cuda.h>
#include <cuda_runtime.h>

// GLM marks defaulted constructors for the device, which nvcc remarks on a hundred times.
#pragma nv_diag_suppress 20012

#include "engine/core/cuda_status.cuh"
#include "engine/shade/shading_gradient_kernels.h"

namespace ars::cuda {
namespace {

/// Tiles, so that the lanes of a warp look up neighbouring texels.
constexpr int kTileWidth = 16, kTileHeight = 8;
constexpr int kBlock = 256, kWarp = 32;

/// Largest bound of all pixels. Numbers that are not negative order as their bits do, NaN above all.
__global__ void boundKernel(ShadingGradientArguments a, std::size_t pixels, unsigned int* bound) {
    const std::size_t i = blockIdx.x * static_cast<std::size_t>(kBlock) + threadIdx.x;
    unsigned int own = 0;
    if (i < pixels) {
        const std::size_t width = static_cast<std::size_t>(a.shading.width);
        own = __float_as_uint(fabsf(lightGradientBound(a, static_cast<int>(i / width), static_cast<int>(i % width))));
    }
    for (int step = kWarp / 2; step > 0; step /= 2) own = max(own, __shfl_xor_sync(0xffffffffu, own, step));
    if (threadIdx.x % kWarp == 0 && own > 0u) atomicMax(bound, own);
}

template <bool Light>
__global__ void shadeBackwardKernel(ShadingGradientArguments a, LightSums light, int bits) {
    const int column = static_cast<int>(blockIdx.x) * kTileWidth + static_cast<int>(threadIdx.x);
    const int row = static_cast<int>(blockIdx.y) * kTileHeight + static_cast<int>(threadIdx.y);
    if (column >= a.shading.width || row >= a.shading.height) return;
    if constexpr (Light) {
        const float bound = __uint_as_float(*light.bound);
        const double steps = isFiniteNumber(bound) ? fixedPointSteps(bound, bits) : 0.0;
        shadePixelBackward(a, row, column, &light.layout, [&](std::size_t place, float value) {
            if (steps == 0.0) return; // the result will be NaN
            const long long number = toFixedPoint(value, steps);
            // Two's complement: adding as unsigned is adding.
            if (number != 0) {
                atomicAdd(reinterpret_cast<unsigned long long*>(light.sums + place),
                          static_cast<unsigned long long>(number));
            }
        });
    } else {
        shadePixelBackward(a, row, column, nullptr, [](std::size_t, float) {});
    }
}

__global__ void fromFixedPointKernel(const long long* sums, float* values, std::size_t count, const unsigned int* bound,
                                     int bits) {
    const std::size_t i = blockIdx.x * static_cast<std::size_t>(kBlock) + threadIdx.x;
    if (i < count) values[i] = fromFixedPoint(sums[i], __uint_as_float(*bound), bits);
}

Status cudaStatus(cudaError_t code) { return statusOf(code, "shading gradient"); }

unsigned blocksFor(std::size_t threads) { return static_cast<unsigned>((threads + kBlock - 1) / kBlock); }

Status prepareSums(const ShadingGradientArguments& arguments, std::size_t pixels, const LightSums& light) {
    ARS_TRY_STATUS(cudaStatus(cudaMemsetAsync(light.bound, 0, sizeof(unsigned int))));
    ARS_TRY_STATUS(cudaStatus(cudaMemsetAsync(light.sums, 0, light.layout.count * sizeof(long long))));
    boundKernel<<<blocksFor(pixels), kBlock>>>(arguments, pixels, light.bound);
    return cudaStatus(cudaGetLastError());
}

Status writeSums(const LightSums& light, int bits, const LightLevelViews<float>& gradLight) {
    for (int l = 0; l <= light.layout.levels; ++l) {
        const ImageView<float>& target =
            l < light.layout.levels ? gradLight.specular[static_cast<std::size_t>(l)] : gradLight.diffuse;
        const std::size_t count = target.valueCount();
        fromFixedPointKernel<<<blocksFor(count), kBlock>>>(light.sums + light.layout.start[l], target.data, count,
                                                           light.bound, bits);
        ARS_TRY_STATUS(cudaStatus(cudaGetLastError()));
    }
    return {};
}

} // namespace

Status shadeBackward(const ShadingGradientArguments& arguments, const LightSums* light,
                     const LightLevelViews<float>& gradLight, int index) {
    ARS_TRY_STATUS(cudaStatus(cudaSetDevice(index)));
    const ShadingArguments& shading = arguments.shading;
    const std::size_t pixels = static_cast<std::size_t>(shading.width) * static_cast<std::size_t>(shading.height);
    const int bits = fixedPointBits(pixels);
    const dim3 blocks(static_cast<unsigned>((shading.width + kTileWidth - 1) / kTileWidth),
                      static_cast<unsigned>((shading.height + kTileHeight - 1) / kTileHeight));
    if (!light) {
        shadeBackwardKernel<false><<<blocks, dim3(kTileWidth, kTileHeight)>>>(arguments, LightSums{}, bits);
        return cudaStatus(cudaGetLastError());
    }
    ARS_TRY_STATUS(prepareSums(arguments, pixels, *light));
    shadeBackwardKernel<true><<<blocks, dim3(kTileWidth, kTileHeight)>>>(arguments, *light, bits);
    ARS_TRY_STATUS(cudaStatus(cudaGetLastError()));
    return writeSums(*light, bits, gradLight);
}

} // namespace ars::cuda
