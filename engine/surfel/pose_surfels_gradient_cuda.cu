// GLM asks for CUDA_VERSION before anything else.
#include <cuda.h>
#include <cuda_runtime.h>

// GLM marks defaulted constructors for the device, which nvcc remarks on a hundred times.
#pragma nv_diag_suppress 20012

#include "engine/core/cuda_status.cuh"
#include "engine/surfel/pose_surfels_gradient_kernels.h"
#include "engine/surfel/pose_surfels_gradient_math.h"

namespace ars::cuda {
namespace {

constexpr int kBlock = 256;
/// Blocks that sum the radii. Fixed, like everything else about these sums: the same input gives the same bits.
constexpr int kRadiusBlocks = 64;

__global__ void geometryKernel(PoseSurfelsGradientArrays a) {
    const std::size_t i = blockIdx.x * static_cast<std::size_t>(kBlock) + threadIdx.x;
    if (i < a.count) backwardPosedSurfel(a, i);
}

/// Each thread sums every kRadiusBlocks * kBlock-th surfel; the threads of a block meet in a tree.
__global__ void __launch_bounds__(kBlock) sumRadiiKernel(PoseSurfelsGradientArrays a, double* blockSums) {
    __shared__ double shared[kBodyPartCount][kBlock];
    double sums[kBodyPartCount] = {};
    const std::size_t step = static_cast<std::size_t>(kRadiusBlocks) * kBlock;
    for (std::size_t i = blockIdx.x * static_cast<std::size_t>(kBlock) + threadIdx.x; i < a.count; i += step) {
        addPartRadii(a, i, sums);
    }
    for (int g = 0; g < kBodyPartCount; ++g) shared[g][threadIdx.x] = sums[g];
    for (unsigned half = kBlock / 2; half > 0; half /= 2) {
        __syncthreads();
        if (threadIdx.x >= half) continue;
        for (int g = 0; g < kBodyPartCount; ++g) shared[g][threadIdx.x] += shared[g][threadIdx.x + half];
    }
    __syncthreads();
    if (threadIdx.x < kBodyPartCount) {
        blockSums[blockIdx.x * static_cast<unsigned>(kBodyPartCount) + threadIdx.x] = shared[threadIdx.x][0];
    }
}

__global__ void finishRadiiKernel(const double* blockSums, float* radii) {
    if (threadIdx.x >= kBodyPartCount) return;
    double sum = 0.0;
    for (int block = 0; block < kRadiusBlocks; ++block) sum += blockSums[block * kBodyPartCount + threadIdx.x];
    radii[threadIdx.x] = static_cast<float>(sum);
}

Status cudaStatus(cudaError_t code) { return statusOf(code, "posing gradient"); }

} // namespace

Status poseSurfelsBackward(const PoseSurfelsGradientArrays& a, PoseGradientWorkspace& workspace, const Device& device) {
    ARS_TRY_STATUS(cudaStatus(cudaSetDevice(device.index)));
    const auto blocks = static_cast<unsigned>((a.count + kBlock - 1) / kBlock);
    if (blocks > 0 && (a.posedMeans || a.posedRotations)) {
        geometryKernel<<<blocks, kBlock>>>(a);
        ARS_TRY_STATUS(cudaStatus(cudaGetLastError()));
    }
    if (!a.posedRadii) return {};
    Buffer& sums = workspace.sums;
    if (!sums.data() || !(sums.device() == device)) {
        ARS_TRY(sums, Buffer::allocate(device, kRadiusBlocks * kBodyPartCount * sizeof(double),
                                       "posing gradient: sums of radii"));
    }
    auto* blockSums = static_cast<double*>(sums.data());
    sumRadiiKernel<<<kRadiusBlocks, kBlock>>>(a, blockSums);
    finishRadiiKernel<<<1, 32>>>(blockSums, a.partRadii);
    return cudaStatus(cudaGetLastError());
}

} // namespace ars::cuda
