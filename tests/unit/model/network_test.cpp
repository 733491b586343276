#include "engine/io/safetensors.h"
#include "model/network/avatar_network.h"
#include "model/network/filters.h"
#include "model/network/style_unet.h"
#include "tests/support/test_data.h"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

namespace ars {
namespace {

double largest(const at::Tensor& a) { return a.abs().max().item<double>(); }
double largestDifference(const at::Tensor& a, const at::Tensor& b) {
    EXPECT_EQ(a.sizes(), b.sizes());
    return largest(a - b);
}

at::Tensor draw(at::IntArrayRef shape, std::uint64_t seed) {
    torch::manual_seed(seed);
    return torch::randn(shape, torch::kDouble);
}

/// Zero insertion, padding, true convolution, every `down`-th sample: upfirdn with the kernel outer(k, k), term by
/// term.
at::Tensor filtered(const at::Tensor& x, std::array<double, 4> k, int up, int down, int before, int after) {
    const auto channels = x.size(1), height = x.size(2), width = x.size(3);
    const auto side = [&](std::int64_t n) { return (n * up + before + after - 4) / down + 1; };
    at::Tensor y = torch::zeros({1, channels, side(height), side(width)}, torch::kDouble);
    const auto in = x.accessor<double, 4>();
    auto out = y.accessor<double, 4>();
    for (std::int64_t c = 0; c < channels; ++c) {
        for (std::int64_t r = 0; r < y.size(2); ++r) {
            for (std::int64_t q = 0; q < y.size(3); ++q) {
                for (int i = 0; i < 4; ++i) {
                    for (int j = 0; j < 4; ++j) {
                        const auto v = r * down + i - before, u = q * down + j - before;
                        if (v < 0 || u < 0 || v % up != 0 || u % up != 0 || v / up >= height || u / up >= width)
                            continue;
                        out[0][c][r][q] += k[3 - static_cast<std::size_t>(i)] * k[3 - static_cast<std::size_t>(j)] *
                                           in[0][c][v / up][u / up];
                    }
                }
            }
        }
    }
    return y;
}
constexpr std::array<double, 4> kBlur{1.0 / 8, 3.0 / 8, 3.0 / 8, 1.0 / 8};
constexpr std::array<double, 4> kDouble{1.0 / 4, 3.0 / 4, 3.0 / 4, 1.0 / 4};

TEST(NetworkFilters, BlurIsTheConvolutionWithItsKernel) {
    const at::Tensor x = draw({1, 5, 9, 7}, 1);
    EXPECT_LT(largestDifference(blur(x, 2, 2), filtered(x, kBlur, 1, 1, 2, 2)), 1e-14);
    EXPECT_LT(largestDifference(blur(x, 1, 1), filtered(x, kBlur, 1, 1, 1, 1)), 1e-14);
    EXPECT_LT(
        largestDifference(blurDownsample(draw({1, 3, 8, 12}, 2)), filtered(draw({1, 3, 8, 12}, 2), kBlur, 1, 2, 1, 1)),
        1e-14);
}

TEST(NetworkFilters, BlurAfterATransposedConvolutionHasFourTimesTheKernel) {
    const at::Tensor x = draw({1, 5, 9, 9}, 3), bias = draw({5}, 4), noise = draw({1, 1, 8, 8}, 5);
    const at::Tensor strength = torch::full({1}, 0.7, torch::kDouble);
    const at::Tensor before = filtered(x, kDouble, 1, 1, 1, 1) + bias.view({1, 5, 1, 1}) + 0.7 * noise;
    const at::Tensor expected = torch::where(before > 0, before, 0.2 * before) * std::sqrt(2.0);
    EXPECT_LT(largestDifference(blurActivate(x, {.bias = bias, .noise = noise, .strength = strength}), expected),
              1e-14);
}

TEST(NetworkFilters, ImagesDoubleByZeroInsertionAndTheKernelTimesFour) {
    const at::Tensor x = draw({1, 3, 6, 5}, 6);
    const at::Tensor doubled = addSubbands(torch::zeros({1, 12, 6, 5}, torch::kDouble), x);
    EXPECT_LT(largestDifference(doubled, filtered(x, kDouble, 2, 1, 2, 1)), 1e-14);
}

TEST(NetworkFilters, InverseHaarUndoesHaarExactly) {
    torch::manual_seed(7);
    const at::Tensor image = torch::randint(-100, 100, {1, 3, 8, 6}, torch::kFloat);
    const auto corner = [&](int r, int q) { return image.slice(2, r, c10::nullopt, 2).slice(3, q, c10::nullopt, 2); };
    const at::Tensor a = corner(0, 0), b = corner(0, 1), c = corner(1, 0), d = corner(1, 1);
    const at::Tensor bands =
        torch::cat({(a + b + c + d) / 2, (a + b - c - d) / 2, (a - b + c - d) / 2, (a - b - c + d) / 2}, 1);
    EXPECT_TRUE(torch::equal(addSubbands(bands, {}), image));
}

TEST(NetworkFilters, DemodulatedFiltersHaveUnitNorm) {
    const at::Tensor weight = draw({1, 6, 5, 3, 3}, 8), one = torch::ones({5}, torch::kDouble);
    const at::Tensor norms = modulatedWeight(weight, one, true, false).square().sum({1, 2, 3});
    EXPECT_LT(largest(norms - 1), 1e-7); // 1e-8 beside squares of about 1
    EXPECT_TRUE(torch::equal(modulatedWeight(weight, one, true, true).transpose(0, 1),
                             modulatedWeight(weight, one, true, false)));
    EXPECT_LT(largestDifference(modulatedWeight(weight, one * 2, false, false), weight[0] * (2 / std::sqrt(45.0))),
              1e-15);
}

TEST(NetworkFilters, NumbersDoNotDependOnTheThreads) {
    torch::manual_seed(9);
    const at::Tensor x = torch::randn({1, 16, 33, 33}), noise = torch::randn({1, 1, 32, 32}),
                     g = torch::randn({1, 16, 32, 32});
    std::vector<at::Tensor> first;
    const int before = at::get_num_threads();
    for (const int threads : {1, 2, 3}) {
        at::set_num_threads(threads);
        at::Tensor in = x.clone().requires_grad_(), bias = torch::ones({16}).requires_grad_();
        at::Tensor strength = torch::ones({1}).requires_grad_();
        blurActivate(in, {.bias = bias, .noise = noise, .strength = strength}).backward(g);
        const std::vector<at::Tensor> now{in.grad(), bias.grad(), strength.grad()};
        if (first.empty()) first = now;
        for (std::size_t i = 0; i < now.size(); ++i) EXPECT_TRUE(torch::equal(now[i], first[i])) << threads << " " << i;
    }
    at::set_num_threads(before);
}

// ------------------------------------------------------------------------------------------------ sizes

TEST(StyleUnet, HasExactlyThePublishedNumberOfParameters) {
    StyleUnetConfig config;
    config.inputChannels = 3;
    config.priors = false;
    EXPECT_EQ(StyleUnet::create(config, 1)->tensors().parameterCount(), 74'479'016);
    config.outputChannels = 8;
    EXPECT_EQ(StyleUnet::create(config, 1)->tensors().parameterCount(), 74'558'616);
    EXPECT_EQ(SideEncoder::create(1, 1).tensors().parameterCount(), 132'288);
}

TEST(StyleUnet, RefusesSizesThatItCannotHave) {
    const auto message = [](auto change) {
        StyleUnetConfig config;
        change(config);
        const auto made = StyleUnet::create(config, 1);
        return made.ok() ? std::string("made") : made.error().describe();
    };
    EXPECT_EQ(message([](auto& c) { c.inputSize = 96; }),
              "network input size: expected a power of two from 64 to 4096, found 96");
    EXPECT_EQ(message([](auto& c) { c.inputSize = 32; }),
              "network input size: expected a power of two from 64 to 4096, found 32");
    EXPECT_EQ(message([](auto& c) { c.outputChannels = 0; }), "network output channels: expected 1 to 256, found 0");
    EXPECT_EQ(message([](auto& c) { c.colorChannels = 1; }),
              "network color channels: expected 0 without a colour copy, found 1");
    EXPECT_EQ(message([](auto& c) { c.channelMultiplier = std::numeric_limits<double>::quiet_NaN(); }),
              "network channel multiplier: expected above 0, at most 16, found nan");
}

// ------------------------------------------------------------------------------------------------ gradients

StyleUnetConfig smallConfig(ViewInjection view) {
    StyleUnetConfig config;
    config.inputSize = 64;
    config.inputChannels = 3;
    config.outputChannels = 4;
    config.channelMultiplier = 0.0625;
    config.maxChannels = 8;
    config.styleSize = 16;
    config.view = view;
    config.colorChannels = view == ViewInjection::ColorCopy ? 2 : 0;
    return config;
}

/// Its tensors in double, and away from the zeros that biases and noise strengths start at.
StyleUnet inDouble(const StyleUnetConfig& config) {
    StyleUnet network = *StyleUnet::create(config, 4);
    torch::manual_seed(11);
    for (NetworkTensor& entry : network.tensors().all()) {
        const at::NoGradGuard noGradients;
        at::Tensor values = entry.tensor.to(torch::kDouble);
        if (largest(values) == 0) values = torch::randn_like(values) * 0.3;
        entry.tensor.set_data(values);
    }
    return network;
}

struct Probe {
    std::string name;
    at::Tensor tensor;
};

/// Central differences of `loss` at two elements of every probe against autograd. The networks are linear in pieces:
/// where a border lies within the step the difference is wrong, so a second, smaller step may answer.
template <typename Loss>
void expectGradients(const std::vector<Probe>& probes, const Loss& loss) {
    loss().backward();
    for (const Probe& probe : probes) {
        ASSERT_TRUE(probe.tensor.grad().defined()) << probe.name;
        const at::Tensor gradient = probe.tensor.grad().contiguous().view(-1);
        const at::NoGradGuard noGradients;
        at::Tensor values = probe.tensor.detach().view(-1);
        const double scale = std::max(largest(gradient), 1e-3);
        const auto difference = [&](std::int64_t at, double step) {
            const double before = values[at].item<double>();
            values[at] = before + step;
            const double above = loss().template item<double>();
            values[at] = before - step;
            const double below = loss().template item<double>();
            values[at] = before;
            return (above - below) / (2 * step);
        };
        const std::int64_t strongest = gradient.abs().argmax().item<std::int64_t>();
        for (const std::int64_t at : std::set<std::int64_t>{strongest, values.numel() / 3}) {
            const double expected = gradient[at].item<double>();
            double found = difference(at, 1e-6);
            if (std::abs(found - expected) > 1e-6 * scale) found = difference(at, 3e-8);
            EXPECT_NEAR(expected, found, 1e-6 * scale) << probe.name << " element " << at;
        }
    }
}

void expectNetworkGradients(ViewInjection view) {
    StyleUnet network = inDouble(smallConfig(view));
    StyleUnetInputs inputs;
    inputs.maps = draw({1, 3, 64, 64}, 12).requires_grad_();
    std::vector<Probe> probes{{"maps", inputs.maps}};
    for (std::size_t side = 0; side < 2; ++side) {
        inputs.priors[side] = draw({1, 128, 16, 16}, 13 + side).requires_grad_();
        inputs.views[side] = draw({1, 128, 16, 16}, 15 + side).requires_grad_();
        probes.push_back({"prior features", inputs.priors[side]});
        probes.push_back({"view features", inputs.views[side]});
    }
    // Every kind of tensor, at the first, a middle and the last level of one decoder.
    for (const NetworkTensor& entry : network.tensors().all()) {
        const bool otherSide = entry.name.find("s1.") != std::string::npos;
        const bool middle =
            entry.name.find("s2.2.") != std::string::npos || entry.name.find("s2.3.") != std::string::npos;
        const bool shared = entry.name.find("color_") == std::string::npos && view == ViewInjection::ColorCopy;
        if (entry.trainable && !otherSide && !middle && !shared) probes.push_back({entry.name, entry.tensor});
    }
    const at::Tensor weights = draw({1, 8, 128, 128}, 17) / 100;
    expectGradients(probes, [&] { return (network.evaluate(inputs) * weights).sum(); });
}

TEST(StyleUnetGradient, EqualsCentralDifferencesWithTheViewAtTheLastLevel) {
    expectNetworkGradients(ViewInjection::LastLevel);
}

TEST(StyleUnetGradient, EqualsCentralDifferencesWithTheColorCopy) { expectNetworkGradients(ViewInjection::ColorCopy); }

// ------------------------------------------------------------------------------------------------ the avatar's
// networks

AvatarNetworkConfig smallAvatar(NetworkSplit split) {
    AvatarNetworkConfig config;
    config.split = split;
    config.inputSize = 64;
    config.channelMultiplier = 0.0625;
    config.maxChannels = 8;
    config.styleSize = 16;
    config.zeroOutputs = false;
    return config;
}

AvatarNetworkInputs someInputs() {
    torch::manual_seed(21);
    return {torch::randn({2, 3, 64, 64}), torch::randn({2, 5, 64, 64}), torch::randn({2, 1, 64, 64})};
}

TEST(AvatarNetwork, TheTrunkNeverSeesTheViewAndColorsDo) {
    const at::NoGradGuard noGradients;
    for (const NetworkSplit split : {NetworkSplit::Two, NetworkSplit::Four}) {
        const auto network = AvatarNetwork::create(smallAvatar(split), 1);
        const at::Tensor pixels = torch::arange(0, 128 * 256, 37);
        AvatarNetworkInputs inputs = someInputs();
        const RawAttributes one = network->evaluate(inputs, pixels);
        inputs.view = -inputs.view;
        const RawAttributes other = network->evaluate(inputs, pixels);
        EXPECT_TRUE(torch::equal(one.offsets, other.offsets));
        EXPECT_TRUE(torch::equal(one.albedos, other.albedos));
        EXPECT_TRUE(torch::equal(one.roughnesses, other.roughnesses));
        EXPECT_GT(largestDifference(one.colors, other.colors), 0.01);

        const auto views = network->evaluateColors(inputs, pixels, {-inputs.view, inputs.view, at::Tensor()});
        ASSERT_EQ(views.size(), 3u);
        EXPECT_TRUE(torch::equal(views[0], one.colors));
        EXPECT_TRUE(torch::equal(views[1], other.colors));
        inputs.view = torch::zeros_like(inputs.view);
        EXPECT_TRUE(torch::equal(views[2], network->evaluate(inputs, pixels).colors));
    }
}

TEST(AvatarNetwork, GivesWhatIsWantedAndNothingElse) {
    const at::NoGradGuard noGradients;
    const at::Tensor pixels = torch::arange(0, 128 * 256, 37);
    const AvatarNetworkInputs inputs = someInputs();
    for (const NetworkSplit split : {NetworkSplit::Two, NetworkSplit::Four}) {
        for (const bool viewDependent : {true, false}) {
            AvatarNetworkConfig config = smallAvatar(split);
            config.viewDependent = viewDependent;
            const auto network = AvatarNetwork::create(config, 1);
            const RawAttributes all = network->evaluate(inputs, pixels);
            for (int mask = 0; mask < 8; ++mask) {
                const WantedAttributes wanted{(mask & 1) != 0, (mask & 2) != 0, (mask & 4) != 0};
                const RawAttributes some = network->evaluate(inputs, pixels, wanted);
                EXPECT_EQ(some.offsets.defined() && some.rotations.defined(), wanted.geometry);
                EXPECT_EQ(some.albedos.defined() && some.roughnesses.defined(), wanted.materials);
                EXPECT_EQ(some.colors.defined(), wanted.colors);
                if (wanted.geometry) {
                    EXPECT_TRUE(torch::equal(some.scales, all.scales));
                }
                if (wanted.materials) {
                    EXPECT_TRUE(torch::equal(some.albedos, all.albedos));
                }
                if (wanted.colors) {
                    EXPECT_TRUE(torch::equal(some.colors, all.colors));
                }
            }
        }
    }
}

TEST(AvatarNetwork, EveryPriorModeAndInputWorks) {
    const at::NoGradGuard noGradients;
    const at::Tensor pixels = torch::arange(0, 128 * 256, 37);
    AvatarNetworkInputs inputs = someInputs();
    for (const PriorMode mode : {PriorMode::Encoder, PriorMode::Concat, PriorMode::Off}) {
        for (const bool frontOnly : {false, true}) {
            AvatarNetworkConfig config = smallAvatar(NetworkSplit::Two);
            config.priors = mode;
            config.frontOnly = frontOnly;
            const auto network = AvatarNetwork::create(config, 1);
            const at::Tensor one = network->evaluate(inputs, pixels).offsets;
            AvatarNetworkInputs other = inputs;
            other.priors = inputs.priors + 1;
            EXPECT_EQ(largestDifference(network->evaluate(other, pixels).offsets, one) > 1e-4, mode != PriorMode::Off);
            other = inputs;
            other.positions = inputs.positions.clone();
            other.positions[1] += 1;
            EXPECT_EQ(largestDifference(network->evaluate(other, pixels).offsets, one) > 1e-4, !frontOnly);
        }
    }
}

TEST(AvatarNetwork, ZeroOutputsStartAtZeroAndStillLearn) {
    AvatarNetworkConfig config = smallAvatar(NetworkSplit::Two);
    config.zeroOutputs = true;
    const auto network = AvatarNetwork::create(config, 1);
    const at::Tensor pixels = torch::arange(0, 128 * 256, 37);
    const RawAttributes raw = network->evaluate(someInputs(), pixels);
    EXPECT_EQ(largest(raw.offsets), 0);
    EXPECT_EQ(largest(raw.colors), 0);
    (raw.offsets.sum() + raw.colors.sum()).backward();
    for (const NetworkTensor& entry : network->tensors().all()) {
        if (entry.name == "geometry.to_rgbs1.2.conv.weight") {
            EXPECT_GT(largest(entry.tensor.grad()), 0);
        }
        if (entry.name == "appearance.color_to_rgbs2.0.conv.weight") {
            EXPECT_GT(largest(entry.tensor.grad()), 0);
        }
    }
}

TEST(AvatarNetwork, TheSameSeedGivesTheSameNetworkAndAnotherAnother) {
    const auto values = [](std::uint64_t seed) {
        SafetensorsFile file;
        AvatarNetwork::create(smallAvatar(NetworkSplit::Two), seed)->tensors().store(file);
        return file;
    };
    const SafetensorsFile a = values(1), b = values(1), c = values(2);
    std::size_t different = 0;
    for (const auto& [name, array] : a.tensors) {
        EXPECT_EQ(array.bytes, b.tensors.at(name).bytes) << name;
        different += array.bytes != c.tensors.at(name).bytes;
    }
    EXPECT_GT(different, a.tensors.size() / 3);
    const auto weight = [&](const std::string& name) { return a.tensors.at(name).bytes; };
    EXPECT_NE(weight("geometry.conv_in.1.weight"), weight("appearance.conv_in.1.weight"));
}

TEST(AvatarNetwork, WeightsSurviveAFile) {
    const at::NoGradGuard noGradients;
    const at::Tensor pixels = torch::arange(0, 128 * 256, 37);
    const auto first = AvatarNetwork::create(smallAvatar(NetworkSplit::Two), 1);
    auto second = AvatarNetwork::create(smallAvatar(NetworkSplit::Two), 2);
    SafetensorsFile file;
    first->tensors().store(file, "network.");
    ASSERT_TRUE(second->tensors().load(file, "network.").ok());
    EXPECT_TRUE(
        torch::equal(first->evaluate(someInputs(), pixels).colors, second->evaluate(someInputs(), pixels).colors));
}

TEST(AvatarNetwork, SizesThatCannotBeAreRefused) {
    AvatarNetworkConfig config = smallAvatar(NetworkSplit::Two);
    config.inputSize = 100;
    const auto made = AvatarNetwork::create(config, 1);
    ASSERT_FALSE(made.ok());
    EXPECT_EQ(made.error().describe(), "network input size: expected a power of two from 64 to 4096, found 100");
}

} // namespace
} // namespace ars
