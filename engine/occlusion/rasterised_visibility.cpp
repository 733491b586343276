#include "engine/occlusion/rasterised_visibility.h"

#include "engine/core/buffer.h"
#include "engine/core/parallel.h"
#include "engine/core/parameter_ranges.h"
#include "engine/occlusion/cosine_directions_math.h"

#include <nanoflann.hpp>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <limits>
#include <numeric>

namespace ars {
namespace {

constexpr const char* kPlace = "rasterised visibility";
constexpr std::size_t kMaxBytes = std::size_t{4} << 30;
constexpr std::size_t kNearest = 3;
constexpr std::uint32_t kNothing = ~0u;

/// The vertices that may be asked, for nanoflann.
struct Cloud {
    std::vector<glm::vec3> pointsM;
    std::vector<std::uint32_t> vertices; ///< of the mesh

    std::size_t kdtree_get_point_count() const { return pointsM.size(); }
    float kdtree_get_pt(std::size_t point, std::size_t axis) const { return pointsM[point][static_cast<int>(axis)]; }
    template <typename Box>
    bool kdtree_get_bbox(Box&) const {
        return false;
    }
};
using Tree = nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<float, Cloud>, Cloud, 3, std::uint32_t>;

/// One orthographic picture: the mesh seen from infinity along a direction.
class DirectionRaster {
public:
    DirectionRaster(std::span<const glm::vec3> verticesM, const glm::vec3& toLight, float pixelsPerMetre, int maxSide)
        : corners_(verticesM.size()) {
        glm::vec3 t, b;
        tangentFrame(toLight, t, b);
        std::vector<glm::vec3> projected(verticesM.size());
        glm::vec2 low(std::numeric_limits<float>::max()), high(-std::numeric_limits<float>::max());
        for (std::size_t v = 0; v < verticesM.size(); ++v) {
            const glm::vec3 p = verticesM[v];
            projected[v] = {glm::dot(p, t), glm::dot(p, b), glm::dot(p, toLight)};
            low = glm::min(low, glm::vec2(projected[v]));
            high = glm::max(high, glm::vec2(projected[v]));
        }
        const glm::vec2 extent = high - low;
        const float scale =
            std::min(pixelsPerMetre, static_cast<float>(maxSide - 1) / std::max({extent.x, extent.y, 1e-12f}));
        // Corners on a lattice and integer edges, as graphics hardware has it: no pixel slips between two triangles
        // that share an edge.
        for (std::size_t v = 0; v < projected.size(); ++v) {
            const glm::vec3 p = projected[v];
            corners_[v] = {static_cast<std::int32_t>(std::lrint((p.x - low.x) * scale * kPixel)),
                           static_cast<std::int32_t>(std::lrint((p.y - low.y) * scale * kPixel)), p.z};
        }
        width_ = std::clamp(static_cast<int>(std::ceil(extent.x * scale)), 1, maxSide);
        height_ = std::clamp(static_cast<int>(std::ceil(extent.y * scale)), 1, maxSide);
        const std::size_t pixels = static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_);
        nearest_.assign(pixels, -std::numeric_limits<float>::max());
        triangle_.assign(pixels, kNothing);
    }

    /// Pixel centres inside a triangle, edges included; of equally near triangles the first stays. Either winding.
    void draw(std::span<const glm::uvec3> triangles) {
        for (std::size_t i = 0; i < triangles.size(); ++i) drawOne(static_cast<std::uint32_t>(i), triangles[i]);
    }

    /// visible[v] = 255 for the corners of every triangle that a pixel shows.
    void markVisible(std::span<const glm::uvec3> triangles, std::uint8_t* visible) const {
        for (const std::uint32_t shown : triangle_) {
            if (shown == kNothing) continue;
            for (int corner = 0; corner < 3; ++corner) visible[triangles[shown][corner]] = 255;
        }
    }

private:
    struct Corner {
        std::int32_t x = 0, y = 0; ///< 1/kPixel pixels
        float depth = 0;           ///< metres towards the light
    };
    static constexpr std::int32_t kPixel = 256;

