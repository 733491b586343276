// Backward of the networks' own filters, each by itself: every element of every input against central differences in
// double. tests/gradient/sign_flips.py compiles this file with the filters alone.
#include "model/network/filters.h"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

namespace ars {
namespace {

struct Input {
    std::string name;
    at::Tensor tensor;
};

at::Tensor drawn(at::IntArrayRef shape, std::uint64_t seed) {
    torch::manual_seed(seed);
    return torch::randn(shape, torch::kDouble).requires_grad_();
}

/// The loss is sum(weights filter()), weights random; `filter` reads the inputs, which are changed in place. But for
/// the modulation the filters are linear in pieces, and none of the numbers drawn here lies within a step of a border.
template <typename Filter>
void expectGradients(const std::vector<Input>& inputs, const Filter& filter, double step = 1e-5) {
    at::Tensor weights;
    const auto loss = [&] {
        const at::Tensor y = filter();
        if (!weights.defined()) {
            torch::manual_seed(99);
            weights = torch::randn(y.sizes(), torch::kDouble);
        }
        return (y * weights).sum();
    };
    loss().backward();
    for (const Input& input : inputs) {
        ASSERT_TRUE(input.tensor.grad().defined()) << input.name;
        const at::Tensor gradient = input.tensor.grad().contiguous().view(-1);
        EXPECT_GT(gradient.abs().max().item<double>(), 1e-3) << input.name << " passes something";
        const at::NoGradGuard noGradients;
        at::Tensor values = input.tensor.detach().view(-1);
        for (std::int64_t i = 0; i < values.numel(); ++i) {
            const double kept = values[i].item<double>();
            values[i] = kept + step;
            const double above = loss().template item<double>();
            values[i] = kept - step;
            const double below = loss().template item<double>();
            values[i] = kept;
            ASSERT_NEAR(gradient[i].item<double>(), (above - below) / (2 * step), 1e-7) << input.name << " " << i;
        }
    }
}

TEST(NetworkFilterGradients, Blur) {
    for (const auto& [before, after] : {std::pair{2, 2}, std::pair{1, 1}, std::pair{0, 3}}) {
        const at::Tensor x = drawn({1, 2, 6, 5}, 1);
        expectGradients({{"x", x}}, [&, b = before, a = after] { return blur(x, b, a); });
    }
    const at::Tensor x = drawn({1, 2, 6, 8}, 2);
    expectGradients({{"x", x}}, [&] { return blurDownsample(x); });
}

TEST(NetworkFilterGradients, Activation) {
    const at::Tensor x = drawn({1, 3, 4, 5}, 3), bias = drawn({3}, 4), other = drawn({1, 3, 4, 5}, 5);
    const at::Tensor noise = drawn({1, 1, 4, 5}, 6).detach(), strength = drawn({1}, 7);
    expectGradients({{"x", x}, {"bias", bias}, {"strength", strength}, {"other", other}},
                    [&] { return activate(x, {.bias = bias, .noise = noise, .strength = strength, .other = other}); });
    const at::Tensor alone = drawn({1, 3, 4, 5}, 8), shift = drawn({3}, 9);
    expectGradients({{"x", alone}, {"bias", shift}}, [&] { return activate(alone, {.bias = shift}); });
}

TEST(NetworkFilterGradients, BlurredActivation) {
    const at::Tensor x = drawn({1, 3, 5, 5}, 10), bias = drawn({3}, 11), other = drawn({1, 3, 4, 4}, 12);
    const at::Tensor noise = drawn({1, 1, 4, 4}, 13).detach(), strength = drawn({1}, 14);
    expectGradients({{"x", x}, {"bias", bias}, {"strength", strength}, {"other", other}}, [&] {
        return blurActivate(x, {.bias = bias, .noise = noise, .strength = strength, .other = other});
    });
}

TEST(NetworkFilterGradients, Subbands) {
    const at::Tensor bands = drawn({1, 8, 3, 4}, 15), previous = drawn({1, 2, 3, 4}, 16);
    expectGradients({{"bands", bands}, {"previous", previous}}, [&] { return addSubbands(bands, previous); });
    const at::Tensor first = drawn({1, 8, 3, 4}, 17);
    expectGradients({{"bands", first}}, [&] { return addSubbands(first, {}); });
}

TEST(NetworkFilterGradients, Modulation) {
    for (const bool demodulate : {true, false}) {
        for (const bool transposed : {true, false}) {
            const at::Tensor weight = drawn({1, 4, 3, 3, 3}, 18), style = drawn({3}, 19);
            expectGradients({{"weight", weight}, {"style", style}},
                            [&] { return modulatedWeight(weight, style, demodulate, transposed); });
        }
    }
}

TEST(NetworkFilterGradients, GatheredRowsOfBothSides) {
    const at::Tensor front = drawn({1, 2, 3, 4}, 20), back = drawn({1, 2, 3, 4}, 21);
    // One of the front twice, both corners of both sides.
    const at::Tensor pixels = torch::tensor({0, 3, 4, 7, 9, 9, 14, 16, 20, 23}, torch::kLong);
    expectGradients({{"front", front}, {"back", back}}, [&] { return gatherSides(front, back, pixels); });
}

} // namespace
} // namespace ars
