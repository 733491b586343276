#include "engine/maps/surface_attributes.h"

#include "engine/core/parallel.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace ars {
namespace {

struct Influence {
    float weight;
    std::uint16_t joint;
};

/// Largest first, equal ones by joint, so that the result does not depend on the order of the corners.
bool heavier(const Influence& a, const Influence& b) {
    return a.weight != b.weight ? a.weight > b.weight : a.joint < b.joint;
}

void blendRows(const SkinWeights& weights, const glm::uvec3& corners, const glm::vec3& shares, std::uint16_t* joints,
               float* values) {
    std::array<Influence, 3 * kMaxInfluences> found;
    std::size_t count = 0;
    for (int c = 0; c < 3; ++c) {
        const std::size_t row = static_cast<std::size_t>(corners[c]) * kMaxInfluences;
        for (std::size_t k = row; k < row + kMaxInfluences; ++k) {
            const float weight = shares[c] * weights.weights[k];
            if (!(weight > 0.0f)) continue;
            const auto end = found.begin() + static_cast<std::ptrdiff_t>(count);
            const auto same =
                std::find_if(found.begin(), end, [&](const Influence& i) { return i.joint == weights.joints[k]; });
            if (same != end)
                same->weight += weight;
            else
                found[count++] = {weight, weights.joints[k]};
        }
    }
    std::sort(found.begin(), found.begin() + static_cast<std::ptrdiff_t>(count), heavier);
    const std::size_t kept = std::min<std::size_t>(count, kMaxInfluences);
    float sum = 0.0f;
    for (std::size_t k = 0; k < kept; ++k) sum += found[k].weight;
    for (std::size_t k = 0; k < kMaxInfluences; ++k) {
        joints[k] = k < kept ? found[k].joint : std::uint16_t{0};
        values[k] = k < kept ? found[k].weight / sum : 0.0f;
    }
}

glm::vec3 unitOrZero(const glm::vec3& v) {
    const float length = glm::length(v);
    return length > 0.0f && std::isfinite(length) ? v / length : glm::vec3(0.0f);
}

} // namespace

SkinWeights interpolatedWeights(const TriangleMesh& mesh, const SkinWeights& vertexWeights,
                                const SurfacePoints& points) {
    const std::size_t count = points.triangles.size();
    SkinWeights result;
    result.joints.resize(count * kMaxInfluences);
    result.weights.resize(count * kMaxInfluences);
    parallelFor(count, [&](std::size_t i) {
        blendRows(vertexWeights, mesh.triangles[points.triangles[i]], points.barycentrics[i],
                  &result.joints[i * kMaxInfluences], &result.weights[i * kMaxInfluences]);
    });
    return result;
}

std::vector<glm::vec3> interpolatedNormals(const TriangleMesh& mesh, std::span<const glm::vec3> positions,
                                           std::span<const glm::vec3> vertexNormals, const SurfacePoints& points) {
    std::vector<glm::vec3> normals(points.triangles.size());
    parallelFor(normals.size(), [&](std::size_t i) {
        const glm::uvec3& t = mesh.triangles[points.triangles[i]];
        const glm::vec3& share = points.barycentrics[i];
        const glm::vec3 face = unitOrZero(glm::cross(positions[t.y] - positions[t.x], positions[t.z] - positions[t.x]));
        const glm::vec3 smooth =
            unitOrZero(share.x * vertexNormals[t.x] + share.y * vertexNormals[t.y] + share.z * vertexNormals[t.z]);
        const bool behind = glm::dot(smooth, face) <= 0.0f && face != glm::vec3(0.0f);
        normals[i] = behind ? face : smooth != glm::vec3(0.0f) ? smooth : glm::vec3(0.0f, 0.0f, 1.0f);
    });
    return normals;
}

std::vector<glm::vec3> smoothNormals(const TriangleMesh& mesh) {
    return mesh.normals.empty() ? vertexNormals(mesh.positions, mesh.triangles) : mesh.normals;
}

} // namespace ars
