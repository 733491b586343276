#include "engine/core/parallel.h"
#include "engine/occlusion/ambient_occlusion_kernels.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <mutex>

namespace ars::cpu {
namespace {

constexpr int kBlock = 8;          ///< pixels are worked off in squares of this side, for the cache
constexpr int kMaxAzimuths = 1024; ///< 2 (1 + alpha) / delta at the ends of their ranges
constexpr int kMaxPolarAngles = 512;

std::atomic<MarchRows> chosenRows{nullptr};

MarchRows marchRows() {
    static const MarchRows fastest = availableMarchRows().front().march;
    const MarchRows chosen = chosenRows.load(std::memory_order_relaxed);
    return chosen ? chosen : fastest;
}

/// What a thread needs for one pixel.
struct Scratch {
    alignas(64) float azimuthU[kMaxAzimuths];
    alignas(64) float azimuthV[kMaxAzimuths];
    alignas(64) float azimuthZ[kMaxAzimuths];
    OcclusionRow rows[kMaxPolarAngles];
    float weights[kMaxPolarAngles];
    int hits[kMaxPolarAngles];
    float distances[kMaxSteps];
    int pieces[kMaxPolarAngles]; ///< of a subset: where each row's azimuths begin in the ordered table
    OcclusionGrid grid;          ///< that the rows are made for
    int rowCount = 0;
    int subsetCount = 0;
    float total = 0.0f; ///< weight of all directions
};

struct Weights {
    float occluded = 0.0f;
    float total = 0.0f;
};

/// Into the scratch at `start`: a multiple of kOcclusionLanes of them.
void turnAzimuths(const OcclusionPixel& pixel, const float* cosines, const float* sines, int count, int start,
                  Scratch& s) {
    for (int first = 0; first < count; first += kOcclusionLanes) {
        for (int i = first; i < first + kOcclusionLanes; ++i) {
            s.azimuthU[start + i] = cosines[i] * pixel.tangent.x + sines[i] * pixel.bitangent.x;
            s.azimuthV[start + i] = cosines[i] * pixel.tangent.y + sines[i] * pixel.bitangent.y;
            s.azimuthZ[start + i] = cosines[i] * pixel.tangent.z + sines[i] * pixel.bitangent.z;
        }
    }
}

/// Every direction of the grid.
void listAllRows(const OcclusionArguments& a, const OcclusionGrid& grid, Scratch& s) {
    const float* angles = a.tables.polarAngles(grid.polarAngles);
    s.rowCount = grid.polarAngles;
    for (int t = 0; t < s.rowCount; ++t) {
        s.rows[t] = {angles[t], angles[s.rowCount + t], 0, grid.azimuths};
        s.weights[t] = angles[2 * s.rowCount + t];
    }
}

/// The directions of one subset.
void listSubsetRows(const OcclusionArguments& a, const OcclusionGrid& grid, Scratch& s) {
    const OcclusionSubsets subsets = occlusionSubsets(grid, a.params.interactiveDirections);
    s.subsetCount = subsets.count();
    const OcclusionSubset subset = occlusionSubset(subsets, a.pass);
    const float* angles = a.tables.polarAngles(grid.polarAngles);
    s.rowCount = 0;
    for (int t = subset.row; t < grid.polarAngles; t += subsets.rowStride) {
        const int residue = occlusionResidue(subsets, subset, t);
        const int count = (grid.azimuths - residue + subsets.azimuthStride - 1) / subsets.azimuthStride;
        s.rows[s.rowCount] = {angles[t], angles[grid.polarAngles + t], s.rowCount * kOcclusionLanes, count};
        s.weights[s.rowCount] = angles[2 * grid.polarAngles + t];
        s.pieces[s.rowCount] = residue * kOcclusionLanes;
        ++s.rowCount;
    }
}

/// Prepares the rows of a pixel; false when a refinement has all of its directions already. The list is kept for the
/// next pixel, whose grid is mostly the same.
bool chooseRows(const OcclusionArguments& a, const OcclusionPixel& pixel, Scratch& s) {
    const OcclusionGrid& grid = pixel.grid;
    if (grid.azimuths != s.grid.azimuths || grid.polarAngles != s.grid.polarAngles) {
        s.grid = grid;
        if (a.subset) {
            listSubsetRows(a, grid, s);
        } else {
            listAllRows(a, grid, s);
        }
        s.total = 0.0f;
        for (int r = 0; r < s.rowCount; ++r) s.total += s.weights[r] * static_cast<float>(s.rows[r].count);
    }
    if (a.sums && a.pass >= s.subsetCount) return false;
    const int padded = roundedToLanes(grid.azimuths);
    const float* azimuths = a.tables.azimuths(grid.azimuths);
    if (!a.subset) {
        turnAzimuths(pixel, azimuths, azimuths + padded, padded, 0, s);
        return true;
    }
    for (int r = 0; r < s.rowCount; ++r) {
        const float* ordered = azimuths + 2 * padded + s.pieces[r];
        turnAzimuths(pixel, ordered, ordered + padded, kOcclusionLanes, s.rows[r].start, s);
    }
    return true;
}

/// Ray by ray through the functions that every device shares.
float plainOccludedWeight(const OcclusionArguments& a, const OcclusionPixel& pixel, const OcclusionReach<float>& reach,
                          const Scratch& s, int& taps) {
    float occluded = 0.0f;
    for (int r = 0; r < s.rowCount; ++r) {
        const OcclusionRow& row = s.rows[r];
        int hits = 0;
        for (int i = row.start; i < row.start + row.count; ++i) {
            const glm::vec3 azimuth(s.azimuthU[i], s.azimuthV[i], s.azimuthZ[i]);
            const glm::vec3 direction = rayDirection(azimuth, pixel.pole, row.sine, row.cosine);
            hits += rayIsHidden(a.march, a.paddedDepth, pixel.origin, direction, reach, &taps) ? 1 : 0;
        }
        occluded += s.weights[r] * static_cast<float>(hits);
    }
    return occluded;
}

/// The tangent plane as a linear function of the picture: 1/z of the points n.X = n.P is n.ray / (n.P).
void setTangentPlane(const OcclusionArguments& a, const OcclusionPixel& pixel, OcclusionRowInput& in) {
    const float distance = -glm::dot(pixel.normal, pixel.position);
    const float x = pixel.position.x / pixel.position.z, y = pixel.position.y / pixel.position.z;
    if (!in.tiles.top || !(distance > 1e-4f * pixel.position.z)) return; // seen from behind or edge-on
    const float w = 1.0f / pixel.position.z;
    const float u = pixel.origin.x * w, v = pixel.origin.y * w;
    const float slopeU = -pixel.normal.x / (a.march.fx * distance);
    const float slopeV = -pixel.normal.y / (a.march.fy * distance);
    // Far outside of what any picture shows the bound would overflow.
    const auto sane = [](float value) { return std::fabs(value) < 1e6f; };
    if (!(w > 1e-6f) || !sane(u) || !sane(v) || !sane(slopeU) || !sane(slopeV)) return;
    in.planeDistance = distance;
    in.planeW = w;
    in.planeU = u;
    in.planeV = v;
    in.planeSlopeU = slopeU;
    in.planeSlopeV = slopeV;
    in.pixelsPerMetre = std::max(a.march.fx * std::sqrt(1.0f + x * x), a.march.fy * std::sqrt(1.0f + y * y));
}

/// Occluded weight of the rows in `s` at one radius.
float occludedWeight(const OcclusionArguments& a, const OcclusionTiles& tiles, MarchRows march,
                     const OcclusionPixel& pixel, float radius, Scratch& s) {
    const OcclusionReach<float> reach = occlusionReach(a.march, radius, pixel.position.z);
    const float step = reach.length / static_cast<float>(a.march.steps);
    // The vector loops clamp to the border instead of asking whether a sample is before the camera.
    if (!(pixel.position.z - reach.length > 2.0f * kOcclusionNearest)) {
        int taps = 0;
        return plainOccludedWeight(a, pixel, reach, s, taps);
    }
    OcclusionRowInput in;
    in.depth = a.paddedDepth;
    in.stride = a.march.stride;
    in.right = static_cast<float>(a.march.width + kOcclusionBorder);
    in.bottom = static_cast<float>(a.march.height + kOcclusionBorder);
    in.originU = pixel.origin.x, in.originV = pixel.origin.y, in.originZ = pixel.origin.z;
    in.poleU = pixel.pole.x, in.poleV = pixel.pole.y, in.poleZ = pixel.pole.z;
    in.azimuthU = s.azimuthU, in.azimuthV = s.azimuthV, in.azimuthZ = s.azimuthZ;
    for (int j = a.march.firstStep; j <= a.march.lastStep; ++j) {
        s.distances[in.distanceCount++] = static_cast<float>(j) * step;
    }
    for (int j = in.distanceCount; j < kMaxSteps; ++j) s.distances[j] = s.distances[in.distanceCount - 1];
    in.distances = s.distances;
    in.bias = reach.bias;
    in.hidingDepth = reach.depth;
    in.rows = s.rows;
    in.rowCount = s.rowCount;
    in.tiles = tiles;
    setTangentPlane(a, pixel, in);
    march(in, s.hits);
    float occluded = 0.0f;
    for (int r = 0; r < s.rowCount; ++r) occluded += s.weights[r] * static_cast<float>(s.hits[r]);
    return occluded;
}

void writePixel(const OcclusionArguments& a, const OcclusionTiles& tiles, MarchRows march, int x, int y, Scratch& s) {
    const std::size_t at =
        static_cast<std::size_t>(y) * static_cast<std::size_t>(a.march.width) + static_cast<std::size_t>(x);
    OcclusionPixel pixel;
    if (!occlusionPixel(a, x + kOcclusionBorder, y + kOcclusionBorder, pixel)) {
        for (int k = 0; k < a.radii; ++k) a.occlusion[k][at] = 1.0f;
        return;
    }
    const bool more = chooseRows(a, pixel, s);
    for (int k = 0; k < a.radii; ++k) {
        const float radius = a.radius[k][at];
        if (!usableRadius(radius)) {
            a.occlusion[k][at] = 1.0f;
            continue;
        }
        Weights w;
        if (more) w = {occludedWeight(a, tiles, march, pixel, radius, s), s.total};
        if (a.sums) {
            float* sums = a.sums + 2 * at;
            w.occluded += a.pass > 0 ? sums[0] : 0.0f;
            w.total += a.pass > 0 ? sums[1] : 0.0f;
            sums[0] = w.occluded;
            sums[1] = w.total;
        }
        a.occlusion[k][at] = occlusionFromWeights(w.occluded, w.total, a.params.strength);
    }
}

void padDepth(const OcclusionArguments& a) {
    const int columns = a.march.stride;
    parallelFor(
        static_cast<std::size_t>(a.march.height + 2 * kOcclusionBorder),
        [&a, columns](std::size_t row) {
            float* out = a.paddedDepth + row * static_cast<std::size_t>(columns);
            const int y = static_cast<int>(row);
            const bool inside = y >= kOcclusionBorder && y < a.march.height + kOcclusionBorder;
            for (int x = 0; x < columns; ++x) {
                float z = 0.0f;
                if (inside) {
                    z = filteredPosition(a.march, x, y, a.params.median, [&a](int c, int r) {
                            return a.depthAt(c, r);
                        }).z;
                }
                out[x] = z > kOcclusionNearest ? z : emptyDepth<float>();
            }
        },
        16);
}

/// Tile size for this picture: rays should reach over about ten tiles. Looks at every fourth pixel of every fourth row.
int tileSize(const OcclusionArguments& a) {
    double pixels = 0.0, count = 0.0;
    for (int y = 0; y < a.march.height; y += 4) {
        for (int x = 0; x < a.march.width; x += 4) {
            const float z = a.paddedDepth[static_cast<std::size_t>(y + kOcclusionBorder) *
                                              static_cast<std::size_t>(a.march.stride) +
                                          static_cast<std::size_t>(x + kOcclusionBorder)];
            const float radius = a.radius[0][static_cast<std::size_t>(y) * static_cast<std::size_t>(a.march.width) +
                                             static_cast<std::size_t>(x)];
            if (!finite(z) || !usableRadius(radius)) continue;
            pixels += static_cast<double>(radius) * static_cast<double>(a.march.fx) / static_cast<double>(z);
            count += 1.0;
        }
    }
    int size = kSmallestTile;
    while (size < 64 && pixels > 10.0 * size * count) size *= 2;
    return size;
}

/// Least-squares plane w = c + su du + sv dv of the covered pixels of one tile, raised until none is above it.
struct TileFit {
    double n = 0, u = 0, v = 0, w = 0, uu = 0, uv = 0, vv = 0, uw = 0, vw = 0;

