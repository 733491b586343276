#pragma once

#include "engine/surfel/splat_gradient_kernels.h"

/// The backward pass over contributor lists, as CUDA takes it: what one thread does to one surfel, pixel or entry (a
/// pair of a surfel and a pixel). Entries of weight 0 name no surfel: pixels pass them over, and sorted they lie behind
/// those of the last surfel. Nothing here knows of threads, so that a plain loop on the host is the same pass
/// (tests/unit/surfel/splat_gradient_devices_test.cpp).
namespace ars {

inline constexpr int kEntryLanes = 32;    ///< threads that share a surfel's entries
inline constexpr int kProjectedSums = 10; ///< numbers of a ProjectedGradient

/// All that the kernels are given, by value.
struct EntryPass {
    SplatView<float> view;
    SurfelView surfels;
    GradientPictures pictures;
    std::size_t pixels = 0;
    const std::uint64_t* starts = nullptr; ///< (pixels + 1)
    const std::uint32_t* listed = nullptr; ///< (entries) surfels
    const float* weights = nullptr;        ///< (entries)

    ProjectedSurfel<float>* rows = nullptr;       ///< (surfels)
    float* features = nullptr;                    ///< (surfels, stride)
    float* pixelGradients = nullptr;              ///< (pixels, stride + 2)
    float* alphaGradients = nullptr;              ///< (entries) dL/dlog2Alpha
    std::uint32_t* entryPixels = nullptr;         ///< (entries)
    std::uint32_t* entries = nullptr;             ///< (entries) 0, 1, 2...
    const std::uint32_t* sortedEntries = nullptr; ///< (entries) by surfel, those of a surfel in the order of pixels
    const std::uint32_t* sortedSurfels = nullptr; ///< (entries) the surfels of sortedEntries
    std::uint64_t entryCount = 0;
    SurfelGradientArrays out;
};

/// What the arguments say; memory and results are for the caller to add.
inline EntryPass entryPass(const SplatBackwardArguments& arguments) {
    const ContributorLists& lists = *arguments.contributors;
    EntryPass pass;
    pass.view = arguments.view;
    pass.surfels = arguments.surfels;
    pass.pictures = arguments.pictures;
    pass.pixels =
        static_cast<std::size_t>(arguments.pictures.width) * static_cast<std::size_t>(arguments.pictures.height);
    pass.starts = static_cast<const std::uint64_t*>(lists.starts.data());
    pass.listed = static_cast<const std::uint32_t*>(lists.surfels.data());
    pass.weights = static_cast<const float*>(lists.weights.data());
    pass.entryCount = lists.entries;
    return pass;
}

/// Surfels that no list holds keep whatever is there.
ARS_HD inline void projectForEntries(const EntryPass& p, std::size_t surfel) {
    glm::vec3 normal(0.0f);
    PixelRect rect;
    const SurfelFate fate =
        projectSurfel(p.view, p.surfels.means[surfel], p.surfels.rotations + 4 * surfel, p.surfels.scales[surfel],
                      p.surfels.opacities[surfel], p.rows[surfel], normal, rect);
    if (fate != SurfelFate::Visible) return;
    packFeatures(p.pictures.layout, surfel, normal, p.view.camera.rotation,
                 p.features + surfel * static_cast<std::size_t>(p.pictures.stride()));
}

/// |sum| of the unit channels of a pixel, by source; the others stay as they are.
ARS_HD inline void unitLengths(const EntryPass& p, std::uint64_t begin, std::uint64_t end, float* lengths) {
    if (!p.pictures.anyUnit) return;
    for (int i = 0; i < p.pictures.layout.count; ++i) {
        const FeatureSource& source = p.pictures.layout.sources[i];
        if (!source.unit) continue;
        glm::vec3 sum(0.0f);
        for (std::uint64_t e = begin; e < end; ++e) {
            if (p.weights[e] == 0.0f) continue;
            const float* f = p.features + p.listed[e] * static_cast<std::size_t>(p.pictures.stride()) + source.offset;
            sum += p.weights[e] * glm::vec3(f[0], f[1], f[2]);
        }
        lengths[i] = std::sqrt(glm::dot(sum, sum));
    }
}

/// One pixel: dL/dlog2Alpha of each of its entries, from the last to the first.
template <SurfelKernel Kernel, DepthMode Depth>
ARS_HD inline void backwardPixel(const EntryPass& p, std::size_t pixel) {
    const std::uint64_t begin = p.starts[pixel], end = p.starts[pixel + 1];
    if (begin == end) return;
    const int stride = p.pictures.stride();
    float* g = p.pixelGradients + pixel * static_cast<std::size_t>(p.pictures.pixelStride());
    float lengths[cpu::kMaxFeatureChannels] = {};
    unitLengths(p, begin, end, lengths);
    sumGradients(p.pictures, pixel, lengths, g);

    // What reaches geometry: a copy without the detached channels.
    float attached[cpu::kMaxFeatures];
    for (int c = 0; c < stride; ++c) attached[c] = g[c];
    for (int i = 0; i < p.pictures.layout.count; ++i) {
        const FeatureSource& source = p.pictures.layout.sources[i];
        if (!p.pictures.detached[i]) continue;
        for (int c = source.offset; c < source.offset + source.width; ++c) attached[c] = 0.0f;
    }
    const auto width = static_cast<std::size_t>(p.pictures.width);
    const float x = static_cast<float>(pixel % width) + 0.5f, y = static_cast<float>(pixel / width) + 0.5f;
    const float gDepth = g[stride], gOpacity = g[stride + 1];
    // The forward pass took the same differences. They wait where the gradients will lie.
    float transmittance = 1.0f;
    for (std::uint64_t e = begin; e < end; ++e) {
        p.alphaGradients[e] = transmittance;
        p.entryPixels[e] = static_cast<std::uint32_t>(pixel);
        p.entries[e] = static_cast<std::uint32_t>(e);
        transmittance -= p.weights[e];
    }
    float suffix = 0.0f;
    for (std::uint64_t e = end; e-- > begin;) {
        if (p.weights[e] == 0.0f) continue;
        const std::uint32_t surfel = p.listed[e];
        const float* features = p.features + surfel * static_cast<std::size_t>(stride);
        float h = gOpacity;
        for (int c = 0; c < stride; ++c) h += attached[c] * features[c];
        if (gDepth != 0.0f) {
            const ProjectedSurfel<float>& row = p.rows[surfel];
            h += gDepth * depthAt<Kernel, Depth>(row, x - row.u, y - row.v);
        }
        const float weight = p.weights[e], before = p.alphaGradients[e];
        p.alphaGradients[e] = blendBackward<float>(weight, before, before - weight, h, suffix);
        suffix += weight * h;
    }
}

/// What a surfel's entries sum up to.
template <int Stride>
struct EntrySums {
    static constexpr int kCount = kProjectedSums + Stride;
    float values[kCount] = {};
};

/// The sums over the entries first, first + step... below `end` of the sorted ones.
template <SurfelKernel Kernel, DepthMode Depth, int Stride>
ARS_HD inline EntrySums<Stride> sumEntries(const EntryPass& p, const ProjectedSurfel<float>& row, std::uint64_t first,
                                           std::uint64_t end, std::uint64_t step) {
    EntrySums<Stride> sums;
    ProjectedGradient<float> g;
    const auto width = static_cast<std::uint32_t>(p.pictures.width);
    for (std::uint64_t k = first; k < end; k += step) {
        const std::uint32_t e = p.sortedEntries[k], pixel = p.entryPixels[e];
        const float dx = static_cast<float>(pixel % width) + 0.5f - row.u;
        const float dy = static_cast<float>(pixel / width) + 0.5f - row.v;
        const float* gPixel =
            p.pixelGradients + pixel * static_cast<std::size_t>(Stride + 2); // Stride is that of the pictures
        log2AlphaBackward<Kernel>(row, dx, dy, p.alphaGradients[e], g);
        if (p.pictures.depth) depthBackward<Kernel, Depth>(row, dx, dy, p.weights[e] * gPixel[Stride], g);
        for (int c = 0; c < Stride; ++c) sums.values[kProjectedSums + c] += p.weights[e] * gPixel[c];
    }
    const float projected[kProjectedSums] = {g.u,        g.v,     g.shape[0], g.shape[1], g.shape[2],
                                             g.shape[3], g.tiltX, g.tiltY,    g.depth,    g.log2Opacity};
    for (int c = 0; c < kProjectedSums; ++c) sums.values[c] = projected[c];
    return sums;
}

template <int Stride>
ARS_HD inline void finishEntries(const EntryPass& p, std::size_t surfel, const EntrySums<Stride>& sums) {
    const float* v = sums.values;
    const ProjectedGradient<float> g{v[0], v[1], {v[2], v[3], v[4], v[5]}, v[6], v[7], v[8], v[9]};
    finishSurfel(p.view, p.surfels, p.pictures.layout, surfel, p.rows[surfel], g, v + kProjectedSums, p.out);
}

/// The first sorted entry of this surfel or a later one.
ARS_HD inline std::uint64_t firstEntryOf(const EntryPass& p, std::size_t surfel) {
    std::uint64_t low = 0, high = p.entryCount;
    while (low < high) {
        const std::uint64_t middle = low + (high - low) / 2;
        if (p.sortedSurfels[middle] < surfel) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    return low;
}

} // namespace ars
