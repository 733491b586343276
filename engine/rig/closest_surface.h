#pragma once

#include "engine/core/error.h"

#include <glm/glm.hpp>

#include <cstdint>
#include <memory>
#include <span>

namespace ars {

/// Closest point on a triangle mesh.
struct SurfacePoint {
    std::uint32_t triangle = 0;
    glm::vec3 barycentric{0.0f}; ///< weights of the triangle's corners
    float distanceM = 0.0f;
};

/// Exact closest points on a mesh by a bounding volume tree (Embree). Safe to ask from many threads.
class ClosestSurface {
public:
    /// The mesh is copied. InvalidArgument without triangles or with indices out of range.
    static Result<ClosestSurface> build(std::span<const glm::vec3> positions, std::span<const glm::uvec3> triangles);
    /// False when nothing lies within `radiusM` of the point.
    bool find(const glm::vec3& pointM, float radiusM, SurfacePoint& closest) const;

private:
    ClosestSurface() = default;
    struct State;
    std::shared_ptr<const State> state_;
};

} // namespace ars