    void add(double du, double dv, double value) {
        n += 1.0, u += du, v += dv, w += value;
        uu += du * du, uv += du * dv, vv += dv * dv, uw += du * value, vw += dv * value;
    }
    void solve(float& slopeU, float& slopeV) const {
        const double a = uu - u * u / n, b = uv - u * v / n, c = vv - v * v / n;
        const double p = uw - u * w / n, q = vw - v * w / n;
        const double det = a * c - b * b;
        if (!(det > 1e-3 * (a + c) * (a + c))) { // pixels in a row: no plane through them is better than another
            slopeU = slopeV = 0.0f;
            return;
        }
        slopeU = static_cast<float>((c * p - b * q) / det);
        slopeV = static_cast<float>((a * q - b * p) / det);
    }
};

OcclusionTiles boundTiles(const OcclusionArguments& a) {
    OcclusionTiles tiles;
    tiles.size = tileSize(a);
    tiles.columns = (a.march.width + tiles.size - 1) / tiles.size;
    tiles.rows = (a.march.height + tiles.size - 1) / tiles.size;
    tiles.stride = tiles.columns + kTileMargins;
    float* top = a.tiles;
    float* slopeU = top + a.tileCapacity;
    float* slopeV = slopeU + a.tileCapacity;
    const OcclusionTiles shape = tiles;
    const auto each = [&a, shape](int column, int row, const auto& visit) {
        const int x0 = column * shape.size;
        const int y0 = row * shape.size;
        const float half = 0.5f * static_cast<float>(shape.size) - 0.5f;
        for (int y = y0; y < std::min(y0 + shape.size, a.march.height); ++y) {
            const float* depths =
                a.paddedDepth +
                static_cast<std::size_t>(y + kOcclusionBorder) * static_cast<std::size_t>(a.march.stride) +
                kOcclusionBorder;
            for (int x = x0; x < std::min(x0 + shape.size, a.march.width); ++x) {
                if (depths[x] == emptyDepth<float>()) continue;
                visit(static_cast<float>(x - x0) - half, static_cast<float>(y - y0) - half, 1.0f / depths[x]);
            }
        }
    };
    parallelFor(
        static_cast<std::size_t>(tiles.stride) * static_cast<std::size_t>(tiles.rows),
        [&](std::size_t at) {
            top[at] = -emptyDepth<float>();
            slopeU[at] = slopeV[at] = 0.0f;
            const int column = static_cast<int>(at % static_cast<std::size_t>(shape.stride)) - kTileMargins / 2;
            const int row = static_cast<int>(at / static_cast<std::size_t>(shape.stride));
            if (column < 0 || column >= shape.columns) return;
            TileFit fit;
            each(column, row, [&fit](float u, float v, float w) { fit.add(u, v, w); });
            if (fit.n == 0.0) return;
            fit.solve(slopeU[at], slopeV[at]);
            float highest = -emptyDepth<float>();
            each(column, row,
                 [&](float u, float v, float w) { highest = std::max(highest, w - slopeU[at] * u - slopeV[at] * v); });
            top[at] = highest;
        },
        64);
    tiles.top = top;
    tiles.slopeU = slopeU;
    tiles.slopeV = slopeV;
    return tiles;
}

/// body(x, y, scratch) for every pixel of the rows that are asked for, block by block.
template <typename Body>
void forEachPixel(const OcclusionArguments& a, const Body& body) {
    const int columns = (a.march.width + kBlock - 1) / kBlock;
    const int rows = std::max(0, a.endRow - a.firstRow + kBlock - 1) / kBlock;
    parallelRanges(static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows), 2,
                   [&a, &body, columns](std::size_t begin, std::size_t end) {
                       Scratch scratch;
                       for (std::size_t block = begin; block < end; ++block) {
                           const int x0 = static_cast<int>(block % static_cast<std::size_t>(columns)) * kBlock;
                           const int y0 =
                               a.firstRow + static_cast<int>(block / static_cast<std::size_t>(columns)) * kBlock;
                           for (int y = y0; y < std::min(y0 + kBlock, a.endRow); ++y) {
                               for (int x = x0; x < std::min(x0 + kBlock, a.march.width); ++x) body(x, y, scratch);
                           }
                       }
                   });
}

} // namespace

