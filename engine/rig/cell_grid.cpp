#include "engine/rig/cell_grid.h"

#include "engine/core/parallel.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace ars {
namespace {

constexpr int kLanes = 8; ///< channels solved together: one cache line holds a cell and a half of neighbours
constexpr int kSmoothingSweeps = 2;
constexpr int kCoarsestSweeps = 40;
constexpr int kMaxCycles = 40;
constexpr std::size_t kParallelCells = 32768; ///< below, waiting for the other threads costs more than they save

struct alignas(32) Lanes {
    std::array<float, kLanes> v{};
};

/// One resolution of the multigrid solve. Solves sum over neighbours (value_nb - value) + source = 0 in free cells.
struct Level {
    glm::ivec3 size{0};
    std::vector<std::uint8_t> fixed;
    std::vector<Lanes> value;
    std::vector<Lanes> source; ///< empty on the finest level: Laplace's equation
    std::vector<Lanes> residual;

    std::size_t index(int i, int j, int k) const {
        return (static_cast<std::size_t>(k) * static_cast<std::size_t>(size.y) + static_cast<std::size_t>(j)) *
                   static_cast<std::size_t>(size.x) +
               static_cast<std::size_t>(i);
    }
    std::size_t count() const { return fixed.size(); }
};

void add(Lanes& sum, const Lanes& other) {
    for (int c = 0; c < kLanes; ++c) sum.v[c] += other.v[c];
}

/// Sum of the values of the neighbours inside the box (plus source), and how many there are.
int gatherNeighbours(const Level& level, int i, int j, int k, std::size_t cell, Lanes& sum) {
    const std::size_t row = static_cast<std::size_t>(level.size.x);
    const std::size_t slice = row * static_cast<std::size_t>(level.size.y);
    sum = level.source.empty() ? Lanes{} : level.source[cell];
    int count = 0;
    const auto take = [&](bool inside, std::size_t neighbour) {
        if (!inside) return;
        add(sum, level.value[neighbour]);
        ++count;
    };
    take(i > 0, cell - 1);
    take(i + 1 < level.size.x, cell + 1);
    take(j > 0, cell - row);
    take(j + 1 < level.size.y, cell + row);
    take(k > 0, cell - slice);
    take(k + 1 < level.size.z, cell + slice);
    return count;
}

/// Calls body(i, j, k, cell) for the free cells of one colour (or all, colour -1), slice by slice in parallel.
template <typename Body>
void forFreeCells(const Level& level, int colour, Body&& body) {
    const auto slice = [&](std::size_t kIndex) {
        const int k = static_cast<int>(kIndex);
        for (int j = 0; j < level.size.y; ++j) {
            const int first = colour < 0 ? 0 : (j + k + colour) & 1;
            const int step = colour < 0 ? 1 : 2;
            for (int i = first; i < level.size.x; i += step) {
                const std::size_t cell = level.index(i, j, k);
                if (!level.fixed[cell]) body(i, j, k, cell);
            }
        }
    };
    if (level.count() < kParallelCells) {
        for (int k = 0; k < level.size.z; ++k) slice(static_cast<std::size_t>(k));
    } else {
        parallelFor(static_cast<std::size_t>(level.size.z), slice, 1);
    }
}

/// Red-black Gauss-Seidel: the cells of one colour only read the other, so the order of the threads does not matter.
void smooth(Level& level, int sweeps) {
    for (int sweep = 0; sweep < 2 * sweeps; ++sweep) {
        forFreeCells(level, sweep & 1, [&level](int i, int j, int k, std::size_t cell) {
            Lanes sum;
            const int count = gatherNeighbours(level, i, j, k, cell, sum);
            if (count == 0) return;
            const float inverse = 1.0f / static_cast<float>(count);
            for (int c = 0; c < kLanes; ++c) level.value[cell].v[c] = sum.v[c] * inverse;
        });
    }
}

/// Residual of every free cell; returns the largest, divided by the number of neighbours.
float computeResidual(Level& level) {
    level.residual.assign(level.count(), Lanes{});
    std::vector<float> largest(static_cast<std::size_t>(level.size.z), 0.0f);
    forFreeCells(level, -1, [&](int i, int j, int k, std::size_t cell) {
        Lanes sum;
        const int count = gatherNeighbours(level, i, j, k, cell, sum);
        float worst = 0.0f;
        for (int c = 0; c < kLanes; ++c) {
            const float r = sum.v[c] - static_cast<float>(count) * level.value[cell].v[c];
            level.residual[cell].v[c] = r;
            worst = std::max(worst, std::abs(r));
        }
        float& slice = largest[static_cast<std::size_t>(k)];
        slice = std::max(slice, worst / static_cast<float>(std::max(count, 1)));
    });
    return *std::max_element(largest.begin(), largest.end());
}

/// Calls body(fine cell) for the cells of `fine` that lie in a coarse cell.
template <typename Body>
void forChildren(const Level& fine, int i, int j, int k, Body&& body) {
    for (int c = 2 * k; c < std::min(2 * k + 2, fine.size.z); ++c) {
        for (int b = 2 * j; b < std::min(2 * j + 2, fine.size.y); ++b) {
            for (int a = 2 * i; a < std::min(2 * i + 2, fine.size.x); ++a) body(fine.index(a, b, c));
        }
    }
}

/// Coarse problem for the correction: four times the mean residual, since the spacing doubled and the equation is not
/// divided by its square. Where the box ends inside a coarse cell the missing children count as zero: the sources stay
/// in balance, while a mean over the others would correct too far and diverge.
void restrictResidual(const Level& fine, Level& coarse) {
    coarse.value.assign(coarse.count(), Lanes{});
    coarse.source.assign(coarse.count(), Lanes{});
    forFreeCells(coarse, -1, [&](int i, int j, int k, std::size_t cell) {
        Lanes sum;
        forChildren(fine, i, j, k, [&](std::size_t child) { add(sum, fine.residual[child]); });
        for (int c = 0; c < kLanes; ++c) coarse.source[cell].v[c] = 0.5f * sum.v[c];
    });
}

/// Trilinear value of a coarse level at a fine cell's centre (3/4 and 1/4 along each axis, clamped at the box).
Lanes interpolateCoarse(const Level& coarse, int i, int j, int k) {
    const auto axis = [](int fineIndex, int coarseSize, std::array<int, 2>& index) {
        const int near = fineIndex / 2;
        index = {near, std::clamp(near + ((fineIndex & 1) ? 1 : -1), 0, coarseSize - 1)};
    };
    std::array<int, 2> is, js, ks;
    axis(i, coarse.size.x, is);
    axis(j, coarse.size.y, js);
    axis(k, coarse.size.z, ks);
    Lanes sum;
    for (int corner = 0; corner < 8; ++corner) {
        const int a = corner & 1, b = (corner >> 1) & 1, c = corner >> 2;
        const float weight = (a ? 0.25f : 0.75f) * (b ? 0.25f : 0.75f) * (c ? 0.25f : 0.75f);
        const Lanes& value = coarse.value[coarse.index(is[a], js[b], ks[c])];
        for (int lane = 0; lane < kLanes; ++lane) sum.v[lane] += weight * value.v[lane];
    }
    return sum;
}

void runCycle(std::vector<Level>& levels, std::size_t l) {
    Level& level = levels[l];
    if (l + 1 == levels.size()) {
        smooth(level, kCoarsestSweeps);
        return;
    }
    smooth(level, kSmoothingSweeps);
    computeResidual(level);
    restrictResidual(level, levels[l + 1]);
    runCycle(levels, l + 1);
    const Level& coarse = levels[l + 1];
    forFreeCells(level, -1, [&](int i, int j, int k, std::size_t cell) {
        add(level.value[cell], interpolateCoarse(coarse, i, j, k));
    });
    smooth(level, kSmoothingSweeps);
}

/// The next coarser level: a cell is fixed, at the mean of its fixed children, where any child is.
Level coarsen(const Level& fine) {
    Level coarse;
    coarse.size = (fine.size + 1) / 2;
    const std::size_t count = static_cast<std::size_t>(coarse.size.x) * static_cast<std::size_t>(coarse.size.y) *
                              static_cast<std::size_t>(coarse.size.z);
    coarse.fixed.assign(count, 0);
    coarse.value.assign(count, Lanes{});
    forFreeCells(coarse, -1, [&](int i, int j, int k, std::size_t cell) {
        Lanes sum;
        int fixedChildren = 0;
        forChildren(fine, i, j, k, [&](std::size_t child) {
            if (!fine.fixed[child]) return;
            add(sum, fine.value[child]);
            ++fixedChildren;
        });
        if (fixedChildren == 0) return;
        coarse.fixed[cell] = 1;
        for (int c = 0; c < kLanes; ++c) coarse.value[cell].v[c] = sum.v[c] / static_cast<float>(fixedChildren);
    });
    return coarse;
}

/// Solves the finest level: every level starts from the solution of the coarser one.
Result<HarmonicSolve> solveLevels(std::vector<Level>& levels, float tolerance, const std::function<bool()>& keepGoing) {
    HarmonicSolve result;
    for (std::size_t l = levels.size(); l-- > 0;) {
        Level& level = levels[l];
        level.source.clear();
        if (l + 1 < levels.size()) {
            const Level& coarse = levels[l + 1];
            forFreeCells(level, -1, [&](int i, int j, int k, std::size_t cell) {
                level.value[cell] = interpolateCoarse(coarse, i, j, k);
            });
        }
        if (l > 0) {
            runCycle(levels, l);
            continue;
        }
        float previous = computeResidual(level);
        result.residual = previous;
        while (result.residual > tolerance && result.cycles < kMaxCycles) {
            runCycle(levels, 0);
            ++result.cycles;
            result.residual = computeResidual(level);
            if (keepGoing && !keepGoing())
                return makeError(ErrorCode::Cancelled, "", "the solve was stopped on request");
            // Single precision ends here: more cycles only stir the last bits.
            if (result.cycles > 4 && result.residual > 0.9f * previous) break;
            previous = result.residual;
        }
    }
    return result;
}

Status checkGrid(const CellGrid& grid) {
    const bool positive = grid.size.x > 0 && grid.size.y > 0 && grid.size.z > 0 && grid.channels > 0;
    if (!positive || grid.fixed.size() != grid.cellCount() ||
        grid.values.size() != grid.cellCount() * static_cast<std::size_t>(grid.channels)) {
        return makeError(ErrorCode::InvalidArgument, "grid",
                         fmt::format("{}x{}x{} cells of {} channels do not fit {} values and {} marks", grid.size.x,
                                     grid.size.y, grid.size.z, grid.channels, grid.values.size(), grid.fixed.size()));
    }
    if (std::find(grid.fixed.begin(), grid.fixed.end(), std::uint8_t{1}) == grid.fixed.end()) {
        return makeError(ErrorCode::InvalidArgument, "grid", "no cell is fixed, the solution is not determined");
    }
    return {};
}

/// The levels of eight channels, coarsest last; the finest has the grid's fixed values.
std::vector<Level> makeLevels(const CellGrid& grid, std::size_t first, std::size_t lanes) {
    std::vector<Level> levels(1);
    levels[0].size = grid.size;
    levels[0].fixed = grid.fixed;
    levels[0].value.assign(grid.cellCount(), Lanes{});
    for (std::size_t cell = 0; cell < grid.cellCount(); ++cell) {
        if (!grid.fixed[cell]) continue;
        const float* values = grid.values.data() + cell * static_cast<std::size_t>(grid.channels) + first;
        std::copy_n(values, lanes, levels[0].value[cell].v.begin());
    }
    while (std::max({levels.back().size.x, levels.back().size.y, levels.back().size.z}) > 4) {
        levels.push_back(coarsen(levels.back()));
    }
    return levels;
}

} // namespace

