#pragma once

#include "engine/core/buffer.h"
#include "engine/core/error.h"

#include <glm/glm.hpp>

#include <cstddef>
#include <vector>

namespace ars {

/// N Gaussian surfels in host memory, one array per attribute. Tangents are columns 0 and 1 of the rotation, the normal
/// is column 2; the surfel is seen from the side that the normal points to.
///
/// The first four attributes are required. Each of the others is empty or has N entries; an empty one is not splatted.
struct Surfels {
    std::vector<glm::vec3> means;  ///< metres
    std::vector<float> rotations;  ///< (N, 4) unit quaternions w, x, y, z
    std::vector<glm::vec2> scales; ///< standard deviations along the tangents, metres, positive
    std::vector<float> opacities;  ///< [0, 1]

    std::vector<glm::vec3> colors;  ///< radiance, sRGB-encoded RGB
    std::vector<glm::vec3> albedos; ///< linear RGB
    std::vector<float> roughnesses; ///< perceptual roughness; alpha_GGX is its square
    std::vector<float> radii;       ///< occlusion radius r_i, metres
    std::vector<float> radiiPlus;   ///< r_i + epsilon, training only
    std::vector<float> radiiMinus;  ///< r_i - epsilon, training only
    std::vector<float> importances; ///< sample importance I_i, [0, 1]
    std::vector<glm::vec3> bones;   ///< bone direction q_i, unit length, world space

    std::size_t count() const { return means.size(); }
};

/// The same arrays wherever they lie, not owned; null pointers are absent attributes. All on `device`.
struct SurfelView {
    Device device;
    std::size_t count = 0;
    const glm::vec3* means = nullptr;
    const float* rotations = nullptr; ///< (N, 4) w, x, y, z
    const glm::vec2* scales = nullptr;
    const float* opacities = nullptr;
    const glm::vec3* colors = nullptr;
    const glm::vec3* albedos = nullptr;
    const float* roughnesses = nullptr;
    const float* radii = nullptr;
    const float* radiiPlus = nullptr;
    const float* radiiMinus = nullptr;
    const float* importances = nullptr;
    const glm::vec3* bones = nullptr;
};

/// InvalidArgument naming the attribute when array lengths differ. Values are not looked at: the splatter leaves out
/// surfels that are not finite, degenerate or invisible.
Status checkSurfels(const Surfels& surfels);

/// View of host arrays; valid as long as they are not resized.
SurfelView viewOf(const Surfels& surfels);

} // namespace ars
