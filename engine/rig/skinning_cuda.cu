// GLM asks for CUDA_VERSION before anything else.
#include <cuda.h>
#include <cuda_runtime.h>

// GLM marks defaulted constructors for the device, which nvcc remarks on a hundred times.
#pragma nv_diag_suppress 20012

#include "engine/core/cuda_status.cuh"
#include "engine/rig/skinning.h"
#include "engine/rig/skinning_kernels.h"

namespace ars::cuda {
namespace {

constexpr int kBlock = 256;

__global__ void skinKernel(SkinArguments a) {
    const std::size_t i = blockIdx.x * static_cast<std::size_t>(kBlock) + threadIdx.x;
    if (i >= a.pointCount) return;
    // The 16 bytes of indices and 32 of weights of a point are read whole; cudaMalloc aligns both arrays.
    const uint4 packed = reinterpret_cast<const uint4*>(a.joints)[i];
    const float4 low = reinterpret_cast<const float4*>(a.weights)[2 * i];
    const float4 high = reinterpret_cast<const float4*>(a.weights)[2 * i + 1];
    const std::uint32_t pairs[4] = {packed.x, packed.y, packed.z, packed.w};
    const float weights[kMaxInfluences] = {low.x, low.y, low.z, low.w, high.x, high.y, high.z, high.w};

    Affine<float> blend = {};
#pragma unroll
    for (int k = 0; k < kMaxInfluences; ++k) {
        const std::uint32_t joint = (pairs[k / 2] >> (16 * (k % 2))) & 0xffffu;
        if (joint >= a.jointCount || weights[k] == 0.0f) continue;
        const Affine<float> one = affineFrom<float>(a.matrices[joint]);
        for (int r = 0; r < 3; ++r) blend.row[r] += weights[k] * one.row[r];
    }
    a.points[i] = transformPoint(blend, a.restPoints[i]);
    if (a.normals) a.normals[i] = rotateNormal(polarRotation(blend), a.restNormals[i]);
}

Status cudaStatus(cudaError_t code) { return statusOf(code, "skinning"); }

} // namespace

Status skin(const SkinArguments& arguments, int index) {
    ARS_TRY_STATUS(cudaStatus(cudaSetDevice(index)));
    const auto blocks = static_cast<unsigned>((arguments.pointCount + kBlock - 1) / kBlock);
    if (blocks == 0) return {};
    skinKernel<<<blocks, kBlock>>>(arguments);
    return cudaStatus(cudaGetLastError());
}

} // namespace ars::cuda
