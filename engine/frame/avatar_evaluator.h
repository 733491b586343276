#pragma once

#include "engine/core/camera.h"
#include "engine/rig/body_parts.h"
#include "engine/rig/pose.h"
#include "engine/rig/skeleton.h"
#include "engine/rig/skinning.h"
#include "engine/rig/template_mesh.h"
#include "engine/surfel/surfels.h"

#include <glm/glm.hpp>

#include <string>
#include <vector>

namespace ars {

/// What every avatar knows about its body, whatever makes its surfels; it never changes while the avatar lives.
struct AvatarRig {
    Skeleton skeleton;
    std::vector<BodyPart> parts;      ///< (J) occlusion part of each joint
    std::vector<glm::mat4> canonical; ///< (J) joint matrices A_j that bring the rest pose into the canonical pose
    SkinWeights weights;              ///< (N) of the surfels
};

/// Stage 3 of a frame: where canonical surfels come from. A rest: avatar has constant ones; a trained avatar runs its
/// networks. Implementations may be slow; callers keep the last result and re-pose it by skinning while they wait.
class AvatarEvaluator {
public:
    virtual ~AvatarEvaluator() = default;

    virtual const AvatarRig& rig() const = 0;
    /// The skinned mesh that the avatar stands on, T-pose; for ray-cast occlusion, overlays and export.
    virtual const TemplateMesh& mesh() const = 0;
    /// One line for the person: what this is ("rest avatar of template.glb, 40,824 surfels").
    virtual std::string description() const = 0;

    virtual bool dependsOnPose() const = 0; ///< canonical surfels change with the pose
    /// Radiance colours change with where the camera stands and looks, its R and t; nothing else does.
    virtual bool colorsDependOnView() const = 0;
    /// Whether the canonical surfels under both poses are the same; an evaluation is spared then.
    virtual bool sameSurfels(const Pose& a, const Pose& b) const {
        return !dependsOnPose() ||
               (a.rotations == b.rotations && a.translation == b.translation && a.expression == b.expression);
    }

    /// Canonical surfels under a pose, N of them, in the canonical pose, world axes, root at rest.
    /// @param view  camera for the radiance colours, or null: they may then be those of the last view
    virtual Status evaluate(const Pose& pose, const Camera* view, Surfels& surfels) = 0;
};

} // namespace ars
