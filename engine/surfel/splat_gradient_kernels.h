#pragma once

#include "engine/core/host_device.h"
#include "engine/surfel/splat_gradient.h"
#include "engine/surfel/splat_gradient_math.h"
#include "engine/surfel/splat_kernels.h"

#include <cstddef>
#include <cstdint>

namespace ars {

/// The pictures of a backward pass and what is made of them; all memory on one device.
struct GradientPictures {
    FeatureLayout layout; ///< of the channels that a gradient came for
    bool detached[cpu::kMaxFeatureChannels] = {};
    int columns = 0;      ///< floats that a pixel's features take among its gradients; at least the layout's stride
    bool depth = false;   ///< a gradient of depth or position came
    bool anyUnit = false; ///< one of the channels is of unit length
    PointMap points;
    int width = 0, height = 0;
    ImageView<const float> values[kChannelCount];    ///< what splat() wrote
    ImageView<const float> gradients[kChannelCount]; ///< dL/d of them; empty where none came

    ARS_HD static int index(Channel channel) { return static_cast<int>(channel); }
    ARS_HD bool has(Channel channel) const { return !gradients[index(channel)].empty(); }
    ARS_HD const float* gradient(Channel channel, std::size_t pixel) const {
        return gradients[index(channel)].pixel(pixel);
    }
    ARS_HD const float* value(Channel channel, std::size_t pixel) const { return values[index(channel)].pixel(pixel); }
    ARS_HD int stride() const { return layout.stride; }
    /// Floats of a pixel's gradients: those of its features' sums (`columns`), of depth's and of opacity's.
    ARS_HD int pixelStride() const { return columns + 2; }
};

/// dL/d of a pixel's sums (features, depth, opacity), before they meet the surfels.
/// @param lengths  |sum| of the unit channels, by source; 1 leaves the division by it to the caller
/// @param g        (pixelStride())
ARS_HD inline void sumGradients(const GradientPictures& p, std::size_t pixel, const float* lengths, float* g) {
    for (int c = 0; c < p.pixelStride(); ++c) g[c] = 0.0f;
    const float opacity = *p.value(Channel::Opacity, pixel);
    float toOpacity = p.has(Channel::Opacity) ? *p.gradient(Channel::Opacity, pixel) : 0.0f;
    if (opacity > kMinOpacity) {
        for (int i = 0; i < p.layout.count; ++i) {
            const FeatureSource& source = p.layout.sources[i];
            const float passed =
                normaliseBackward(source.width, source.unit, opacity, lengths[i], p.value(source.channel, pixel),
                                  p.gradient(source.channel, pixel), g + source.offset);
            if (!p.detached[i]) toOpacity += passed;
        }
        if (p.depth) {
            float atDepth = p.has(Channel::Depth) ? *p.gradient(Channel::Depth, pixel) : 0.0f;
            if (p.has(Channel::Position)) {
                const auto width = static_cast<std::size_t>(p.width);
                const float x = static_cast<float>(pixel % width) + 0.5f, y = static_cast<float>(pixel / width) + 0.5f;
                const glm::vec3 ray = p.points.perX * x + p.points.perY * y + p.points.atZero;
                const float* at = p.gradient(Channel::Position, pixel);
                atDepth += ray.x * at[0] + ray.y * at[1] + ray.z * at[2];
            }
            g[p.columns] = atDepth / opacity;
            toOpacity -= atDepth * *p.value(Channel::Depth, pixel) / opacity;
        }
    }
    g[p.columns + 1] = toOpacity;
}

/// From the sums over a surfel's pixels to the surfel.
/// @param g         dL/d of its projection
/// @param features  sum of w dL/dSum, in the order of the layout
ARS_HD inline void finishSurfel(const SplatView<float>& view, const SurfelView& surfels, const FeatureLayout& layout,
                                std::size_t surfel, const ProjectedSurfel<float>& row,
                                const ProjectedGradient<float>& g, const float* features,
                                const SurfelGradientArrays& out) {
    glm::vec3 normal(0.0f);
    for (int i = 0; i < layout.count; ++i) {
        const FeatureSource& source = layout.sources[i];
        const float* value = features + source.offset;
        if (source.channel == Channel::Normal) {
            normal = {value[0], value[1], value[2]};
            continue;
        }
        float* to = out.attributes[static_cast<int>(source.channel)];
        if (!to) continue;
        if (source.width == 1) {
            to[surfel] = value[0];
            continue;
        }
        glm::vec3 turned(value[0], value[1], value[2]);
        if (source.turned) turned = glm::transpose(view.camera.rotation) * turned;
        for (int c = 0; c < 3; ++c) to[3 * surfel + static_cast<std::size_t>(c)] = turned[c];
    }
    SurfelGeometryGradient<float> geometry;
    projectSurfelBackward(view, surfels.means[surfel], surfels.rotations + 4 * surfel, surfels.scales[surfel],
                          surfels.opacities[surfel], row, g, normal, geometry);
    for (int c = 0; c < 3; ++c) out.means[3 * surfel + static_cast<std::size_t>(c)] = geometry.mean[c];
    for (int c = 0; c < 4; ++c) out.rotations[4 * surfel + static_cast<std::size_t>(c)] = geometry.rotation[c];
    for (int c = 0; c < 2; ++c) out.scales[2 * surfel + static_cast<std::size_t>(c)] = geometry.scale[c];
    out.opacities[surfel] = geometry.opacity;
}

/// What both devices are given, checked.
struct SplatBackwardArguments {
    SplatParams params;
    SurfelView surfels;
    SplatView<float> view;
    GradientPictures pictures;
    ChannelSet splatted; ///< all channels of the forward pass
    const ContributorLists* contributors = nullptr;
    SplatGradientWorkspace* workspace = nullptr;
    SurfelGradientArrays out; ///< on the surfels' device, zeros
};

/// Checks everything; errors are those of splatBackward().
Result<SplatBackwardArguments> backwardArguments(const SplatParams& params, const SurfelView& surfels,
                                                 const Camera& camera, const GBuffer& forward,
                                                 const ContributorLists* contributors,
                                                 const GBufferGradients& gradients, SplatGradientWorkspace& workspace,
                                                 const SurfelGradientArrays& out, const SplatBackwardParams& options);

/// Sizes the results, zeros, and points at them.
SurfelGradientArrays prepareOutputs(std::size_t n, const GBufferGradients& gradients, SurfelGradients& out);

namespace cpu {
Status splatBackward(const SplatBackwardArguments& arguments);
} // namespace cpu

namespace cuda {
/// Queued on the default stream of the surfels' device; does not wait.
Status splatBackward(const SplatBackwardArguments& arguments);
/// Results to arrays in host memory, zeros; waits for the device to bring them.
Status splatBackwardToHost(SplatBackwardArguments arguments, const SurfelGradientArrays& host);
} // namespace cuda

} // namespace ars
