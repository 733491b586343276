#pragma once

#include "engine/rig/skeleton.h"

#include <array>
#include <string_view>
#include <vector>

namespace ars {

/// The nine parts of the body that each have an occlusion radius (paper Sec. 3.4).
enum class BodyPart { Torso, Hip, Knee, Foot, Head, Shoulder, Elbow, Wrist, Hand };
inline constexpr int kBodyPartCount = 9;

std::string_view bodyPartName(BodyPart part);
/// Initial occlusion radius r_init of a part, metres.
float bodyPartInitialRadiusM(BodyPart part);
/// A part's learned or edited radius stays within these factors of r_init.
inline constexpr float kMinRadiusFactor = 0.2f;
inline constexpr float kMaxRadiusFactor = 3.0f;

/// Part of a SMPL-X joint (0..54).
BodyPart smplxJointPart(int joint);

/// Part of every joint of any skeleton: by SMPL-X names, by the known names of other rigs (Mixamo, MakeHuman, CMU,
/// Blender Rigify...; resources/retarget/*.json), else inherited from the parent, else Torso.
std::vector<BodyPart> jointParts(const Skeleton& skeleton);

} // namespace ars
