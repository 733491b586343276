#include "engine/maps/canonical_maps.h"

#include "engine/core/parallel.h"
#include "engine/maps/surface_attributes.h"
#include "engine/rig/pose.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace ars {
namespace {

constexpr std::uint32_t kNoTriangle = std::numeric_limits<std::uint32_t>::max();

/// A vertex in the maps: x to the right and y down in pixels, z towards the viewer in metres.
struct MapVertex {
    double x, y, z;
};

/// Twice the signed area of (a, b, p). Both triangles at an edge must get exactly opposite numbers, or their common
/// edge would leak: the edge is always taken from its lower vertex.
double edgeArea(const std::vector<MapVertex>& vertices, std::uint32_t a, std::uint32_t b, double px, double py) {
    const bool swapped = a > b;
    const MapVertex& from = vertices[swapped ? b : a];
    const MapVertex& to = vertices[swapped ? a : b];
    const double area = (to.x - from.x) * (py - from.y) - (to.y - from.y) * (px - from.x);
    return swapped ? -area : area;
}

/// Where a pixel centre lies in a triangle; false outside and for triangles seen edge-on.
bool pixelShares(const std::vector<MapVertex>& vertices, const glm::uvec3& t, double px, double py,
                 glm::dvec3& shares) {
    const double a = edgeArea(vertices, t.y, t.z, px, py);
    const double b = edgeArea(vertices, t.z, t.x, px, py);
    const double c = edgeArea(vertices, t.x, t.y, px, py);
    const bool inside = (a >= 0.0 && b >= 0.0 && c >= 0.0) || (a <= 0.0 && b <= 0.0 && c <= 0.0);
    const double sum = a + b + c;
    if (!inside || sum == 0.0) return false;
    shares = glm::dvec3(a, b, c) / sum;
    return true;
}

/// The z-buffer of both maps: nearest and farthest triangle of every pixel.
struct SurfaceBuffer {
    explicit SurfaceBuffer(std::size_t pixels)
        : front(pixels, kNoTriangle), back(pixels, kNoTriangle), frontZ(pixels, -std::numeric_limits<double>::max()),
          backZ(pixels, std::numeric_limits<double>::max()) {}

