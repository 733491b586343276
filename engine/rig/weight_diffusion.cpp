#include "engine/rig/weight_diffusion.h"

#include "engine/core/parallel.h"
#include "engine/rig/cell_grid.h"
#include "engine/rig/closest_surface.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <mutex>
#include <numeric>

namespace ars {
namespace {

constexpr int kBlockJoints = 8;
constexpr std::uint64_t kFloatsPerCell =
    3 * kBlockJoints + 6; ///< of one block: grid, solution, residual, coarser levels
constexpr std::uint64_t kParallelBytes = std::uint64_t{1} << 30; ///< blocks are solved side by side within this, bytes

struct Box {
    glm::vec3 low{std::numeric_limits<float>::max()};
    glm::vec3 high{std::numeric_limits<float>::lowest()};

    void add(std::span<const glm::vec3> points) {
        for (const glm::vec3& p : points) {
            low = glm::min(low, p);
            high = glm::max(high, p);
        }
    }
    float longestSide() const {
        const glm::vec3 side = high - low;
        return std::max({side.x, side.y, side.z});
    }
};

/// The body with its weights as the solve needs them: only the joints that move anything.
struct Source {
    std::span<const glm::uvec3> triangles;
    const SkinWeights* weights = nullptr;
    std::vector<int> activeJoints;   ///< joint of each channel
    std::vector<int> channelOfJoint; ///< -1: moves nothing

