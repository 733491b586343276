#pragma once

#include <glm/glm.hpp>
#include <glm/gtc/constants.hpp>

#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <utility>
#include <vector>

namespace ars::test {

/// Triangles for the comparison methods; counter-clockwise seen from outside.
struct TestMesh {
    std::vector<glm::vec3> vertices;
    std::vector<glm::uvec3> triangles;

    void append(const TestMesh& other) {
        const auto offset = static_cast<std::uint32_t>(vertices.size());
        vertices.insert(vertices.end(), other.vertices.begin(), other.vertices.end());
        for (const glm::uvec3& t : other.triangles) triangles.push_back(t + offset);
    }
};

/// The parallelogram at `corner` with sides u and v in n x n squares; its front is the side of cross(u, v).
inline TestMesh sheet(const glm::vec3& corner, const glm::vec3& u, const glm::vec3& v, int n = 1) {
    TestMesh mesh;
    for (int i = 0; i <= n; ++i) {
        for (int j = 0; j <= n; ++j) {
            mesh.vertices.push_back(corner + u * (static_cast<float>(i) / static_cast<float>(n)) +
                                    v * (static_cast<float>(j) / static_cast<float>(n)));
        }
    }
    const auto row = static_cast<std::uint32_t>(n + 1);
    for (std::uint32_t i = 0; i + 1 < row; ++i) {
        for (std::uint32_t j = 0; j + 1 < row; ++j) {
            const std::uint32_t a = i * row + j, b = a + row, c = b + 1, d = a + 1;
            mesh.triangles.emplace_back(a, b, c);
            mesh.triangles.emplace_back(a, c, d);
        }
    }
    return mesh;
}

/// An octahedron divided `levels` times, pushed out to the sphere about the origin.
inline TestMesh sphere(float radius, int levels) {
    TestMesh mesh;
    mesh.vertices = {{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}};
    mesh.triangles = {{0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4}, {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}};
    for (int level = 0; level < levels; ++level) {
        std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> middles;
        const auto middle = [&](std::uint32_t a, std::uint32_t b) {
            const auto key = std::minmax(a, b);
            const auto found = middles.find(key);
            if (found != middles.end()) return found->second;
            mesh.vertices.push_back(glm::normalize(mesh.vertices[a] + mesh.vertices[b]));
            return middles[key] = static_cast<std::uint32_t>(mesh.vertices.size() - 1);
        };
        std::vector<glm::uvec3> finer;
        for (const glm::uvec3& t : mesh.triangles) {
            const std::uint32_t ab = middle(t.x, t.y), bc = middle(t.y, t.z), ca = middle(t.z, t.x);
            for (const glm::uvec3& f : {glm::uvec3(t.x, ab, ca), {ab, t.y, bc}, {ca, bc, t.z}, {ab, bc, ca}}) {
                finer.push_back(f);
            }
        }
        mesh.triangles = finer;
    }
    for (glm::vec3& v : mesh.vertices) v *= radius;
    return mesh;
}

/// The half of a sphere with z <= 0, turned so that its inside is the front: a bowl open towards +z.
inline TestMesh bowl(float radius, int levels) {
    TestMesh whole = sphere(radius, levels), half;
    half.vertices = whole.vertices;
    for (const glm::uvec3& t : whole.triangles) {
        const float z = whole.vertices[t.x].z + whole.vertices[t.y].z + whole.vertices[t.z].z;
        if (z < 0.0f) half.triangles.emplace_back(t.x, t.z, t.y);
    }
    return half;
}

/// A floor y = 0 with its front up, and a wall in the plane x = 0 of this height that faces +x. `reach` is how far both
/// go, `pieces` into how many squares a side each is cut.
inline TestMesh floorAndWall(float reach, float height, int pieces = 1) {
    TestMesh mesh = sheet({-reach, 0, -reach}, {0, 0, 2 * reach}, {2 * reach, 0, 0}, pieces);
    mesh.append(sheet({0, 0, -reach}, {0, height, 0}, {0, 0, 2 * reach}, pieces));
    return mesh;
}

/// Cosine-weighted share of the hemisphere over a floor that an infinite wall at distance d hides from rays of length
/// t.
inline double wallShare(double d, double t) {
    const double c = d / t;
    return c >= 1 ? 0.0 : (std::acos(c) - c * std::sqrt(1 - c * c)) / glm::pi<double>();
}

/// The same for a wall of height h and unlimited rays.
inline double stepShare(double d, double h) { return 0.5 * (1 - d / std::sqrt(d * d + h * h)); }

/// Points on the unit sphere, evenly spread (golden-angle spiral).
inline std::vector<glm::vec3> spreadDirections(int count) {
    std::vector<glm::vec3> result;
    for (int i = 0; i < count; ++i) {
        const float y = 1 - (2 * static_cast<float>(i) + 1) / static_cast<float>(count);
        const float r = std::sqrt(1 - y * y), phi = 2.3999632f * static_cast<float>(i);
        result.emplace_back(r * std::cos(phi), y, r * std::sin(phi));
    }
    return result;
}

inline double mean(const std::vector<float>& values) {
    double sum = 0;
    for (const float v : values) sum += static_cast<double>(v);
    return values.empty() ? 0.0 : sum / static_cast<double>(values.size());
}

} // namespace ars::test
