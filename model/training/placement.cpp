#include "model/training/placement.h"

#include <ATen/ATen.h>
#include <torch/cuda.h>

namespace ars {
namespace {

Error noDevice(std::string message) {
    return makeError(ErrorCode::Unavailable, "run.device", "is cuda, but " + std::move(message));
}

/// Other handles of the same tensor, the networks' and autograd's, follow.
void moveLeaf(const at::Tensor& leaf, const c10::Device& device) {
    if (!leaf.defined() || leaf.device() == device) return;
    at::Tensor handle = leaf;
    handle.set_data(leaf.detach().to(device));
}

void copyLeaf(at::Tensor& into, const at::Tensor& from) {
    if (from.defined()) into = from.detach().cpu().set_requires_grad(from.requires_grad());
}

} // namespace

TrainingDevices trainingDevices() { return {availableDevices().size() > 1, torch::cuda::is_available()}; }

Result<Device> trainingDevice(RunDevice wanted, const TrainingDevices& devices) {
    const Device first{DeviceKind::Cuda, 0};
    if (wanted == RunDevice::Cpu) return Device{};
    if (devices.engine && devices.torch) return first;
    if (wanted == RunDevice::Auto) return Device{};
    if (!devices.engine) return noDevice("no CUDA device answers this program; expected auto or cpu");
    return noDevice("this LibTorch has no CUDA kernels for it; expected auto or cpu, or a LibTorch with CUDA");
}

void placeState(LearnedState& state, const c10::Device& device) {
    AvatarModel& model = state.model;
    for (const NetworkTensor& entry : model.network->tensors().all()) moveLeaf(entry.tensor, device);
    SurfelBase& base = model.base;
    for (at::Tensor* fixed : {&base.points, &base.rotations, &base.logScales, &model.pixels}) {
        if (fixed->defined()) *fixed = fixed->to(device);
    }
    for (const at::Tensor& leaf : {base.geometry, base.materials, base.colors, state.lightLog, state.radiusOffsets}) {
        moveLeaf(leaf, device);
    }
}

Result<AvatarModel> modelOnHost(const AvatarModel& model) {
    if (model.pixels.is_cpu()) return model;
    AvatarModel host = model;
    ARS_TRY(AvatarNetwork network, AvatarNetwork::create(model.spec.network, 0));
    const at::NoGradGuard noGradient;
    const std::vector<NetworkTensor>& from = model.network->tensors().all();
    std::vector<NetworkTensor>& to = network.tensors().all();
    for (std::size_t i = 0; i < to.size(); ++i) to[i].tensor.copy_(from[i].tensor);
    host.network = std::make_shared<AvatarNetwork>(std::move(network));
    SurfelBase& base = host.base;
    for (at::Tensor* tensor : {&base.points, &base.rotations, &base.logScales, &base.geometry, &base.materials,
                               &base.colors, &host.pixels}) {
        copyLeaf(*tensor, *tensor);
    }
    return host;
}

} // namespace ars