    std::vector<std::uint32_t> front, back;
    std::vector<double> frontZ, backZ;
};

/// First and last of pixels [begin, end) whose centre, at +0.5, lies at or beyond `low` and at or before `high`.
/// Clamped before they become integers.
int firstCentre(double low, int begin, int end) {
    return static_cast<int>(std::ceil(std::clamp<double>(low - 0.5, begin, end)));
}
int lastCentre(double high, int begin, int end) {
    return static_cast<int>(std::floor(std::clamp<double>(high - 0.5, begin - 1, end - 1)));
}

/// Rows [begin, end) of both maps. Of surfaces at the same depth the triangle with the lower index stays.
void rasteriseRows(const std::vector<MapVertex>& vertices, const std::vector<glm::uvec3>& triangles, int size,
                   int begin, int end, SurfaceBuffer& buffer) {
    for (std::size_t index = 0; index < triangles.size(); ++index) {
        const glm::uvec3& t = triangles[index];
        const MapVertex &a = vertices[t.x], &b = vertices[t.y], &c = vertices[t.z];
        const int row0 = firstCentre(std::min({a.y, b.y, c.y}), begin, end);
        const int row1 = lastCentre(std::max({a.y, b.y, c.y}), begin, end);
        if (row0 > row1) continue;
        const int column0 = firstCentre(std::min({a.x, b.x, c.x}), 0, size);
        const int column1 = lastCentre(std::max({a.x, b.x, c.x}), 0, size);
        for (int row = row0; row <= row1; ++row) {
            for (int column = column0; column <= column1; ++column) {
                glm::dvec3 shares;
                if (!pixelShares(vertices, t, column + 0.5, row + 0.5, shares)) continue;
                const double z = shares.x * a.z + shares.y * b.z + shares.z * c.z;
                const std::size_t p =
                    static_cast<std::size_t>(row) * static_cast<std::size_t>(size) + static_cast<std::size_t>(column);
                if (z > buffer.frontZ[p]) {
                    buffer.frontZ[p] = z;
                    buffer.front[p] = static_cast<std::uint32_t>(index);
                }
                if (z < buffer.backZ[p]) {
                    buffer.backZ[p] = z;
                    buffer.back[p] = static_cast<std::uint32_t>(index);
                }
            }
        }
    }
}

glm::vec3 boxCenter(std::span<const glm::vec3> points) {
    glm::vec3 low(std::numeric_limits<float>::max()), high(std::numeric_limits<float>::lowest());
    for (const glm::vec3& p : points) {
        low = glm::min(low, p);
        high = glm::max(high, p);
    }
    return 0.5f * (low + high);
}

Status checkOptions(const CanonicalMapOptions& options) {
    if (options.size < 8 || options.size > 4096 || options.size % 2 != 0) {
        return makeError(ErrorCode::InvalidArgument, "canonical maps",
                         fmt::format("a size of {} pixels, expected an even number from 8 to 4096", options.size));
    }
    if (!(options.halfExtentM > 0.0f) || !std::isfinite(options.halfExtentM)) {
        return makeError(ErrorCode::InvalidArgument, "canonical maps",
                         fmt::format("an extent of +-{} m, expected a positive length", options.halfExtentM));
    }
    if (options.centerM && !(std::isfinite(options.centerM->x) && std::isfinite(options.centerM->y) &&
                             std::isfinite(options.centerM->z))) {
        return makeError(ErrorCode::InvalidArgument, "canonical maps", "the centre holds a number that is not finite");
    }
    return {};
}

/// Centre of pixel (row, column) of either map.
glm::dvec2 pixelCenter(const CanonicalMaps& maps, int row, int column) {
    const double step = 2.0 / maps.size, extent = maps.halfExtentM;
    return {maps.centerM.x + ((column + 0.5) * step - 1.0) * extent,
            maps.centerM.y + (1.0 - (row + 0.5) * step) * extent};
}

/// Lists the masked pixels of both maps in the order of the picture, with their place on the mesh.
void listPoints(const std::vector<MapVertex>& vertices, const std::vector<glm::uvec3>& triangles,
                const SurfaceBuffer& buffer, CanonicalMaps& maps) {
    for (int row = 0; row < maps.size; ++row) {
        for (int side = 0; side < 2; ++side) {
            const std::vector<std::uint32_t>& found = side == 0 ? buffer.front : buffer.back;
            for (int column = 0; column < maps.size; ++column) {
                const std::size_t p = static_cast<std::size_t>(row) * static_cast<std::size_t>(maps.size) +
                                      static_cast<std::size_t>(column);
                if (found[p] == kNoTriangle) continue;
                const glm::uvec3& t = triangles[found[p]];
                glm::dvec3 shares(0.0);
                pixelShares(vertices, t, column + 0.5, row + 0.5, shares);
                const glm::dvec2 xy = pixelCenter(maps, row, column);
                const double z = shares.x * vertices[t.x].z + shares.y * vertices[t.y].z + shares.z * vertices[t.z].z;
                maps.pixels.push_back(static_cast<std::uint32_t>((row * 2 + side) * maps.size + column));
                maps.triangles.push_back(found[p]);
                maps.barycentrics.emplace_back(shares);
                maps.positions.emplace_back(xy.x, xy.y, z);
            }
        }
    }
}

void addAttributes(const TemplateMesh& templateMesh, const std::vector<glm::vec3>& canonical,
                   const std::vector<glm::vec3>& vertexNormals, CanonicalMaps& maps) {
    const TriangleMesh& mesh = templateMesh.mesh;
    const SurfacePoints points{maps.triangles, maps.barycentrics};
    maps.normals = interpolatedNormals(mesh, canonical, vertexNormals, points);
    maps.weights = interpolatedWeights(mesh, templateMesh.weights, points);
    if (mesh.uvs.empty()) return;
    for (std::size_t i = 0; i < maps.pointCount(); ++i) {
        const glm::uvec3& t = mesh.triangles[maps.triangles[i]];
        const glm::vec3& share = maps.barycentrics[i];
        maps.uvs.push_back(share.x * mesh.uvs[t.x] + share.y * mesh.uvs[t.y] + share.z * mesh.uvs[t.z]);
    }
}

} // namespace

