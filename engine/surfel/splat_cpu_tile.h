#pragma once

#include "engine/surfel/splat_simd.h"
#include "engine/surfel/splat_tile.h"

#include <cstdint>
#include <cstring>

/// Blending of one 16x16 tile, compiled once per instruction set (F is the set's vector of 16 floats, one 4x4
/// sub-tile). Two steps per sub-tile: weights w = alpha T of up to kChunk surfels, in order, then the sums over
/// channels as a small matrix product, w (16 pixels) times features (channels), with the sums in registers.
namespace ars::cpu {

inline constexpr int kSubtiles = 16;
inline constexpr int kBatch = 256; ///< surfels of a tile that are staged at once
inline constexpr int kChunk = 64;  ///< weights between the two steps

/// What a tile keeps while its surfels pass. About 40 KiB, of which a sub-tile touches a few at a time.
template <typename F>
struct TileState {
    alignas(64) float sums[kSubtiles][kMaxFeatures][kLanes];
    F transmittance[kSubtiles];
    F opacity[kSubtiles]; ///< sum of the weights: 1 - T, without its cancellation where little was blended
    F depth[kSubtiles];
    typename F::Mask live[kSubtiles];
    alignas(64) ProjectedSurfel<float> rows[kBatch];
    alignas(64) float weights[kChunk][kLanes];
    const float* features[kChunk];
    std::uint32_t instances[kBatch];
    std::uint8_t lists[kSubtiles][kBatch];
    std::uint32_t liveBits; ///< sub-tiles that still have a live pixel
    std::uint64_t blended;
    std::uint64_t cursor[kSubtiles][kLanes]; ///< entries written or counted per pixel
};

template <typename F>
struct SubtileGrid {
    F laneX, laneY;             ///< pixel centres relative to the sub-tile's corner
    F left, top, right, bottom; ///< of the 16 sub-tiles: outermost pixel centres relative to the tile's corner
};

template <typename F>
SubtileGrid<F> subtileGrid() {
    alignas(64) float x[kLanes], y[kLanes];
    SubtileGrid<F> grid;
    for (int i = 0; i < kLanes; ++i) {
        x[i] = static_cast<float>(i % kSubtileSide) + 0.5f;
        y[i] = static_cast<float>(i / kSubtileSide) + 0.5f;
    }
    grid.laneX = F::load(x);
    grid.laneY = F::load(y);
    for (int i = 0; i < kSubtiles; ++i) {
        x[i] = static_cast<float>(kSubtileSide * (i % 4)) + 0.5f;
        y[i] = static_cast<float>(kSubtileSide * (i / 4)) + 0.5f;
    }
    grid.left = F::load(x);
    grid.top = F::load(y);
    const F reach(static_cast<float>(kSubtileSide - 1));
    grid.right = grid.left + reach;
    grid.bottom = grid.top + reach;
    return grid;
}

/// sums[c] += sum over k of weights[k] features[k][c], for the channels [first, first + Count).
template <int Count, typename F>
inline void addFeatures(const TileState<F>& state, int filled, int first, float (*sums)[kLanes]) {
    F total[Count];
    for (int c = 0; c < Count; ++c) total[c] = F::load(sums[first + c]);
    for (int k = 0; k < filled; ++k) {
        const F weight = F::load(state.weights[k]);
        const float* feature = state.features[k] + first;
        // Hides where the pointer comes from: GCC would otherwise keep one index register per channel and spill most.
        asm("" : "+r"(feature));
        for (int c = 0; c < Count; ++c) total[c] = mulAdd(weight, F(feature[c]), total[c]);
    }
    for (int c = 0; c < Count; ++c) total[c].store(sums[first + c]);
}

template <typename F>
inline void addAllFeatures(const TileState<F>& state, int filled, int count, float (*sums)[kLanes]) {
    int first = 0;
    if constexpr (F::kGroup >= 16) {
        for (; first + 16 <= count; first += 16) addFeatures<16>(state, filled, first, sums);
    }
    if constexpr (F::kGroup >= 8) {
        for (; first + 8 <= count; first += 8) addFeatures<8>(state, filled, first, sums);
    }
    constexpr int kSmall = F::kGroup < 4 ? F::kGroup : 4;
    for (; first < count; first += kSmall) addFeatures<kSmall>(state, filled, first, sums);
}

/// The contributors of one surfel in one sub-tile: counted, or written behind those that are there.
template <bool Write, typename F>
inline void noteContributors(const TileJob& job, TileState<F>& state, int subtile, std::uint32_t slot,
                             std::uint32_t bits, const float* weights) {
    for (; bits != 0; bits &= bits - 1) {
        const int lane = __builtin_ctz(bits);
        const std::uint64_t at = state.cursor[subtile][lane]++;
        if constexpr (Write) {
            job.contributorSurfels[at] = job.surfelOfSlot[slot];
            job.contributorWeights[at] = weights[lane];
        }
    }
}

enum class TileTask { Blend, BlendAndCount, List };

/// One sub-tile under the `count` surfels of its list, front to back.
template <typename F, SurfelKernel Kernel, DepthMode Depth, TileTask Task>
void blendSubtile(const TileJob& job, TileState<F>& state, int subtile, int count, const F& x, const F& y) {
    using Mask = typename F::Mask;
    F transmittance = state.transmittance[subtile];
    F opacity = state.opacity[subtile], depth = state.depth[subtile];
    Mask live = state.live[subtile];
    const std::uint8_t* list = state.lists[subtile];
    std::uint64_t blended = 0;
    int next = 0;
    bool dead = false;
    while (next < count && !dead) {
        int filled = 0;
        for (; next < count && filled < kChunk; ++next) {
            const ProjectedSurfel<float>& row = state.rows[list[next]];
            const F dx = x - F(row.u), dy = y - F(row.v);
            const F log2Alpha = log2AlphaAt<Kernel>(row, dx, dy);
            if (both(live, log2Alpha >= F(static_cast<float>(kMinLog2Alpha))).none()) continue;
            const F weight = blendWeight(log2Alpha, transmittance, live);
            weight.store(state.weights[filled]);
            const std::uint32_t bits = (F(0.0f) < weight).bits();
            blended += static_cast<std::uint64_t>(__builtin_popcount(bits));
            const std::uint32_t slot = state.instances[list[next]];
            if constexpr (Task != TileTask::List) {
                opacity = opacity + weight;
                depth = mulAdd(weight, depthAt<Kernel, Depth>(row, dx, dy), depth);
                const float* features =
                    job.features + static_cast<std::size_t>(slot) * static_cast<std::size_t>(job.featureStride);
                state.features[filled] = features;
                __builtin_prefetch(
                    features); // needed after this chunk: time enough to come from the second-level cache
                __builtin_prefetch(features + job.featureStride - 1);
            }
            if constexpr (Task != TileTask::Blend) {
                noteContributors<Task == TileTask::List>(job, state, subtile, slot, bits, state.weights[filled]);
            }
            if constexpr (Task != TileTask::List) ++filled;
            if (live.none()) {
                dead = true;
                break;
            }
        }
        if constexpr (Task != TileTask::List) {
            if (filled > 0) addAllFeatures(state, filled, job.featureStride, state.sums[subtile]);
        }
    }
    state.transmittance[subtile] = transmittance;
    state.opacity[subtile] = opacity;
    state.depth[subtile] = depth;
    state.live[subtile] = live;
    if (dead) state.liveBits &= ~(1u << subtile);
    state.blended += blended;
}

/// Stages the instances [begin, begin + count) and lists for each sub-tile those that reach it.
template <typename F, SurfelKernel Kernel>
void stageBatch(const TileJob& job, TileState<F>& state, const SubtileGrid<F>& grid, std::uint64_t begin, int count,
                float tileX, float tileY, int* listed) {
    constexpr int kAhead = 8;
    for (int k = 0; k < count; ++k) {
        const std::uint32_t slot = job.instances[begin + static_cast<std::uint64_t>(k)];
        if (k + kAhead < count)
            __builtin_prefetch(job.rows + job.instances[begin + static_cast<std::uint64_t>(k + kAhead)]);
        ProjectedSurfel<float>& row = state.rows[k];
        std::memcpy(&row, job.rows + slot, sizeof row);
        row.u -= tileX; // offsets within the tile: nothing is lost, coordinates are multiples of 16
        row.v -= tileY;
        state.instances[k] = slot;
        std::uint32_t reached =
            reachesRect<Kernel>(row, grid.left, grid.top, grid.right, grid.bottom).bits() & state.liveBits;
        for (; reached != 0; reached &= reached - 1) {
            const int subtile = __builtin_ctz(reached);
            state.lists[subtile][listed[subtile]++] = static_cast<std::uint8_t>(k);
        }
    }
}

/// The part of a tile that lies in the picture.
struct TileArea {
    int x0, y0, columns, rows;
};

/// A tile of one picture on its way to memory: whole rows are written at once, because pictures are powers of two wide
/// more often than not, and then all rows of all pictures compete for the same few cache lines.
template <typename F>
struct TilePicture {
    alignas(64) float values[kTileSide][3 * kTileSide];

