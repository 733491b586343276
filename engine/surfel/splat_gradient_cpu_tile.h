#pragma once

#include "engine/surfel/splat_cpu_tile.h"
#include "engine/surfel/splat_gradient_pixel_math.h"
#include "engine/surfel/splat_gradient_tile.h"

/// Backward of one 16x16 tile, compiled once per instruction set like splat_cpu_tile.h. Each 4x4 sub-tile is one
/// vector: its surfels front to back as the forward pass took them (weights and transmittances are kept), back to front
/// for the terms of each surfel and pixel, and then the moments of all terms as a small matrix product: terms (surfels,
/// 16 pixels) times powers of the pixels' places (16, 6), weights times the pixels' gradients (16, features).
namespace ars::cpu {

/// Eight floats of one instruction set, named by its vector of sixteen.
template <typename F>
struct Eight {
#if ARS_SIMD_AVX512 || ARS_SIMD_AVX2
    __m256 v;
    static Eight load(const float* from) { return {_mm256_loadu_ps(from)}; }
    void store(float* to) const { _mm256_storeu_ps(to, v); }
    void add(float factor, const Eight& row) { v = _mm256_fmadd_ps(_mm256_set1_ps(factor), row.v, v); }
#else
    Float4 low, high;
    static Eight load(const float* from) {
        Eight result;
        std::memcpy(&result.low, from, sizeof result.low);
        std::memcpy(&result.high, from + 4, sizeof result.high);
        return result;
    }
    void store(float* to) const {
        std::memcpy(to, &low, sizeof low);
        std::memcpy(to + 4, &high, sizeof high);
    }
    void add(float factor, const Eight& row) {
        low = low + factor * row.low;
        high = high + factor * row.high;
    }
#endif
};

/// 1, x, y, x^2, x y, y^2, 0, 0 of the pixels of each sub-tile, from the tile's centre.
template <typename F>
struct TilePowers {
    alignas(64) float of[kSubtiles][kLanes][kColumns];

