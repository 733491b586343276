#pragma once

#include "engine/core/buffer.h"
#include "engine/core/parallel.h"
#include "engine/surfel/splat.h"
#include "engine/surfel/splat_math.h"
#include "tests/support/devices.h"

#include <glm/gtc/quaternion.hpp>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <map>
#include <random>
#include <string>
#include <vector>

namespace ars::test {

/// Pictures in host memory as doubles, whoever made them.
struct Pictures {
    int width = 0, height = 0;
    std::map<Channel, std::vector<double>> channels;
    SplatStats stats;

    double at(Channel channel, int row, int column, int part = 0) const {
        const int parts = channelWidth(channel);
        return channels.at(channel)[static_cast<std::size_t>((row * width + column) * parts + part)];
    }
    glm::dvec3 vec(Channel channel, int row, int column) const {
        return {at(channel, row, column, 0), at(channel, row, column, 1), at(channel, row, column, 2)};
    }
};

/// The camera at the origin that looks along +z: camera space is world space.
inline Camera straightCamera(int width, int height, double focal, double cx, double cy) {
    Camera camera;
    camera.width = width;
    camera.height = height;
    camera.fx = camera.fy = focal;
    camera.cx = cx;
    camera.cy = cy;
    return camera;
}

/// w, x, y, z of the shortest turn from +z to `normal` (unit length), after a turn by `spin` about +z.
inline std::array<float, 4> rotationTo(const glm::dvec3& normal, double spin = 0.0) {
    glm::dquat turn(1.0 + normal.z, -normal.y, normal.x, 0.0);
    turn = glm::length(turn) > 1e-6 ? glm::normalize(turn) : glm::dquat(0.0, 1.0, 0.0, 0.0);
    const glm::dquat both = turn * glm::dquat(std::cos(0.5 * spin), 0.0, 0.0, std::sin(0.5 * spin));
    return {static_cast<float>(both.w), static_cast<float>(both.x), static_cast<float>(both.y),
            static_cast<float>(both.z)};
}

/// Adds a surfel with every attribute; those not given are functions of its index that differ from one another.
inline void addSurfel(Surfels& s, const glm::dvec3& mean, const glm::dvec3& normal, double sigma0, double sigma1,
                      double opacity, double spin = 0.0) {
    const auto i = static_cast<float>(s.count() % 17);
    s.means.emplace_back(mean);
    for (const float q : rotationTo(normal, spin)) s.rotations.push_back(q);
    s.scales.emplace_back(static_cast<float>(sigma0), static_cast<float>(sigma1));
    s.opacities.push_back(static_cast<float>(opacity));
    s.colors.emplace_back(0.05f * i, 1.0f - 0.05f * i, 0.3f);
    s.albedos.emplace_back(0.9f - 0.04f * i, 0.2f + 0.02f * i, 0.1f);
    s.roughnesses.push_back(0.1f + 0.05f * i);
    s.radii.push_back(0.04f + 0.01f * i);
    s.radiiPlus.push_back(0.05f + 0.01f * i);
    s.radiiMinus.push_back(0.03f + 0.01f * i);
    s.importances.push_back(0.05f * i);
    s.bones.push_back(glm::normalize(glm::vec3(0.1f * i, 1.0f, 0.2f)));
}

/// Surfels of all kinds in front of `straightCamera`: sizes from below a pixel to a fifth of the picture, long ones,
/// tilted ones up to edge-on, opacities from nothing to 1.
inline Surfels randomSurfels(std::size_t count, unsigned seed) {
    Surfels s;
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> unit(0.0, 1.0);
    std::normal_distribution<double> normal;
    for (std::size_t i = 0; i < count; ++i) {
        const double z = 1.5 + 2.0 * unit(random);
        const glm::dvec3 mean((unit(random) - 0.5) * 1.1 * z, (unit(random) - 0.5) * 1.1 * z, z);
        const glm::dvec3 direction =
            glm::normalize(glm::dvec3(0.7 * normal(random), 0.7 * normal(random), -1.0 + 0.6 * normal(random)));
        const double size = 0.002 * std::pow(60.0, unit(random) * unit(random));
        addSurfel(s, mean, direction, size, size * std::pow(6.0, unit(random) - 0.5), 0.02 + 0.98 * unit(random),
                  6.3 * unit(random));
    }
    return s;
}

inline constexpr ChannelSet kAllChannels{Channel::Opacity,     Channel::Depth,      Channel::Normal,
                                         Channel::Position,    Channel::Radiance,   Channel::Albedo,
                                         Channel::Roughness,   Channel::Radius,     Channel::RadiusPlus,
                                         Channel::RadiusMinus, Channel::Importance, Channel::Bone};

// --- the slow twin ---------------------------------------------------------------------------------------------------

/// What made each pixel, and how near its decisions came to their thresholds.
struct ReferencePixel {
    std::vector<std::pair<std::size_t, double>> contributors; ///< surfel, w
    double margin = 1e9; ///< least relative distance of an alpha to 1/255, or of a transmittance to 1e-4
};

template <typename T>
struct ReferenceSurfel {
    std::size_t index;
    ProjectedSurfel<T> row;
    Vec3<T> normal;
};

template <typename T>
std::vector<ReferenceSurfel<T>> projectAll(const SplatParams& params, const Surfels& s, const Camera& camera,
                                           SplatStats& stats) {
    const SplatView<T> view = splatView(camera.as<T>(), params.kernel, params.twoSided, params.depth);
    std::vector<ReferenceSurfel<T>> result;
    stats.surfels = s.count();
    for (std::size_t i = 0; i < s.count(); ++i) {
        ReferenceSurfel<T> one{i, {}, {}};
        T rotation[4];
        for (std::size_t k = 0; k < 4; ++k) rotation[k] = T(s.rotations[4 * i + k]);
        PixelRect rect;
        const SurfelFate fate = projectSurfel(view, Vec3<T>(s.means[i]), rotation, Vec2<T>(s.scales[i]),
                                              T(s.opacities[i]), one.row, one.normal, rect);
        ++stats.fates[static_cast<std::size_t>(fate)];
        if (fate == SurfelFate::Visible) result.push_back(one);
    }
    std::stable_sort(result.begin(), result.end(),
                     [](const auto& a, const auto& b) { return a.row.depth < b.row.depth; });
    return result;
}

template <typename T, SurfelKernel Kernel, DepthMode Depth>
ReferencePixel referencePixel(const std::vector<ReferenceSurfel<T>>& surfels, int row, int column, T& opacity,
                              T& depth) {
    ReferencePixel pixel;
    bool live = true;
    T transmittance = T(1);
    opacity = depth = T(0);
    for (const ReferenceSurfel<T>& s : surfels) {
        const T dx = T(column) + T(0.5) - s.row.u, dy = T(row) + T(0.5) - s.row.v;
        const T log2Alpha = log2AlphaAt<Kernel>(s.row, dx, dy);
        if (!live) break;
        pixel.margin = std::min(pixel.margin, std::abs(double(log2Alpha) - kMinLog2Alpha) * 0.69);
        const T before = transmittance;
        const T weight = blendWeight(log2Alpha, transmittance, live);
        const double next = double(before) * (1 - std::min(std::exp2(double(log2Alpha)), 0.99));
        if (log2Alpha >= T(kMinLog2Alpha)) pixel.margin = std::min(pixel.margin, std::abs(next / 1e-4 - 1));
        if (weight == T(0)) continue;
        opacity += weight;
        depth += weight * depthAt<Kernel, Depth>(s.row, dx, dy);
        pixel.contributors.emplace_back(s.index, double(weight));
    }
    EXPECT_NEAR(double(opacity), 1 - double(transmittance), 1e-6); // the weights' partition of 1 - T (S5)
    return pixel;
}

/// Every surfel against every pixel, in T, with the maths header and nothing of the sorting and tiling.
template <typename T>
Pictures referenceSplat(const SplatParams& params, const Surfels& s, const Camera& camera, ChannelSet wanted,
                        std::vector<ReferencePixel>* pixels = nullptr) {
    wanted.add(Channel::Opacity);
    Pictures result;
    result.width = camera.width;
    result.height = camera.height;
    const auto surfels = projectAll<T>(params, s, camera, result.stats);
    std::vector<Vec3<T>> normals(s.count(), Vec3<T>(0));
    for (const auto& one : surfels) normals[one.index] = one.normal;
    const auto count = static_cast<std::size_t>(camera.width * camera.height);
    for (int c = 0; c < kChannelCount; ++c) {
        const auto channel = static_cast<Channel>(c);
        if (wanted.has(channel)) {
            result.channels[channel].assign(count * static_cast<std::size_t>(channelWidth(channel)), 0.0);
        }
    }
    if (pixels) pixels->resize(count);
    const PinholeCamera<T> camT = camera.as<T>();
    for (int row = 0; row < camera.height; ++row) {
        for (int column = 0; column < camera.width; ++column) {
            const auto p = static_cast<std::size_t>(row * camera.width + column);
            T opacity, depth;
            ReferencePixel pixel;
            if (params.kernel == SurfelKernel::RaySplat) {
                pixel =
                    referencePixel<T, SurfelKernel::RaySplat, DepthMode::Exact>(surfels, row, column, opacity, depth);
            } else if (params.depth == DepthMode::Exact) {
                pixel = referencePixel<T, SurfelKernel::GaussianSurfel, DepthMode::Exact>(surfels, row, column, opacity,
                                                                                          depth);
            } else {
                pixel = referencePixel<T, SurfelKernel::GaussianSurfel, DepthMode::Linear>(surfels, row, column,
                                                                                           opacity, depth);
            }
            result.channels[Channel::Opacity][p] = double(opacity);
            if (opacity > T(kMinOpacity)) {
                auto blend1 = [&](Channel channel, auto value) {
                    if (!wanted.has(channel)) return;
                    T sum = 0;
                    for (const auto& [i, w] : pixel.contributors) sum += T(w) * T(value(i));
                    result.channels[channel][p] = double(sum / opacity);
                };
                auto blend3 = [&](Channel channel, bool unit, auto value) {
                    if (!wanted.has(channel)) return;
                    Vec3<T> sum(0);
                    for (const auto& [i, w] : pixel.contributors) sum += T(w) * Vec3<T>(value(i));
                    sum = unit ? glm::normalize(sum) : sum / opacity;
                    for (int k = 0; k < 3; ++k)
                        result.channels[channel][3 * p + static_cast<std::size_t>(k)] = double(sum[k]);
                };
                if (wanted.has(Channel::Depth)) result.channels[Channel::Depth][p] = double(depth / opacity);
                if (wanted.has(Channel::Position)) {
                    const Vec3<T> point = camT.toWorld(depth / opacity * camT.ray(T(column) + T(0.5), T(row) + T(0.5)));
                    for (int k = 0; k < 3; ++k) {
                        result.channels[Channel::Position][3 * p + static_cast<std::size_t>(k)] = double(point[k]);
                    }
                }
                blend3(Channel::Normal, true, [&](std::size_t i) { return normals[i]; });
                blend3(Channel::Radiance, false, [&](std::size_t i) { return s.colors[i]; });
                blend3(Channel::Albedo, false, [&](std::size_t i) { return s.albedos[i]; });
                blend1(Channel::Roughness, [&](std::size_t i) { return s.roughnesses[i]; });
                blend1(Channel::Radius, [&](std::size_t i) { return s.radii[i]; });
                blend1(Channel::RadiusPlus, [&](std::size_t i) { return s.radiiPlus[i]; });
                blend1(Channel::RadiusMinus, [&](std::size_t i) { return s.radiiMinus[i]; });
                blend1(Channel::Importance, [&](std::size_t i) { return s.importances[i]; });
                blend3(Channel::Bone, true, [&](std::size_t i) { return camT.rotation * Vec3<T>(s.bones[i]); });
            }
            if (pixels) (*pixels)[p] = std::move(pixel);
        }
    }
    return result;
}

// --- the operator on a device ----------------------------------------------------------------------------------------

/// A copy of surfels on a device.
class DeviceSurfels {
public:
    DeviceSurfels(const Surfels& surfels, const Device& device) : view_(viewOf(surfels)) {
        if (device.kind == DeviceKind::Host) return;
        view_.device = device;
        const std::size_t n = surfels.count();
        move(view_.means, n);
        move(view_.rotations, 4 * n);
        move(view_.scales, n);
        move(view_.opacities, n);
        move(view_.colors, n);
        move(view_.albedos, n);
        move(view_.roughnesses, n);
        move(view_.radii, n);
        move(view_.radiiPlus, n);
        move(view_.radiiMinus, n);
        move(view_.importances, n);
        move(view_.bones, n);
    }
    const SurfelView& view() const { return view_; }

private:
    template <typename V>
    void move(const V*& data, std::size_t count) {
        if (!data) return;
        auto buffer = Buffer::allocate(view_.device, count * sizeof(V), "test: surfels");
        ASSERT_TRUE(buffer.ok());
        ASSERT_TRUE(uploadBuffer(*buffer, std::as_bytes(std::span<const V>(data, count))).ok());
        buffers_.push_back(std::move(*buffer));
        data = static_cast<const V*>(buffers_.back().data());
    }
    SurfelView view_;
    std::vector<Buffer> buffers_;
};

inline Pictures download(const GBuffer& gbuffer) {
    Pictures result;
    result.width = gbuffer.width();
    result.height = gbuffer.height();
    for (int c = 0; c < kChannelCount; ++c) {
        const auto channel = static_cast<Channel>(c);
        if (!gbuffer.channels.has(channel)) continue;
        const PixelBuffer& picture = gbuffer[channel];
        std::vector<float> values(picture.view().valueCount());
        EXPECT_TRUE(downloadBuffer(std::as_writable_bytes(std::span<float>(values)), picture.memory()).ok());
        result.channels[channel].assign(values.begin(), values.end());
    }
    return result;
}

inline Pictures deviceSplat(const Device& device, CpuPath path, const SplatParams& params, const Surfels& surfels,
                            const Camera& camera, ChannelSet wanted) {
    const DeviceSurfels there(surfels, device);
    SplatWorkspace workspace;
    workspace.setCpuPath(path);
    GBuffer gbuffer;
    SplatStats stats;
    const Status status = splat(params, there.view(), camera, wanted, gbuffer, workspace, nullptr, &stats);
    EXPECT_TRUE(status.ok()) << (status.ok() ? "" : status.error().describe());
    if (!status) return {};
    Pictures result = download(gbuffer);
    result.stats = stats;
    return result;
}

struct Renderer {
    std::string name;
    std::function<Pictures(const SplatParams&, const Surfels&, const Camera&, ChannelSet)> render;
};

inline const char* pathName(CpuPath path) {
    return path == CpuPath::Portable ? "cpu portable" : path == CpuPath::Avx2 ? "cpu avx2" : "cpu avx512";
}

/// Everything that can splat here: every device, every instruction set, and the slow twin in float and double.
inline std::vector<Renderer> renderers() {
    std::vector<Renderer> result;
    result.push_back({"reference in double", [](const auto& p, const auto& s, const auto& c, ChannelSet w) {
                          return referenceSplat<double>(p, s, c, w);
                      }});
    result.push_back({"reference in float", [](const auto& p, const auto& s, const auto& c, ChannelSet w) {
                          return referenceSplat<float>(p, s, c, w);
                      }});
    for (const Device& device : devicesUnderTest()) {
        if (device.kind == DeviceKind::Host) {
            for (const CpuPath path : availableCpuPaths()) {
                result.push_back({pathName(path), [=](const auto& p, const auto& s, const auto& c, ChannelSet w) {
                                      return deviceSplat(device, path, p, s, c, w);
                                  }});
            }
        } else {
            result.push_back({deviceName(device), [=](const auto& p, const auto& s, const auto& c, ChannelSet w) {
                                  return deviceSplat(device, CpuPath::Best, p, s, c, w);
                              }});
        }
    }
    return result;
}

} // namespace ars::test