Result<CanonicalMaps> canonicalMaps(const TemplateMesh& templateMesh, const CanonicalMapOptions& options) {
    ARS_TRY_STATUS(checkOptions(options));
    ARS_TRY_STATUS(validateTemplate(templateMesh));
    const TriangleMesh& mesh = templateMesh.mesh;
    if (mesh.triangles.empty()) {
        return makeError(ErrorCode::InvalidArgument, "canonical maps",
                         fmt::format("the template has {} vertices and no triangle", mesh.positions.size()));
    }
    CanonicalMaps maps;
    maps.size = options.size;
    maps.halfExtentM = options.halfExtentM;
    maps.canonical = skinningMatrices(templateMesh.skeleton(), canonicalPose());
    std::vector<glm::vec3> canonical(mesh.positions.size()), normals(mesh.positions.size());
    ARS_TRY_STATUS(skinPointsAndNormals(maps.canonical, templateMesh.weights, mesh.positions, smoothNormals(mesh),
                                        canonical, normals));
    maps.centerM = options.centerM.value_or(boxCenter(canonical));

    std::vector<MapVertex> vertices;
    const double pixelsPerM = 0.5 * options.size / options.halfExtentM;
    const double middle = 0.5 * options.size;
    for (const glm::vec3& p : canonical) {
        vertices.push_back({middle + (static_cast<double>(p.x) - maps.centerM.x) * pixelsPerM,
                            middle - (static_cast<double>(p.y) - maps.centerM.y) * pixelsPerM, p.z});
    }
    SurfaceBuffer buffer(maps.pixelCount() / 2);
    constexpr std::size_t kBand = 32;
    const std::size_t bands = (static_cast<std::size_t>(options.size) + kBand - 1) / kBand;
    parallelFor(
        bands,
        [&](std::size_t band) {
            const int begin = static_cast<int>(band * kBand);
            rasteriseRows(vertices, mesh.triangles, options.size, begin,
                          std::min(begin + static_cast<int>(kBand), options.size), buffer);
        },
        1);
    listPoints(vertices, mesh.triangles, buffer, maps);
    if (maps.pixels.empty()) {
        return makeError(ErrorCode::Unsupported, "canonical maps",
                         fmt::format("nothing of the template lies within +-{} m of ({:.2f}, {:.2f})",
                                     options.halfExtentM, maps.centerM.x, maps.centerM.y));
    }
    addAttributes(templateMesh, canonical, normals, maps);
    return maps;
}

glm::vec3 canonicalCenter(const BodyModel& body, const BodyShape& shape) {
    return boxCenter(posedVertices(body, shape, canonicalPose()));
}

Result<CanonicalMaps> halvedMaps(const CanonicalMaps& maps) {
    if (maps.size < 2 || maps.size % 2 != 0) {
        return makeError(ErrorCode::InvalidArgument, "canonical maps",
                         fmt::format("maps of {} pixels cannot be halved", maps.size));
    }
    CanonicalMaps half;
    half.size = maps.size / 2;
    half.halfExtentM = maps.halfExtentM;
    half.centerM = maps.centerM;
    half.canonical = maps.canonical;
    const auto width = static_cast<std::uint32_t>(2 * maps.size);
    for (std::size_t i = 0; i < maps.pointCount(); ++i) {
        const std::uint32_t row = maps.pixels[i] / width, column = maps.pixels[i] % width;
        if (row % 2 != 0 || column % 2 != 0) continue;
        half.pixels.push_back(row / 2 * (width / 2) + column / 2);
        half.triangles.push_back(maps.triangles[i]);
        half.barycentrics.push_back(maps.barycentrics[i]);
        half.positions.push_back(maps.positions[i]);
        half.normals.push_back(maps.normals[i]);
        if (!maps.uvs.empty()) half.uvs.push_back(maps.uvs[i]);
        const auto influence = static_cast<std::ptrdiff_t>(i * kMaxInfluences);
        half.weights.joints.insert(half.weights.joints.end(), maps.weights.joints.begin() + influence,
                                   maps.weights.joints.begin() + influence + kMaxInfluences);
        half.weights.weights.insert(half.weights.weights.end(), maps.weights.weights.begin() + influence,
                                    maps.weights.weights.begin() + influence + kMaxInfluences);
    }
    return half;
}

std::vector<std::uint8_t> mapMask(const CanonicalMaps& maps) {
    std::vector<std::uint8_t> mask(maps.pixelCount(), 0);
    for (const std::uint32_t pixel : maps.pixels) mask[pixel] = 1;
    return mask;
}

} // namespace ars
