#pragma once

#include "engine/light/cube_map.h"
#include "engine/light/prefilter.h"
#include "engine/light/split_sum_lut.h"

#include <gtest/gtest.h>

#include <functional>
#include <random>
#include <vector>

namespace ars::test {

using Direction = glm::dvec3;

/// Direction of a texel by the table of reference conventions, written out once more.
inline Direction texelDirection(int face, int row, int column, int size) {
    const double u = 2.0 * (column + 0.5) / size - 1.0, v = 2.0 * (row + 0.5) / size - 1.0;
    const Direction table[6] = {{1, -v, -u}, {-1, -v, u}, {u, 1, v}, {u, -1, -v}, {u, -v, 1}, {-u, -v, -1}};
    return glm::normalize(table[face]);
}

/// A cube whose texels are a function of direction.
inline CubeMap cubeOf(int size, const std::function<glm::dvec3(const Direction&)>& radiance) {
    CubeMap cube(size);
    for (int face = 0; face < 6; ++face) {
        for (int row = 0; row < size; ++row) {
            for (int column = 0; column < size; ++column) {
                const glm::dvec3 color = radiance(texelDirection(face, row, column, size));
                for (int c = 0; c < 3; ++c) cube.texel(face, row, column)[c] = static_cast<float>(color[c]);
            }
        }
    }
    return cube;
}

inline CubeMap randomCube(int size, unsigned seed) {
    std::mt19937 random(seed);
    std::lognormal_distribution<float> value(0.0f, 1.5f);
    CubeMap cube(size);
    for (float& v : cube.texels) v = value(random);
    return cube;
}

/// A lat-long picture as a function of direction.
inline Image latLongOf(int width, int height, const std::function<glm::dvec3(const Direction&)>& radiance) {
    Image image;
    image.width = width;
    image.height = height;
    image.channels = 3;
    image.pixels.resize(3 * static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
    for (int row = 0; row < height; ++row) {
        for (int column = 0; column < width; ++column) {
            const double a = 2.0 * 3.14159265358979323846 * (0.5 - (column + 0.5) / width);
            const double t = 3.14159265358979323846 * (row + 0.5) / height;
            const glm::dvec3 color = radiance({std::sin(t) * std::sin(a), std::cos(t), std::sin(t) * std::cos(a)});
            for (int c = 0; c < 3; ++c) image.at(row, column, c) = static_cast<float>(color[c]);
        }
    }
    return image;
}

inline std::vector<float> download(const PixelBuffer& picture) {
    std::vector<float> values(picture.view().valueCount());
    EXPECT_TRUE(downloadBuffer(std::as_writable_bytes(std::span<float>(values)), picture.memory()).ok());
    return values;
}

inline PixelBuffer upload(const Device& device, const std::vector<float>& values, int width, int height, int channels) {
    auto picture = PixelBuffer::allocate(device, width, height, channels, "test");
    EXPECT_TRUE(picture.ok());
    EXPECT_TRUE(uploadBuffer(picture->memory(), std::as_bytes(std::span<const float>(values))).ok());
    return std::move(*picture);
}

inline PrefilteredLight filtered(const Device& device, const CubeMap& base, const PrefilterParams& params = {}) {
    PrefilteredLight light;
    const Status status = prefilterLight(device, base, params, light);
    EXPECT_TRUE(status.ok()) << status.error().describe();
    return light;
}

/// The same light in host memory and in T, for the templates of light_math.h.
template <typename T>
struct HostLight {
    std::array<std::vector<T>, kMaxLightLevels> levels;
    std::vector<T> diffuse, lut;
    LightView<T> view;

    explicit HostLight(const PrefilteredLight& light) {
        const auto copy = [](const PixelBuffer& picture) {
            const std::vector<float> values = download(picture);
            return std::vector<T>(values.begin(), values.end());
        };
        view.levels = light.levels;
        for (int l = 0; l < light.levels; ++l) {
            const std::size_t i = static_cast<std::size_t>(l);
            levels[i] = copy(light.specular[i]);
            view.specular[l] = {levels[i].data(), light.specular[i].width()};
        }
        diffuse = copy(light.diffuse);
        lut = copy(*light.lut);
        view.diffuse = {diffuse.data(), light.diffuse.width()};
        view.lut = lut.data();
        view.lutSize = light.lut->width();
    }
};

} // namespace ars::test
