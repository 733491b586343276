#pragma once

#include "engine/core/image_view.h"

/// What device_texture.cpp needs of CUDA; defined in device_texture_cuda.cu, so that no other file of gl sees CUDA.
namespace ars::cuda {

/// Makes a texture (GL_TEXTURE_2D, R32F or RGBA32F) writable from a CUDA device. Unavailable where the context is not
/// on that card.
Result<void*> registerTexture(int device, unsigned texture);
void unregisterTexture(void* resource) noexcept;
/// Writes a picture that lies on `device` into a registered texture of its size: R of one channel, else RGBA. Queued
/// behind what the device does; OpenGL sees it in order.
Status writeTexture(int device, void* resource, ImageView<const float> picture);
/// Bytes from the device to host memory; waits.
Status download(int device, void* host, const void* source, std::size_t bytes);

} // namespace ars::cuda
