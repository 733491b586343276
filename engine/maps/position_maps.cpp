#include "engine/maps/position_maps.h"

#include "engine/core/parallel.h"
#include "engine/maps/position_maps_math.h"

#include <fmt/format.h>
#include <nanoflann.hpp>

#include <algorithm>
#include <cmath>

namespace ars {
namespace {

constexpr std::size_t kFirstFingerJoint = 25;

struct VertexCloud {
    std::span<const glm::vec3> points;
    std::size_t kdtree_get_point_count() const { return points.size(); }
    float kdtree_get_pt(std::size_t i, std::size_t axis) const { return points[i][static_cast<int>(axis)]; }
    template <typename Box>
    bool kdtree_get_bbox(Box&) const {
        return false;
    }
};

using VertexTree = nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<float, VertexCloud>, VertexCloud, 3,
                                                       std::uint32_t>;

Error wrongCount(std::string_view what, std::size_t found, std::size_t expected) {
    return makeError(ErrorCode::InvalidArgument, "maps",
                     fmt::format("{} numbers of {}, expected {}", found, what, expected));
}

Status checkFinite(std::span<const glm::vec3> points, std::string_view what) {
    for (std::size_t i = 0; i < points.size(); ++i) {
        if (std::isfinite(points[i].x) && std::isfinite(points[i].y) && std::isfinite(points[i].z)) continue;
        return makeError(ErrorCode::InvalidArgument, "maps",
                         fmt::format("{} {} holds a number that is not finite", what, i));
    }
    return {};
}

} // namespace

Pose mapPose(const Pose& pose) {
    Pose result = pose;
    result.translation = glm::vec3(0.0f);
    result.expression.clear();
    const glm::quat rest(1.0f, 0.0f, 0.0f, 0.0f);
    for (std::size_t j = 0; j < result.rotations.size(); ++j) {
        if (j == 0 || j >= kFirstFingerJoint) result.rotations[j] = rest;
    }
    return result;
}

Result<std::vector<glm::mat4>> mapMatrices(const Skeleton& skeleton, const CanonicalMaps& maps, const Pose& pose) {
    const std::vector<glm::mat4> posed = skinningMatrices(skeleton, mapPose(pose));
    if (posed.size() != maps.canonical.size()) {
        return makeError(ErrorCode::InvalidArgument, "maps",
                         fmt::format("a skeleton of {} joints, the maps' has {}", posed.size(), maps.canonical.size()));
    }
    std::vector<glm::mat4> matrices;
    for (std::size_t j = 0; j < posed.size(); ++j) {
        matrices.emplace_back(glm::dmat4(posed[j]) * glm::inverse(glm::dmat4(maps.canonical[j])));
    }
    return matrices;
}

Result<std::vector<glm::vec3>> posedMapPoints(const Skeleton& skeleton, const CanonicalMaps& maps, const Pose& pose) {
    ARS_TRY(const std::vector<glm::mat4> matrices, mapMatrices(skeleton, maps, pose));
    std::vector<glm::vec3> points(maps.pointCount());
    ARS_TRY_STATUS(skinPoints(matrices, maps.weights, maps.positions, points));
    return points;
}

Status deformationPriors(const CanonicalMaps& maps, std::span<const glm::vec3> posedPoints,
                         std::span<const glm::vec3> bodyVertices, std::span<float> priors) {
    const std::size_t count = maps.pointCount();
    if (posedPoints.size() != count) return wrongCount("posed points", posedPoints.size(), count);
    if (priors.size() != count * kPriorWidth) return wrongCount("priors", priors.size(), count * kPriorWidth);
    ARS_TRY_STATUS(checkFinite(posedPoints, "posed point"));
    ARS_TRY_STATUS(checkFinite(bodyVertices, "body vertex"));
    const VertexCloud cloud{bodyVertices};
    const VertexTree tree(3, cloud, nanoflann::KDTreeSingleIndexAdaptorParams(8));
    parallelFor(count, [&](std::size_t i) {
        float distance2 = 0.0f;
        std::uint32_t nearest = 0;
        if (!bodyVertices.empty()) tree.knnSearch(&posedPoints[i].x, 1, &nearest, &distance2);
        deformationPrior(maps.positions[i], posedPoints[i], std::sqrt(distance2), kMinPriorDistanceM,
                         &priors[i * kPriorWidth]);
    });
    return {};
}

std::vector<glm::vec3> mapBodyVertices(const BodyModel& body, const BodyShape& shape, const Pose& pose) {
    return posedVertices(body, shape, mapPose(pose));
}

Status spreadPicture(const CanonicalMaps& maps, std::span<const float> values, ImageView<float> picture) {
    const auto channels = static_cast<std::size_t>(picture.channels);
    if (picture.width != 2 * maps.size || picture.height != maps.size || picture.channels < 1) {
        return makeError(ErrorCode::InvalidArgument, "maps",
                         fmt::format("a picture of {}x{} pixels, expected {}x{}", picture.width, picture.height,
                                     2 * maps.size, maps.size));
    }
    if (values.size() != maps.pointCount() * channels) {
        return wrongCount("values", values.size(), maps.pointCount() * channels);
    }
    std::fill_n(picture.data, picture.valueCount(), 0.0f);
    parallelFor(maps.pointCount(),
                [&](std::size_t i) { std::copy_n(&values[i * channels], channels, picture.pixel(maps.pixels[i])); });
    return {};
}

Status spreadPlanes(const CanonicalMaps& maps, std::span<const float> values, int channels, std::span<float> planes) {
    const auto width = static_cast<std::size_t>(std::max(channels, 0));
    if (channels < 1 || values.size() != maps.pointCount() * width) {
        return wrongCount("values", values.size(), maps.pointCount() * width);
    }
    if (planes.size() != maps.pixelCount() * width)
        return wrongCount("planes", planes.size(), maps.pixelCount() * width);
    std::fill(planes.begin(), planes.end(), 0.0f);
    parallelFor(maps.pointCount(), [&](std::size_t i) {
        for (int c = 0; c < channels; ++c) {
            planes[planeIndex(maps.pixels[i], maps.size, c, channels)] =
                values[i * width + static_cast<std::size_t>(c)];
        }
    });
    return {};
}

Status gatherPlanes(const CanonicalMaps& maps, std::span<const float> planes, int channels, std::span<float> values) {
    const auto width = static_cast<std::size_t>(std::max(channels, 0));
    if (channels < 1 || values.size() != maps.pointCount() * width) {
        return wrongCount("values", values.size(), maps.pointCount() * width);
    }
    if (planes.size() != maps.pixelCount() * width)
        return wrongCount("planes", planes.size(), maps.pixelCount() * width);
    parallelFor(maps.pointCount(), [&](std::size_t i) {
        for (int c = 0; c < channels; ++c) {
            values[i * width + static_cast<std::size_t>(c)] =
                planes[planeIndex(maps.pixels[i], maps.size, c, channels)];
        }
    });
    return {};
}

} // namespace ars
