#pragma once

#include "engine/core/image_view.h"
#include "engine/maps/canonical_maps.h"
#include "engine/rig/pose.h"

#include <glm/glm.hpp>

#include <span>
#include <vector>

namespace ars {

/// What the networks see of a pose: root rotation and translation removed, fingers at rest, jaw kept, no expression
/// (design section 4).
Pose mapPose(const Pose& pose);

/// M_j = A_j A_canonical,j^-1 of mapPose(pose): canonical pose to root-free posed space (55).
Result<std::vector<glm::mat4>> mapMatrices(const Skeleton& skeleton, const CanonicalMaps& maps, const Pose& pose);

/// The map's points under mapPose(pose), by linear blend skinning, root-free space, metres (P).
Result<std::vector<glm::vec3>> posedMapPoints(const Skeleton& skeleton, const CanonicalMaps& maps, const Pose& pose);

/// Numbers of a deformation prior per point: |d|, d/|d| (3), |s|.
inline constexpr int kPriorWidth = 5;
/// |d| below which its direction is 0, metres.
inline constexpr float kMinPriorDistanceM = 1e-6f;

/// Deformation priors (paper Sec. 3.2 and supplement) of every point, (P, 5) row-major: d = posed minus canonical, s
/// the distance to the nearest vertex of the posed body.
///
/// @param posedPoints (P) of posedMapPoints, or of a PCA projection
/// @param bodyVertices posed body in the same root-free space, pose blend shapes included; empty: |s| is 0
/// @param priors receives (P, 5)
/// @return InvalidArgument when sizes differ
Status deformationPriors(const CanonicalMaps& maps, std::span<const glm::vec3> posedPoints,
                         std::span<const glm::vec3> bodyVertices, std::span<float> priors);

/// The body's vertices under mapPose(pose), pose blend shapes included: what s is measured against.
std::vector<glm::vec3> mapBodyVertices(const BodyModel& body, const BodyShape& shape, const Pose& pose);

/// Values of points as pictures for people and files: (N, 2N, C) interleaved, 0 outside the mask.
/// @param values (P, C) row-major
Status spreadPicture(const CanonicalMaps& maps, std::span<const float> values, ImageView<float> picture);

/// Values of points as networks take them: (2C, N, N) planes, the front's C first, then the back's; 0 outside.
/// @param planes receives 2 C N^2 numbers
Status spreadPlanes(const CanonicalMaps& maps, std::span<const float> values, int channels, std::span<float> planes);

/// The way back: values (P, C) at the mask's pixels out of (2C, N, N) planes.
Status gatherPlanes(const CanonicalMaps& maps, std::span<const float> planes, int channels, std::span<float> values);

} // namespace ars
