#include "model/runtime.h"

#include "engine/core/parallel.h"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <fstream>
#include <set>

namespace ars {
namespace {

TEST(Torch, UsesTheThreadsOfTheBudget) {
    const TorchInfo info = initializeTorch();
    EXPECT_EQ(info.version, "2.11.0");
    EXPECT_EQ(info.threads, threadCount());
    EXPECT_TRUE(info.onednn);
    EXPECT_TRUE(info.mkl);
}

TEST(Torch, OneOpenMpServesBothSides) {
    initializeTorch();
    parallelFor(10'000, [](std::size_t) {}, 1);
    std::ifstream maps("/proc/self/maps");
    std::set<std::string> libraries;
    for (std::string line; std::getline(maps, line);) {
        if (line.find("libgomp") != std::string::npos || line.find("libomp") != std::string::npos ||
            line.find("libiomp") != std::string::npos) {
            libraries.insert(line.substr(line.find('/')));
        }
    }
    EXPECT_EQ(libraries.size(), 1u) << (libraries.empty() ? "none" : *libraries.begin());
}

TEST(Torch, ConvolutionAgreesWithItsDefinition) {
    // Three by three by hand in double: proves that the library that was loaded computes, not only that it loads.
    torch::manual_seed(1);
    const auto image = torch::randn({1, 3, 9, 7});
    const auto kernel = torch::randn({2, 3, 3, 3});
    const auto result = torch::conv2d(image, kernel, {}, 1, 1);
    for (int o = 0; o < 2; ++o) {
        for (int y = 0; y < 9; ++y) {
            for (int x = 0; x < 7; ++x) {
                double sum = 0;
                for (int c = 0; c < 3; ++c) {
                    for (int dy = -1; dy <= 1; ++dy) {
                        for (int dx = -1; dx <= 1; ++dx) {
                            if (y + dy < 0 || y + dy >= 9 || x + dx < 0 || x + dx >= 7) continue;
                            sum += image[0][c][y + dy][x + dx].item<double>() *
                                   kernel[o][c][dy + 1][dx + 1].item<double>();
                        }
                    }
                }
                ASSERT_NEAR(result[0][o][y][x].item<double>(), sum, 1e-5);
            }
        }
    }
}

TEST(Torch, GradientsFlow) {
    const auto x = torch::tensor({2.0, 3.0}, torch::requires_grad());
    (x * x * x).sum().backward();
    EXPECT_TRUE(torch::allclose(x.grad(), torch::tensor({12.0, 27.0})));
}

} // namespace
} // namespace ars
