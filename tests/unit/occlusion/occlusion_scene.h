#pragma once

#include "engine/occlusion/ambient_occlusion.h"

#include <glm/glm.hpp>

#include <cmath>
#include <functional>
#include <vector>

namespace ars::test {

/// Host pictures that occlusion is computed from.
struct OcclusionScene {
    Camera camera;
    std::vector<float> depth, normal, radius, importance, bone;

    OcclusionScene() = default;
    OcclusionScene(int width, int height, double focal) {
        camera.width = width;
        camera.height = height;
        camera.fx = camera.fy = focal;
        camera.cx = 0.5 * width;
        camera.cy = 0.5 * height;
    }

    std::size_t pixels() const {
        return static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
    }
    std::size_t at(int row, int column) const {
        return static_cast<std::size_t>(row) * static_cast<std::size_t>(camera.width) +
               static_cast<std::size_t>(column);
    }
    glm::dvec3 ray(int row, int column) const { return camera.ray(column + 0.5, row + 0.5); }

    /// surface(ray, depth, normal) sets both where the ray (z = 1) hits something; radius everywhere the same.
    void fill(double radiusM,
              const std::function<bool(const glm::dvec3& ray, double& depth, glm::dvec3& normal)>& surface) {
        depth.assign(pixels(), 0.0f);
        normal.assign(3 * pixels(), 0.0f);
        radius.assign(pixels(), static_cast<float>(radiusM));
        for (int r = 0; r < camera.height; ++r) {
            for (int c = 0; c < camera.width; ++c) {
                double z = 0.0;
                glm::dvec3 n(0.0);
                if (!surface(ray(r, c), z, n)) continue;
                depth[at(r, c)] = static_cast<float>(z);
                for (int k = 0; k < 3; ++k)
                    normal[3 * at(r, c) + static_cast<std::size_t>(k)] = static_cast<float>(n[k]);
            }
        }
    }

    ImageView<const float> picture(const std::vector<float>& values, int channels) const {
        if (values.empty()) return {};
        return {values.data(), camera.width, camera.height, channels};
    }
    OcclusionInputs inputs() const {
        OcclusionInputs in;
        in.camera = camera;
        in.depth = picture(depth, 1);
        in.normal = picture(normal, 3);
        in.radius = picture(radius, 1);
        in.importance = picture(importance, 1);
        in.bone = picture(bone, 3);
        return in;
    }
};

/// A body of capsules with folds, 1.7 m tall, arms beside it, seen from 3 m; about 17 % of the picture. Importance
/// rises from the trunk to the hands so that the paper's directions are about 2,300 a pixel.
inline OcclusionScene capsuleBody(int side, double radiusM = 0.25) {
    struct Capsule {
        glm::dvec3 a, b;
        double r, importance;
    };
    static const std::vector<Capsule> capsules = {{{0.0, 0.45, 0.0}, {0.0, 0.0, 0.0}, 0.17, 0.30},
                                                  {{0.06, 0.42, 0.02}, {-0.06, 0.42, 0.02}, 0.16, 0.30},
                                                  {{0.0, 0.78, 0.02}, {0.0, 0.86, 0.02}, 0.095, 0.5},
                                                  {{0.19, 0.50, 0.0}, {0.30, 0.18, 0.05}, 0.055, 0.45},
                                                  {{0.30, 0.18, 0.05}, {0.20, -0.02, 0.22}, 0.045, 0.6},
                                                  {{0.20, -0.02, 0.22}, {0.15, -0.08, 0.26}, 0.035, 0.9},
                                                  {{-0.19, 0.50, 0.0}, {-0.33, 0.20, 0.0}, 0.055, 0.45},
                                                  {{-0.33, 0.20, 0.0}, {-0.38, -0.06, 0.05}, 0.045, 0.6},
                                                  {{-0.38, -0.06, 0.05}, {-0.39, -0.16, 0.07}, 0.035, 0.9},
                                                  {{0.10, -0.05, 0.0}, {0.13, -0.42, 0.03}, 0.085, 0.4},
                                                  {{0.13, -0.42, 0.03}, {0.13, -0.80, 0.0}, 0.06, 0.45},
                                                  {{-0.10, -0.05, 0.0}, {-0.12, -0.42, 0.05}, 0.085, 0.4},
                                                  {{-0.12, -0.42, 0.05}, {-0.12, -0.80, 0.0}, 0.06, 0.45}};
    double importance = 0.0;
    const auto distance = [&importance](const glm::dvec3& p) {
        double nearest = 1e9;
        for (const Capsule& c : capsules) {
            const glm::dvec3 ab = c.b - c.a;
            const double t = glm::clamp(glm::dot(p - c.a, ab) / glm::dot(ab, ab), 0.0, 1.0);
            const double d = glm::length(p - c.a - t * ab) - c.r;
            if (d < nearest) nearest = d, importance = c.importance;
        }
        return nearest + 0.004 * std::sin(70.0 * p.y + 25.0 * p.x) * std::sin(20.0 * p.x + 30.0 * p.z);
    };
    OcclusionScene scene(side, side, 1.62 * side);
    const glm::dvec3 eye(0.0, 0.03, -3.0); // camera y is down, the body's is up; z of the body looks at the camera
    scene.importance.assign(scene.pixels(), 0.0f);
    std::size_t at = 0;
    scene.fill(radiusM, [&](const glm::dvec3& ray, double& depth, glm::dvec3& normal) {
        const std::size_t pixel = at++;
        const double length = glm::length(ray);
        const auto world = [&](double z) {
            const glm::dvec3 p = eye + z * glm::dvec3(ray.x, -ray.y, 1.0);
            return glm::dvec3(p.x, p.y, -p.z);
        };
        for (double z = 2.3; z < 3.6;) {
            const double d = distance(world(z));
            if (d < 1e-5) {
                const double e = 1e-5;
                const glm::dvec3 p = world(z);
                const glm::dvec3 n(distance(p + glm::dvec3(e, 0, 0)) - distance(p - glm::dvec3(e, 0, 0)),
                                   distance(p + glm::dvec3(0, e, 0)) - distance(p - glm::dvec3(0, e, 0)),
                                   distance(p + glm::dvec3(0, 0, e)) - distance(p - glm::dvec3(0, 0, e)));
                depth = z;
                normal = glm::normalize(glm::dvec3(n.x, -n.y, -n.z));
                scene.importance[pixel] = static_cast<float>(importance);
                return true;
            }
            z += 0.7 * d / length;
        }
        return false;
    });
    return scene;
}

} // namespace ars::test
