#include "engine/surfel/knn.h"

#include "engine/core/parallel.h"

#include <fmt/format.h>
#include <nanoflann.hpp>

#include <algorithm>
#include <cmath>
#include <numeric>

namespace ars {
namespace {

/// nanoflann's view of a span of points.
struct PointCloud {
    std::span<const glm::vec3> points;
    std::size_t kdtree_get_point_count() const { return points.size(); }
    float kdtree_get_pt(std::size_t i, std::size_t axis) const { return points[i][static_cast<int>(axis)]; }
    template <typename Box>
    bool kdtree_get_bbox(Box&) const {
        return false;
    }
};

using Tree =
    nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<float, PointCloud>, PointCloud, 3, std::uint32_t>;

constexpr std::size_t kGrain = 512;
constexpr int kMaxNeighbors = 64;

/// Row i of `indices` and `squares` (N, k): the k nearest others of each point.
Status findNeighbors(std::span<const glm::vec3> points, int neighbors, std::vector<std::uint32_t>& indices,
                     std::vector<float>& squares) {
    if (neighbors < 1 || neighbors > kMaxNeighbors) {
        return makeError(ErrorCode::InvalidArgument, "nearest neighbours",
                         fmt::format("{} neighbours, expected 1 to {}", neighbors, kMaxNeighbors));
    }
    for (std::size_t i = 0; i < points.size(); ++i) {
        const glm::vec3& p = points[i];
        if (std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z)) continue;
        return makeError(ErrorCode::InvalidArgument, "nearest neighbours",
                         fmt::format("point {} holds a number that is not finite", i));
    }
    const auto k = static_cast<std::size_t>(neighbors);
    indices.assign(points.size() * k, 0);
    squares.assign(points.size() * k, 0.0f);
    if (points.empty()) return {};
    const PointCloud cloud{points};
    const Tree tree(3, cloud, nanoflann::KDTreeSingleIndexAdaptorParams(8));
    parallelRanges(points.size(), kGrain, [&](std::size_t begin, std::size_t end) {
        // The point finds itself as well, though among equals not always first.
        std::vector<std::pair<float, std::uint32_t>> found;
        std::vector<std::uint32_t> foundIndices(k + 1);
        std::vector<float> foundSquares(k + 1);
        for (std::size_t i = begin; i < end; ++i) {
            const std::size_t count = tree.knnSearch(&points[i].x, k + 1, foundIndices.data(), foundSquares.data());
            found.clear();
            for (std::size_t n = 0; n < count; ++n) {
                if (foundIndices[n] != i) found.emplace_back(foundSquares[n], foundIndices[n]);
            }
            std::sort(found.begin(), found.end());
            for (std::size_t n = 0; n < k; ++n) {
                const bool there = n < found.size();
                indices[i * k + n] = there ? found[n].second : static_cast<std::uint32_t>(i);
                squares[i * k + n] = there ? found[n].first : -1.0f;
            }
        }
    });
    return {};
}

} // namespace

Result<std::vector<float>> neighborDistances(std::span<const glm::vec3> points, int neighbors) {
    std::vector<std::uint32_t> indices;
    std::vector<float> squares;
    ARS_TRY_STATUS(findNeighbors(points, neighbors, indices, squares));
    const auto k = static_cast<std::size_t>(neighbors);
    std::vector<float> distances(points.size());
    parallelFor(points.size(), [&](std::size_t i) {
        float sum = 0.0f;
        int count = 0;
        for (std::size_t n = 0; n < k; ++n) {
            if (squares[i * k + n] < 0.0f) continue;
            sum += squares[i * k + n];
            ++count;
        }
        const float distance = count > 0 ? std::sqrt(sum / static_cast<float>(count)) : 0.0f;
        distances[i] = std::max(distance, kMinNeighborDistanceM);
    });
    return distances;
}

Result<std::vector<std::uint32_t>> nearestNeighbors(std::span<const glm::vec3> points, int neighbors) {
    std::vector<std::uint32_t> indices;
    std::vector<float> squares;
    ARS_TRY_STATUS(findNeighbors(points, neighbors, indices, squares));
    return indices;
}

} // namespace ars
