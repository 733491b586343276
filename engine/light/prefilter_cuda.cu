// GLM asks for CUDA_VERSION before anything else.
#include <cuda.h>
#include <cuda_runtime.h>

// GLM marks defaulted constructors for the device, which nvcc remarks on a hundred times.
#pragma nv_diag_suppress 20012

#include "engine/core/cuda_status.cuh"
#include "engine/light/prefilter_kernels.h"
#include "engine/light/prefilter_math.h"

namespace ars::cuda {
namespace {

constexpr int kBlock = 128;
/// Levels with fewer texels are filtered by a warp each: a thread each would leave most of the device idle.
constexpr std::size_t kThreadPerTexel = 200000;

__global__ void averagePoolKernel(const float* source, float* target, std::size_t width, std::size_t count) {
    const std::size_t i = blockIdx.x * static_cast<std::size_t>(kBlock) + threadIdx.x;
    if (i >= count) return;
    const std::size_t row = i / (3 * width), x = i % (3 * width);
    const float* upper = source + row * 12 * width + x / 3 * 6 + x % 3;
    const float* lower = upper + 6 * width;
    target[i] = 0.25f * (upper[0] + upper[3] + lower[0] + lower[3]);
}

/// Sums over the lanes of one texel; every lane gets the sum.
template <int Lanes>
__device__ float sumLanes(float value) {
    if constexpr (Lanes > 1) {
        for (int step = Lanes / 2; step > 0; step /= 2) value += __shfl_xor_sync(0xffffffffu, value, step);
    }
    return value;
}

/// Unit direction of texel `i` of the target, and the face that it lies on.
__device__ glm::vec3 texelDirection(std::size_t i, int size, int& face) {
    const std::size_t n = static_cast<std::size_t>(size);
    face = static_cast<int>(i / (n * n));
    const float u = texelCoordinate<float>(static_cast<int>(i % n), size);
    const float v = texelCoordinate<float>(static_cast<int>(i / n % n), size);
    const glm::vec3 d = cubeDirection<float>(face, u, v);
    return d * (1.0f / sqrtf(glm::dot(d, d)));
}

template <int Lanes>
__global__ void specularKernel(FilterArguments a, std::size_t texels) {
    const std::size_t thread = blockIdx.x * static_cast<std::size_t>(kBlock) + threadIdx.x;
    const std::size_t i = thread / Lanes;
    const int lane = static_cast<int>(thread % Lanes);
    // Whole warps leave together: Lanes divides both the block and a warp, and a texel's lanes share i.
    if (i >= texels) return;
    int ownFace = 0;
    const glm::vec3 axis = texelDirection(i, a.target.width, ownFace);
    const int size = a.source.width;
    const float cosine = a.cutoffCosine, sine = sqrtf(1.0f - cosine * cosine);
    glm::vec3 sum(0.0f);
    float weights = 0.0f;
    for (int k = 0; k < 6; ++k) {
        // The texel's own face first: a cone that ends inside it touches no other.
        const int face = (ownFace + k) % 6;
        ConeSpan span;
        if (!coneSpan(axis, cosine, sine, face, size, span)) continue;
        for (int y = span.y0; y < span.y1; ++y) {
            const float v = texelCoordinate<float>(y, size);
            const std::size_t row = static_cast<std::size_t>(y) * static_cast<std::size_t>(size);
            const std::size_t line =
                static_cast<std::size_t>(face) * static_cast<std::size_t>(size) * static_cast<std::size_t>(size) + row;
            for (int x = span.x0 + lane; x < span.x1; x += Lanes) {
                const std::size_t column = static_cast<std::size_t>(x);
                const float w = specularTexelWeight(span.right, span.down, span.major, texelCoordinate<float>(x, size),
                                                    v, a.areas[row + column], a.alphaSquared, cosine);
                const float* texel = a.source.data + 3 * (line + column);
                sum += w * glm::vec3(texel[0], texel[1], texel[2]);
                weights += w;
            }
        }
        if (k == 0 && span.x0 > 0 && span.y0 > 0 && span.x1 < size && span.y1 < size) break;
    }
    const float total = sumLanes<Lanes>(weights);
    for (int c = 0; c < 3; ++c) {
        const float value = sumLanes<Lanes>(sum[c]);
        if (lane == 0) a.target.data[3 * i + static_cast<std::size_t>(c)] = total > 0.0f ? value / total : 0.0f;
    }
}

__global__ void diffuseKernel(FilterArguments a, std::size_t texels) {
    constexpr int kLanes = 32;
    const std::size_t thread = blockIdx.x * static_cast<std::size_t>(kBlock) + threadIdx.x;
    const std::size_t i = thread / kLanes;
    if (i >= texels) return;
    const int lane = static_cast<int>(thread % kLanes);
    int face = 0;
    const glm::vec3 axis = texelDirection(i, a.target.width, face);
    const std::size_t area = static_cast<std::size_t>(a.source.width) * static_cast<std::size_t>(a.source.width);
    glm::vec3 sum(0.0f);
    for (std::size_t s = static_cast<std::size_t>(lane); s < 6 * area; s += kLanes) {
        const glm::vec3 direction = texelDirection(s, a.source.width, face);
        const float w = diffuseTexelWeight(glm::dot(axis, direction), a.areas[s % area]);
        sum += w * glm::vec3(a.source.data[3 * s], a.source.data[3 * s + 1], a.source.data[3 * s + 2]);
    }
    for (int c = 0; c < 3; ++c) {
        const float value = sumLanes<kLanes>(sum[c]);
        if (lane == 0) a.target.data[3 * i + static_cast<std::size_t>(c)] = value;
    }
}

Status cudaStatus(cudaError_t code) { return statusOf(code, "light"); }

unsigned blocksFor(std::size_t threads) { return static_cast<unsigned>((threads + kBlock - 1) / kBlock); }

} // namespace

Status averagePool(ImageView<const float> source, ImageView<float> target, int index) {
    ARS_TRY_STATUS(cudaStatus(cudaSetDevice(index)));
    const std::size_t count = target.valueCount();
    averagePoolKernel<<<blocksFor(count), kBlock>>>(source.data, target.data, static_cast<std::size_t>(target.width),
                                                    count);
    return cudaStatus(cudaGetLastError());
}

Status filterSpecular(const FilterArguments& arguments, int index) {
    ARS_TRY_STATUS(cudaStatus(cudaSetDevice(index)));
    const std::size_t texels = arguments.target.pixelCount();
    if (texels >= kThreadPerTexel) {
        specularKernel<1><<<blocksFor(texels), kBlock>>>(arguments, texels);
    } else {
        specularKernel<32><<<blocksFor(32 * texels), kBlock>>>(arguments, texels);
    }
    return cudaStatus(cudaGetLastError());
}

Status filterDiffuse(const FilterArguments& arguments, int index) {
    ARS_TRY_STATUS(cudaStatus(cudaSetDevice(index)));
    const std::size_t texels = arguments.target.pixelCount();
    diffuseKernel<<<blocksFor(32 * texels), kBlock>>>(arguments, texels);
    return cudaStatus(cudaGetLastError());
}

} // namespace ars::cuda
