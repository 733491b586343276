#pragma once

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

} // namespace ars
