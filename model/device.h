#pragma once

#include "engine/core/buffer.h"

#include <ATen/core/Tensor.h>

namespace ars {

/// A tensor's device, the host or CUDA, in the words of engine/, and back.
///
/// Engine and LibTorch queue their work on the same stream, the legacy default one (LibTorch's default unless somebody
/// sets another, which nobody here does): what one has queued is done before what the other queues next, and memory
/// that LibTorch's allocator hands out again is used in that order, too.
Device deviceOf(const at::Tensor& tensor);
c10::Device torchDevice(const Device& device);

} // namespace ars
