#include "engine/core/parallel.h"
#include "engine/light/cube_map.h"
#include "model/evaluation/evaluation.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace ars {
namespace {

constexpr int kSide = 16;          ///< of the irradiance cube
constexpr int kLargestSource = 64; ///< larger lights are averaged down to it; the cosine is far wider than a texel

/// Directions and solid angles of a cube's texels.
struct Sphere {
    std::vector<glm::vec3> directions;
    std::vector<float> areas;
};

Sphere sphereOf(int side) {
    Sphere sphere;
    const std::vector<float> face = texelSolidAngles(side);
    for (int f = 0; f < 6; ++f) {
        for (int row = 0; row < side; ++row) {
            for (int column = 0; column < side; ++column) {
                sphere.directions.push_back(glm::normalize(
                    cubeDirection<float>(f, texelCoordinate<float>(column, side), texelCoordinate<float>(row, side))));
                sphere.areas.push_back(face[static_cast<std::size_t>(row * side + column)]);
            }
        }
    }
    return sphere;
}

/// Half the side, averaged with the texels' solid angles.
CubeMap halvedCube(const CubeMap& cube) {
    CubeMap half(cube.size / 2);
    const std::vector<float> areas = texelSolidAngles(cube.size);
    for (int face = 0; face < 6; ++face) {
        for (int row = 0; row < half.size; ++row) {
            for (int column = 0; column < half.size; ++column) {
                glm::vec3 sum(0.0f);
                float area = 0.0f;
                for (int k = 0; k < 4; ++k) {
                    const int r = 2 * row + k / 2, c = 2 * column + k % 2;
                    const float a = areas[static_cast<std::size_t>(r * cube.size + c)];
                    const float* texel = cube.texel(face, r, c);
                    sum += a * glm::vec3(texel[0], texel[1], texel[2]);
                    area += a;
                }
                sum /= area;
                std::copy_n(&sum.x, 3, half.texel(face, row, column));
            }
        }
    }
    return half;
}

/// E / pi in every direction of a 16x16 cube.
std::vector<glm::dvec3> irradianceOf(CubeMap cube) {
    while (cube.size > kLargestSource && cube.size % 2 == 0) cube = halvedCube(cube);
    const Sphere source = sphereOf(cube.size), target = sphereOf(kSide);
    std::vector<glm::dvec3> result(target.directions.size(), glm::dvec3(0.0));
    parallelFor(
        result.size(),
        [&](std::size_t i) {
            glm::dvec3 sum(0.0);
            double total = 0;
            for (std::size_t k = 0; k < source.directions.size(); ++k) {
                const float cosine = glm::dot(target.directions[i], source.directions[k]);
                if (cosine <= 0.0f) continue;
                const double weight = static_cast<double>(cosine) * source.areas[k];
                const float* texel = &cube.texels[3 * k];
                sum += weight * glm::dvec3(texel[0], texel[1], texel[2]);
                total += weight;
            }
            if (total > 0) result[i] = sum / total;
        },
        32);
    return result;
}

} // namespace

double irradianceCorrelation(const CubeMap& a, const CubeMap& b) {
    if (a.size <= 0 || b.size <= 0) return std::nan("");
    const std::vector<glm::dvec3> x = irradianceOf(a), y = irradianceOf(b);
    double n = 0, sx = 0, sy = 0, sxx = 0, syy = 0, sxy = 0;
    for (std::size_t i = 0; i < x.size(); ++i) {
        for (int c = 0; c < 3; ++c) {
            n += 1;
            sx += x[i][c];
            sy += y[i][c];
            sxx += x[i][c] * x[i][c];
            syy += y[i][c] * y[i][c];
            sxy += x[i][c] * y[i][c];
        }
    }
    const double vx = n * sxx - sx * sx, vy = n * syy - sy * sy;
    // A light that is the same from everywhere has no pattern to correlate.
    if (!(vx > 1e-12 * sx * sx) || !(vy > 1e-12 * sy * sy)) return std::nan("");
    return (n * sxy - sx * sy) / std::sqrt(vx * vy);
}

} // namespace ars
