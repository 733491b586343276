#include "engine/occlusion/baked_visibility.h"

#include "engine/core/parallel.h"
#include "engine/core/parameter_ranges.h"
#include "engine/occlusion/cosine_directions_math.h"
#include "engine/occlusion/mesh_occlusion.h"

#include <algorithm>
#include <chrono>
#include <cmath>

namespace ars {
namespace {

constexpr const char* kPlace = "baked visibility";
/// Corners that a query sees with less weight than this say nothing that rounding does not.
constexpr float kLeastWeight = 1e-6f;

/// The box of grid vertices.
struct Grid {
    glm::vec3 originM{0.0f};
    float cellM = 0;
    int resolution = 0;

    std::size_t index(int x, int y, int z) const {
        const auto n = static_cast<std::size_t>(resolution);
        return (static_cast<std::size_t>(x) * n + static_cast<std::size_t>(y)) * n + static_cast<std::size_t>(z);
    }
    std::size_t index(const glm::ivec3& i) const { return index(i.x, i.y, i.z); }
    std::size_t count() const { return index(resolution - 1, resolution - 1, resolution - 1) + 1; }
    glm::vec3 positionM(const glm::ivec3& i) const { return originM + cellM * glm::vec3(i); }
};

/// Marks the corners of every cell that the triangle's plane crosses within the triangle's box: all cells that it
/// touches, and few more. Corners a, b, c in units of cells.
void markTriangle(const Grid& grid, const glm::vec3& a, const glm::vec3& b, const glm::vec3& c,
                  std::vector<std::int32_t>& marked) {
    const auto last = static_cast<float>(grid.resolution - 2);
    const glm::vec3 low = glm::floor(glm::min(a, glm::min(b, c))), high = glm::floor(glm::max(a, glm::max(b, c)));
    for (int axis = 0; axis < 3; ++axis) {
        if (high[axis] < 0.0f || low[axis] > last) return;
    }
    const glm::ivec3 first(glm::clamp(low, 0.0f, last)), end(glm::clamp(high, 0.0f, last));
    const glm::vec3 n = glm::cross(b - a, c - a), size = glm::abs(n);
    // Columns along the axis that the plane is most across: in each the plane passes few cells.
    const int w = size.x >= size.y && size.x >= size.z ? 0 : (size.y >= size.z ? 1 : 2);
    const int u = (w + 1) % 3, v = (w + 2) % 3;
    for (int i = first[u]; i <= end[u]; ++i) {
        for (int j = first[v]; j <= end[v]; ++j) {
            int from = first[w], to = end[w];
            if (size[w] > 0.0f) { // otherwise it has no area: its whole box
                const float du = static_cast<float>(i) + 0.5f - a[u], dv = static_cast<float>(j) + 0.5f - a[v];
                const float height = a[w] - (n[u] * du + n[v] * dv) / n[w];
                const float half = 0.5f * (size[u] + size[v]) / size[w] + 1e-3f;
                from = std::max(from, static_cast<int>(std::floor(std::clamp(height - half, -1.0f, last + 1.0f))));
                to = std::min(to, static_cast<int>(std::floor(std::clamp(height + half, -1.0f, last + 1.0f))));
            }
            for (int k = from; k <= to; ++k) {
                glm::ivec3 cell;
                cell[u] = i;
                cell[v] = j;
                cell[w] = k;
                for (int corner = 0; corner < 8; ++corner) {
                    marked[grid.index(cell + glm::ivec3(corner & 1, corner >> 1 & 1, corner >> 2))] = 0;
                }
            }
        }
    }
}

/// The grid vertices to bake; ids[i] becomes the place of vertex i among them, -1 elsewhere.
std::vector<glm::ivec3> touchedVertices(const Grid& grid, std::span<const glm::vec3> verticesM,
                                        std::span<const glm::uvec3> triangles, std::vector<std::int32_t>& ids) {
    ids.assign(grid.count(), -1);
    const auto inCells = [&](std::uint32_t v) { return (verticesM[v] - grid.originM) / grid.cellM; };
    for (const glm::uvec3& t : triangles) markTriangle(grid, inCells(t.x), inCells(t.y), inCells(t.z), ids);
    std::vector<glm::ivec3> touched;
    for (int x = 0; x < grid.resolution; ++x) {
        for (int y = 0; y < grid.resolution; ++y) {
            for (int z = 0; z < grid.resolution; ++z) {
                std::int32_t& id = ids[grid.index(x, y, z)];
                if (id < 0) continue;
                id = static_cast<std::int32_t>(touched.size());
                touched.emplace_back(x, y, z);
            }
        }
    }
    return touched;
}

/// Every grid vertex gets the id of the baked one that is the fewest steps along the axes away: the original's repeated
/// dilation by 6 neighbours, in one breadth-first pass and in a defined order.
void dilate(const Grid& grid, const std::vector<glm::ivec3>& baked, std::vector<std::int32_t>& ids) {
    std::vector<glm::ivec3> front = baked, next;
    while (!front.empty()) {
        next.clear();
        for (const glm::ivec3& from : front) {
            for (int side = 0; side < 6; ++side) {
                glm::ivec3 to = from;
                to[side / 2] += side % 2 ? 1 : -1;
                if (to[side / 2] < 0 || to[side / 2] >= grid.resolution || ids[grid.index(to)] >= 0) continue;
                ids[grid.index(to)] = ids[grid.index(from)];
                next.push_back(to);
            }
        }
        front.swap(next);
    }
}

/// Y_lm dw of every direction, (D, 16).
std::vector<float> projectionTable(const DirectionGrid& grid) {
    std::vector<float> table(grid.directions.size() * kHarmonicCount);
    for (std::size_t d = 0; d < grid.directions.size(); ++d) {
        double y[kHarmonicCount];
        sphericalHarmonics(glm::dvec3(grid.directions[d]), y);
        for (int i = 0; i < kHarmonicCount; ++i) {
            table[d * kHarmonicCount + static_cast<std::size_t>(i)] =
                static_cast<float>(y[i] * static_cast<double>(grid.solidAnglesSr[d]));
        }
    }
    return table;
}

VisibilityHarmonics project(std::span<const float> table, std::span<const std::uint8_t> visible) {
    VisibilityHarmonics c;
    for (std::size_t d = 0; d < visible.size(); ++d) {
        if (!visible[d]) continue;
        for (std::size_t i = 0; i < kHarmonicCount; ++i) c.values[i] += table[d * kHarmonicCount + i];
    }
    return c;
}

std::vector<glm::vec3> cosineDirections(int samples) {
    const auto n = static_cast<std::uint32_t>(samples);
    std::vector<glm::vec3> directions(n);
    for (std::uint32_t i = 0; i < n; ++i) directions[i] = cosineDirection<float>(i, n);
    return directions;
}

float reconstruct(const VisibilityHarmonics& c, const glm::vec3& unitNormal, std::span<const glm::vec3> directions) {
    glm::vec3 t, b;
    tangentFrame(unitNormal, t, b);
    const glm::mat3 frame(t, b, unitNormal);
    float sum = 0;
    for (const glm::vec3& d : directions) sum += clampedVisibility(c.values, frame * d);
    return sum / static_cast<float>(directions.size());
}

} // namespace

struct BakedVisibility::State {
    Grid grid;
    BakedVisibilityParams params;
    std::vector<std::int32_t> ids;              ///< by grid vertex; dilated, so all are set
    std::vector<VisibilityHarmonics> harmonics; ///< by id
    std::vector<glm::vec3> directions;          ///< of a query, about +z
    double bakeMilliseconds = 0;

