#pragma once

#include "engine/core/host_device.h"

#include <glm/glm.hpp>

#include <cmath>

namespace ars {

/// |d|, d/|d| and |s| of one point (supplement, Detailed Deformation Feature Maps): d = posed - canonical. Where
/// |d| < smallest there is no direction, and it is 0.
template <typename T>
ARS_HD void deformationPrior(const glm::vec<3, T>& canonical, const glm::vec<3, T>& posed, T bodyDistance, T smallest,
                             T* prior) {
    const glm::vec<3, T> d = posed - canonical;
    const T length = std::sqrt(glm::dot(d, d));
    const T scale = length < smallest ? T(0) : T(1) / length;
    prior[0] = length;
    prior[1] = scale * d.x;
    prior[2] = scale * d.y;
    prior[3] = scale * d.z;
    prior[4] = bodyDistance;
}

/// Place of value `channel` of a pixel of the (N, 2N) picture in (2C, N, N) planes: the front's planes, then the
/// back's.
ARS_HD inline std::size_t planeIndex(std::uint32_t pixel, int size, int channel, int channels) {
    const std::uint32_t width = 2 * static_cast<std::uint32_t>(size);
    const std::uint32_t row = pixel / width, column = pixel % width;
    const std::uint32_t side = column / static_cast<std::uint32_t>(size);
    const std::size_t plane =
        static_cast<std::size_t>(side) * static_cast<std::size_t>(channels) + static_cast<std::size_t>(channel);
    return (plane * static_cast<std::size_t>(size) + row) * static_cast<std::size_t>(size) + column -
           static_cast<std::size_t>(side) * static_cast<std::size_t>(size);
}

} // namespace ars
