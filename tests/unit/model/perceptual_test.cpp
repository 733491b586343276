#include "model/loss/perceptual.h"

#include "engine/core/file.h"
#include "engine/io/safetensors.h"
#include "model/loss/perceptual_patch.h"
#include "model/loss/pickle.h"
#include "model/loss/torch_file.h"
#include "tests/support/test_data.h"
#include "tests/unit/model/lpips_fixture.h"

#include <ATen/ATen.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <torch/torch.h>

#include <array>
#include <cmath>

namespace ars {
namespace {

using test::kAlex;
using test::kVgg;

at::Tensor picture(std::int64_t height, std::int64_t width, std::uint64_t seed) {
    const auto values = test::uniformNumbers(static_cast<std::size_t>(height * width * 3), seed);
    return 0.5 + 0.5 * at::tensor(values).view({height, width, 3});
}

/// Against the package `lpips` on the same random backbone: value, and gradient by the first picture.
void expectParity(const std::string& net, const std::vector<test::Convolution>& convolutions) {
    ARS_TEST_DATA_FILE(heads, "lpips/" + net + ".pth");
    const auto text = readTextFile(test::sourceFolder() / "tests/unit/model/fixtures/lpips.json");
    ASSERT_TRUE(text.ok());
    const auto expected = nlohmann::json::parse(*text).at(net);
    const test::TemporaryFolder folder;
    ASSERT_TRUE(writeSafetensors(folder / "backbone.safetensors", test::lpipsBackbone(convolutions)).ok());
    const auto loss = readLpips(folder / "backbone.safetensors", heads);
    ASSERT_TRUE(loss.ok()) << loss.error().describe();
    EXPECT_EQ((*loss)->name(), "lpips_" + net);
    const at::Tensor a = picture(48, 56, 1).requires_grad_(true), b = picture(48, 56, 2);
    const at::Tensor value = (*loss)->evaluate(a, b);
    value.backward();
    EXPECT_NEAR(value.item<double>(), expected.at("value").get<double>(), 1e-5 * expected.at("value").get<double>());
    const double norm = expected.at("gradient_norm").get<double>();
    EXPECT_NEAR(a.grad().norm().item<double>(), norm, 1e-4 * norm);
    const std::array<std::array<std::int64_t, 3>, 4> places{{{0, 0, 0}, {10, 20, 1}, {47, 55, 2}, {30, 5, 0}}};
    for (std::size_t k = 0; k < places.size(); ++k) {
        const auto [y, x, c] = places[k];
        EXPECT_NEAR(a.grad()[y][x][c].item<double>(), expected.at("gradient")[k].get<double>(), 1e-5 * norm);
    }
    EXPECT_EQ((*loss)->evaluate(b, b).item<double>(), 0.0);
}

TEST(Lpips, AlexNetEqualsThePackage) { expectParity("alex", kAlex); }
TEST(Lpips, Vgg16EqualsThePackage) { expectParity("vgg", kVgg); }

TEST(Lpips, NamesTheTensorThatIsMissingOrWrong) {
    ARS_TEST_DATA_FILE(heads, "lpips/alex.pth");
    const test::TemporaryFolder folder;
    SafetensorsFile file = test::lpipsBackbone(kAlex);
    file.tensors.erase("features.6.bias");
    ASSERT_TRUE(writeSafetensors(folder / "a.safetensors", file).ok());
    const auto missing = readLpips(folder / "a.safetensors", heads);
    ASSERT_FALSE(missing.ok());
    EXPECT_NE(missing.error().describe().find("features.6.bias"), std::string::npos) << missing.error().describe();
    const auto wrongHeads = readLpips(folder / "a.safetensors", folder / "none.pth");
    ASSERT_FALSE(wrongHeads.ok());
    EXPECT_EQ(wrongHeads.error().code, ErrorCode::NotFound);
}

TEST(TorchFile, CutOrForeignFilesAreRefused) {
    ARS_TEST_DATA_FILE(heads, "lpips/alex.pth");
    auto bytes = readFile(heads);
    ASSERT_TRUE(bytes.ok());
    const auto whole = readTorchFile(heads);
    ASSERT_TRUE(whole.ok()) << whole.error().describe();
    EXPECT_EQ(whole->at("lin1.model.1.weight").shape, (std::vector<std::size_t>{1, 192, 1, 1}));
    const test::TemporaryFolder folder;
    for (std::size_t length = 0; length < bytes->size(); length += 61) {
        ASSERT_TRUE(writeFileAtomic(folder / "cut.pth", std::span(*bytes).first(length)).ok());
        EXPECT_FALSE(readTorchFile(folder / "cut.pth").ok()) << length;
    }
    // cposix\nsystem\n: what a hostile pickle would call.
    const std::string hostile = "\x80\x02\x8a\x0a"
                                "0123456789.cposix\nsystem\nU\x04trueR.";
    ASSERT_TRUE(writeFileAtomic(folder / "bad.pth", hostile).ok());
    EXPECT_FALSE(readTorchFile(folder / "bad.pth").ok());
}

/// Protocol 2: OrderedDict as memo 0, a list of `pairs` as memo 1, then OrderedDict(list) `calls` times.
std::string manyDictionaries(std::size_t pairs, std::size_t calls) {
    std::string text = "\x80\x02"
                       "ccollections\nOrderedDict\nq";
    text += std::string(1, '\0') + "0]q\x01(";
    for (std::size_t i = 0; i < pairs; ++i) text += "K\x01K\x02\x86";
    text += "e0";
    for (std::size_t i = 0; i < calls; ++i) text += std::string("h\0h\x01\x85R0", 7);
    return text + "N.";
}

TEST(Pickle, AMemoIsNoWayToMultiplyMemory) {
    const auto parsed = [](std::size_t pairs, std::size_t calls) {
        const std::string text = manyDictionaries(pairs, calls);
        return detail::parsePickle(std::as_bytes(std::span(text)));
    };
    const auto few = parsed(1000, 100);
    ASSERT_TRUE(few.ok()) << few.error().describe();
    EXPECT_EQ(few->length, manyDictionaries(1000, 100).size());
    const auto many = parsed(4000, 4000); // 16 million entries out of 44 kB
    ASSERT_FALSE(many.ok());
    EXPECT_NE(many.error().describe().find("at most 4 million things"), std::string::npos) << many.error().describe();
}

/// MS-SSIM in plain double tensors, all fields by 2-D convolution.
at::Tensor plainStandIn(const at::Tensor& a, const at::Tensor& b, int scales) {
    const double weights[5] = {0.0448, 0.2856, 0.3001, 0.2363, 0.1333};
    at::Tensor line = at::exp(-(at::arange(11, at::kDouble) - 5).square() / 4.5);
    line = line / line.sum();
    const at::Tensor window = at::outer(line, line).expand({3, 1, 11, 11}).contiguous();
    at::Tensor x = a.permute({2, 0, 1}).unsqueeze(0), y = b.permute({2, 0, 1}).unsqueeze(0);
    const auto filtered = [&](const at::Tensor& t) {
        return at::conv2d(t, window, {}, at::IntArrayRef{1}, at::IntArrayRef{0}, at::IntArrayRef{1}, 3);
    };
    at::Tensor product = at::ones({3}, at::kDouble);
    double sum = 0;
    for (int s = 0; s < scales; ++s) sum += weights[s];
    for (int s = 0; s < scales; ++s) {
        const at::Tensor mx = filtered(x), my = filtered(y);
        const at::Tensor vx = filtered(x * x) - mx * mx, vy = filtered(y * y) - my * my, v = filtered(x * y) - mx * my;
        at::Tensor map = (2 * v + 9e-4) / (vx + vy + 9e-4);
        if (s + 1 == scales) map = map * (2 * mx * my + 1e-4) / (mx * mx + my * my + 1e-4);
        product = product * map.mean({0, 2, 3}).clamp_min(1e-4).pow(weights[s] / sum);
        x = at::avg_pool2d(x, {2, 2});
        y = at::avg_pool2d(y, {2, 2});
    }
    const at::Tensor d = a - b;
    const at::Tensor across = (d.narrow(1, 1, d.size(1) - 1) - d.narrow(1, 0, d.size(1) - 1)).abs();
    const at::Tensor down = (d.narrow(0, 1, d.size(0) - 1) - d.narrow(0, 0, d.size(0) - 1)).abs();
    return (1 - product.mean()) / 2 + (across.sum() + down.sum()) / static_cast<double>(across.numel() + down.numel());
}

TEST(MsSsimGradient, ValueAndGradientAreThoseOfThePlainFormula) {
    const auto loss = msSsimGradientLoss();
    EXPECT_EQ(loss->name(), "ms_ssim_gradient");
    for (const auto& [height, width, scales] : {std::array{47, 53, 3}, {13, 30, 1}, {23, 25, 2}}) {
        const at::Tensor b = picture(height, width, 3).to(at::kDouble);
        const at::Tensor start = 0.7 * b + 0.3 * picture(height, width, 4).to(at::kDouble);
        at::Tensor x = start.clone().requires_grad_(true), y = start.clone().requires_grad_(true);
        const at::Tensor ours = loss->evaluate(x, b), plain = plainStandIn(y, b, scales);
        EXPECT_NEAR(ours.item<double>(), plain.item<double>(), 1e-12);
        ours.backward();
        plain.backward();
        const double largest = y.grad().abs().max().item<double>();
        EXPECT_LT((x.grad() - y.grad()).abs().max().item<double>(), 1e-9 * largest);
        const at::Tensor rough = loss->evaluate(start.to(at::kFloat), b.to(at::kFloat));
        EXPECT_NEAR(rough.item<double>(), plain.item<double>(), 1e-5);
    }
}

TEST(MsSsimGradient, IsZeroForEqualPicturesOfAnySize) {
    const auto loss = msSsimGradientLoss();
    for (const std::int64_t side : {4, 11, 40}) {
        const at::Tensor a = picture(side, side + 3, 5);
        EXPECT_NEAR(loss->evaluate(a, a).item<double>(), 0.0, 1e-6);
    }
}

TEST(PerceptualPatch, SquareIsThePersonsLongerSideAboutTheirCentre) {
    at::Tensor inside = at::zeros({20, 30, 1});
    inside.slice(0, 3, 15).slice(1, 10, 14).fill_(1.0); // 12 high, 4 wide
    EXPECT_EQ(personSquare(inside), (PictureSquare{6, 3, 12}));
    inside.slice(0, 8, 9).slice(1, 0, 30).fill_(1.0); // now 30 wide: reaches above and below
    EXPECT_EQ(personSquare(inside), (PictureSquare{0, -6, 30}));
    EXPECT_EQ(personSquare(at::zeros({20, 30, 1})), (PictureSquare{0, -5, 30}));
}

TEST(PerceptualPatch, ShowsTheBackgroundBeyondThePictureAndThePixelsAsTheyAre) {
    const at::Tensor original = picture(6, 8, 3), background = at::tensor({0.2f, 0.4f, 0.6f});
    const at::Tensor patch = perceptualPatch(original, {-2, 1, 7}, 7, background);
    ASSERT_EQ(patch.sizes(), at::IntArrayRef({7, 7, 3}));
    EXPECT_LT((patch.slice(0, 0, 5).slice(1, 2, 7) - original.slice(0, 1, 6).slice(1, 0, 5)).abs().max().item<double>(),
              1e-6);
    EXPECT_LT((patch.slice(1, 0, 2) - background).abs().max().item<double>(), 1e-6);
    EXPECT_LT((patch.slice(0, 5, 7) - background).abs().max().item<double>(), 1e-6);
}

TEST(PerceptualPatch, ResizesAboutPixelCentres) {
    // A ramp stays a ramp: at size 2 n the centres lie at (i + 0.5) / 2.
    const at::Tensor ramp = at::arange(8, at::kFloat).view({1, 8, 1}).expand({8, 8, 3}).contiguous();
    const at::Tensor patch = perceptualPatch(ramp, {0, 0, 8}, 16, at::zeros({3}));
    for (int i = 1; i < 15; ++i) EXPECT_NEAR(patch[5][i][1].item<float>(), (i + 0.5f) / 2.0f - 0.5f, 1e-5f);
    at::Tensor leaf = ramp.clone().requires_grad_();
    perceptualPatch(leaf, {2, 2, 4}, 8, at::zeros({3})).sum().backward();
    // Four pixels became sixteen numbers each, those around the square none.
    EXPECT_NEAR(leaf.grad().sum().item<double>(), 8 * 8 * 3, 1e-3);
    EXPECT_EQ(leaf.grad().slice(0, 0, 2).abs().max().item<double>(), 0.0);
}

} // namespace
} // namespace ars
