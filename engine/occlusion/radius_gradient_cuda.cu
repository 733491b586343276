#include <cuda_runtime.h>

#include "engine/core/cuda_status.cuh"
#include "engine/occlusion/radius_gradient_kernels.h"

namespace ars::cuda {
namespace {

constexpr int kBlock = 256;

__global__ void radiusGradientKernel(RadiusGradientArguments a) {
    const std::size_t p = blockIdx.x * static_cast<std::size_t>(kBlock) + threadIdx.x;
    if (p < a.pixels) radiusGradientPixel(a, p);
}

Status cudaStatus(cudaError_t code) { return statusOf(code, "radius gradient"); }

} // namespace

Status backwardRadius(const RadiusGradientArguments& arguments, int index) {
    ARS_TRY_STATUS(cudaStatus(cudaSetDevice(index)));
    const auto blocks = static_cast<unsigned>((arguments.pixels + kBlock - 1) / kBlock);
    radiusGradientKernel<<<blocks, kBlock>>>(arguments);
    return cudaStatus(cudaGetLastError());
}

} // namespace ars::cuda
