// Backward of the networks' own filters, each by itself: every element of every input against central differences in
// double. tests/gradient/sign_flips.py compiles this file with the filters alone.
#include "model/network/filters.h"

#include "model/network/filter_chains.h"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <algorithm>
#include <cmath>
#include <functional>
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

// --- the chains that other devices take ------------------------------------------------------------------------------

/// Value and gradients of a chain against those of the filter, whose gradients the tests above judge.
template <typename Filter>
void expectSame(const std::vector<Input>& inputs, const Filter& filter, const Filter& chain) {
    const auto run = [&](const Filter& function) {
        for (const Input& input : inputs) input.tensor.mutable_grad() = at::Tensor();
        const at::Tensor y = function();
        torch::manual_seed(98);
        (y * torch::randn(y.sizes(), torch::kDouble)).sum().backward();
        std::vector<at::Tensor> results{y.detach()};
        for (const Input& input : inputs) results.push_back(input.tensor.grad().clone());
        return results;
    };
    const std::vector<at::Tensor> a = run(filter), b = run(chain);
    for (std::size_t i = 0; i < a.size(); ++i) {
        ASSERT_EQ(a[i].sizes(), b[i].sizes());
        EXPECT_LE((a[i] - b[i]).abs().max().item<double>(), 1e-12) << (i == 0 ? "value" : inputs[i - 1].name);
    }
    EXPECT_EQ(a[0].strides(), b[0].strides());
}
using Function = std::function<at::Tensor()>;

TEST(NetworkFilterChains, AreTheFilters) {
    const at::Tensor x = drawn({1, 3, 6, 5}, 30), bias = drawn({3}, 31), other = drawn({1, 3, 6, 5}, 32);
    const at::Tensor noise = drawn({1, 1, 6, 5}, 33).detach(), strength = drawn({1}, 34);
    for (const auto& [before, after] : {std::pair{2, 2}, std::pair{1, 1}, std::pair{0, 3}}) {
        expectSame<Function>(
            {{"x", x}}, [&, b = before, a = after] { return blur(x, b, a); },
            [&, b = before, a = after] { return chains::blur(x, b, a, 1); });
    }
    const ActivationTerms all{.bias = bias, .noise = noise, .strength = strength, .other = other};
    expectSame<Function>(
        {{"x", x}, {"bias", bias}, {"strength", strength}, {"other", other}}, [&] { return activate(x, all); },
        [&] { return chains::activate(x, all); });
    const ActivationTerms few{.bias = bias};
    expectSame<Function>(
        {{"x", x}, {"bias", bias}}, [&] { return activate(x, few); }, [&] { return chains::activate(x, few); });
    const ActivationTerms smaller{.bias = bias,
                                  .noise = drawn({1, 1, 5, 4}, 35).detach(),
                                  .strength = strength,
                                  .other = drawn({1, 3, 5, 4}, 36)};
    expectSame<Function>(
        {{"x", x}, {"bias", bias}, {"strength", strength}, {"other", smaller.other}},
        [&] { return blurActivate(x, smaller); }, [&] { return chains::blurActivate(x, smaller); });
}

TEST(NetworkFilterChains, AreTheTransformsAndWeights) {
    const at::Tensor bands = drawn({1, 8, 3, 4}, 40), previous = drawn({1, 2, 3, 4}, 41);
    expectSame<Function>(
        {{"bands", bands}, {"previous", previous}}, [&] { return addSubbands(bands, previous); },
        [&] { return chains::addSubbands(bands, previous); });
    expectSame<Function>(
        {{"bands", bands}}, [&] { return addSubbands(bands, {}); }, [&] { return chains::addSubbands(bands, {}); });
    const at::Tensor weight = drawn({1, 4, 3, 3, 3}, 42), style = drawn({3}, 43);
    for (const bool demodulate : {true, false}) {
        for (const bool transposed : {true, false}) {
            expectSame<Function>(
                {{"weight", weight}, {"style", style}},
                [&] { return modulatedWeight(weight, style, demodulate, transposed); },
                [&] { return chains::modulatedWeight(weight, style, demodulate, transposed); });
        }
    }
    const at::Tensor front = drawn({1, 2, 3, 4}, 44), back = drawn({1, 2, 3, 4}, 45);
    const at::Tensor pixels = torch::tensor({0, 3, 4, 7, 9, 9, 14, 16, 20, 23}, torch::kLong);
    expectSame<Function>(
        {{"front", front}, {"back", back}}, [&] { return gatherSides(front, back, pixels); },
        [&] { return chains::gatherSides(front, back, pixels); });
}

// A device without memory: whatever a filter makes must lie where its inputs lie, and nothing may look at numbers.
TEST(NetworkFilterChains, MakeNothingOnAnotherDevice) {
    const auto there = at::TensorOptions(at::kFloat).device(at::kMeta);
    const at::Tensor x = at::empty({1, 3, 6, 6}, there), bias = at::empty({3}, there);
    const at::Tensor noise = at::empty({1, 1, 6, 6}, there), strength = at::empty({1}, there);
    const ActivationTerms terms{.bias = bias, .noise = noise, .strength = strength, .other = x};
    const at::Tensor bands = at::empty({1, 12, 3, 3}, there), old = at::empty({1, 3, 3, 3}, there);
    const at::Tensor pixels = at::empty({7}, there.dtype(at::kLong));
    const std::vector<std::pair<at::Tensor, std::vector<std::int64_t>>> results{
        {blurDownsample(x), {1, 3, 3, 3}},
        {activate(x, terms), {1, 3, 6, 6}},
        {blurActivate(at::empty({1, 3, 7, 7}, there), terms), {1, 3, 6, 6}},
        {addSubbands(bands, old), {1, 3, 6, 6}},
        {modulatedWeight(at::empty({1, 4, 3, 3, 3}, there), at::empty({3}, there), true, true), {3, 4, 3, 3}},
        {gatherSides(x, x, pixels), {7, 3}}};
    for (const auto& [result, sizes] : results) {
        EXPECT_TRUE(result.is_meta());
        EXPECT_EQ(result.sizes(), at::IntArrayRef(sizes));
    }
    EXPECT_ANY_THROW(activate(x, {.bias = at::zeros({3})}));
}

} // namespace
} // namespace ars