    /// Twice the area of (a, b, point), positive counter-clockwise; below 2^43 for pictures of 8,192 pixels.
    static std::int64_t edge(const Corner& a, const Corner& b, std::int32_t x, std::int32_t y) {
        return std::int64_t{b.x - a.x} * (y - a.y) - std::int64_t{b.y - a.y} * (x - a.x);
    }
    /// First pixel whose centre is at or after `low`, last whose centre is at or before `high`.
    static int firstPixel(std::int32_t low) { return (low + kPixel / 2 - 1) / kPixel; }
    static int lastPixel(std::int32_t high) { return (high + kPixel / 2) / kPixel - 1; }

    void drawOne(std::uint32_t index, const glm::uvec3& triangle) {
        Corner a = corners_[triangle.x], b = corners_[triangle.y];
        const Corner c = corners_[triangle.z];
        const int x0 = firstPixel(std::min({a.x, b.x, c.x})),
                  x1 = std::min(width_ - 1, lastPixel(std::max({a.x, b.x, c.x})));
        const int y0 = firstPixel(std::min({a.y, b.y, c.y})),
                  y1 = std::min(height_ - 1, lastPixel(std::max({a.y, b.y, c.y})));
        if (x0 > x1 || y0 > y1) return;
        std::int64_t area = edge(a, b, c.x, c.y);
        if (area == 0) return;
        if (area < 0) {
            std::swap(a, b);
            area = -area;
        }
        const float scale = 1.0f / static_cast<float>(area);
        for (int y = y0; y <= y1; ++y) {
            const std::int32_t py = y * kPixel + kPixel / 2;
            for (int x = x0; x <= x1; ++x) {
                const std::int32_t px = x * kPixel + kPixel / 2;
                const std::int64_t wa = edge(b, c, px, py), wb = edge(c, a, px, py), wc = area - wa - wb;
                if (wa < 0 || wb < 0 || wc < 0) continue;
                const float depth = (static_cast<float>(wa) * a.depth + static_cast<float>(wb) * b.depth +
                                     static_cast<float>(wc) * c.depth) *
                                    scale;
                const std::size_t pixel =
                    static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) + static_cast<std::size_t>(x);
                if (depth <= nearest_[pixel]) continue;
                nearest_[pixel] = depth;
                triangle_[pixel] = index;
            }
        }
    }

    std::vector<Corner> corners_; ///< by vertex
    std::vector<float> nearest_;
    std::vector<std::uint32_t> triangle_;
    int width_ = 0;
    int height_ = 0;
};

/// (directions, V), 0 or 255.
std::vector<std::uint8_t> rasteriseAll(std::span<const glm::vec3> verticesM, std::span<const glm::uvec3> triangles,
                                       const DirectionGrid& grid, const RasterisedVisibilityParams& params) {
    std::vector<std::uint8_t> visible(grid.directions.size() * verticesM.size(), 0);
    parallelFor(
        grid.directions.size(),
        [&](std::size_t d) {
            DirectionRaster raster(verticesM, grid.directions[d], params.pixelsPerMetre, params.maxSide);
            raster.draw(triangles);
            raster.markVisible(triangles, visible.data() + d * verticesM.size());
        },
        1);
    return visible;
}

/// (D, V) to (V, D), in blocks that stay in the cache.
std::vector<std::uint8_t> transposed(const std::vector<std::uint8_t>& source, std::size_t vertices,
                                     std::size_t directions) {
    std::vector<std::uint8_t> result(source.size());
    constexpr std::size_t kBlock = 64;
    parallelFor((vertices + kBlock - 1) / kBlock,
                [&](std::size_t block) {
                    const std::size_t first = block * kBlock, last = std::min(vertices, first + kBlock);
                    for (std::size_t d = 0; d < directions; ++d) {
                        for (std::size_t v = first; v < last; ++v)
                            result[v * directions + d] = source[d * vertices + v];
                    }
                },
                1);
    return result;
}

/// For each vertex the first of those at exactly its place: texture seams split vertices, not the surface.
std::vector<std::uint32_t> firstAtPlace(std::span<const glm::vec3> verticesM) {
    const auto before = [&](std::uint32_t a, std::uint32_t b) {
        const glm::vec3 p = verticesM[a], q = verticesM[b];
        if (p.x != q.x) return p.x < q.x;
        if (p.y != q.y) return p.y < q.y;
        if (p.z != q.z) return p.z < q.z;
        return a < b;
    };
    std::vector<std::uint32_t> order(verticesM.size()), first(verticesM.size());
    std::iota(order.begin(), order.end(), 0u);
    std::sort(order.begin(), order.end(), before);
    for (std::size_t i = 0; i < order.size(); ++i) {
        const bool same = i > 0 && verticesM[order[i]] == verticesM[order[i - 1]];
        first[order[i]] = same ? first[order[i - 1]] : order[i];
    }
    return first;
}

