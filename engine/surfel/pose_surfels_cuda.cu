// GLM asks for CUDA_VERSION before anything else.
#include <cuda.h>
#include <cuda_runtime.h>

// GLM marks defaulted constructors for the device, which nvcc remarks on a hundred times.
#pragma nv_diag_suppress 20012

#include "engine/core/cuda_status.cuh"
#include "engine/surfel/pose_surfels_kernels.h"
#include "engine/surfel/pose_surfels_math.h"

namespace ars::cuda {
namespace {

constexpr int kBlock = 256;

/// The steps' parameters as a kernel takes them.
struct Steps {
    float importanceFalloffM;
    float radiusStepFraction;
    float minRadiusStepM;
};

/// Influences of surfel i in registers, those of joints that do not exist and of weight 0 left out.
struct LocalInfluences {
    std::uint16_t joints[kMaxInfluences];
    float weights[kMaxInfluences];
    int count = 0;
};

__device__ LocalInfluences readInfluences(const PoseSurfelsArrays& a, std::size_t i) {
    // The 16 bytes of indices and 32 of weights of a surfel are read whole; both arrays are aligned to 16 bytes.
    const uint4 packed = reinterpret_cast<const uint4*>(a.joints)[i];
    const float4 low = reinterpret_cast<const float4*>(a.weights)[2 * i];
    const float4 high = reinterpret_cast<const float4*>(a.weights)[2 * i + 1];
    const std::uint32_t pairs[4] = {packed.x, packed.y, packed.z, packed.w};
    const float weights[kMaxInfluences] = {low.x, low.y, low.z, low.w, high.x, high.y, high.z, high.w};
    LocalInfluences result;
#pragma unroll
    for (int k = 0; k < kMaxInfluences; ++k) {
        const std::uint32_t joint = (pairs[k / 2] >> (16 * (k % 2))) & 0xffffu;
        // Fixed places keep the arrays in registers; what is left out weighs nothing at joint 0.
        const bool counts = joint < a.jointCount && weights[k] != 0.0f;
        result.joints[k] = counts ? static_cast<std::uint16_t>(joint) : std::uint16_t{0};
        result.weights[k] = counts ? weights[k] : 0.0f;
        if (counts) result.count = k + 1;
    }
    return result;
}

__global__ void poseSurfelsKernel(PoseSurfelsArrays a, Steps steps) {
    const std::size_t i = blockIdx.x * static_cast<std::size_t>(kBlock) + threadIdx.x;
    if (i >= a.count) return;
    const LocalInfluences local = readInfluences(a, i);
    const Influences<float> influences{local.joints, local.weights, local.count};
    if (a.radii) {
        const float radius = blendedRadius(influences, a.jointRadii);
        const float step = radiusStep(radius, steps.radiusStepFraction, steps.minRadiusStepM);
        a.radii[i] = radius;
        if (a.radiiPlus) a.radiiPlus[i] = radius + step;
        if (a.radiiMinus) a.radiiMinus[i] = radius - step;
    }
    if (!a.posedMeans) return;

    Affine<float> blend = {};
    for (int k = 0; k < local.count; ++k) {
        const Affine<float> one = affineFrom<float>(a.matrices[local.joints[k]]);
        for (int r = 0; r < 3; ++r) blend.row[r] += local.weights[k] * one.row[r];
    }
    const float* q = a.rotations + 4 * i;
    const PosedSurfel<float> posed = posedSurfel(blend, a.means[i], glm::quat(q[0], q[1], q[2], q[3]));
    a.posedMeans[i] = posed.mean;
    float* turned = a.posedRotations + 4 * i;
    turned[0] = posed.rotation.w;
    turned[1] = posed.rotation.x;
    turned[2] = posed.rotation.y;
    turned[3] = posed.rotation.z;
    if (a.bones) a.bones[i] = posed.bone;
    if (a.importances) {
        a.importances[i] =
            surfelImportance(influences, posed.mean, a.jointPositions, a.jointInitialRadii, steps.importanceFalloffM);
    }
}

Status cudaStatus(cudaError_t code) { return statusOf(code, "pose surfels"); }

} // namespace

Status poseSurfels(const PoseSurfelsParams& params, const PoseSurfelsArrays& arrays, int index) {
    ARS_TRY_STATUS(cudaStatus(cudaSetDevice(index)));
    const auto blocks = static_cast<unsigned>((arrays.count + kBlock - 1) / kBlock);
    if (blocks == 0) return {};
    poseSurfelsKernel<<<blocks, kBlock>>>(
        arrays, {params.importanceFalloffM, params.radiusStepFraction, params.minRadiusStepM});
    return cudaStatus(cudaGetLastError());
}

} // namespace ars::cuda
