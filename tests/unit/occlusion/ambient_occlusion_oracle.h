#pragma once

#include "tests/unit/occlusion/ambient_occlusion_scenes.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace ars::test {

/// Camera-space position of a pixel in double, (0, 0, 0) where it is empty or outside; with the median of GI-GS on
/// request.
inline glm::dvec3 oraclePosition(const OcclusionScene& scene, int row, int column, bool median) {
    if (median) {
        std::array<std::array<double, 9>, 3> values;
        for (int k = 0; k < 9; ++k) {
            const glm::dvec3 p = oraclePosition(scene, row + k / 3 - 1, column + k % 3 - 1, false);
            for (int axis = 0; axis < 3; ++axis)
                values[static_cast<std::size_t>(axis)][static_cast<std::size_t>(k)] = p[axis];
        }
        glm::dvec3 result;
        for (int axis = 0; axis < 3; ++axis) {
            auto& v = values[static_cast<std::size_t>(axis)];
            std::sort(v.begin(), v.end());
            result[axis] = v[4];
        }
        return result;
    }
    if (row < 0 || column < 0 || row >= scene.camera.height || column >= scene.camera.width) return glm::dvec3(0.0);
    return static_cast<double>(scene.depth[scene.at(row, column)]) * scene.ray(row, column);
}

/// O of one pixel, straight from rendering.md section 2 with the project's decisions, in double.
inline double oracleOcclusion(const OcclusionParams& params, const OcclusionScene& scene, int row, int column) {
    const Camera& camera = scene.camera;
    const glm::dvec3 p = oraclePosition(scene, row, column, params.median);
    const std::size_t at = scene.at(row, column);
    const double radius = scene.radius[at];
    if (p.z <= 0.0 || scene.depth[at] <= 0.0f || radius <= 0.0) return 1.0;
    const glm::dvec3 n =
        glm::normalize(glm::dvec3(scene.normal[3 * at], scene.normal[3 * at + 1], scene.normal[3 * at + 2]));
    glm::dvec3 q(0.0, -1.0, 0.0);
    if (!scene.bone.empty()) q = {scene.bone[3 * at], scene.bone[3 * at + 1], scene.bone[3 * at + 2]};
    glm::dvec3 t = q - glm::dot(q, n) * n;
    if (glm::length(t) < 1e-3) t = glm::dvec3(1.0, 0.0, 0.0) - n.x * n;
    t = glm::normalize(t);
    const glm::dvec3 b = glm::cross(n, t);

    const double importance = scene.importance.empty() || params.adaptive == OcclusionAdaptive::Off
                                  ? 0.0
                                  : std::clamp(static_cast<double>(scene.importance[at]), 0.0, 1.0);
    const double delta = params.delta / (1.0 + params.alpha * importance);
    const int azimuths = static_cast<int>(std::lround(2.0 / delta));
    const int polar =
        static_cast<int>(std::lround(1.0 / (params.adaptive == OcclusionAdaptive::Azimuth ? params.delta : delta)));
    const double length = params.depthFactor ? radius * (1.0 + p.z / 100.0) * (1.0 + p.z / 100.0) : radius;
    const double bias = params.biasM + params.biasPerRadius * radius;
    double occluded = 0.0, total = 0.0;
    for (int i = 0; i < azimuths; ++i) {
        for (int k = 0; k < polar; ++k) {
            const double phi = (i + 0.5) * 2.0 * std::numbers::pi / azimuths;
            const double theta = (k + 0.5) * 0.5 * std::numbers::pi / polar;
            const glm::dvec3 w = std::sin(theta) * (std::cos(phi) * t + std::sin(phi) * b) + std::cos(theta) * n;
            const double weight = std::cos(theta) * std::sin(theta);
            total += weight;
            for (int j = params.firstStep; j <= params.lastStep; ++j) {
                const glm::dvec3 x = p + (length * j / params.steps) * w;
                if (x.z <= 1e-3) break;
                const glm::dvec2 pixel = camera.project(x);
                const int c = static_cast<int>(std::floor(pixel.x)), r = static_cast<int>(std::floor(pixel.y));
                if (c < 0 || r < 0 || c >= camera.width || r >= camera.height) break;
                const double depth = oraclePosition(scene, r, c, params.median).z;
                if (depth > 0.0 && depth <= x.z + bias && depth >= x.z - params.thicknessM) {
                    occluded += weight;
                    break;
                }
            }
        }
    }
    return std::clamp(1.0 - params.strength * occluded / total, 0.0, 1.0);
}

} // namespace ars::test
