// GLM asks for CUDA_VERSION before anything else.
#include <cuda.h>
#include <cuda_runtime.h>

// GLM marks defaulted constructors for the device, which nvcc remarks on a hundred times.
#pragma nv_diag_suppress 20012

#include "engine/core/cuda_status.cuh"
#include "engine/shade/tone_gradient_kernels.h"

namespace ars::cuda {
namespace {

constexpr int kBlock = 256;

__global__ void toneGradientKernel(ToneGradientArguments a) {
    const std::size_t i = blockIdx.x * static_cast<std::size_t>(kBlock) + threadIdx.x;
    if (i < a.pixels) toneGradientPixel(a, i);
}

Status cudaStatus(cudaError_t code) { return statusOf(code, "tone gradient"); }

} // namespace

Status toneMapBackward(const ToneGradientArguments& arguments, int index) {
    ARS_TRY_STATUS(cudaStatus(cudaSetDevice(index)));
    const auto blocks = static_cast<unsigned>((arguments.pixels + kBlock - 1) / kBlock);
    toneGradientKernel<<<blocks, kBlock>>>(arguments);
    return cudaStatus(cudaGetLastError());
}

} // namespace ars::cuda
