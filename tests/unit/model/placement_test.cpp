// Where a training runs. Most of it can be seen on a machine without a GPU: the choice, the refusals, what the placing
// and the optimiser do by whichever path.
#include "model/training/placement.h"

#include "engine/io/safetensors.h"
#include "model/device.h"
#include "model/training/adam_chain.h"

#include <gtest/gtest.h>
#include <torch/torch.h>

namespace ars {
namespace {

TEST(Placement, TheDeviceIsChosenWhereEngineAndLibTorchBothHaveIt) {
    const Device first{DeviceKind::Cuda, 0};
    const TrainingDevices both{true, true}, none{false, false};
    EXPECT_EQ(trainingDevice(RunDevice::Auto, both).value(), first);
    EXPECT_EQ(trainingDevice(RunDevice::Cuda, both).value(), first);
    EXPECT_EQ(trainingDevice(RunDevice::Cpu, both).value(), Device{});
    for (const TrainingDevices& lacking : {none, TrainingDevices{true, false}, TrainingDevices{false, true}}) {
        EXPECT_EQ(trainingDevice(RunDevice::Auto, lacking).value(), Device{});
        EXPECT_EQ(trainingDevice(RunDevice::Cpu, lacking).value(), Device{});
        const Result<Device> refused = trainingDevice(RunDevice::Cuda, lacking);
        ASSERT_FALSE(refused.ok());
        EXPECT_EQ(refused.error().code, ErrorCode::Unavailable);
    }
    EXPECT_EQ(trainingDevice(RunDevice::Cuda, none).error().describe(),
              "run.device: is cuda, but no CUDA device answers this program; expected auto or cpu");
    EXPECT_NE(trainingDevice(RunDevice::Cuda, {true, false}).error().describe().find("LibTorch has no CUDA kernels"),
              std::string::npos);
}

TEST(Placement, ADeviceInTheWordsOfBoth) {
    EXPECT_EQ(torchDevice({}), at::Device(at::kCPU));
    EXPECT_EQ(torchDevice({DeviceKind::Cuda, 3}), at::Device(at::kCUDA, 3));
    EXPECT_EQ(deviceOf(at::zeros({2})), Device{});
}

// On the host placing moves nothing, and what evaluators get is the model itself.
TEST(Placement, WhatLiesThereStaysWhereItIs) {
    LearnedState state;
    AvatarNetworkConfig config;
    config.inputSize = 64;
    config.maxChannels = 4;
    config.styleSize = 8;
    state.model.network = std::make_shared<AvatarNetwork>(AvatarNetwork::create(config, 1).value());
    state.model.pixels = at::zeros({5}, at::kLong);
    state.lightLog = at::zeros({6, 64, 64, 3}).set_requires_grad(true);
    state.radiusOffsets = at::zeros({kBodyPartCount});
    std::vector<const void*> before;
    const auto addresses = [&] {
        std::vector<const void*> all{state.lightLog.const_data_ptr(), state.radiusOffsets.const_data_ptr(),
                                     state.model.pixels.const_data_ptr()};
        for (const NetworkTensor& entry : state.model.network->tensors().all()) {
            all.push_back(entry.tensor.const_data_ptr());
        }
        return all;
    };
    before = addresses();
    EXPECT_GT(before.size(), 20u);
    placeState(state, c10::kCPU);
    EXPECT_EQ(addresses(), before);
    EXPECT_TRUE(state.lightLog.requires_grad() && state.lightLog.is_leaf());
    const Result<AvatarModel> host = modelOnHost(state.model);
    ASSERT_TRUE(host.ok());
    EXPECT_EQ(host->network, state.model.network);
}

TEST(AdamChain, StepsAsTheOptimiserDoes) {
    torch::manual_seed(5);
    const at::Tensor start = torch::randn({7, 3});
    at::Tensor leaf = start.clone().requires_grad_(true);
    Adam adam(0.9, 0.99);
    adam.addGroup("all", {{"leaf", leaf}});
    adam.setRate("all", 0.05);
    at::Tensor x = start.clone(), m = at::zeros_like(x), v = at::zeros_like(x);
    for (int t = 1; t <= 5; ++t) {
        const at::Tensor gradient = torch::randn({7, 3});
        leaf.mutable_grad() = gradient;
        ASSERT_TRUE(adam.step().ok());
        chains::adamStep(x, gradient, m, v,
                         {0.9f, 0.99f, static_cast<float>(0.05 / (1.0 - std::pow(0.9, t))),
                          static_cast<float>(1.0 / (1.0 - std::pow(0.99, t)))});
        EXPECT_LE((x - leaf.detach()).abs().max().item<double>(), 1e-6) << "step " << t;
    }
    SafetensorsFile stored;
    adam.store(stored);
    const at::Tensor second = tensorFromArray(stored.tensors.at("adam.leaf.v")).value();
    EXPECT_LE((second - v).abs().max().item<double>(), 1e-6);
    EXPECT_GT((x - start).abs().max().item<double>(), 0.1);
}

} // namespace
} // namespace ars