/// Vertices joined to each vertex by an edge: others of vertex v are list[begin[v] .. begin[v + 1]), ascending.
struct Adjacency {
    std::vector<std::size_t> begin;
    std::vector<std::uint32_t> list;
};

Adjacency adjacencyOf(std::size_t vertices, std::span<const glm::uvec3> triangles) {
    std::vector<std::pair<std::uint32_t, std::uint32_t>> edges;
    edges.reserve(triangles.size() * 6);
    for (const glm::uvec3& t : triangles) {
        for (int corner = 0; corner < 3; ++corner) {
            const std::uint32_t a = t[corner], b = t[(corner + 1) % 3];
            if (a == b) continue;
            edges.emplace_back(a, b);
            edges.emplace_back(b, a);
        }
    }
    std::sort(edges.begin(), edges.end());
    edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
    Adjacency result;
    result.begin.assign(vertices + 1, 0);
    for (const auto& edge : edges) ++result.begin[edge.first + 1];
    for (std::size_t v = 0; v < vertices; ++v) result.begin[v + 1] += result.begin[v];
    result.list.reserve(edges.size());
    for (const auto& edge : edges) result.list.push_back(edge.second);
    return result;
}

/// Up to `size` vertices breadth first from each vertex, itself first; padded with kNothing. (V, size).
std::vector<std::uint32_t> neighbourhoods(const Adjacency& adjacency, std::size_t vertices, std::size_t size) {
    std::vector<std::uint32_t> result(vertices * size, kNothing);
    parallelRanges(vertices, 2048, [&](std::size_t begin, std::size_t end) {
        std::vector<std::uint32_t> seenBy(vertices, kNothing);
        for (std::size_t v = begin; v < end; ++v) {
            std::uint32_t* found = result.data() + v * size;
            found[0] = static_cast<std::uint32_t>(v);
            seenBy[v] = static_cast<std::uint32_t>(v);
            std::size_t count = 1;
            for (std::size_t next = 0; next < count && count < size; ++next) {
                const std::uint32_t from = found[next];
                for (std::size_t e = adjacency.begin[from]; e < adjacency.begin[from + 1] && count < size; ++e) {
                    const std::uint32_t other = adjacency.list[e];
                    if (seenBy[other] == v) continue;
                    seenBy[other] = static_cast<std::uint32_t>(v);
                    found[count++] = other;
                }
            }
        }
    });
    return result;
}

enum class Smoothing { Median, Mean };

/// One pass over (V, D) bytes that are 0 or 255 before it, and after it too where the median is taken.
std::vector<std::uint8_t> smoothed(const std::vector<std::uint8_t>& source, std::span<const std::uint32_t> neighbours,
                                   std::size_t size, std::size_t directions, Smoothing smoothing) {
    std::vector<std::uint8_t> result(source.size());
    const std::size_t vertices = source.size() / directions;
    parallelRanges(vertices, 256, [&](std::size_t begin, std::size_t end) {
        std::vector<std::uint8_t> sums(directions);
        for (std::size_t v = begin; v < end; ++v) {
            std::fill(sums.begin(), sums.end(), std::uint8_t{0});
            unsigned count = 0;
            for (; count < size && neighbours[v * size + count] != kNothing; ++count) {
                const std::uint8_t* row = source.data() + neighbours[v * size + count] * directions;
                for (std::size_t d = 0; d < directions; ++d)
                    sums[d] = static_cast<std::uint8_t>(sums[d] + (row[d] & 1));
            }
            std::array<std::uint8_t, 256> value{}; // by how many of the neighbourhood see the direction
            for (unsigned seen = 0; seen <= count; ++seen) {
                // Of an even count the lower of the middle two, as the original's median.
                value[seen] = static_cast<std::uint8_t>(
                    smoothing == Smoothing::Median ? (2 * seen > count ? 255 : 0) : (255 * seen + count / 2) / count);
            }
            std::uint8_t* out = result.data() + v * directions;
            for (std::size_t d = 0; d < directions; ++d) out[d] = value[sums[d]];
        }
    });
    return result;
}

