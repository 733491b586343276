#pragma once

#include "engine/io/safetensors.h"

#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

/// Weights for LPIPS that are drawn by a formula, the same as make_lpips_fixtures.py draws.
namespace ars::test {

/// Numbers in [-1, 1) as make_lpips_fixtures.py draws them.
inline std::vector<float> uniformNumbers(std::size_t count, std::uint64_t seed) {
    std::vector<float> numbers(count);
    for (std::size_t i = 0; i < count; ++i) {
        std::uint64_t z = (seed << 32) + i + 0x9E3779B97F4A7C15ull;
        z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ull;
        z = (z ^ (z >> 27)) * 0x94D049BB133111EBull;
        z ^= z >> 31;
        numbers[i] = static_cast<float>(static_cast<double>(z >> 40) / double(1 << 23) - 1.0);
    }
    return numbers;
}

struct Convolution {
    const char* name;
    std::size_t outputs, inputs, side;
};
inline const std::vector<Convolution> kAlex{{"features.0", 64, 3, 11},
                                            {"features.3", 192, 64, 5},
                                            {"features.6", 384, 192, 3},
                                            {"features.8", 256, 384, 3},
                                            {"features.10", 256, 256, 3}};
inline const std::vector<Convolution> kVgg{
    {"features.0", 64, 3, 3},     {"features.2", 64, 64, 3},    {"features.5", 128, 64, 3},
    {"features.7", 128, 128, 3},  {"features.10", 256, 128, 3}, {"features.12", 256, 256, 3},
    {"features.14", 256, 256, 3}, {"features.17", 512, 256, 3}, {"features.19", 512, 512, 3},
    {"features.21", 512, 512, 3}, {"features.24", 512, 512, 3}, {"features.26", 512, 512, 3},
    {"features.28", 512, 512, 3}};

inline SafetensorsFile lpipsBackbone(const std::vector<Convolution>& convolutions) {
    const std::vector<float> block = uniformNumbers(1 << 16, 7);
    SafetensorsFile file;
    for (std::size_t index = 0; index < convolutions.size(); ++index) {
        const Convolution& c = convolutions[index];
        const std::size_t fan = c.inputs * c.side * c.side;
        const auto bound = static_cast<float>(std::sqrt(6.0 / static_cast<double>(fan)));
        std::vector<float> weight(c.outputs * fan), bias(c.outputs);
        for (std::size_t i = 0; i < weight.size(); ++i)
            weight[i] = block[(i * 40503 + index * 977) % block.size()] * bound;
        for (std::size_t i = 0; i < bias.size(); ++i) bias[i] = 0.05f * block[(i + 31 * index) % block.size()];
        file.tensors[std::string(c.name) + ".weight"] =
            Array::fromFloats({c.outputs, c.inputs, c.side, c.side}, weight);
        file.tensors[std::string(c.name) + ".bias"] = Array::fromFloats({c.outputs}, bias);
    }
    return file;
}

/// Linear weights of a network's five compared layers: positive, of the shapes that the package's files have.
inline SafetensorsFile lpipsHeads(const std::vector<std::size_t>& channels) {
    SafetensorsFile file;
    for (std::size_t layer = 0; layer < channels.size(); ++layer) {
        std::vector<float> weights = uniformNumbers(channels[layer], 11 + layer);
        for (float& weight : weights) weight = 0.1f * std::abs(weight);
        file.tensors["lin" + std::to_string(layer) + ".model.1.weight"] =
            Array::fromFloats({1, channels[layer], 1, 1}, weights);
    }
    return file;
}

} // namespace ars::test
