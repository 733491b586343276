#include "engine/core/buffer_cuda.h"

#include "engine/core/cuda_status.cuh"

namespace ars::cuda {
namespace {

Status check(cudaError_t code, const char* what) { return statusOf(code, "CUDA", what); }

} // namespace

int deviceCount() {
    int count = 0;
    // No driver, an old driver and no card all mean the same here: no device.
    if (cudaGetDeviceCount(&count) != cudaSuccess) {
        (void)cudaGetLastError();
        return 0;
    }
    return count;
}

Result<void*> allocate(int device, std::size_t bytes) {
    ARS_TRY_STATUS(check(cudaSetDevice(device), "selecting the device"));
    void* data = nullptr;
    ARS_TRY_STATUS(check(cudaMalloc(&data, bytes), "allocating"));
    return data;
}

void release(int device, void* data) noexcept {
    (void)cudaSetDevice(device);
    (void)cudaFree(data);
    (void)cudaGetLastError(); // nobody is told, so nobody else shall be blamed
}

Status copy(void* destination, const Device& destinationDevice, const void* source, const Device& sourceDevice,
            std::size_t bytes) {
    const bool toHost = destinationDevice.kind == DeviceKind::Host;
    const bool fromHost = sourceDevice.kind == DeviceKind::Host;
    ARS_TRY_STATUS(check(cudaSetDevice(toHost ? sourceDevice.index : destinationDevice.index), "selecting the device"));
    if (!toHost && !fromHost && destinationDevice.index != sourceDevice.index) {
        ARS_TRY_STATUS(check(cudaMemcpyPeer(destination, destinationDevice.index, source, sourceDevice.index, bytes),
                             "copying between devices"));
        return check(cudaDeviceSynchronize(), "copying between devices");
    }
    const cudaMemcpyKind kind = toHost     ? cudaMemcpyDeviceToHost
                                : fromHost ? cudaMemcpyHostToDevice
                                           : cudaMemcpyDeviceToDevice;
    ARS_TRY_STATUS(check(cudaMemcpy(destination, source, bytes, kind), "copying"));
    return check(cudaDeviceSynchronize(), "copying");
}

Result<MemoryInfo> memory(int device) {
    ARS_TRY_STATUS(check(cudaSetDevice(device), "selecting the device"));
    std::size_t freeBytes = 0, totalBytes = 0;
    ARS_TRY_STATUS(check(cudaMemGetInfo(&freeBytes, &totalBytes), "asking for the memory"));
    return MemoryInfo{freeBytes, totalBytes};
}

Status wait(int device) {
    ARS_TRY_STATUS(check(cudaSetDevice(device), "selecting the device"));
    return check(cudaDeviceSynchronize(), "waiting for the device");
}

} // namespace ars::cuda