    TilePowers() {
        for (int s = 0; s < kSubtiles; ++s) {
            for (int lane = 0; lane < kLanes; ++lane) {
                const float x = static_cast<float>(kSubtileSide * (s % 4) + lane % kSubtileSide) - 7.5f;
                const float y = static_cast<float>(kSubtileSide * (s / 4) + lane / kSubtileSide) - 7.5f;
                const float row[kColumns] = {1.0f, x, y, x * x, x * y, y * y, 0.0f, 0.0f};
                std::memcpy(of[s][lane], row, sizeof row);
            }
        }
    }
};

/// out[kept[k]] += sum over the pixels of values[k][pixel] rows[pixel], for Count surfels at once.
template <typename F, int Count>
inline void addProducts(const float* values, const float* rows, std::uint64_t rowStride, const std::uint32_t* kept,
                        float* out, std::uint64_t columns) {
    Eight<F> sums[Count];
    for (int k = 0; k < Count; ++k) sums[k] = Eight<F>::load(out + kept[k] * columns);
    for (int lane = 0; lane < kLanes; ++lane) {
        const Eight<F> row = Eight<F>::load(rows + static_cast<std::uint64_t>(lane) * rowStride);
        for (int k = 0; k < Count; ++k) sums[k].add(values[k * kLanes + lane], row);
    }
    for (int k = 0; k < Count; ++k) sums[k].store(out + kept[k] * columns);
}

template <typename F>
inline void addAllProducts(const float* values, const float* rows, std::uint64_t rowStride, const GradientTile& tile,
                           std::uint64_t count, float* out, std::uint64_t columns) {
    std::uint64_t k = 0;
    for (; k + 8 <= count; k += 8) {
        addProducts<F, 8>(values + k * kLanes, rows, rowStride, tile.kept + k, out, columns);
    }
    for (; k < count; ++k) addProducts<F, 1>(values + k * kLanes, rows, rowStride, tile.kept + k, out, columns);
}

/// Front to back, as blendSubtile: keeps the weights and the transmittances behind them of all surfels that anything
/// was blended of, and sums up the channels of unit length.
/// @return how many surfels that are
template <typename F, SurfelKernel Kernel>
std::uint64_t replaySubtile(const GradientTileJob& job, const GradientTile& tile, const std::uint32_t* slots,
                            const std::uint32_t* list, std::uint64_t count, const F& x, const F& y,
                            typename F::Mask live, F (*unitSums)[3]) {
    F transmittance(1.0f);
    std::uint64_t kept = 0;
    for (std::uint64_t next = 0; next < count; ++next) {
        const ProjectedSurfel<float>& row = tile.rows[list[next]];
        const F log2Alpha = log2AlphaAt<Kernel>(row, x - F(row.u), y - F(row.v));
        if (both(live, log2Alpha >= F(static_cast<float>(kMinLog2Alpha))).none()) continue;
        const F weight = blendWeight(log2Alpha, transmittance, live);
        weight.store(tile.weights + kept * kLanes);
        transmittance.store(tile.after + kept * kLanes);
        tile.kept[kept++] = list[next];
        const float* features = job.features + static_cast<std::uint64_t>(slots[list[next]]) *
                                                   static_cast<std::uint64_t>(job.featureStride);
        __builtin_prefetch(features);
        for (int u = 0; u < job.unitCount; ++u) {
            const float* from = features + job.unitOffsets[u];
            for (int c = 0; c < 3; ++c) unitSums[u][c] = mulAdd(weight, F(from[c]), unitSums[u][c]);
        }
        if (live.none()) break;
    }
    return kept;
}

/// The gradients of a sub-tile's pixels once more, number by number instead of pixel by pixel.
template <typename F>
struct SubtileGradients {
    F attached[kMaxFeatures]; ///< of features, 0 where they do not reach geometry
    F depth, opacity;
};

/// Divides unit channels by the length of their sums (0 where there is none) and turns the gradients.
template <typename F>
SubtileGradients<F> subtileGradients(const GradientTileJob& job, float* pixels, const F (*unitSums)[3]) {
    const int stride = job.pixelStride;
    for (int u = 0; u < job.unitCount; ++u) {
        const F* s = unitSums[u];
        const F length = sqrtOf(mulAdd(s[0], s[0], mulAdd(s[1], s[1], s[2] * s[2]))), least(1e-10f);
        alignas(64) float by[kLanes];
        select(least < length, F(1.0f) / maxOf(length, least), F(0.0f)).store(by);
        for (int lane = 0; lane < kLanes; ++lane) {
            for (int c = 0; c < 3; ++c) pixels[lane * stride + job.unitOffsets[u] + c] *= by[lane];
        }
    }
    SubtileGradients<F> g;
    alignas(64) float turned[kLanes];
    const auto turn = [&](int from) {
        for (int lane = 0; lane < kLanes; ++lane) turned[lane] = pixels[lane * stride + from];
        return F::load(turned);
    };
    for (int c = 0; c < job.featureStride; ++c) g.attached[c] = turn(c) * F(job.attached[c]);
    g.depth = turn(job.featureColumns);
    g.opacity = turn(job.featureColumns + 1);
    return g;
}

/// h_i = dL/dw of one surfel at the 16 pixels, without depth.
template <typename F>
inline F gradientOfWeights(const GradientTileJob& job, const SubtileGradients<F>& g, const float* features) {
    F even = g.opacity, odd(0.0f);
    for (int c = 0; c < job.featureStride; c += 4) {
        even = mulAdd(g.attached[c], F(features[c]), even);
        odd = mulAdd(g.attached[c + 1], F(features[c + 1]), odd);
        even = mulAdd(g.attached[c + 2], F(features[c + 2]), even);
        odd = mulAdd(g.attached[c + 3], F(features[c + 3]), odd);
    }
    return even + odd;
}

/// Back to front: the terms of the kept surfels.
template <typename F, SurfelKernel Kernel, DepthMode Depth, bool WithDepth>
void termsOfSubtile(const GradientTileJob& job, const GradientTile& tile, const std::uint32_t* slots,
                    const SubtileGradients<F>& g, std::uint64_t kept, const F& x, const F& y) {
    constexpr int kFalloff = kFalloffTerms<Kernel>, kTerms = kFalloff + (WithDepth ? kDepthTerms : 0);
    const std::uint64_t termStride = tile.capacity * kLanes;
    F suffix(0.0f);
    for (std::uint64_t k = kept; k-- > 0;) {
        const std::uint32_t instance = tile.kept[k];
        const ProjectedSurfel<float>& row = tile.rows[instance];
        const F dx = x - F(row.u), dy = y - F(row.v);
        const F weight = F::load(tile.weights + k * kLanes), after = F::load(tile.after + k * kLanes);
        const F before = k > 0 ? F::load(tile.after + (k - 1) * kLanes) : F(1.0f);
        F h = gradientOfWeights(job, g,
                                job.features + static_cast<std::uint64_t>(slots[instance]) *
                                                   static_cast<std::uint64_t>(job.featureStride));
        if constexpr (WithDepth) h = mulAdd(g.depth, depthAt<Kernel, Depth>(row, dx, dy), h);
        F terms[kTerms];
        falloffTerms<Kernel>(row, dx, dy, blendBackward<float>(weight, before, after, h, suffix), terms);
        if constexpr (WithDepth) depthTerms<Kernel, Depth>(row, dx, dy, weight * g.depth, terms + kFalloff);
        suffix = mulAdd(weight, h, suffix);
        for (int t = 0; t < kTerms; ++t) {
            terms[t].store(tile.terms + static_cast<std::uint64_t>(t) * termStride + k * kLanes);
        }
    }
}

template <typename F, SurfelKernel Kernel, DepthMode Depth>
void backwardSubtile(const GradientTileJob& job, const GradientTile& tile, const TilePowers<F>& powers,
                     const SubtileGrid<F>& grid, int subtile, std::uint64_t count, typename F::Mask live) {
    const std::uint64_t begin = job.tileStarts[tile.tile];
    const std::uint32_t* slots = job.instances + begin;
    const F x = grid.laneX + F(static_cast<float>(kSubtileSide * (subtile % 4)));
    const F y = grid.laneY + F(static_cast<float>(kSubtileSide * (subtile / 4)));
    F unitSums[kMaxFeatureChannels][3];
    for (int u = 0; u < job.unitCount; ++u) unitSums[u][0] = unitSums[u][1] = unitSums[u][2] = F(0.0f);
    const std::uint64_t kept =
        replaySubtile<F, Kernel>(job, tile, slots, tile.lists + static_cast<std::uint64_t>(subtile) * tile.capacity,
                                 count, x, y, live, unitSums);
    if (kept == 0) return;
    float* pixels = tile.pixels + subtile * kLanes * job.pixelStride;
    const SubtileGradients<F> g = subtileGradients<F>(job, pixels, unitSums);
    if (job.depth) {
        termsOfSubtile<F, Kernel, Depth, true>(job, tile, slots, g, kept, x, y);
    } else {
        termsOfSubtile<F, Kernel, Depth, false>(job, tile, slots, g, kept, x, y);
    }
    const auto columns = static_cast<std::uint64_t>(job.columns);
    float* out = job.sums + begin * columns;
    for (int t = 0; t < job.terms; ++t, out += kColumns) {
        addAllProducts<F>(tile.terms + static_cast<std::uint64_t>(t) * tile.capacity * kLanes, powers.of[subtile][0],
                          kColumns, tile, kept, out, columns);
    }
    for (int c = 0; c < job.featureColumns; c += kColumns, out += kColumns) {
        addAllProducts<F>(tile.weights, pixels + c, static_cast<std::uint64_t>(job.pixelStride), tile, kept, out,
                          columns);
    }
}

template <typename F, SurfelKernel Kernel, DepthMode Depth>
void backwardTile(const GradientTileJob& job, const GradientTile& tile) {
    static const TilePowers<F> powers;
    const SubtileGrid<F> grid = subtileGrid<F>();
    const std::uint64_t begin = job.tileStarts[tile.tile], count = job.tileStarts[tile.tile + 1] - begin;
    const int x0 = kTileSide * static_cast<int>(tile.tile % static_cast<std::uint32_t>(job.tilesX));
    const int y0 = kTileSide * static_cast<int>(tile.tile / static_cast<std::uint32_t>(job.tilesX));
    const auto columns = static_cast<std::uint64_t>(job.columns);
    std::memset(job.sums + begin * columns, 0, count * columns * sizeof(float));
    std::uint64_t listed[kSubtiles] = {};
    for (std::uint64_t k = 0; k < count; ++k) {
        constexpr std::uint64_t kAhead = 8;
        if (k + kAhead < count) __builtin_prefetch(job.rows + job.instances[begin + k + kAhead]);
        ProjectedSurfel<float>& row = tile.rows[k];
        std::memcpy(&row, job.rows + job.instances[begin + k], sizeof row);
        row.u -= static_cast<float>(x0); // as stageBatch
        row.v -= static_cast<float>(y0);
        std::uint32_t reached = reachesRect<Kernel>(row, grid.left, grid.top, grid.right, grid.bottom).bits();
        for (; reached != 0; reached &= reached - 1) {
            const auto subtile = static_cast<std::uint64_t>(__builtin_ctz(reached));
            tile.lists[subtile * tile.capacity + listed[subtile]++] = static_cast<std::uint32_t>(k);
        }
    }
    for (int s = 0; s < kSubtiles; ++s) {
        if (listed[s] == 0) continue;
        std::uint32_t inside = 0;
        for (int lane = 0; lane < kLanes; ++lane) {
            const int x = x0 + kSubtileSide * (s % 4) + lane % kSubtileSide;
            const int y = y0 + kSubtileSide * (s / 4) + lane / kSubtileSide;
            if (x < job.width && y < job.height) inside |= 1u << lane;
        }
        if (inside == 0) continue;
        backwardSubtile<F, Kernel, Depth>(job, tile, powers, grid, s, listed[s], F::Mask::fromBits(inside));
    }
}

template <typename F>
GradientTileFunction gradientTileFunction() {
    return [](const GradientTileJob& job, const GradientTile& tile) {
        if (job.kernel == SurfelKernel::RaySplat) {
            backwardTile<F, SurfelKernel::RaySplat, DepthMode::Exact>(job, tile);
        } else if (job.depthMode == DepthMode::Exact) {
            backwardTile<F, SurfelKernel::GaussianSurfel, DepthMode::Exact>(job, tile);
        } else {
            backwardTile<F, SurfelKernel::GaussianSurfel, DepthMode::Linear>(job, tile);
        }
    };
}

} // namespace ars::cpu
