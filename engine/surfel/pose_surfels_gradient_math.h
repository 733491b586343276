#pragma once

#include "engine/rig/body_parts.h"
#include "engine/surfel/pose_surfels_gradient.h"
#include "engine/surfel/pose_surfels_math.h"

namespace ars {

/// dL/d of the linear part's argument: M^T g.
template <typename T>
ARS_HD glm::vec<3, T> transformPointBackward(const Affine<T>& a, const glm::vec<3, T>& g) {
    return {a.row[0].x * g.x + a.row[1].x * g.y + a.row[2].x * g.z,
            a.row[0].y * g.x + a.row[1].y * g.y + a.row[2].y * g.z,
            a.row[0].z * g.x + a.row[1].z * g.y + a.row[2].z * g.z};
}

/// Backward of turnedRotation with respect to `own`. Turning by a unit quaternion is orthogonal, so its transpose is
/// turning back; what is left is the normalisation.
template <typename T>
ARS_HD glm::qua<T> turnedRotationBackward(const glm::qua<T>& turn, const glm::qua<T>& own, const glm::qua<T>& g) {
    const T length2 = own.w * own.w + own.x * own.x + own.y * own.y + own.z * own.z;
    if (!(length2 > T(1e-20)) || !(length2 < T(1e20))) return glm::qua<T>(T(0), T(0), T(0), T(0));
    const glm::qua<T> back = glm::qua<T>(turn.w, -turn.x, -turn.y, -turn.z) * g;
    const T inverse = T(1) / std::sqrt(length2);
    const glm::qua<T> unit(own.w * inverse, own.x * inverse, own.y * inverse, own.z * inverse);
    const T along = back.w * unit.w + back.x * unit.x + back.y * unit.y + back.z * unit.z;
    return glm::qua<T>((back.w - along * unit.w) * inverse, (back.x - along * unit.x) * inverse,
                       (back.y - along * unit.y) * inverse, (back.z - along * unit.z) * inverse);
}

/// Means and rotation of surfel i.
ARS_HD inline void backwardPosedSurfel(const PoseSurfelsGradientArrays& a, std::size_t i) {
    Affine<float> blend = {};
    for (std::size_t k = i * kMaxInfluences; k < (i + 1) * kMaxInfluences; ++k) {
        if (a.weights[k] == 0.0f || a.joints[k] >= a.jointCount) continue;
        const Affine<float> one = affineFrom<float>(a.matrices[a.joints[k]]);
        for (int r = 0; r < 3; ++r) blend.row[r] += a.weights[k] * one.row[r];
    }
    if (a.posedMeans) a.means[i] = transformPointBackward(blend, a.posedMeans[i]);
    if (!a.posedRotations) return;
    const float *own = a.rotations + 4 * i, *g = a.posedRotations + 4 * i;
    const glm::qua<float> result = turnedRotationBackward(
        polarRotation(blend), glm::qua<float>(own[0], own[1], own[2], own[3]), glm::qua<float>(g[0], g[1], g[2], g[3]));
    float* to = a.gradRotations + 4 * i;
    to[0] = result.w;
    to[1] = result.x;
    to[2] = result.y;
    to[3] = result.z;
}

/// What surfel i passes to the radii of the parts (r_i = sum_j w_ij r_part(j)): adds to the nine sums.
ARS_HD inline void addPartRadii(const PoseSurfelsGradientArrays& a, std::size_t i, double* sums) {
    const auto g = static_cast<double>(a.posedRadii[i]);
    for (std::size_t k = i * kMaxInfluences; k < (i + 1) * kMaxInfluences; ++k) {
        if (a.joints[k] >= a.jointCount) continue;
        const int part = static_cast<int>(a.parts[a.joints[k]]);
        if (part >= 0 && part < kBodyPartCount) sums[part] += static_cast<double>(a.weights[k]) * g;
    }
}

} // namespace ars
