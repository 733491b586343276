#pragma once

#include "engine/core/host_device.h"

#include <glm/glm.hpp>

#include <cmath>
#include <cstdint>

namespace ars {

/// Van der Corput's sequence in base 2, [0, 1).
template <typename T>
ARS_HD T radicalInverse2(std::uint32_t bits) {
    bits = (bits << 16) | (bits >> 16);
    bits = ((bits & 0x00ff00ffu) << 8) | ((bits & 0xff00ff00u) >> 8);
    bits = ((bits & 0x0f0f0f0fu) << 4) | ((bits & 0xf0f0f0f0u) >> 4);
    bits = ((bits & 0x33333333u) << 2) | ((bits & 0xccccccccu) >> 2);
    bits = ((bits & 0x55555555u) << 1) | ((bits & 0xaaaaaaaau) >> 1);
    return T(bits) * T(2.3283064365386963e-10);
}

/// Direction i of n about +z, distributed as cos(theta)/pi: Hammersley points, i.e. equal shares of sin^2(theta). It is
/// also what importance sampling of GGX gives at roughness 1, whose half vectors are cosine-distributed.
template <typename T>
ARS_HD glm::vec<3, T, glm::defaultp> cosineDirection(std::uint32_t i, std::uint32_t n) {
    const T u = (T(i) + T(0.5)) / T(n);
    const T phi = T(6.283185307179586) * radicalInverse2<T>(i);
    const T sine = std::sqrt(u);
    return {sine * std::cos(phi), sine * std::sin(phi), std::sqrt(T(1) - u)};
}

/// Two unit vectors that make a right-handed frame with the unit vector n (Duff et al. 2017: no normal without a
/// frame).
template <typename T>
ARS_HD void tangentFrame(const glm::vec<3, T, glm::defaultp>& n, glm::vec<3, T, glm::defaultp>& t,
                         glm::vec<3, T, glm::defaultp>& b) {
    const T sign = std::copysign(T(1), n.z);
    const T a = T(-1) / (sign + n.z);
    const T c = n.x * n.y * a;
    t = {T(1) + sign * n.x * n.x * a, sign * c, -sign * n.x};
    b = {c, sign + n.y * n.y * a, -n.y};
}

} // namespace ars
