#include "engine/io/safetensors.h"
#include "model/network/avatar_network.h"
#include "tests/support/test_data.h"

#include <gtest/gtest.h>
#include <torch/torch.h>

namespace ars {
namespace {

/// Inputs, weights and outputs that tests/parity/network/reference_network.py wrote: the same networks in PyTorch's
/// plain operators.
SafetensorsFile stored(const std::string& name) {
    const auto folder = test::sourceFolder() / "tests/parity/network";
    auto file = readSafetensors(folder / name);
    auto encoders = readSafetensors(folder / "side_encoders.safetensors");
    EXPECT_TRUE(file.ok()) << (file.ok() ? "" : file.error().describe());
    EXPECT_TRUE(encoders.ok());
    file->tensors.merge(encoders->tensors);
    return std::move(*file);
}

at::Tensor take(const SafetensorsFile& file, const std::string& name) {
    return *tensorFromArray(file.tensors.at(name));
}

double largestDifference(const at::Tensor& a, const at::Tensor& b) {
    EXPECT_EQ(a.sizes(), b.sizes());
    return (a - b).abs().max().item<double>();
}

template <typename Network>
void loadFrom(Network& network, const SafetensorsFile& file, const std::string& prefix) {
    const Status status = network.tensors().load(file, prefix);
    ASSERT_TRUE(status.ok()) << status.error().describe();
}

TEST(NetworkParity, ColorNetworkOfAnimatableGaussiansWithTheViewAtItsLastLevel) {
    const SafetensorsFile file = stored("animatable_gaussians.safetensors");
    StyleUnetConfig config;
    config.inputSize = 64;
    config.inputChannels = 3;
    config.channelMultiplier = 0.0234375;
    config.maxChannels = 8;
    config.styleSize = 16;
    config.priors = false;
    config.view = ViewInjection::LastLevel;
    auto network = StyleUnet::create(config, 5);
    ASSERT_TRUE(network.ok());
    SideEncoder encoder = SideEncoder::create(1, 6);
    loadFrom(*network, file, "net.");
    loadFrom(encoder, file, "net.view_encoder.");

    const at::NoGradGuard noGradients;
    const at::Tensor features = encoder.evaluate(take(file, "in.view"));
    StyleUnetInputs inputs;
    inputs.maps = take(file, "in.maps");
    inputs.views = {features.slice(0, 0, 1), features.slice(0, 1, 2)};
    const at::Tensor out = network->evaluate(inputs);
    const at::Tensor sampled = out.slice(2, 1, c10::nullopt, 3).slice(3, 0, c10::nullopt, 3);
    EXPECT_GT(take(file, "out").abs().mean().item<double>(), 0.1);
    EXPECT_LT(largestDifference(sampled, take(file, "out")), 1e-4);
}

void compareAvatarNetworks(const std::string& name, NetworkSplit split) {
    const SafetensorsFile file = stored(name);
    AvatarNetworkConfig config;
    config.split = split;
    config.inputSize = 64;
    config.channelMultiplier = 0.0234375;
    config.maxChannels = 8;
    config.styleSize = 16;
    auto network = AvatarNetwork::create(config, 3);
    ASSERT_TRUE(network.ok());
    loadFrom(*network, file, "net.");

    const at::NoGradGuard noGradients;
    const AvatarNetworkInputs inputs{take(file, "in.positions"), take(file, "in.priors"), take(file, "in.view")};
    const RawAttributes raw = network->evaluate(inputs, take(file, "in.pixels"));
    const std::pair<const char*, const at::Tensor*> rows[] = {
        {"offsets", &raw.offsets},     {"opacities", &raw.opacities}, {"scales", &raw.scales},
        {"rotations", &raw.rotations}, {"albedos", &raw.albedos},     {"roughnesses", &raw.roughnesses},
        {"colors", &raw.colors}};
    for (const auto& [what, values] : rows) {
        const at::Tensor expected = take(file, std::string("out.") + what);
        EXPECT_GT(expected.abs().mean().item<double>(), 0.1) << what;
        EXPECT_LT(largestDifference(*values, expected), 1e-4) << what;
    }
}

TEST(NetworkParity, TwoNetworksWithPriorsAndTheColorCopy) {
    compareAvatarNetworks("two_networks.safetensors", NetworkSplit::Two);
}

TEST(NetworkParity, FourNetworksWithPriors) { compareAvatarNetworks("four_networks.safetensors", NetworkSplit::Four); }

} // namespace
} // namespace ars
