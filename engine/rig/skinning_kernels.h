#pragma once

#include "engine/core/error.h"
#include "engine/rig/skinning_math.h"

#include <cstddef>
#include <cstdint>
#include <vector>

namespace ars {

/// Largest joint index of (N, 8) influences; 0 for none. Fast enough to be asked before every pose.
std::uint16_t largestJoint(const std::vector<std::uint16_t>& joints);

/// What both devices are given, checked: pointers of one device, `normals` and `restNormals` both null or neither.
struct SkinArguments {
    const glm::mat4* matrices = nullptr; ///< (jointCount)
    std::size_t jointCount = 0;
    const std::uint16_t* joints = nullptr;  ///< (pointCount, 8)
    const float* weights = nullptr;         ///< (pointCount, 8)
    const glm::vec3* restPoints = nullptr;  ///< (pointCount)
    const glm::vec3* restNormals = nullptr; ///< (pointCount) or null
    glm::vec3* points = nullptr;            ///< (pointCount), may be restPoints
    glm::vec3* normals = nullptr;           ///< (pointCount) or null, may be restNormals
    std::size_t pointCount = 0;
};

namespace cpu {
void skin(const SkinArguments& arguments);
void skinRotations(const SkinArguments& arguments, glm::quat* rotations);
} // namespace cpu

namespace cuda {
/// Queued on the default stream of device `index`; does not wait. Influences of joints that do not exist count as 0.
Status skin(const SkinArguments& arguments, int index);
} // namespace cuda

} // namespace ars