    template <int Channels>
    void put(int subtile, const F* parts) {
        alignas(64) float lanes[Channels][kLanes];
        for (int k = 0; k < Channels; ++k) parts[k].store(lanes[k]);
        const int column = kSubtileSide * (subtile % 4), row = kSubtileSide * (subtile / 4);
        for (int r = 0; r < kSubtileSide; ++r) {
            float* to = values[row + r] + Channels * column;
            for (int c = 0; c < kSubtileSide; ++c) {
                for (int k = 0; k < Channels; ++k) to[Channels * c + k] = lanes[k][kSubtileSide * r + c];
            }
        }
    }
    template <int Channels>
    void write(float* picture, int width, const TileArea& area) const {
        constexpr std::size_t kPixelBytes = Channels * sizeof(float);
        float* to = picture + (static_cast<std::size_t>(area.y0) * static_cast<std::size_t>(width) +
                               static_cast<std::size_t>(area.x0)) *
                                  Channels;
        for (int r = 0; r < area.rows; ++r, to += static_cast<std::size_t>(width) * Channels) {
            if (area.columns == kTileSide) {
                std::memcpy(to, values[r], kTileSide * kPixelBytes); // a constant size becomes a few wide moves
            } else {
                std::memcpy(to, values[r], static_cast<std::size_t>(area.columns) * kPixelBytes);
            }
        }
    }
};

/// 1 / opacity, or 0 in empty pixels.
template <typename F>
inline F coverageScale(const TileState<F>& state, int subtile) {
    const F opacity = state.opacity[subtile];
    return select(F(1e-3f) < opacity, F(1.0f) / opacity, F(0.0f)); // kMinOpacity
}

template <typename F>
void writeOpacityAndDepth(const TileJob& job, const TileState<F>& state, const TileArea& area) {
    TilePicture<F> picture;
    for (int s = 0; s < kSubtiles; ++s) picture.template put<1>(s, &state.opacity[s]);
    picture.template write<1>(job.opacity, job.width, area);
    if (!job.depth) return;
    for (int s = 0; s < kSubtiles; ++s) {
        const F depth = state.depth[s] * coverageScale(state, s);
        picture.template put<1>(s, &depth);
    }
    picture.template write<1>(job.depth, job.width, area);
}

template <typename F>
void writePosition(const TileJob& job, const TileState<F>& state, const SubtileGrid<F>& grid, const TileArea& area) {
    TilePicture<F> picture;
    for (int s = 0; s < kSubtiles; ++s) {
        const F x = grid.laneX + F(static_cast<float>(area.x0 + kSubtileSide * (s % 4)));
        const F y = grid.laneY + F(static_cast<float>(area.y0 + kSubtileSide * (s / 4)));
        const F scale = coverageScale(state, s), depth = state.depth[s] * scale;
        F point[3];
        for (int k = 0; k < 3; ++k) {
            const F ray = mulAdd(F(job.pointPerX[k]), x, mulAdd(F(job.pointPerY[k]), y, F(job.pointAtZero[k])));
            point[k] = select(F(0.0f) < scale, mulAdd(depth, ray, F(job.pointOrigin[k])), F(0.0f));
        }
        picture.template put<3>(s, point);
    }
    picture.template write<3>(job.position, job.width, area);
}

template <typename F>
void writeFeature(const TileJob& job, const TileState<F>& state, const FeatureOutput& output, const TileArea& area) {
    TilePicture<F> picture;
    for (int s = 0; s < kSubtiles; ++s) {
        F by = coverageScale(state, s);
        F sum[3];
        for (int k = 0; k < output.width; ++k) sum[k] = F::load(state.sums[s][output.offset + k]);
        if (output.width == 1) {
            sum[0] = sum[0] * by;
            picture.template put<1>(s, sum);
            continue;
        }
        if (output.unit) {
            const F least(1e-20f), square = mulAdd(sum[0], sum[0], mulAdd(sum[1], sum[1], sum[2] * sum[2]));
            by = select(both(F(0.0f) < by, least < square), F(1.0f) / sqrtOf(maxOf(square, least)), F(0.0f));
        }
        for (F& part : sum) part = part * by;
        picture.template put<3>(s, sum);
    }
    if (output.width == 1) {
        picture.template write<1>(output.data, job.width, area);
    } else {
        picture.template write<3>(output.data, job.width, area);
    }
}

/// Zeros to all pictures of a tile that no surfel reaches.
template <typename F>
void clearRows(float* picture, int channels, int width, const TileArea& area) {
    if (!picture) return;
    const std::size_t pixel = static_cast<std::size_t>(channels);
    float* to = picture + (static_cast<std::size_t>(area.y0) * static_cast<std::size_t>(width) +
                           static_cast<std::size_t>(area.x0)) *
                              pixel;
    // Empty pixels are most of a picture and the next stages look at none but their opacity: they go past the caches.
    const bool wholeLines =
        area.columns == kTileSide && width % kTileSide == 0 && reinterpret_cast<std::uintptr_t>(picture) % 64 == 0;
    const F zero(0.0f);
    for (int r = 0; r < area.rows; ++r, to += static_cast<std::size_t>(width) * pixel) {
        if (wholeLines) {
            for (int k = 0; k < channels; ++k) zero.stream(to + k * kTileSide);
            continue;
        }
        std::memset(to, 0, static_cast<std::size_t>(area.columns) * pixel * sizeof(float));
    }
}

template <typename F>
void clearTile(const TileJob& job, const TileArea& area) {
    clearRows<F>(job.opacity, 1, job.width, area);
    clearRows<F>(job.depth, 1, job.width, area);
    clearRows<F>(job.position, 3, job.width, area);
    for (int i = 0; i < job.outputCount; ++i) clearRows<F>(job.outputs[i].data, job.outputs[i].width, job.width, area);
}

template <typename F>
std::uint64_t countForeground(const TileState<F>& state) {
    std::uint64_t count = 0;
    for (int s = 0; s < kSubtiles; ++s) {
        // Pixels outside the picture were never live.
        count += static_cast<std::uint64_t>(__builtin_popcount((F(1e-3f) < state.opacity[s]).bits()));
    }
    return count;
}

template <typename F, TileTask Task>
void beginTile(const TileJob& job, TileState<F>& state, int x0, int y0) {
    state.liveBits = 0;
    state.blended = 0;
    for (int s = 0; s < kSubtiles; ++s) {
        const int left = x0 + kSubtileSide * (s % 4), top = y0 + kSubtileSide * (s / 4);
        std::uint32_t inside = 0;
        for (int lane = 0; lane < kLanes; ++lane) {
            const int x = left + lane % kSubtileSide, y = top + lane / kSubtileSide;
            const bool in = x < job.width && y < job.height;
            if (in) inside |= 1u << lane;
            if constexpr (Task == TileTask::BlendAndCount) state.cursor[s][lane] = 0;
            if constexpr (Task == TileTask::List) {
                state.cursor[s][lane] =
                    in ? job.contributorStarts[static_cast<std::size_t>(y) * static_cast<std::size_t>(job.width) +
                                               static_cast<std::size_t>(x)]
                       : 0;
            }
        }
        state.live[s] = F::Mask::fromBits(inside);
        if (inside != 0) state.liveBits |= 1u << s;
        state.transmittance[s] = F(1.0f);
        state.opacity[s] = state.depth[s] = F(0.0f);
        if constexpr (Task != TileTask::List) {
            std::memset(state.sums[s], 0, static_cast<std::size_t>(job.featureStride) * sizeof state.sums[s][0]);
        }
    }
}

template <typename F>
void writeCounts(const TileJob& job, const TileState<F>& state, int x0, int y0) {
    for (int s = 0; s < kSubtiles; ++s) {
        for (int lane = 0; lane < kLanes; ++lane) {
            const int x = x0 + kSubtileSide * (s % 4) + lane % kSubtileSide;
            const int y = y0 + kSubtileSide * (s / 4) + lane / kSubtileSide;
            if (x >= job.width || y >= job.height) continue;
            job.contributorCounts[static_cast<std::size_t>(y) * static_cast<std::size_t>(job.width) +
                                  static_cast<std::size_t>(x)] = state.cursor[s][lane];
        }
    }
}

template <typename F, SurfelKernel Kernel, DepthMode Depth, TileTask Task>
void blendTile(const TileJob& job, TileState<F>& state, const SubtileGrid<F>& grid, std::uint32_t tile) {
    const int x0 = kTileSide * static_cast<int>(tile % static_cast<std::uint32_t>(job.tilesX));
    const int y0 = kTileSide * static_cast<int>(tile / static_cast<std::uint32_t>(job.tilesX));
    const TileArea area{x0, y0, job.width - x0 < kTileSide ? job.width - x0 : kTileSide,
                        job.height - y0 < kTileSide ? job.height - y0 : kTileSide};
    if (Task == TileTask::Blend && job.tileStarts[tile] == job.tileStarts[tile + 1]) {
        clearTile<F>(job, area);
        job.blended[tile] = job.foreground[tile] = 0;
        return;
    }
    beginTile<F, Task>(job, state, x0, y0);
    const std::uint64_t end = job.tileStarts[tile + 1];
    for (std::uint64_t begin = job.tileStarts[tile]; begin < end && state.liveBits != 0; begin += kBatch) {
        const int count = static_cast<int>(end - begin < kBatch ? end - begin : kBatch);
        int listed[kSubtiles] = {};
        stageBatch<F, Kernel>(job, state, grid, begin, count, static_cast<float>(x0), static_cast<float>(y0), listed);
        for (int s = 0; s < kSubtiles; ++s) {
            if (listed[s] == 0) continue;
            const F x = grid.laneX + F(static_cast<float>(kSubtileSide * (s % 4)));
            const F y = grid.laneY + F(static_cast<float>(kSubtileSide * (s / 4)));
            blendSubtile<F, Kernel, Depth, Task>(job, state, s, listed[s], x, y);
        }
    }
    if constexpr (Task == TileTask::List) return;
    job.blended[tile] = state.blended;
    job.foreground[tile] = countForeground(state);
    writeOpacityAndDepth(job, state, area);
    if (job.position) writePosition(job, state, grid, area);
    for (int i = 0; i < job.outputCount; ++i) writeFeature(job, state, job.outputs[i], area);
    if constexpr (Task == TileTask::BlendAndCount) writeCounts(job, state, x0, y0);
}

template <typename F, SurfelKernel Kernel, DepthMode Depth, TileTask Task>
void blendTiles(const TileJob& job, std::uint32_t begin, std::uint32_t end) {
    TileState<F> state;
    const SubtileGrid<F> grid = subtileGrid<F>();
    for (std::uint32_t tile = begin; tile < end; ++tile) blendTile<F, Kernel, Depth, Task>(job, state, grid, tile);
    F::streamEnd();
}

template <typename F, TileTask Task>
void blendByKernel(const TileJob& job, std::uint32_t begin, std::uint32_t end) {
    if (job.kernel == SurfelKernel::RaySplat) {
        blendTiles<F, SurfelKernel::RaySplat, DepthMode::Exact, Task>(job, begin, end);
    } else if (job.depthMode == DepthMode::Exact) {
        blendTiles<F, SurfelKernel::GaussianSurfel, DepthMode::Exact, Task>(job, begin, end);
    } else {
        blendTiles<F, SurfelKernel::GaussianSurfel, DepthMode::Linear, Task>(job, begin, end);
    }
}

template <typename F>
TileFunctions tileFunctions() {
    TileFunctions functions;
    functions.blend = [](const TileJob& job, std::uint32_t begin, std::uint32_t end) {
        if (job.contributorCounts) {
            blendByKernel<F, TileTask::BlendAndCount>(job, begin, end);
        } else {
            blendByKernel<F, TileTask::Blend>(job, begin, end);
        }
    };
    functions.list = [](const TileJob& job, std::uint32_t begin, std::uint32_t end) {
        blendByKernel<F, TileTask::List>(job, begin, end);
    };
    return functions;
}

} // namespace ars::cpu
