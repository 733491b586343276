#pragma once

#include "engine/frame/avatar_evaluator.h"
#include "engine/scene/frame_worker.h"

#include <glm/glm.hpp>

#include <optional>
#include <string>
#include <vector>

namespace ars::ui {

/// What a ray through the picture meets on the body.
struct BodyHit {
    glm::dvec3 world{0.0}; ///< seen point, metres
    double depthM = 0.0;   ///< camera z
    int surfel = -1;       ///< nearest to it
    int joint = -1;        ///< with the largest weight there: turning it moves this skin
};

/// What is seen at a pixel of a frame: from its depth picture, its posed surfels and the rig's weights; nothing where
/// the pixel is empty.
std::optional<BodyHit> bodyAt(const Frame& frame, int column, int row);

/// The joint that a person drags by holding skin of `joint`: the far end of that segment (thigh: knee, forearm: wrist),
/// a hand or foot itself, the chest for a torso, the root itself for a root.
int draggedJoint(const Skeleton& skeleton, int joint);

/// "Left forearm" for the skin that left_elbow moves; names of other rigs made readable.
std::string segmentName(const Skeleton& skeleton, int joint);
/// "left_elbow" -> "Left elbow".
std::string readableName(const std::string& name);

/// Surfels whose skin is dragged by the same joint as that of `joint`: what lights up under the cursor.
std::vector<int> surfelsDraggedBy(const AvatarRig& rig, int dragged);
/// The joint with the largest weight of every surfel.
std::vector<int> dominantJoints(const AvatarRig& rig);

} // namespace ars::ui