Result<HarmonicSolve> solveHarmonic(CellGrid& grid, float tolerance, const std::function<bool()>& keepGoing) {
    ARS_TRY_STATUS(checkGrid(grid));
    const auto channels = static_cast<std::size_t>(grid.channels);
    HarmonicSolve worst;
    for (std::size_t first = 0; first < channels; first += kLanes) {
        const std::size_t lanes = std::min<std::size_t>(kLanes, channels - first);
        std::vector<Level> levels = makeLevels(grid, first, lanes);
        ARS_TRY(const HarmonicSolve block, solveLevels(levels, tolerance, keepGoing));
        worst.cycles = std::max(worst.cycles, block.cycles);
        worst.residual = std::max(worst.residual, block.residual);
        for (std::size_t cell = 0; cell < grid.cellCount(); ++cell) {
            if (!grid.fixed[cell])
                std::copy_n(levels[0].value[cell].v.begin(), lanes, &grid.values[cell * channels + first]);
        }
    }
    return worst;
}

void sampleGrid(const CellGrid& grid, const glm::vec3& pointM, std::span<float> values) {
    // Centres lie at half-integer cell coordinates, so index space starts half a cell inside the box.
    const glm::vec3 position =
        glm::clamp((pointM - grid.originM) / grid.cellM - 0.5f, glm::vec3(0.0f), glm::vec3(grid.size - 1));
    const glm::ivec3 low = glm::min(glm::ivec3(position), glm::max(grid.size - 2, glm::ivec3(0)));
    const glm::ivec3 high = glm::min(low + 1, grid.size - 1);
    const glm::vec3 t = position - glm::vec3(low);
    const auto channels = static_cast<std::size_t>(grid.channels);
    std::fill(values.begin(), values.end(), 0.0f);
    for (int corner = 0; corner < 8; ++corner) {
        const int a = corner & 1, b = (corner >> 1) & 1, c = corner >> 2;
        const float weight = (a ? t.x : 1.0f - t.x) * (b ? t.y : 1.0f - t.y) * (c ? t.z : 1.0f - t.z);
        const std::size_t cell = grid.cellIndex(a ? high.x : low.x, b ? high.y : low.y, c ? high.z : low.z);
        for (std::size_t channel = 0; channel < channels; ++channel) {
            values[channel] += weight * grid.values[cell * channels + channel];
        }
    }
}

} // namespace ars
