#pragma once

#include "engine/core/buffer.h"

/// What buffer.cpp needs of the CUDA runtime; defined in buffer_cuda.cu, so that no other file of core sees CUDA.
namespace ars::cuda {

int deviceCount();
Result<void*> allocate(int device, std::size_t bytes);
void release(int device, void* data) noexcept;
Status copy(void* destination, const Device& destinationDevice, const void* source, const Device& sourceDevice,
            std::size_t bytes);
Result<MemoryInfo> memory(int device);
Status wait(int device);

} // namespace ars::cuda