void ambientOcclusion(const OcclusionArguments& arguments) {
    const OcclusionArguments& a = arguments;
    padDepth(a);
    const OcclusionTiles tiles = a.tiles ? boundTiles(a) : OcclusionTiles{};
    const MarchRows march = marchRows();
    forEachPixel(a, [&a, &tiles, march](int x, int y, Scratch& s) { writePixel(a, tiles, march, x, y, s); });
}

OcclusionCost countTaps(const OcclusionArguments& arguments) {
    const OcclusionArguments& a = arguments;
    padDepth(a);
    OcclusionCost cost;
    std::mutex mutex;
    forEachPixel(a, [&](int x, int y, Scratch& s) {
        OcclusionPixel pixel;
        const std::size_t at =
            static_cast<std::size_t>(y) * static_cast<std::size_t>(a.march.width) + static_cast<std::size_t>(x);
        if (!occlusionPixel(a, x + kOcclusionBorder, y + kOcclusionBorder, pixel)) return;
        if (!usableRadius(a.radius[0][at])) return;
        chooseRows(a, pixel, s);
        int taps = 0;
        plainOccludedWeight(a, pixel, occlusionReach(a.march, a.radius[0][at], pixel.position.z), s, taps);
        std::uint64_t directions = 0;
        for (int r = 0; r < s.rowCount; ++r) directions += static_cast<std::uint64_t>(s.rows[r].count);
        const std::lock_guard lock(mutex);
        cost.pixels += 1;
        cost.directions += directions;
        cost.tapsTaken += static_cast<std::uint64_t>(taps);
    });
    cost.tapsBound = cost.directions * static_cast<std::uint64_t>(a.march.lastStep - a.march.firstStep + 1);
    return cost;
}

std::vector<NamedMarchRows> availableMarchRows() {
    std::vector<NamedMarchRows> rows;
#if defined(__x86_64__)
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq")) {
        rows.push_back({"avx512", &marchRowsAvx512});
    }
    if (__builtin_cpu_supports("avx2")) rows.push_back({"avx2", &marchRowsAvx2});
#endif
    rows.push_back({"portable", &marchRowsPortable});
    return rows;
}

void setMarchRows(MarchRows march) { chosenRows.store(march, std::memory_order_relaxed); }

} // namespace ars::cpu