    /// Trilinear mean over the corners that lie in front of the surface; over all of them where none has weight.
    VisibilityHarmonics harmonicsAt(const glm::vec3& pointM, const glm::vec3& normal) const {
        const auto last = static_cast<float>(grid.resolution - 1);
        const glm::vec3 cells = glm::clamp((pointM - grid.originM) / grid.cellM, 0.0f, last);
        const glm::vec3 low = glm::min(glm::floor(cells), last - 1.0f);
        const glm::vec3 share = cells - low;
        VisibilityHarmonics front, all;
        float frontWeight = 0;
        for (int corner = 0; corner < 8; ++corner) {
            const glm::ivec3 step(corner & 1, corner >> 1 & 1, corner >> 2);
            const glm::ivec3 at = glm::ivec3(low) + step;
            float weight = 1;
            for (int axis = 0; axis < 3; ++axis) weight *= step[axis] ? share[axis] : 1.0f - share[axis];
            const bool inFront = glm::dot(grid.positionM(at) - pointM, normal) > 0.0f;
            const VisibilityHarmonics& c = harmonics[static_cast<std::size_t>(ids[grid.index(at)])];
            for (int i = 0; i < kHarmonicCount; ++i) {
                all.values[i] += weight * c.values[i];
                if (inFront) front.values[i] += weight * c.values[i];
            }
            if (inFront) frontWeight += weight;
        }
        if (frontWeight < kLeastWeight) return all;
        for (float& value : front.values) value /= frontWeight;
        return front;
    }
};

const ParameterTable<BakedVisibilityParams>& bakedVisibilityParameters() {
    using P = BakedVisibilityParams;
    static const ParameterTable<P> table{
        {"resolution", &P::resolution, {2, 512}, "", ParameterTier::Advanced, "Grid vertices along each side."},
        {"bound", &P::boundM, {0.01, 1000}, "m", ParameterTier::Advanced, "Half side of the box."},
        {"threshold", &P::thresholdM, {0.02, 1000}, "m", ParameterTier::Advanced, "Nearer surfaces block a direction."},
        {"near", &P::nearM, {0, 0.019}, "m", ParameterTier::Expert, "Still nearer surfaces do not."},
        {"rows",
         &P::rows,
         {4, 256},
         "",
         ParameterTier::Advanced,
         "Latitudes of the directions of a bake; twice as many longitudes."},
        {"normal_shift",
         &P::normalShift,
         {0, 2},
         "",
         ParameterTier::Expert,
         "A query moves along its normal by this share of bound / resolution."},
        {"samples",
         &P::samples,
         {1, 4096},
         "",
         ParameterTier::Advanced,
         "Cosine-distributed directions that a query averages."},
    };
    return table;
}

VisibilityHarmonics projectVisibility(const DirectionGrid& grid, std::span<const std::uint8_t> visible) {
    return project(projectionTable(grid), visible.first(std::min(visible.size(), grid.directions.size())));
}

float occlusionFromHarmonics(const VisibilityHarmonics& harmonics, const glm::vec3& unitNormal, int samples) {
    return reconstruct(harmonics, unitNormal, cosineDirections(std::max(samples, 1)));
}

Result<BakedVisibility> BakedVisibility::bake(std::span<const glm::vec3> verticesM,
                                              std::span<const glm::uvec3> triangles,
                                              const BakedVisibilityParams& params) {
    ARS_TRY_STATUS(checkRanges(bakedVisibilityParameters(), params, kPlace));
    if (!(glm::length(params.centerM) <= 1e6f)) { // NaN fails too
        return makeError(ErrorCode::InvalidArgument, kPlace,
                         fmt::format("the centre of the box is ({}, {}, {}), expected finite metres", params.centerM.x,
                                     params.centerM.y, params.centerM.z));
    }
    const auto start = std::chrono::steady_clock::now();
    auto mesh = MeshOcclusion::build(verticesM, triangles);
    if (!mesh) return atPlace(std::move(mesh).error(), kPlace);

    auto state = std::make_shared<State>();
    state->params = params;
    state->grid = {params.centerM - params.boundM, 2 * params.boundM / static_cast<float>(params.resolution - 1),
                   params.resolution};
    const std::vector<glm::ivec3> touched = touchedVertices(state->grid, verticesM, triangles, state->ids);
    if (touched.empty()) {
        return makeError(ErrorCode::InvalidArgument, kPlace,
                         fmt::format("the mesh lies wholly outside the box of {} m about ({}, {}, {})",
                                     2 * params.boundM, params.centerM.x, params.centerM.y, params.centerM.z));
    }
    const DirectionGrid directions = latLongDirections(params.rows, 2 * params.rows);
    const std::vector<float> table = projectionTable(directions);
    state->harmonics.resize(touched.size());
    parallelRanges(touched.size(), 16, [&](std::size_t begin, std::size_t end) {
        std::vector<glm::vec3> origins(directions.directions.size());
        std::vector<std::uint8_t> hit(origins.size());
        for (std::size_t i = begin; i < end; ++i) {
            std::fill(origins.begin(), origins.end(), state->grid.positionM(touched[i]));
            // Cannot fail: lengths agree and the distances were checked.
            (void)mesh->blockedRays(origins, directions.directions, params.nearM, params.thresholdM, hit);
            for (std::uint8_t& value : hit) value = !value;
            state->harmonics[i] = project(table, hit);
        }
    });
    dilate(state->grid, touched, state->ids);
    state->directions = cosineDirections(params.samples);
    state->bakeMilliseconds =
        std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
    BakedVisibility result;
    result.state_ = std::move(state);
    return result;
}

std::size_t BakedVisibility::bakedCount() const { return state_->harmonics.size(); }
double BakedVisibility::bakeMilliseconds() const { return state_->bakeMilliseconds; }

Status BakedVisibility::atPoints(const OcclusionQuery& points, std::span<float> occlusion) const {
    ARS_TRY_STATUS(checkOcclusionQuery(points, occlusion.size(), kPlace));
    const float shiftM =
        state_->params.normalShift * state_->params.boundM / static_cast<float>(state_->params.resolution);
    parallelFor(
        occlusion.size(),
        [&](std::size_t i) {
            occlusion[i] = 1.0f;
            if (!hasAnswer(points.pointsM[i], points.normals[i])) return;
            const glm::vec3 normal = glm::normalize(points.normals[i]);
            const VisibilityHarmonics c = state_->harmonicsAt(points.pointsM[i] + shiftM * normal, normal);
            occlusion[i] = reconstruct(c, normal, state_->directions);
        },
        64);
    return {};
}

} // namespace ars
