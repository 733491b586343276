// Backward of splatting: the maths against central differences in double without cut-offs, the float path against the
// maths in double.
#include "engine/surfel/splat_gradient.h"
#include "engine/surfel/splat_gradient_math.h"
#include "tests/unit/surfel/splat_gradient_support.h"

#include <glm/gtc/quaternion.hpp>

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>
#include <random>
#include <vector>

namespace ars {
namespace {

constexpr int kWidth = 24, kHeight = 20;
constexpr int kFeatures = 3 + 3 + 1 + 3; ///< normal, albedo, radius (detached), bone

/// Numbers of one surfel: mean 3, rotation 4, scale 2, opacity 1, albedo 3, radius 1, bone 3.
constexpr int kNumbers = 17;
using Numbers = std::vector<double>;

struct Weights {
    std::vector<double> opacity, depth, position, features; ///< dL/dOut, per pixel
};

struct Scene {
    Camera camera;
    SplatParams params;
    std::vector<Numbers> surfels;
    Weights weights;
    bool cutOffs = false; ///< 1/255 and 1e-4, as the program has them
};

struct Blended {
    ProjectedSurfel<double> row;
    double features[kFeatures];
    std::size_t surfel;
};

Scene randomScene(SurfelKernel kernel, DepthMode depth, int count, unsigned seed) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> unit(-1.0, 1.0);
    Scene scene;
    scene.camera = lookAtCamera({0.1, 0.2, 2.0}, {0.0, 0.0, 0.0}, 30.0, kWidth, kHeight);
    scene.camera.cx += 1.3;
    scene.params.kernel = kernel;
    scene.params.depth = depth;
    for (int i = 0; i < count; ++i) {
        Numbers s(kNumbers);
        for (int k = 0; k < 3; ++k) s[static_cast<std::size_t>(k)] = 0.35 * unit(random);
        // Facing the camera within 60 degrees; length 1.3, so that normalisation is part of the test.
        const glm::dquat q =
            glm::angleAxis(1.0 * unit(random), glm::normalize(glm::dvec3(unit(random), unit(random), 0.3)));
        s[3] = 1.3 * q.w;
        s[4] = 1.3 * q.x;
        s[5] = 1.3 * q.y;
        s[6] = 1.3 * q.z;
        s[7] = 0.05 + 0.04 * std::abs(unit(random));
        s[8] = 0.03 + 0.04 * std::abs(unit(random));
        s[9] = 0.5 + 0.35 * unit(random);
        for (std::size_t k = 10; k < kNumbers; ++k) s[k] = 0.5 + 0.4 * unit(random);
        scene.surfels.push_back(s);
    }
    const auto fill = [&](std::vector<double>& values, int channels) {
        values.resize(static_cast<std::size_t>(kWidth * kHeight * channels));
        for (double& v : values) v = unit(random);
    };
    fill(scene.weights.opacity, 1);
    fill(scene.weights.depth, 1);
    fill(scene.weights.position, 3);
    fill(scene.weights.features, kFeatures);
    return scene;
}

/// Where a channel of the test lies among the features, its width, and whether it is brought to unit length.
struct TestChannel {
    int offset, width;
    bool unit, detached;
};
constexpr TestChannel kTestChannels[] = {
    {0, 3, true, false}, {3, 3, false, false}, {6, 1, false, true}, {7, 3, true, true}};

std::vector<Blended> projected(const Scene& scene) {
    const SplatView<double> view = splatView(scene.camera, scene.params.kernel, false, scene.params.depth);
    std::vector<Blended> blended;
    for (std::size_t i = 0; i < scene.surfels.size(); ++i) {
        const Numbers& s = scene.surfels[i];
        Blended b;
        b.surfel = i;
        glm::dvec3 normal(0.0);
        PixelRect rect;
        const SurfelFate fate =
            projectSurfel(view, glm::dvec3(s[0], s[1], s[2]), &s[3], glm::dvec2(s[7], s[8]), s[9], b.row, normal, rect);
        if (fate != SurfelFate::Visible) continue;
        const glm::dvec3 bone = scene.camera.rotation * glm::dvec3(s[14], s[15], s[16]);
        const double features[kFeatures] = {normal.x, normal.y, normal.z, s[10],  s[11],
                                            s[12],    s[13],    bone.x,   bone.y, bone.z};
        std::copy(features, features + kFeatures, b.features);
        blended.push_back(b);
    }
    std::stable_sort(blended.begin(), blended.end(),
                     [](const Blended& a, const Blended& b) { return a.row.depth < b.row.depth; });
    return blended;
}

double log2AlphaOf(const Scene& scene, const ProjectedSurfel<double>& row, double x, double y) {
    return scene.params.kernel == SurfelKernel::RaySplat
               ? log2AlphaAt<SurfelKernel::RaySplat>(row, x - row.u, y - row.v)
               : log2AlphaAt<SurfelKernel::GaussianSurfel>(row, x - row.u, y - row.v);
}

double depthOf(const Scene& scene, const ProjectedSurfel<double>& row, double x, double y) {
    const double dx = x - row.u, dy = y - row.v;
    if (scene.params.kernel == SurfelKernel::RaySplat)
        return depthAt<SurfelKernel::RaySplat, DepthMode::Exact>(row, dx, dy);
    if (scene.params.depth == DepthMode::Exact)
        return depthAt<SurfelKernel::GaussianSurfel, DepthMode::Exact>(row, dx, dy);
    return depthAt<SurfelKernel::GaussianSurfel, DepthMode::Linear>(row, dx, dy);
}

/// One pixel of the oracle: which surfels, with what weights, and the pictures' values.
struct Pixel {
    std::vector<std::size_t> entries;
    std::vector<double> log2Alpha, transmittance, weight;
    double opacity = 0.0, depth = 0.0;
    double sums[kFeatures] = {}, out[kFeatures] = {};
    glm::dvec3 ray{0.0};
};

Pixel blendPixel(const Scene& scene, const std::vector<Blended>& blended, int column, int row) {
    Pixel p;
    const double x = column + 0.5, y = row + 0.5;
    double t = 1.0, depthSum = 0.0;
    for (std::size_t k = 0; k < blended.size(); ++k) {
        const double log2Alpha = log2AlphaOf(scene, blended[k].row, x, y);
        if (scene.cutOffs && log2Alpha < kMinLog2Alpha) continue;
        const double alpha = std::min(std::exp2(log2Alpha), kMaxAlpha), weight = t * alpha;
        if (scene.cutOffs && t - weight < kMinTransmittance) break;
        p.entries.push_back(k);
        p.log2Alpha.push_back(log2Alpha);
        p.transmittance.push_back(t);
        p.weight.push_back(weight);
        p.opacity += weight;
        depthSum += weight * depthOf(scene, blended[k].row, x, y);
        for (int c = 0; c < kFeatures; ++c) p.sums[c] += weight * blended[k].features[c];
        t -= weight;
    }
    const glm::dvec3 view((x - scene.camera.cx) / scene.camera.fx, (y - scene.camera.cy) / scene.camera.fy, 1.0);
    p.ray = glm::transpose(scene.camera.rotation) * view;
    if (!(p.opacity > kMinOpacity)) return p;
    p.depth = depthSum / p.opacity;
    for (const TestChannel& channel : kTestChannels) {
        double by = p.opacity;
        if (channel.unit) {
            const double* s = p.sums + channel.offset;
            by = std::sqrt(s[0] * s[0] + s[1] * s[1] + s[2] * s[2]);
        }
        for (int c = 0; c < channel.width; ++c) p.out[channel.offset + c] = p.sums[channel.offset + c] / by;
    }
    return p;
}

/// L, the sum of all outputs times their weights. `only`: the loss of the detached channels, of the others, or both.
double loss(const Scene& scene, bool attached = true, bool detached = true) {
    const std::vector<Blended> blended = projected(scene);
    const glm::dvec3 origin = scene.camera.centerWorld();
    double total = 0.0;
    for (int row = 0; row < kHeight; ++row) {
        for (int column = 0; column < kWidth; ++column) {
            const Pixel p = blendPixel(scene, blended, column, row);
            const auto i = static_cast<std::size_t>(row * kWidth + column);
            if (attached) {
                total += scene.weights.opacity[i] * p.opacity;
                if (!(p.opacity > kMinOpacity)) continue;
                total += scene.weights.depth[i] * p.depth;
                const glm::dvec3 position = origin + p.depth * p.ray;
                for (int c = 0; c < 3; ++c)
                    total += scene.weights.position[3 * i + static_cast<std::size_t>(c)] * position[c];
            }
            for (const TestChannel& channel : kTestChannels) {
                if (channel.detached ? !detached : !attached) continue;
                for (int c = channel.offset; c < channel.offset + channel.width; ++c) {
                    total += scene.weights.features[i * kFeatures + static_cast<std::size_t>(c)] * p.out[c];
                }
            }
        }
    }
    return total;
}

template <SurfelKernel Kernel, DepthMode Depth>
void passBack(const Blended& b, double x, double y, double gLog2Alpha, double gDepth, ProjectedGradient<double>& g) {
    log2AlphaBackward<Kernel>(b.row, x - b.row.u, y - b.row.v, gLog2Alpha, g);
    depthBackward<Kernel, Depth>(b.row, x - b.row.u, y - b.row.v, gDepth, g);
}

/// The backward maths in double, all pairs.
std::vector<Numbers> analytic(const Scene& scene) {
    const std::vector<Blended> blended = projected(scene);
    std::vector<ProjectedGradient<double>> rows(blended.size());
    std::vector<std::array<double, kFeatures>> features(blended.size(), std::array<double, kFeatures>{});
    for (int row = 0; row < kHeight; ++row) {
        for (int column = 0; column < kWidth; ++column) {
            const Pixel p = blendPixel(scene, blended, column, row);
            const auto i = static_cast<std::size_t>(row * kWidth + column);
            double gOpacity = scene.weights.opacity[i], gDepth = 0.0;
            double g[kFeatures] = {}, attached[kFeatures] = {};
            if (p.opacity > kMinOpacity) {
                for (const TestChannel& channel : kTestChannels) {
                    const double* s = p.sums + channel.offset;
                    const double length = channel.unit ? std::sqrt(s[0] * s[0] + s[1] * s[1] + s[2] * s[2]) : 0.0;
                    const double to = normaliseBackward(
                        channel.width, channel.unit, p.opacity, length, p.out + channel.offset,
                        scene.weights.features.data() + i * kFeatures + static_cast<std::size_t>(channel.offset),
                        g + channel.offset);
                    if (channel.detached) continue;
                    gOpacity += to;
                    std::copy(g + channel.offset, g + channel.offset + channel.width, attached + channel.offset);
                }
                double atDepth = scene.weights.depth[i];
                for (int c = 0; c < 3; ++c)
                    atDepth += scene.weights.position[3 * i + static_cast<std::size_t>(c)] * p.ray[c];
                gDepth = atDepth / p.opacity;
                gOpacity -= atDepth * p.depth / p.opacity;
            }
            double suffix = 0.0;
            for (std::size_t k = p.entries.size(); k-- > 0;) {
                const Blended& b = blended[p.entries[k]];
                const double x = column + 0.5, y = row + 0.5;
                double h = gOpacity + gDepth * depthOf(scene, b.row, x, y);
                for (int c = 0; c < kFeatures; ++c) h += attached[c] * b.features[c];
                const double before = p.transmittance[k];
                const double gAlpha = blendBackward<double>(p.weight[k], before, before - p.weight[k], h, suffix);
                suffix += p.weight[k] * h;
                ProjectedGradient<double>& out = rows[p.entries[k]];
                const double gz = p.weight[k] * gDepth;
                if (scene.params.kernel == SurfelKernel::RaySplat) {
                    passBack<SurfelKernel::RaySplat, DepthMode::Exact>(b, x, y, gAlpha, gz, out);
                } else if (scene.params.depth == DepthMode::Exact) {
                    passBack<SurfelKernel::GaussianSurfel, DepthMode::Exact>(b, x, y, gAlpha, gz, out);
                } else {
                    passBack<SurfelKernel::GaussianSurfel, DepthMode::Linear>(b, x, y, gAlpha, gz, out);
                }
                for (int c = 0; c < kFeatures; ++c)
                    features[p.entries[k]][static_cast<std::size_t>(c)] += p.weight[k] * g[c];
            }
        }
    }
    const SplatView<double> view = splatView(scene.camera, scene.params.kernel, false, scene.params.depth);
    std::vector<Numbers> result(scene.surfels.size(), Numbers(kNumbers, 0.0));
    for (std::size_t k = 0; k < blended.size(); ++k) {
        const Numbers& s = scene.surfels[blended[k].surfel];
        Numbers& out = result[blended[k].surfel];
        const auto& f = features[k];
        SurfelGeometryGradient<double> geometry;
        projectSurfelBackward(view, glm::dvec3(s[0], s[1], s[2]), &s[3], glm::dvec2(s[7], s[8]), s[9], blended[k].row,
                              rows[k], glm::dvec3(f[0], f[1], f[2]), geometry);
        for (int c = 0; c < 3; ++c) out[static_cast<std::size_t>(c)] = geometry.mean[c];
        std::copy(geometry.rotation, geometry.rotation + 4, out.begin() + 3);
        out[7] = geometry.scale.x;
        out[8] = geometry.scale.y;
        out[9] = geometry.opacity;
        for (std::size_t c = 0; c < 4; ++c) out[10 + c] = f[3 + c];
        const glm::dvec3 bone = glm::transpose(scene.camera.rotation) * glm::dvec3(f[7], f[8], f[9]);
        for (int c = 0; c < 3; ++c) out[14 + static_cast<std::size_t>(c)] = bone[c];
    }
    return result;
}

/// The largest size of a gradient among the numbers [first, last) of all surfels.
double sizeOf(const std::vector<Numbers>& g, std::size_t first, std::size_t last) {
    double most = 0.0;
    for (const Numbers& row : g) {
        for (std::size_t k = first; k < last; ++k) most = std::max(most, std::abs(row[k]));
    }
    return most;
}

struct Group {
    const char* name;
    std::size_t first, last;
    bool detached;
};
constexpr Group kGroups[] = {{"mean", 0, 3, false},     {"rotation", 3, 7, false}, {"scale", 7, 9, false},
                             {"opacity", 9, 10, false}, {"albedo", 10, 13, false}, {"radius", 13, 14, true},
                             {"bone", 14, 17, true}};

/// Number k of surfel i, as in Numbers.
double numberOf(const SurfelGradients& got, std::size_t i, std::size_t k) {
    if (k < 3) return got.means[i][static_cast<int>(k)];
    if (k < 7) return got.rotations[4 * i + k - 3];
    if (k < 9) return got.scales[i][static_cast<int>(k - 7)];
    if (k < 10) return got.opacities[i];
    if (k < 13) return got.albedos[i][static_cast<int>(k - 10)];
    if (k < 14) return got.radii[i];
    return got.bones[i][static_cast<int>(k - 14)];
}

/// Each number within 1e-3 of the largest of its kind.
void expectNumbers(const SurfelGradients& got, const std::vector<Numbers>& expected) {
    for (const Group& group : kGroups) {
        const double size = sizeOf(expected, group.first, group.last);
        for (std::size_t i = 0; i < expected.size(); ++i) {
            for (std::size_t k = group.first; k < group.last; ++k) {
                EXPECT_NEAR(numberOf(got, i, k), expected[i][k], 1e-3 * size)
                    << group.name << " " << k - group.first << " of surfel " << i;
            }
        }
    }
}

class SplatGradient : public ::testing::TestWithParam<std::pair<SurfelKernel, DepthMode>> {};

TEST_P(SplatGradient, EqualsCentralDifferencesInDouble) {
    for (const unsigned seed : {1u, 2u, 3u}) {
        Scene scene = randomScene(GetParam().first, GetParam().second, 9, seed);
        const std::vector<Numbers> expected = analytic(scene);
        for (const Group& group : kGroups) {
            const double size = sizeOf(expected, group.first, group.last);
            EXPECT_GT(size, 0.0) << group.name;
            for (std::size_t i = 0; i < scene.surfels.size(); ++i) {
                for (std::size_t k = group.first; k < group.last; ++k) {
                    const double kept = scene.surfels[i][k], step = 2e-6;
                    // Five points: the error of the differences themselves stays far below the bound.
                    const auto at = [&](double offset) {
                        scene.surfels[i][k] = kept + offset;
                        // Radius and bone pass nothing to geometry, and geometry gets nothing from them.
                        return loss(scene, !group.detached, group.detached);
                    };
                    const double slope =
                        (8.0 * (at(step) - at(-step)) - (at(2.0 * step) - at(-2.0 * step))) / (12.0 * step);
                    scene.surfels[i][k] = kept;
                    EXPECT_NEAR(expected[i][k], slope, 1e-6 * size + 1e-9)
                        << group.name << " " << k - group.first << " of surfel " << i << ", seed " << seed;
                }
            }
        }
    }
}

TEST_P(SplatGradient, FloatPathFollowsTheMathsInDouble) {
    Scene scene = randomScene(GetParam().first, GetParam().second, 40, 5);
    scene.cutOffs = true;
    Surfels surfels;
    for (Numbers& s : scene.surfels) {
        for (double& number : s) number = static_cast<double>(static_cast<float>(number));
        const auto f = [&](std::size_t k) { return static_cast<float>(s[k]); };
        surfels.means.push_back({f(0), f(1), f(2)});
        for (std::size_t k = 3; k < 7; ++k) surfels.rotations.push_back(f(k));
        surfels.scales.push_back({f(7), f(8)});
        surfels.opacities.push_back(f(9));
        surfels.albedos.push_back({f(10), f(11), f(12)});
        surfels.radii.push_back(f(13));
        surfels.bones.push_back({f(14), f(15), f(16)});
    }
    const ChannelSet channels{Channel::Opacity, Channel::Depth,  Channel::Normal, Channel::Position,
                              Channel::Albedo,  Channel::Radius, Channel::Bone};
    std::array<std::vector<float>, kChannelCount> pictures;
    GBufferGradients gradients;
    const auto give = [&](Channel channel, const std::vector<double>& from, int stride, int offset) {
        const int width = channelWidth(channel);
        std::vector<float>& values = pictures[static_cast<std::size_t>(channel)];
        for (std::size_t p = 0; p < kWidth * kHeight; ++p) {
            for (int c = 0; c < width; ++c) {
                values.push_back(static_cast<float>(
                    from[p * static_cast<std::size_t>(stride) + static_cast<std::size_t>(offset + c)]));
            }
        }
        gradients[channel] = {values.data(), kWidth, kHeight, width};
    };
    give(Channel::Opacity, scene.weights.opacity, 1, 0);
    give(Channel::Depth, scene.weights.depth, 1, 0);
    give(Channel::Position, scene.weights.position, 3, 0);
    give(Channel::Normal, scene.weights.features, kFeatures, 0);
    give(Channel::Albedo, scene.weights.features, kFeatures, 3);
    give(Channel::Radius, scene.weights.features, kFeatures, 6);
    give(Channel::Bone, scene.weights.features, kFeatures, 7);
    const std::vector<Numbers> expected = analytic(scene);
    for (const test::Backward& backward : test::backwards()) {
        SCOPED_TRACE(backward.name);
        SurfelGradients got;
        ASSERT_TRUE(backward.run({scene.params, surfels, scene.camera, channels, gradients, {}}, got).ok());
        expectNumbers(got, expected);
    }
}

INSTANTIATE_TEST_SUITE_P(Kernels, SplatGradient,
                         ::testing::Values(std::pair{SurfelKernel::GaussianSurfel, DepthMode::Linear},
                                           std::pair{SurfelKernel::GaussianSurfel, DepthMode::Exact},
                                           std::pair{SurfelKernel::GaussianSurfel, DepthMode::Filtered},
                                           std::pair{SurfelKernel::RaySplat, DepthMode::Exact}));

} // namespace
} // namespace ars
