#include "engine/gl/device_texture_cuda.h"

#include "engine/core/cuda_status.cuh"

#include <GL/gl.h>

#include <cuda_gl_interop.h>
#include <cuda_runtime.h>

namespace ars::cuda {
namespace {

Status check(cudaError_t code, const char* what) { return statusOf(code, "CUDA with OpenGL", what); }

__global__ void writeOne(cudaSurfaceObject_t surface, const float* values, int width, int height) {
    const int x = static_cast<int>(blockIdx.x * blockDim.x + threadIdx.x);
    const int y = static_cast<int>(blockIdx.y * blockDim.y + threadIdx.y);
    if (x >= width || y >= height) return;
    const std::size_t pixel =
        static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x);
    surf2Dwrite(values[pixel], surface, x * static_cast<int>(sizeof(float)), y);
}

__global__ void writeFour(cudaSurfaceObject_t surface, const float* values, int channels, int width, int height) {
    const int x = static_cast<int>(blockIdx.x * blockDim.x + threadIdx.x);
    const int y = static_cast<int>(blockIdx.y * blockDim.y + threadIdx.y);
    if (x >= width || y >= height) return;
    const std::size_t pixel =
        static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x);
    const float* v = values + pixel * static_cast<std::size_t>(channels);
    surf2Dwrite(make_float4(v[0], v[1], v[2], channels == 4 ? v[3] : 1.0f), surface,
                x * static_cast<int>(sizeof(float4)), y);
}

Status launch(cudaArray_t array, ImageView<const float> picture) {
    cudaResourceDesc description{};
    description.resType = cudaResourceTypeArray;
    description.res.array.array = array;
    cudaSurfaceObject_t surface = 0;
    ARS_TRY_STATUS(check(cudaCreateSurfaceObject(&surface, &description), "opening the texture"));
    const dim3 block(32, 8);
    const dim3 grid(static_cast<unsigned>((picture.width + 31) / 32), static_cast<unsigned>((picture.height + 7) / 8));
    if (picture.channels == 1) {
        writeOne<<<grid, block>>>(surface, picture.data, picture.width, picture.height);
    } else {
        writeFour<<<grid, block>>>(surface, picture.data, picture.channels, picture.width, picture.height);
    }
    const Status launched = check(cudaGetLastError(), "writing the texture");
    (void)cudaDestroySurfaceObject(surface);
    return launched;
}

} // namespace

Result<void*> registerTexture(int device, unsigned texture) {
    ARS_TRY_STATUS(check(cudaSetDevice(device), "selecting the device"));
    cudaGraphicsResource* resource = nullptr;
    const unsigned flags = cudaGraphicsRegisterFlagsSurfaceLoadStore | cudaGraphicsRegisterFlagsWriteDiscard;
    ARS_TRY_STATUS(check(cudaGraphicsGLRegisterImage(&resource, texture, GL_TEXTURE_2D, flags), "sharing a texture"));
    return static_cast<void*>(resource);
}

void unregisterTexture(void* resource) noexcept {
    (void)cudaGraphicsUnregisterResource(static_cast<cudaGraphicsResource*>(resource));
    (void)cudaGetLastError(); // nobody is told, so nobody else shall be blamed
}

Status writeTexture(int device, void* resource, ImageView<const float> picture) {
    ARS_TRY_STATUS(check(cudaSetDevice(device), "selecting the device"));
    auto* shared = static_cast<cudaGraphicsResource*>(resource);
    ARS_TRY_STATUS(check(cudaGraphicsMapResources(1, &shared), "taking the texture"));
    cudaArray_t array = nullptr;
    const Status written = [&]() -> Status {
        ARS_TRY_STATUS(check(cudaGraphicsSubResourceGetMappedArray(&array, shared, 0, 0), "finding the texture"));
        return launch(array, picture);
    }();
    const Status returned = check(cudaGraphicsUnmapResources(1, &shared), "giving the texture back");
    return written.ok() ? returned : written;
}

Status download(int device, void* host, const void* source, std::size_t bytes) {
    ARS_TRY_STATUS(check(cudaSetDevice(device), "selecting the device"));
    return check(cudaMemcpy(host, source, bytes, cudaMemcpyDeviceToHost), "copying a picture");
}

} // namespace ars::cuda