    std::size_t channels() const { return activeJoints.size(); }
};

Source makeSource(std::span<const glm::uvec3> triangles, const SkinWeights& weights, int joints) {
    Source source{triangles, &weights, {}, std::vector<int>(static_cast<std::size_t>(joints), -1)};
    std::vector<bool> used(static_cast<std::size_t>(joints), false);
    for (std::size_t i = 0; i < weights.weights.size(); ++i) {
        if (weights.weights[i] > 0.0f) used[weights.joints[i]] = true;
    }
    for (int joint = 0; joint < joints; ++joint) {
        if (!used[static_cast<std::size_t>(joint)]) continue;
        source.channelOfJoint[static_cast<std::size_t>(joint)] = static_cast<int>(source.activeJoints.size());
        source.activeJoints.push_back(joint);
    }
    return source;
}

/// Adds the body's weights at a surface point, times `factor`, to a row of channels.
void addSurfaceWeights(const Source& source, const SurfacePoint& at, float factor, std::span<float> row) {
    for (int corner = 0; corner < 3; ++corner) {
        const std::size_t vertex = source.triangles[at.triangle][corner];
        for (std::size_t slot = vertex * kMaxInfluences; slot < (vertex + 1) * kMaxInfluences; ++slot) {
            const float weight = source.weights->weights[slot];
            if (weight <= 0.0f) continue;
            const int channel = source.channelOfJoint[source.weights->joints[slot]];
            row[static_cast<std::size_t>(channel)] += factor * at.barycentric[corner] * weight;
        }
    }
}

Status checkOptions(const DiffusionOptions& options) {
    const auto bad = [](std::string_view name, auto value, std::string_view range) {
        return makeError(ErrorCode::InvalidArgument, std::string(name), fmt::format("{} is outside {}", value, range));
    };
    if (options.resolution < 16 || options.resolution > 512) return bad("resolution", options.resolution, "[16, 512]");
    if (!(options.boxScale >= 1.0f && options.boxScale <= 2.0f)) return bad("boxScale", options.boxScale, "[1, 2]");
    if (!(options.fixedBandM >= 0.0f && options.fixedBandM <= 0.2f)) {
        return bad("fixedBandM", options.fixedBandM, "[0, 0.2]");
    }
    if (!(options.surfaceBlendM >= 0.0f && options.surfaceBlendM <= 0.2f)) {
        return bad("surfaceBlendM", options.surfaceBlendM, "[0, 0.2]");
    }
    if (!(options.tolerance > 0.0f)) return bad("tolerance", options.tolerance, "(0, ...)");
    return {};
}

Status checkInputs(std::span<const glm::vec3> bodyVertices, const SkinWeights& bodyWeights, int joints,
                   std::span<const glm::vec3> points) {
    if (joints < 1 || bodyWeights.pointCount() != bodyVertices.size() ||
        bodyWeights.joints.size() != bodyWeights.weights.size()) {
        return makeError(ErrorCode::InvalidArgument, "body weights",
                         fmt::format("{} rows for {} vertices and {} joints", bodyWeights.pointCount(),
                                     bodyVertices.size(), joints));
    }
    for (std::size_t i = 0; i < bodyWeights.weights.size(); ++i) {
        if (bodyWeights.weights[i] > 0.0f && bodyWeights.joints[i] >= joints) {
            return makeError(ErrorCode::InvalidArgument, fmt::format("body weights: vertex {}", i / kMaxInfluences),
                             fmt::format("names joint {}, there are {}", bodyWeights.joints[i], joints));
        }
    }
    if (points.empty()) return makeError(ErrorCode::InvalidArgument, "points", "there are none");
    const auto finite = [](const glm::vec3& p) {
        return std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z);
    };
    for (std::size_t i = 0; i < points.size(); ++i) {
        if (!finite(points[i])) {
            return makeError(ErrorCode::InvalidArgument, fmt::format("point {}", i), "is not a finite position");
        }
    }
    for (std::size_t i = 0; i < bodyVertices.size(); ++i) {
        if (!finite(bodyVertices[i])) {
            return makeError(ErrorCode::InvalidArgument, fmt::format("body vertex {}", i), "is not a finite position");
        }
    }
    return {};
}

/// The empty grid of one block of joints.
Result<CellGrid> makeGrid(const Box& box, const DiffusionOptions& options, std::size_t floatsBeside,
                          const ReadLimits& limits) {
    const float longest = box.longestSide();
    if (!(longest > 0.0f)) return makeError(ErrorCode::InvalidArgument, "body", "the body has no extent");
    CellGrid grid;
    grid.channels = kBlockJoints;
    grid.cellM = longest * options.boxScale / static_cast<float>(options.resolution);
    const glm::vec3 side = box.high - box.low + longest * (options.boxScale - 1.0f);
    grid.size = glm::max(glm::ivec3(glm::ceil(side / grid.cellM - 1e-4f)), glm::ivec3(1));
    grid.originM = 0.5f * (box.low + box.high) - 0.5f * grid.cellM * glm::vec3(grid.size);
    const std::uint64_t bytes = (grid.cellCount() * kFloatsPerCell + floatsBeside) * sizeof(float);
    if (bytes > limits.maxBytes) {
        return makeError(ErrorCode::LimitExceeded, "weight diffusion",
                         fmt::format("{}x{}x{} cells need {} MB, the limit is {} MB; try a lower resolution",
                                     grid.size.x, grid.size.y, grid.size.z, bytes >> 20, limits.maxBytes >> 20));
    }
    grid.fixed.assign(grid.cellCount(), 0);
    return grid;
}

/// Calls body(i, j, k, cell) for every cell, rows in parallel.
template <typename Body>
void forCells(const CellGrid& grid, Body&& body) {
    const auto rows = static_cast<std::size_t>(grid.size.y);
    parallelFor(
        rows * static_cast<std::size_t>(grid.size.z),
        [&](std::size_t row) {
            const int j = static_cast<int>(row % rows), k = static_cast<int>(row / rows);
            for (int i = 0; i < grid.size.x; ++i) body(i, j, k, grid.cellIndex(i, j, k));
        },
        16);
}

/// Whether `test` holds for one of the cells around (i,j,k) that are inside the grid; the six next to it, or all 26.
template <typename Test>
bool anyNeighbour(const CellGrid& grid, int i, int j, int k, bool all26, Test&& test) {
    for (int c = std::max(k - 1, 0); c <= std::min(k + 1, grid.size.z - 1); ++c) {
        for (int b = std::max(j - 1, 0); b <= std::min(j + 1, grid.size.y - 1); ++b) {
            for (int a = std::max(i - 1, 0); a <= std::min(i + 1, grid.size.x - 1); ++a) {
                const int steps = std::abs(a - i) + std::abs(b - j) + std::abs(c - k);
                if (steps == 0 || (!all26 && steps > 1)) continue;
                if (test(grid.cellIndex(a, b, c))) return true;
            }
        }
    }
    return false;
}

/// Marks the cells that take the weights of their closest surface point: all within one cell of the surface, and
/// further ones up to `bandM` where that point moves smoothly from cell to cell. Between two limbs it jumps from one
/// skin to the other; there and around the solve makes the transition instead.
std::vector<SurfacePoint> markFixedCells(CellGrid& grid, const ClosestSurface& surface, const Source& source,
                                         std::span<const glm::vec3> vertices, float bandM) {
    constexpr float kTear = 3.0f; // jump of the closest point between neighbours, in cells
    std::vector<SurfacePoint> closest(grid.cellCount());
    std::vector<glm::vec3> foot(grid.cellCount());
    std::vector<std::uint8_t> reached(grid.cellCount(), 0);
    forCells(grid, [&](int i, int j, int k, std::size_t cell) {
        if (!surface.find(grid.centerM(i, j, k), bandM, closest[cell])) return;
        const glm::uvec3 t = source.triangles[closest[cell].triangle];
        const glm::vec3 at = closest[cell].barycentric;
        foot[cell] = at.x * vertices[t.x] + at.y * vertices[t.y] + at.z * vertices[t.z];
        reached[cell] = 1;
    });
    std::vector<std::uint8_t> torn(grid.cellCount(), 0);
    forCells(grid, [&](int i, int j, int k, std::size_t cell) {
        if (!reached[cell]) return;
        torn[cell] = anyNeighbour(grid, i, j, k, false, [&](std::size_t other) {
            return reached[other] && glm::distance(foot[cell], foot[other]) > kTear * grid.cellM;
        });
    });
    // The transition takes half the band on either side, whatever the size of the cells.
    for (int width = std::max(1, static_cast<int>(std::lround(0.5f * bandM / grid.cellM))); width > 0; --width) {
        const std::vector<std::uint8_t> before = torn;
        forCells(grid, [&](int i, int j, int k, std::size_t cell) {
            torn[cell] = before[cell] ||
                         anyNeighbour(grid, i, j, k, true, [&](std::size_t other) { return before[other] != 0; });
        });
    }
    parallelFor(grid.cellCount(), [&](std::size_t cell) {
        grid.fixed[cell] = reached[cell] && (!torn[cell] || closest[cell].distanceM <= grid.cellM);
    });
    return closest;
}

/// The fixed cells and the weights that they are held at.
struct FixedCells {
    std::vector<std::size_t> cells;
    std::vector<float> weights; ///< (cells, channels)
};

FixedCells fixNearSurface(CellGrid& grid, const ClosestSurface& surface, const Source& source,
                          std::span<const glm::vec3> vertices, float bandM) {
    const std::vector<SurfacePoint> closest = markFixedCells(grid, surface, source, vertices, bandM);
    FixedCells fixed;
    for (std::size_t cell = 0; cell < grid.cellCount(); ++cell) {
        if (grid.fixed[cell]) fixed.cells.push_back(cell);
    }
    const std::size_t channels = source.channels();
    fixed.weights.assign(fixed.cells.size() * channels, 0.0f);
    parallelFor(fixed.cells.size(), [&](std::size_t n) {
        addSurfaceWeights(source, closest[fixed.cells[n]], 1.0f,
                          std::span(fixed.weights).subspan(n * channels, channels));
    });
    return fixed;
}

/// Passes the progress of blocks that are solved side by side on to one listener.
class SharedProgress {
public:
    SharedProgress(const ProgressFunction& progress, std::size_t blocks) : progress_(progress), share_(blocks, 0.0) {}

