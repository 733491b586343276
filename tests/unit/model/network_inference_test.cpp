#include "model/network/inference_network.h"

#include <gtest/gtest.h>
#include <torch/torch.h>

namespace ars {
namespace {

AvatarNetworkConfig smallConfig(NetworkSplit split, bool viewDependent, bool viewNormals = false) {
    AvatarNetworkConfig config;
    config.split = split;
    config.inputSize = 64;
    config.channelMultiplier = 0.0625;
    config.maxChannels = 16;
    config.styleSize = 16;
    config.zeroOutputs = false;
    config.viewDependent = viewDependent;
    config.viewNormals = viewNormals;
    return config;
}

AvatarNetworkInputs someInputs(int viewChannels = 1) {
    torch::manual_seed(31);
    return {torch::randn({2, 3, 64, 64}), torch::randn({2, 5, 64, 64}), torch::randn({2, viewChannels, 64, 64})};
}

/// A network whose biases and noise strengths are not the zeros that they start at.
AvatarNetwork trainedLike(const AvatarNetworkConfig& config) {
    AvatarNetwork network = *AvatarNetwork::create(config, 7);
    const at::NoGradGuard noGradients;
    torch::manual_seed(32);
    for (NetworkTensor& entry : network.tensors().all()) {
        if (entry.tensor.abs().max().item<double>() == 0) entry.tensor.normal_(0, 0.3);
    }
    return network;
}

/// Largest difference in parts of the largest value.
double relative(const at::Tensor& found, const at::Tensor& expected) {
    EXPECT_EQ(found.sizes(), expected.sizes());
    EXPECT_EQ(found.scalar_type(), at::kFloat);
    return ((found - expected).abs().max() / expected.abs().max()).item<double>();
}

void expectAgreement(NetworkPrecision precision, double tolerance) {
    const at::NoGradGuard noGradients;
    const at::Tensor pixels = torch::arange(0, 128 * 256, 11);
    const AvatarNetworkInputs inputs = someInputs();
    for (const NetworkSplit split : {NetworkSplit::Two, NetworkSplit::Four}) {
        for (const bool viewDependent : {true, false}) {
            const AvatarNetwork network = trainedLike(smallConfig(split, viewDependent));
            InferenceNetwork folded = InferenceNetwork::create(network, precision);
            const RawAttributes expected = network.evaluate(inputs, pixels);
            const RawAttributes found = folded.evaluate(inputs, pixels);
            EXPECT_LT(relative(found.offsets, expected.offsets), tolerance);
            EXPECT_LT(relative(found.opacities, expected.opacities), tolerance);
            EXPECT_LT(relative(found.scales, expected.scales), tolerance);
            EXPECT_LT(relative(found.rotations, expected.rotations), tolerance);
            EXPECT_LT(relative(found.albedos, expected.albedos), tolerance);
            EXPECT_LT(relative(found.roughnesses, expected.roughnesses), tolerance);
            EXPECT_LT(relative(found.colors, expected.colors), tolerance);
        }
    }
}

TEST(InferenceNetwork, GivesWhatTheTrainingFormGives) { expectAgreement(NetworkPrecision::Float32, 1e-4); }

TEST(InferenceNetwork, TakesViewMapsWithNormals) {
    const at::NoGradGuard noGradients;
    const at::Tensor pixels = torch::arange(0, 128 * 256, 11);
    AvatarNetworkInputs inputs = someInputs(4);
    const AvatarNetwork network = trainedLike(smallConfig(NetworkSplit::Two, true, true));
    InferenceNetwork folded = InferenceNetwork::create(network, NetworkPrecision::Float32);
    const at::Tensor seen = folded.evaluate(inputs, pixels).colors;
    EXPECT_LT(relative(seen, network.evaluate(inputs, pixels).colors), 1e-4);
    inputs.view = at::Tensor();
    EXPECT_LT(relative(folded.evaluate(inputs, pixels).colors, network.evaluate(inputs, pixels).colors), 1e-4);
    EXPECT_GT(relative(folded.evaluate(inputs, pixels).colors, seen), 1e-3);
}

TEST(InferenceNetwork, GivesNearlyThatInBFloat16) { expectAgreement(NetworkPrecision::BFloat16, 2e-2); }

TEST(InferenceNetwork, ANewCameraNeedsThePoseNoMore) {
    const at::NoGradGuard noGradients;
    const at::Tensor pixels = torch::arange(0, 128 * 256, 11);
    const AvatarNetworkInputs inputs = someInputs();
    for (const NetworkSplit split : {NetworkSplit::Two, NetworkSplit::Four}) {
        const AvatarNetwork network = trainedLike(smallConfig(split, true));
        InferenceNetwork folded = InferenceNetwork::create(network, NetworkPrecision::Float32);
        EXPECT_FALSE(folded.colorsOfLastPose(pixels, inputs.view).defined());
        folded.evaluate(inputs, pixels);
        const std::vector<at::Tensor> views{-inputs.view, at::Tensor()};
        const auto expected = network.evaluateColors(inputs, pixels, views);
        const auto found = folded.evaluateColors(inputs, pixels, views);
        for (std::size_t i = 0; i < views.size(); ++i) {
            EXPECT_LT(relative(folded.colorsOfLastPose(pixels, views[i]), expected[i]), 1e-4);
            EXPECT_LT(relative(found[i], expected[i]), 1e-4);
        }
    }
}

TEST(InferenceNetwork, KeepsItsWeightsWhileTrainingGoesOn) {
    const at::NoGradGuard noGradients;
    const at::Tensor pixels = torch::arange(0, 128 * 256, 11);
    AvatarNetwork network = trainedLike(smallConfig(NetworkSplit::Two, true));
    InferenceNetwork folded = InferenceNetwork::create(network, NetworkPrecision::Float32);
    const at::Tensor before = folded.evaluate(someInputs(), pixels).colors;
    for (NetworkTensor& entry : network.tensors().all()) entry.tensor.mul_(1.5).add_(0.1);
    EXPECT_TRUE(torch::equal(folded.evaluate(someInputs(), pixels).colors, before));
}

} // namespace
} // namespace ars
