#include "engine/occlusion/mesh_occlusion.h"

#include "engine/core/parallel.h"
#include "engine/core/parameter_ranges.h"
#include "engine/occlusion/cosine_directions_math.h"

#if __has_include(<embree4/rtcore.h>)
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>

namespace ars {

struct MeshOcclusion::State {
    RTCDevice device = nullptr;
    RTCScene scene = nullptr;
    RTCGeometry geometry = nullptr;
    std::size_t vertexCount = 0;
    std::size_t triangleCount = 0;
    double buildMilliseconds = 0;

    State() = default;
    State(const State&) = delete;
    State& operator=(const State&) = delete;
    ~State() {
        if (geometry) rtcReleaseGeometry(geometry);
        if (scene) rtcReleaseScene(scene);
        if (device) rtcReleaseDevice(device);
    }
};

namespace {

constexpr const char* kPlace = "mesh occlusion";
constexpr unsigned kPacket = 16;

#if RTC_VERSION_MAJOR >= 4
using RayContext = RTCRayQueryContext;
void initContext(RayContext& context) { rtcInitRayQueryContext(&context); }
void occluded(RTCScene scene, const int* valid, RayContext& context, RTCRay16& rays) {
    RTCOccludedArguments arguments;
    rtcInitOccludedArguments(&arguments);
    arguments.context = &context;
    rtcOccluded16(valid, scene, &rays, &arguments);
}
#else
using RayContext = RTCIntersectContext;
void initContext(RayContext& context) { rtcInitIntersectContext(&context); }
void occluded(RTCScene scene, const int* valid, RayContext& context, RTCRay16& rays) {
    rtcOccluded16(valid, scene, &context, &rays);
}
#endif

/// What the hit filter must know of the point whose rays are under way. The context comes first: the filter gets only
/// its address.
struct PointContext {
    RayContext base;
    glm::vec3 normal{0.0f};
    float offsetM = 0; ///< height of the rays' origin over the point
    float sinkM = -1;  ///< negative: every hit counts
};

/// Rejects hits on the inner side of a triangle that lie less than sinkM over the tangent plane of the point: there the
/// ray only leaves the sheet under which its point lies.
void passOwnSheet(const RTCFilterFunctionNArguments* arguments) {
    // The context was made as PointContext by the loops below, and is its first member.
    const auto& point = *reinterpret_cast<const PointContext*>(arguments->context);
    if (point.sinkM < 0.0f) return;
    const unsigned n = arguments->N;
    for (unsigned i = 0; i < n; ++i) {
        if (arguments->valid[i] == 0) continue;
        const glm::vec3 direction(RTCRayN_dir_x(arguments->ray, n, i), RTCRayN_dir_y(arguments->ray, n, i),
                                  RTCRayN_dir_z(arguments->ray, n, i));
        const glm::vec3 outward(RTCHitN_Ng_x(arguments->hit, n, i), RTCHitN_Ng_y(arguments->hit, n, i),
                                RTCHitN_Ng_z(arguments->hit, n, i));
        const float heightM = point.offsetM + RTCRayN_tfar(arguments->ray, n, i) * glm::dot(direction, point.normal);
        if (glm::dot(direction, outward) > 0.0f && heightM < point.sinkM) arguments->valid[i] = 0;
    }
}

Status embreeStatus(RTCDevice device, std::size_t triangles) {
    const RTCError error = rtcGetDeviceError(device);
    if (error == RTC_ERROR_NONE) return {};
    return makeError(error == RTC_ERROR_OUT_OF_MEMORY ? ErrorCode::OutOfMemory : ErrorCode::Internal, kPlace,
                     fmt::format("Embree error {} for {} triangles", static_cast<int>(error), triangles));
}

double millisecondsSince(std::chrono::steady_clock::time_point start) {
    return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
}

/// The rays about +z, neighbours in direction beside one another, so that a packet stays together in the tree.
std::vector<glm::vec3> coherentDirections(int count) {
    const auto n = static_cast<std::uint32_t>(count);
    std::vector<glm::vec3> directions(n);
    for (std::uint32_t i = 0; i < n; ++i) directions[i] = cosineDirection<float>(i, n);
    const auto place = [](const glm::vec3& d) { // Morton order of an 8x8 grid over the disk
        const auto x = static_cast<unsigned>(std::clamp((d.x + 1.0f) * 4.0f, 0.0f, 7.0f));
        const auto y = static_cast<unsigned>(std::clamp((d.y + 1.0f) * 4.0f, 0.0f, 7.0f));
        unsigned code = 0;
        for (unsigned bit = 0; bit < 3; ++bit) {
            code |= ((x >> bit & 1u) << (2 * bit)) | ((y >> bit & 1u) << (2 * bit + 1));
        }
        return code;
    };
    std::stable_sort(directions.begin(), directions.end(),
                     [&](const glm::vec3& a, const glm::vec3& b) { return place(a) < place(b); });
    return directions;
}

/// An angle that looks random from one point to the next and depends on nothing but the index.
float turnOfPoint(std::size_t index) {
    std::uint32_t h = static_cast<std::uint32_t>(index) * 747796405u + 2891336453u; // PCG output hash
    h = ((h >> ((h >> 28) + 4u)) ^ h) * 277803737u;
    h = (h >> 22) ^ h;
    return static_cast<float>(h >> 8) * (6.2831853f / 16777216.0f);
}

void setRay(RTCRay16& rays, std::size_t k, const glm::vec3& originM, const glm::vec3& direction, float nearM,
            float farM) {
    rays.org_x[k] = originM.x;
    rays.org_y[k] = originM.y;
    rays.org_z[k] = originM.z;
    rays.dir_x[k] = direction.x;
    rays.dir_y[k] = direction.y;
    rays.dir_z[k] = direction.z;
    rays.tnear[k] = nearM;
    rays.tfar[k] = farM;
    rays.time[k] = 0.0f;
    rays.mask[k] = ~0u;
    rays.id[k] = static_cast<unsigned>(k);
    rays.flags[k] = 0;
}

/// One point: how many of the rays hit something.
std::size_t countBlocked(RTCScene scene, std::span<const glm::vec3> directions, const glm::vec3& originM,
                         const glm::vec3& normal, float turn, float reachM, PointContext& context) {
    glm::vec3 t, b;
    tangentFrame(normal, t, b);
    const float c = std::cos(turn), s = std::sin(turn);
    const glm::mat3 frame(c * t + s * b, c * b - s * t, normal);
    alignas(64) RTCRay16 rays;
    alignas(64) int valid[kPacket];
    std::size_t blocked = 0;
    for (std::size_t first = 0; first < directions.size(); first += kPacket) {
        for (unsigned k = 0; k < kPacket; ++k) {
            const bool used = first + k < directions.size();
            valid[k] = used ? -1 : 0;
            setRay(rays, k, originM, frame * directions[used ? first + k : first], 0.0f, reachM);
        }
        occluded(scene, valid, context.base, rays);
        // Embree sets the far end of a blocked ray to -infinity.
        for (unsigned k = 0; k < kPacket; ++k) blocked += valid[k] != 0 && rays.tfar[k] < 0.0f;
    }
    return blocked;
}

} // namespace

const ParameterTable<MeshOcclusionParams>& meshOcclusionParameters() {
    static const ParameterTable<MeshOcclusionParams> table{
        {"rays", &MeshOcclusionParams::rays, {1, 65536}, "", ParameterTier::Basic, "Rays a point."},
        {"offset",
         &MeshOcclusionParams::offsetM,
         {0, 1},
         "m",
         ParameterTier::Advanced,
         "Distance along the normal at which a ray starts."},
        {"sink",
         &MeshOcclusionParams::sinkM,
         {0, 1},
         "m",
         ParameterTier::Expert,
         "How deep a surfel may lie under the mesh and still see out."},
    };
    return table;
}

MeshOcclusion::MeshOcclusion() : state_(std::make_unique<State>()) {}
MeshOcclusion::MeshOcclusion(MeshOcclusion&&) noexcept = default;
MeshOcclusion& MeshOcclusion::operator=(MeshOcclusion&&) noexcept = default;
MeshOcclusion::~MeshOcclusion() = default;

Result<MeshOcclusion> MeshOcclusion::build(std::span<const glm::vec3> verticesM,
                                           std::span<const glm::uvec3> triangles) {
    ARS_TRY_STATUS(checkOccluderMesh(verticesM, triangles, kPlace));
    const auto start = std::chrono::steady_clock::now();
    MeshOcclusion mesh;
    State& state = *mesh.state_;
    // One thread: the tree of a body takes milliseconds, and the cores belong to the program's own pool.
    state.device = rtcNewDevice("threads=1");
    if (!state.device) return makeError(ErrorCode::Unavailable, kPlace, "Embree could not be started");
    state.scene = rtcNewScene(state.device);
    // Robust: a ray must not slip through the edge between two triangles.
    rtcSetSceneFlags(state.scene, static_cast<RTCSceneFlags>(RTC_SCENE_FLAG_ROBUST | RTC_SCENE_FLAG_DYNAMIC));
    state.geometry = rtcNewGeometry(state.device, RTC_GEOMETRY_TYPE_TRIANGLE);
    // Set before the first build: a later change of quality would rebuild instead of refit.
    rtcSetGeometryBuildQuality(state.geometry, RTC_BUILD_QUALITY_REFIT);
    rtcSetGeometryOccludedFilterFunction(state.geometry, passOwnSheet);
    void* vertices = rtcSetNewGeometryBuffer(state.geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                             sizeof(glm::vec3), verticesM.size());
    void* indices = rtcSetNewGeometryBuffer(state.geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                            sizeof(glm::uvec3), triangles.size());
    if (vertices && indices) {
        std::memcpy(vertices, verticesM.data(), verticesM.size_bytes());
        std::memcpy(indices, triangles.data(), triangles.size_bytes());
        rtcCommitGeometry(state.geometry);
        rtcAttachGeometry(state.scene, state.geometry);
        rtcCommitScene(state.scene);
    }
    ARS_TRY_STATUS(embreeStatus(state.device, triangles.size()));
    state.vertexCount = verticesM.size();
    state.triangleCount = triangles.size();
    state.buildMilliseconds = millisecondsSince(start);
    return mesh;
}

Status MeshOcclusion::update(std::span<const glm::vec3> verticesM) {
    State& state = *state_;
    if (verticesM.size() != state.vertexCount) {
        return makeError(ErrorCode::InvalidArgument, kPlace,
                         fmt::format("{} vertices, the mesh was built with {}", verticesM.size(), state.vertexCount));
    }
    const glm::uvec3 anyTriangle(0u); // the triangles are the old ones: only the vertices are looked at
    ARS_TRY_STATUS(checkOccluderMesh(verticesM, {&anyTriangle, 1}, kPlace));
    const auto start = std::chrono::steady_clock::now();
    std::memcpy(rtcGetGeometryBufferData(state.geometry, RTC_BUFFER_TYPE_VERTEX, 0), verticesM.data(),
                verticesM.size_bytes());
    rtcUpdateGeometryBuffer(state.geometry, RTC_BUFFER_TYPE_VERTEX, 0);
    rtcCommitGeometry(state.geometry);
    rtcCommitScene(state.scene);
    ARS_TRY_STATUS(embreeStatus(state.device, state.triangleCount));
    state.buildMilliseconds = millisecondsSince(start);
    return {};
}

std::size_t MeshOcclusion::vertexCount() const { return state_->vertexCount; }
std::size_t MeshOcclusion::triangleCount() const { return state_->triangleCount; }
double MeshOcclusion::buildMilliseconds() const { return state_->buildMilliseconds; }

Status MeshOcclusion::atPoints(const MeshOcclusionParams& params, const OcclusionQuery& points,
                               std::span<float> occlusion) const {
    ARS_TRY_STATUS(checkRanges(meshOcclusionParameters(), params, kPlace));
    ARS_TRY_STATUS(checkOcclusionQuery(points, occlusion.size(), kPlace));
    const std::vector<glm::vec3> directions = coherentDirections(params.rays);
    parallelRanges(occlusion.size(), 64, [&](std::size_t begin, std::size_t end) {
        PointContext context;
        initContext(context.base);
        context.offsetM = params.offsetM;
        context.sinkM = params.sinkM;
        for (std::size_t i = begin; i < end; ++i) {
            const float reachM = points.radiiM.empty() ? INFINITY : points.radiiM[i];
            occlusion[i] = 1.0f;
            if (!hasAnswer(points.pointsM[i], points.normals[i]) || !(reachM > 0.0f)) continue;
            context.normal = glm::normalize(points.normals[i]);
            const glm::vec3 originM = points.pointsM[i] + params.offsetM * context.normal;
            const std::size_t blocked =
                countBlocked(state_->scene, directions, originM, context.normal, turnOfPoint(i), reachM, context);
            occlusion[i] = 1.0f - static_cast<float>(blocked) / static_cast<float>(directions.size());
        }
    });
    return {};
}

Status MeshOcclusion::atPixels(const MeshOcclusionParams& params, const Camera& camera,
                               ImageView<const float> positionM, ImageView<const float> normalView,
                               ImageView<const float> radiusM, ImageView<const float> opacity,
                               ImageView<float> occlusion) const {
    ARS_TRY(const PixelPoints pixels, collectPixelPoints(camera, positionM, normalView, radiusM, opacity));
    std::vector<float> values(pixels.pixels.size());
    ARS_TRY_STATUS(atPoints(params, pixels.points(), values));
    return scatterToPixels(pixels, values, occlusion);
}

Status MeshOcclusion::blockedRays(std::span<const glm::vec3> originsM, std::span<const glm::vec3> directions,
                                  float nearM, float farM, std::span<std::uint8_t> blocked) const {
    if (originsM.size() != directions.size() || blocked.size() != directions.size()) {
        return makeError(ErrorCode::InvalidArgument, kPlace,
                         fmt::format("{} origins and {} places for answers for {} directions", originsM.size(),
                                     blocked.size(), directions.size()));
    }
    if (!(nearM >= 0.0f) || !(farM > nearM)) {
        return makeError(ErrorCode::InvalidArgument, kPlace,
                         fmt::format("rays from {} to {} m, expected 0 <= near < far", nearM, farM));
    }
    const std::size_t packets = (directions.size() + kPacket - 1) / kPacket;
    parallelRanges(packets, 64, [&](std::size_t begin, std::size_t end) {
        PointContext context;
        initContext(context.base);
        alignas(64) RTCRay16 rays;
        alignas(64) int valid[kPacket];
        for (std::size_t packet = begin; packet < end; ++packet) {
            const std::size_t first = packet * kPacket;
            const std::size_t used = std::min<std::size_t>(kPacket, directions.size() - first);
            for (std::size_t k = 0; k < kPacket; ++k) {
                const glm::vec3 o = originsM[first + (k < used ? k : 0)], d = directions[first + (k < used ? k : 0)];
                valid[k] = k < used && hasAnswer(o, d) ? -1 : 0;
                setRay(rays, k, o, d, nearM, farM);
            }
            occluded(state_->scene, valid, context.base, rays);
            for (std::size_t k = 0; k < used; ++k) blocked[first + k] = valid[k] != 0 && rays.tfar[k] < 0.0f;
        }
    });
    return {};
}

} // namespace ars
