// GLM asks for CUDA_VERSION before anything else.
#include <cuda.h>
#include <cuda_runtime.h>

// GLM marks defaulted constructors for the device, which nvcc remarks on a hundred times.
#pragma nv_diag_suppress 20012

#include "engine/core/cuda_status.cuh"
#include "engine/shade/shading_kernels.h"

namespace ars::cuda {
namespace {

/// Tiles, so that the lanes of a warp look up neighbouring texels.
constexpr int kTileWidth = 16, kTileHeight = 8;

__global__ void shadeKernel(ShadingArguments a) {
    const int column = static_cast<int>(blockIdx.x) * kTileWidth + static_cast<int>(threadIdx.x);
    const int row = static_cast<int>(blockIdx.y) * kTileHeight + static_cast<int>(threadIdx.y);
    if (column < a.width && row < a.height) shadePixel(a, row, column);
}

Status cudaStatus(cudaError_t code) { return statusOf(code, "shading"); }

} // namespace

Status shade(const ShadingArguments& arguments, int index) {
    ARS_TRY_STATUS(cudaStatus(cudaSetDevice(index)));
    const dim3 blocks(static_cast<unsigned>((arguments.width + kTileWidth - 1) / kTileWidth),
                      static_cast<unsigned>((arguments.height + kTileHeight - 1) / kTileHeight));
    shadeKernel<<<blocks, dim3(kTileWidth, kTileHeight)>>>(arguments);
    return cudaStatus(cudaGetLastError());
}

} // namespace ars::cuda
