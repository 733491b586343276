#include "model/device.h"

#include <cassert>

namespace ars {

Device deviceOf(const at::Tensor& tensor) {
    assert(tensor.is_cpu() || tensor.is_cuda());
    if (tensor.is_cpu()) return {};
    return {DeviceKind::Cuda, tensor.device().index()};
}

c10::Device torchDevice(const Device& device) {
    if (device.kind == DeviceKind::Host) return c10::kCPU;
    return {c10::kCUDA, static_cast<c10::DeviceIndex>(device.index)};
}

} // namespace ars