    /// One more cycle of a block; false when the work shall stop.
    bool addCycle(std::size_t block) {
        const std::lock_guard lock(mutex_);
        constexpr double kPerCycle = 0.2; // of what a block has left: the number of cycles is not known before
        share_[block] += kPerCycle * (1.0 - share_[block]);
        return report();
    }
    bool finishBlock(std::size_t block) {
        const std::lock_guard lock(mutex_);
        share_[block] = 1.0;
        return report();
    }

private:
    bool report() {
        const double done = std::accumulate(share_.begin(), share_.end(), 0.0) / static_cast<double>(share_.size());
        if (!stopped_ && progress_) stopped_ = !progress_(0.1 + 0.8 * done, "skinning weights");
        return !stopped_;
    }

    const ProgressFunction& progress_;
    std::mutex mutex_;
    std::vector<double> share_;
    bool stopped_ = false;
};

/// Solves eight joints from `first` on and samples them at the points into the dense rows.
Result<HarmonicSolve> solveBlock(CellGrid& grid, const FixedCells& fixed, std::size_t channels, std::size_t first,
                                 float tolerance, std::span<const glm::vec3> points, std::vector<float>& dense,
                                 const std::function<bool()>& keepGoing) {
    const std::size_t lanes = std::min<std::size_t>(kBlockJoints, channels - first);
    grid.values.assign(grid.cellCount() * kBlockJoints, 0.0f);
    for (std::size_t n = 0; n < fixed.cells.size(); ++n) {
        std::copy_n(&fixed.weights[n * channels + first], lanes, &grid.values[fixed.cells[n] * kBlockJoints]);
    }
    ARS_TRY(const HarmonicSolve solve, solveHarmonic(grid, tolerance, keepGoing));
    parallelFor(points.size(), [&](std::size_t p) {
        std::array<float, kBlockJoints> row;
        sampleGrid(grid, points[p], row);
        for (std::size_t c = 0; c < lanes; ++c) dense[p * channels + first + c] = std::clamp(row[c], 0.0f, 1.0f);
    });
    return solve;
}

/// Solves all blocks, side by side where memory allows: a block alone has too little work between two barriers to keep
/// several threads busy.
Status solveBlocks(const CellGrid& grid, const FixedCells& fixed, std::size_t channels, float tolerance,
                   std::span<const glm::vec3> points, std::vector<float>& dense, const ProgressFunction& progress,
                   DiffusionReport& report) {
    const std::size_t blocks = (channels + kBlockJoints - 1) / kBlockJoints;
    const std::uint64_t blockBytes = grid.cellCount() * kFloatsPerCell * sizeof(float);
    const bool sideBySide =
        blockBytes * std::min<std::uint64_t>(static_cast<std::uint64_t>(threadCount()), blocks) <= kParallelBytes;
    SharedProgress shared(progress, blocks);
    std::vector<Result<HarmonicSolve>> solves(blocks, HarmonicSolve{});
    const auto solve = [&](std::size_t block) {
        CellGrid own = grid;
        solves[block] = solveBlock(own, fixed, channels, block * kBlockJoints, tolerance, points, dense,
                                   [&shared, block] { return shared.addCycle(block); });
        if (solves[block] && !shared.finishBlock(block)) {
            solves[block] = makeError(ErrorCode::Cancelled, "", "the skinning weights were stopped on request");
        }
    };
    if (sideBySide) {
        parallelFor(blocks, solve, 1);
    } else {
        for (std::size_t block = 0; block < blocks && (block == 0 || solves[block - 1]); ++block) solve(block);
    }
    for (const Result<HarmonicSolve>& solved : solves) {
        if (!solved) return solved.error();
        report.cycles = std::max(report.cycles, solved->cycles);
        report.residual = std::max(report.residual, solved->residual);
    }
    return {};
}

/// Mixes the body's own weights in where a point lies on or close to it, and measures the distances.
void blendSurface(const ClosestSurface& surface, const Source& source, float blendM, float reachM,
                  std::span<const glm::vec3> points, std::vector<float>& dense, DiffusionReport& report) {
    const std::size_t channels = source.channels();
    std::vector<float> distances(points.size(), 0.0f);
    parallelFor(points.size(), [&](std::size_t p) {
        SurfacePoint at;
        if (!surface.find(points[p], reachM, at)) return;
        distances[p] = at.distanceM;
        if (at.distanceM >= blendM) return;
        const float t = at.distanceM / blendM;
        const float grid = t * t * (3.0f - 2.0f * t);
        const std::span<float> row = std::span(dense).subspan(p * channels, channels);
        for (float& weight : row) weight *= grid;
        addSurfaceWeights(source, at, 1.0f - grid, row);
    });
    double sum = 0.0;
    for (const float distance : distances) {
        sum += distance;
        report.maxBodyDistanceM = std::max(report.maxBodyDistanceM, distance);
    }
    report.meanBodyDistanceM = static_cast<float>(sum / static_cast<double>(points.size()));
}

} // namespace

