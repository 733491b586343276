#include "engine/occlusion/surface_points.h"

#include "engine/surfel/gbuffer.h"

#include <cmath>

namespace ars {
namespace {

/// Coordinates beyond this are no body; sums and products of smaller ones stay finite in float.
constexpr float kFarthestM = 1e6f;

bool finite(const glm::vec3& v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }

Status checkPicture(std::string_view name, ImageView<const float> picture, int width, int height, int channels) {
    if (picture.data && picture.width == width && picture.height == height && picture.channels == channels) return {};
    return makeError(ErrorCode::InvalidArgument, "occlusion",
                     fmt::format("the {} picture is {}x{} with {} channels, expected {}x{} with {}", name,
                                 picture.width, picture.height, picture.data ? picture.channels : 0, width, height,
                                 channels));
}

} // namespace

bool hasAnswer(const glm::vec3& pointM, const glm::vec3& normal) {
    const float length = glm::length(normal);
    return finite(pointM) && std::isfinite(length) && length > 0.0f;
}

Status checkOcclusionQuery(const OcclusionQuery& points, std::size_t answers, std::string_view place) {
    const std::size_t count = points.pointsM.size();
    const auto differs = [&](const char* name, std::size_t found) {
        return makeError(ErrorCode::InvalidArgument, std::string(place),
                         fmt::format("{} {} for {} points", found, name, count));
    };
    if (points.normals.size() != count) return differs("normals", points.normals.size());
    if (!points.radiiM.empty() && points.radiiM.size() != count) return differs("radii", points.radiiM.size());
    if (answers != count) return differs("places for answers", answers);
    return {};
}

Result<PixelPoints> collectPixelPoints(const Camera& camera, ImageView<const float> positionM,
                                       ImageView<const float> normalView, ImageView<const float> radiusM,
                                       ImageView<const float> opacity) {
    ARS_TRY_STATUS(validateCamera(camera, "occlusion: camera"));
    ARS_TRY_STATUS(checkPicture("position", positionM, camera.width, camera.height, 3));
    ARS_TRY_STATUS(checkPicture("normal", normalView, camera.width, camera.height, 3));
    ARS_TRY_STATUS(checkPicture("opacity", opacity, camera.width, camera.height, 1));
    if (!radiusM.empty()) ARS_TRY_STATUS(checkPicture("radius", radiusM, camera.width, camera.height, 1));

    const glm::mat3 toWorld(glm::transpose(camera.rotation));
    PixelPoints result;
    result.width = camera.width;
    result.height = camera.height;
    for (std::size_t p = 0; p < opacity.pixelCount(); ++p) {
        if (!(opacity[p] >= kMinOpacity)) continue;
        const float* x = positionM.pixel(p);
        const float* n = normalView.pixel(p);
        const glm::vec3 point(x[0], x[1], x[2]), normal(n[0], n[1], n[2]);
        if (!hasAnswer(point, normal)) continue;
        result.pixels.push_back(p);
        result.pointsM.push_back(point);
        result.normals.push_back(toWorld * glm::normalize(normal));
        if (!radiusM.empty()) result.radiiM.push_back(radiusM[p]);
    }
    return result;
}

Status scatterToPixels(const PixelPoints& points, std::span<const float> values, ImageView<float> picture) {
    if (values.size() != points.pixels.size()) {
        return makeError(ErrorCode::InvalidArgument, "occlusion",
                         fmt::format("{} values for {} points", values.size(), points.pixels.size()));
    }
    ARS_TRY_STATUS(checkPicture("occlusion", picture, points.width, points.height, 1));
    for (std::size_t p = 0; p < picture.pixelCount(); ++p) picture[p] = 1.0f;
    for (std::size_t i = 0; i < values.size(); ++i) picture[points.pixels[i]] = values[i];
    return {};
}

Status checkOccluderMesh(std::span<const glm::vec3> verticesM, std::span<const glm::uvec3> triangles,
                         std::string_view place) {
    if (triangles.empty()) {
        return makeError(ErrorCode::InvalidArgument, std::string(place), "the mesh has no triangles");
    }
    for (std::size_t v = 0; v < verticesM.size(); ++v) {
        const glm::vec3 p = verticesM[v];
        // Written so that NaN fails too.
        if (std::abs(p.x) <= kFarthestM && std::abs(p.y) <= kFarthestM && std::abs(p.z) <= kFarthestM) continue;
        return makeError(
            ErrorCode::InvalidArgument, fmt::format("{}: vertex {}", place, v),
            fmt::format("({}, {}, {}), expected finite coordinates within {:g} m", p.x, p.y, p.z, kFarthestM));
    }
    for (std::size_t t = 0; t < triangles.size(); ++t) {
        for (int corner = 0; corner < 3; ++corner) {
            if (triangles[t][corner] < verticesM.size()) continue;
            return makeError(
                ErrorCode::InvalidArgument, fmt::format("{}: triangle {}", place, t),
                fmt::format("vertex {} does not exist, the mesh has {}", triangles[t][corner], verticesM.size()));
        }
    }
    return {};
}

} // namespace ars