std::vector<glm::vec3> areaWeightedNormals(std::span<const glm::vec3> verticesM,
                                           std::span<const glm::uvec3> triangles) {
    std::vector<glm::vec3> normals(verticesM.size(), glm::vec3(0.0f));
    for (const glm::uvec3& t : triangles) {
        const glm::vec3 n = glm::cross(verticesM[t.y] - verticesM[t.x], verticesM[t.z] - verticesM[t.x]);
        for (int corner = 0; corner < 3; ++corner) normals[t[corner]] += n;
    }
    return normals;
}

} // namespace

struct RasterisedVisibility::State {
    DirectionGrid grid;
    std::vector<std::uint8_t> visibility; ///< (V, directions)
    std::vector<float> vertexOcclusion;
    Cloud cloud;
    std::unique_ptr<Tree> tree;
    double buildMilliseconds = 0;

    /// Gives every split vertex what the first at its place has.
    void fillSeams(std::span<const std::uint32_t> first) {
        const std::size_t directions = grid.directions.size();
        for (std::size_t v = 0; v < first.size(); ++v) {
            if (first[v] == v) continue;
            std::copy_n(visibility.data() + first[v] * directions, directions, visibility.data() + v * directions);
        }
    }

    /// The vertices of triangles, each place once, in a tree.
    void indexVertices(std::span<const glm::vec3> verticesM, std::span<const glm::uvec3> welded) {
        std::vector<bool> used(verticesM.size(), false);
        for (const glm::uvec3& t : welded) used[t.x] = used[t.y] = used[t.z] = true;
        for (std::size_t v = 0; v < verticesM.size(); ++v) {
            if (!used[v]) continue;
            cloud.pointsM.push_back(verticesM[v]);
            cloud.vertices.push_back(static_cast<std::uint32_t>(v));
        }
        tree = std::make_unique<Tree>(3, cloud, nanoflann::KDTreeSingleIndexAdaptorParams(10));
        tree->buildIndex();
    }

    void computeVertexOcclusion(std::span<const glm::vec3> verticesM, std::span<const glm::uvec3> welded,
                                std::span<const std::uint32_t> first) {
        const std::vector<glm::vec3> normals = areaWeightedNormals(verticesM, welded);
        vertexOcclusion.resize(verticesM.size());
        parallelFor(verticesM.size(), [&](std::size_t v) {
            const std::uint32_t vertex = first[v];
            const float weight = 1.0f;
            vertexOcclusion[v] = hasAnswer(verticesM[v], normals[vertex])
                                     ? occlusionOf(glm::normalize(normals[vertex]), {&vertex, 1}, {&weight, 1})
                                     : 1.0f;
        });
    }

    /// sum_d sum_k weight_k V_k(d) max(n.w_d, 0) dw_d / pi, at most 1: the grid's cosine weights reach a little more.
    float occlusionOf(const glm::vec3& normal, std::span<const std::uint32_t> vertices,
                      std::span<const float> weights) const {
        const std::size_t directions = grid.directions.size();
        double sum = 0;
        for (std::size_t d = 0; d < directions; ++d) {
            const float cosine = glm::dot(normal, grid.directions[d]);
            if (cosine <= 0.0f) continue;
            float seen = 0;
            for (std::size_t k = 0; k < vertices.size(); ++k) {
                seen += weights[k] * static_cast<float>(visibility[vertices[k] * directions + d]);
            }
            sum += static_cast<double>(seen * cosine * grid.solidAnglesSr[d]);
        }
        return std::clamp(static_cast<float>(sum / (255.0 * 3.14159265358979323846)), 0.0f, 1.0f);
    }
};

