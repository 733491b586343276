#pragma once

#include "engine/core/camera.h"
#include "engine/frame/avatar_evaluator.h"
#include "engine/io/image.h"
#include "engine/surfel/splat.h"

#include <glm/glm.hpp>

#include <memory>
#include <vector>

namespace ars {

/// Colour of every surfel of a rig: those of the nine parts (bodyPartColors) blended by its skin weights, sRGB.
std::vector<glm::vec3> surfelPartColors(const AvatarRig& rig);

/// Paints the nine parts as a camera sees them. Keeps its memory between pictures.
class PartPicture {
public:
    /// @param surfels  posed ones of an avatar with this rig, on any device
    /// @param picture  receives RGB, sRGB-encoded, 0 where nothing is
    /// @return errors of splat; InvalidArgument where the rig has another number of surfels
    Status render(const AvatarRig& rig, const SurfelView& surfels, const SplatParams& params, const Camera& camera,
                  Image& picture);

private:
    const AvatarRig* rig_ = nullptr; ///< that `colors_` was made for
    std::vector<glm::vec3> colors_;
    Buffer deviceColors_; ///< CUDA only
    GBuffer gbuffer_;
    SplatWorkspace workspace_;
};

} // namespace ars
