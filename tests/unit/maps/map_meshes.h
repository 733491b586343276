#pragma once

#include "engine/rig/pose.h"
#include "engine/rig/template_mesh.h"

#include <cmath>
#include <numbers>
#include <vector>

namespace ars::test {

/// Everything follows the root, which the canonical pose leaves where it is.
inline void followTheRoot(TemplateMesh& mesh) {
    mesh.joints.assign(kSmplxJointCount, glm::vec3(0.0f));
    mesh.weights.joints.assign(mesh.mesh.positions.size() * kMaxInfluences, 0);
    mesh.weights.weights.assign(mesh.mesh.positions.size() * kMaxInfluences, 0.0f);
    for (std::size_t v = 0; v < mesh.mesh.positions.size(); ++v) mesh.weights.weights[v * kMaxInfluences] = 1.0f;
}

/// A sphere of rows x 2 rows quads, wound so that its outside is seen.
inline TemplateMesh sphereTemplate(float radius, int rows) {
    TemplateMesh mesh;
    const int columns = 2 * rows;
    for (int r = 0; r <= rows; ++r) {
        for (int c = 0; c <= columns; ++c) {
            const double theta = std::numbers::pi * r / rows, phi = 2.0 * std::numbers::pi * c / columns;
            const glm::dvec3 n(std::sin(theta) * std::sin(phi), std::cos(theta), std::sin(theta) * std::cos(phi));
            mesh.mesh.positions.emplace_back(radius * glm::vec3(n));
        }
    }
    for (int r = 0; r < rows; ++r) {
        for (int c = 0; c < columns; ++c) {
            const auto a = static_cast<unsigned>(r * (columns + 1) + c), d = a + static_cast<unsigned>(columns) + 1;
            mesh.mesh.triangles.push_back({a, d, a + 1});
            mesh.mesh.triangles.push_back({a + 1, d, d + 1});
        }
    }
    followTheRoot(mesh);
    return mesh;
}

/// The rectangle [x0,x1] x [y0,y1] at depth z, seen from +z.
inline void addRectangle(TriangleMesh& mesh, float x0, float y0, float x1, float y1, float z) {
    const auto first = static_cast<unsigned>(mesh.positions.size());
    for (const glm::vec2& p : {glm::vec2(x0, y0), {x1, y0}, {x1, y1}, {x0, y1}}) mesh.positions.emplace_back(p, z);
    mesh.triangles.push_back(glm::uvec3(0, 1, 2) + first);
    mesh.triangles.push_back(glm::uvec3(0, 2, 3) + first);
}

} // namespace ars::test