Result<SkinWeights> diffuseWeights(std::span<const glm::vec3> bodyVertices, std::span<const glm::uvec3> bodyTriangles,
                                   const SkinWeights& bodyWeights, int joints, std::span<const glm::vec3> points,
                                   const DiffusionOptions& options, const ProgressFunction& progress,
                                   DiffusionReport* report, const ReadLimits& limits) {
    ARS_TRY_STATUS(checkOptions(options));
    ARS_TRY_STATUS(checkInputs(bodyVertices, bodyWeights, joints, points));
    ARS_TRY(const ClosestSurface surface, ClosestSurface::build(bodyVertices, bodyTriangles));
    const Source source = makeSource(bodyTriangles, bodyWeights, joints);
    const std::size_t channels = source.channels();
    if (channels == 0) return makeError(ErrorCode::InvalidArgument, "body weights", "no joint has any weight");

    Box box;
    box.add(bodyVertices);
    box.add(points);
    ARS_TRY(CellGrid grid,
            makeGrid(box, options, points.size() * (channels + static_cast<std::size_t>(joints)), limits));
    ARS_TRY_STATUS(reportProgress(progress, 0.0, "skinning weights"));
    const FixedCells fixed =
        fixNearSurface(grid, surface, source, bodyVertices, std::max(options.fixedBandM, grid.cellM));

    DiffusionReport numbers{.gridSize = grid.size,
                            .cellM = grid.cellM,
                            .channels = static_cast<int>(channels),
                            .fixedCells = fixed.cells.size()};
    std::vector<float> dense(points.size() * channels, 0.0f);
    ARS_TRY_STATUS(solveBlocks(grid, fixed, channels, options.tolerance, points, dense, progress, numbers));
    ARS_TRY_STATUS(reportProgress(progress, 0.9, "skinning weights"));
    blendSurface(surface, source, options.surfaceBlendM, 2.0f * box.longestSide(), points, dense, numbers);

    ARS_TRY(SkinWeights weights, sparseWeights(dense, points.size(), channels));
    for (std::size_t i = 0; i < weights.joints.size(); ++i) {
        // Unused slots keep joint 0 with weight 0, as everywhere.
        if (weights.weights[i] > 0.0f) {
            weights.joints[i] = static_cast<std::uint16_t>(source.activeJoints[weights.joints[i]]);
        } else {
            weights.joints[i] = 0;
        }
    }
    if (report) *report = numbers;
    return weights;
}

} // namespace ars