const ParameterTable<RasterisedVisibilityParams>& rasterisedVisibilityParameters() {
    using P = RasterisedVisibilityParams;
    static const ParameterTable<P> table{
        {"rows", &P::rows, {2, 64}, "", ParameterTier::Advanced, "Latitudes of directions; twice as many longitudes."},
        {"pixels_per_metre",
         &P::pixelsPerMetre,
         {1, 10000},
         "1/m",
         ParameterTier::Advanced,
         "Resolution of the picture of each direction."},
        {"max_side", &P::maxSide, {16, 8192}, "px", ParameterTier::Expert, "Largest side of such a picture."},
        {"neighbourhood",
         &P::neighbourhood,
         {1, 255},
         "",
         ParameterTier::Advanced,
         "Vertices that smoothing looks at, itself among them; 1 smooths nothing."},
    };
    return table;
}

Result<RasterisedVisibility> RasterisedVisibility::build(std::span<const glm::vec3> verticesM,
                                                         std::span<const glm::uvec3> triangles,
                                                         const RasterisedVisibilityParams& params) {
    ARS_TRY_STATUS(checkRanges(rasterisedVisibilityParameters(), params, kPlace));
    ARS_TRY_STATUS(checkOccluderMesh(verticesM, triangles, kPlace));
    const auto start = std::chrono::steady_clock::now();
    auto state = std::make_shared<State>();
    state->grid = latLongDirections(params.rows, 2 * params.rows);
    const std::size_t directions = state->grid.directions.size(), vertices = verticesM.size();
    if (vertices > kMaxBytes / directions) {
        return makeError(ErrorCode::LimitExceeded, kPlace,
                         fmt::format("{} of visibility for {} vertices and {} directions, at most {}",
                                     formatBytes(vertices * directions), vertices, directions, formatBytes(kMaxBytes)));
    }
    const std::vector<std::uint32_t> first = firstAtPlace(verticesM);
    std::vector<glm::uvec3> welded(triangles.begin(), triangles.end());
    for (glm::uvec3& t : welded) t = {first[t.x], first[t.y], first[t.z]};
    state->visibility = transposed(rasteriseAll(verticesM, welded, state->grid, params), vertices, directions);
    if (params.neighbourhood > 1) {
        const auto size = static_cast<std::size_t>(params.neighbourhood);
        const auto neighbours = neighbourhoods(adjacencyOf(vertices, welded), vertices, size);
        for (const Smoothing smoothing : {Smoothing::Median, Smoothing::Median, Smoothing::Mean}) {
            state->visibility = smoothed(state->visibility, neighbours, size, directions, smoothing);
        }
    }
    state->fillSeams(first);
    state->indexVertices(verticesM, welded);
    state->computeVertexOcclusion(verticesM, welded, first);
    state->buildMilliseconds =
        std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
    RasterisedVisibility result;
    result.state_ = std::move(state);
    return result;
}

const DirectionGrid& RasterisedVisibility::directions() const { return state_->grid; }
std::span<const std::uint8_t> RasterisedVisibility::visibility() const { return state_->visibility; }
std::span<const float> RasterisedVisibility::vertexOcclusion() const { return state_->vertexOcclusion; }
double RasterisedVisibility::buildMilliseconds() const { return state_->buildMilliseconds; }

Status RasterisedVisibility::atPoints(const OcclusionQuery& points, std::span<float> occlusion) const {
    ARS_TRY_STATUS(checkOcclusionQuery(points, occlusion.size(), kPlace));
    parallelFor(occlusion.size(), [&](std::size_t i) {
        occlusion[i] = 1.0f;
        if (!hasAnswer(points.pointsM[i], points.normals[i])) return;
        std::array<std::uint32_t, kNearest> nearest{};
        std::array<float, kNearest> squared{}, weights{};
        std::array<std::uint32_t, kNearest> vertices{};
        const glm::vec3 p = points.pointsM[i];
        const std::size_t found = state_->tree->knnSearch(&p.x, kNearest, nearest.data(), squared.data());
        float sum = 0;
        for (std::size_t k = 0; k < found; ++k) {
            vertices[k] = state_->cloud.vertices[nearest[k]];
            weights[k] = 1.0f / (std::sqrt(squared[k]) + 1e-8f); // on a vertex: that vertex alone
            sum += weights[k];
        }
        for (std::size_t k = 0; k < found; ++k) weights[k] /= sum;
        occlusion[i] =
            state_->occlusionOf(glm::normalize(points.normals[i]), {vertices.data(), found}, {weights.data(), found});
    });
    return {};
}

} // namespace ars
