#include "engine/rig/closest_surface.h"

#if __has_include(<embree4/rtcore.h>)
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

#include <cmath>
#include <cstring>
#include <vector>

namespace ars {

struct ClosestSurface::State {
    std::vector<glm::vec3> positions;
    std::vector<glm::uvec3> triangles;
    RTCDevice device = nullptr;
    RTCScene scene = nullptr;

    State() = default;
    State(const State&) = delete;
    State& operator=(const State&) = delete;
    ~State() {
        if (scene) rtcReleaseScene(scene);
        if (device) rtcReleaseDevice(device);
    }
};

namespace {

/// Barycentric coordinates of the point of triangle abc that is closest to p (regions of corners, edges and inside as
/// in C. Ericson, Real-Time Collision Detection, 5.1.5).
glm::vec3 closestBarycentric(const glm::vec3& p, const glm::vec3& a, const glm::vec3& b, const glm::vec3& c) {
    const glm::vec3 ab = b - a, ac = c - a;
    const glm::vec3 ap = p - a, bp = p - b, cp = p - c;
    const float d1 = glm::dot(ab, ap), d2 = glm::dot(ac, ap);
    if (d1 <= 0.0f && d2 <= 0.0f) return {1.0f, 0.0f, 0.0f};
    const float d3 = glm::dot(ab, bp), d4 = glm::dot(ac, bp);
    if (d3 >= 0.0f && d4 <= d3) return {0.0f, 1.0f, 0.0f};
    const float d5 = glm::dot(ab, cp), d6 = glm::dot(ac, cp);
    if (d6 >= 0.0f && d5 <= d6) return {0.0f, 0.0f, 1.0f};

    const float vc = d1 * d4 - d3 * d2;
    if (vc <= 0.0f && d1 >= 0.0f && d3 <= 0.0f) {
        const float t = d1 / (d1 - d3);
        return {1.0f - t, t, 0.0f};
    }
    const float vb = d5 * d2 - d1 * d6;
    if (vb <= 0.0f && d2 >= 0.0f && d6 <= 0.0f) {
        const float t = d2 / (d2 - d6);
        return {1.0f - t, 0.0f, t};
    }
    const float va = d3 * d6 - d5 * d4;
    if (va <= 0.0f && d4 - d3 >= 0.0f && d5 - d6 >= 0.0f) {
        const float t = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return {0.0f, 1.0f - t, t};
    }
    const float sum = va + vb + vc;
    // A triangle without area falls through every edge test only by rounding: any corner is on it.
    if (!(sum > 0.0f)) return {1.0f, 0.0f, 0.0f};
    return {va / sum, vb / sum, vc / sum};
}

struct Query {
    const std::vector<glm::vec3>* positions;
    const std::vector<glm::uvec3>* triangles;
    glm::vec3 point;
    SurfacePoint* closest;
    bool found = false;
};

bool visitTriangle(RTCPointQueryFunctionArguments* arguments) {
    Query& query = *static_cast<Query*>(arguments->userPtr);
    const glm::uvec3 t = (*query.triangles)[arguments->primID];
    const glm::vec3 &a = (*query.positions)[t.x], &b = (*query.positions)[t.y], &c = (*query.positions)[t.z];
    const glm::vec3 barycentric = closestBarycentric(query.point, a, b, c);
    const float distance = glm::distance(query.point, barycentric.x * a + barycentric.y * b + barycentric.z * c);
    if (!(distance <= arguments->query->radius)) return false;
    // Of equally near triangles the first in the file wins, whatever order the tree visits them in.
    const bool tie = query.found && distance == query.closest->distanceM;
    if (tie && arguments->primID > query.closest->triangle) return false;
    *query.closest = {arguments->primID, barycentric, distance};
    query.found = true;
    arguments->query->radius = distance;
    return true;
}

Status buildScene(RTCDevice device, RTCScene scene, std::span<const glm::vec3> positions,
                  std::span<const glm::uvec3> triangles) {
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    void* vertices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, sizeof(glm::vec3),
                                             positions.size());
    void* indices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, sizeof(glm::uvec3),
                                            triangles.size());
    if (vertices && indices) {
        std::memcpy(vertices, positions.data(), positions.size_bytes());
        std::memcpy(indices, triangles.data(), triangles.size_bytes());
        rtcCommitGeometry(geometry);
        rtcAttachGeometry(scene, geometry);
        rtcCommitScene(scene);
    }
    rtcReleaseGeometry(geometry);
    if (const RTCError error = rtcGetDeviceError(device); error != RTC_ERROR_NONE || !vertices || !indices) {
        return makeError(error == RTC_ERROR_OUT_OF_MEMORY ? ErrorCode::OutOfMemory : ErrorCode::Internal,
                         "surface tree",
                         fmt::format("Embree error {} for {} triangles", static_cast<int>(error), triangles.size()));
    }
    return {};
}

} // namespace

Result<ClosestSurface> ClosestSurface::build(std::span<const glm::vec3> positions,
                                             std::span<const glm::uvec3> triangles) {
    if (triangles.empty()) return makeError(ErrorCode::InvalidArgument, "surface", "the mesh has no triangles");
    for (std::size_t t = 0; t < triangles.size(); ++t) {
        for (int corner = 0; corner < 3; ++corner) {
            const std::uint32_t vertex = triangles[t][corner];
            if (vertex >= positions.size()) {
                return makeError(ErrorCode::InvalidArgument, fmt::format("surface: triangle {}", t),
                                 fmt::format("vertex {} does not exist, the mesh has {}", vertex, positions.size()));
            }
        }
    }
    auto state = std::make_shared<State>();
    state->positions.assign(positions.begin(), positions.end());
    state->triangles.assign(triangles.begin(), triangles.end());
    // One thread: the tree of a body takes milliseconds, and the cores belong to the program's own pool.
    state->device = rtcNewDevice("threads=1");
    if (!state->device) return makeError(ErrorCode::Unavailable, "surface tree", "Embree could not be started");
    state->scene = rtcNewScene(state->device);
    ARS_TRY_STATUS(buildScene(state->device, state->scene, positions, triangles));
    ClosestSurface surface;
    surface.state_ = std::move(state);
    return surface;
}

bool ClosestSurface::find(const glm::vec3& pointM, float radiusM, SurfacePoint& closest) const {
    Query query{&state_->positions, &state_->triangles, pointM, &closest};
    RTCPointQuery point{};
    point.x = pointM.x;
    point.y = pointM.y;
    point.z = pointM.z;
    point.time = 0.0f;
    point.radius = radiusM;
    RTCPointQueryContext context;
    rtcInitPointQueryContext(&context);
    rtcPointQuery(state_->scene, &point, &context, visitTriangle, &query);
    return query.found;
}

} // namespace ars
