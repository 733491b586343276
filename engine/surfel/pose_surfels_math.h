#pragma once

#include "engine/core/host_device.h"
#include "engine/rig/skinning_math.h"

#include <glm/glm.hpp>
#include <glm/gtc/quaternion.hpp>

#include <cmath>
#include <cstdint>

namespace ars {

/// Joints that a surfel follows and how much; the first `count` of its row.
template <typename T>
struct Influences {
    const std::uint16_t* joints = nullptr;
    const T* weights = nullptr;
    int count = 0;
};

/// sum_j w_j r_j: the occlusion radius of a surfel from those of its joints' parts (paper Sec. 3.4), metres.
template <typename T>
ARS_HD T blendedRadius(const Influences<T>& influences, const T* jointRadii) {
    T radius = T(0);
    for (int k = 0; k < influences.count; ++k) radius += influences.weights[k] * jointRadii[influences.joints[k]];
    return radius;
}

/// epsilon = max(fraction r, smallest): the step of the radius' finite difference (design section 4), metres.
template <typename T>
ARS_HD T radiusStep(T radius, T fraction, T smallest) {
    const T step = fraction * radius;
    return step > smallest ? step : smallest;
}

/// I = sum_j w_j e^(-|x - p_j| / sigma) r_j / sum_j w_j r_j, clamped to [0, 1] (supplement, Sample Importance Map; the
/// exponential stands in the numerator alone). `r_j` are the initial radii. Without any weight: 0.
template <typename T>
ARS_HD T surfelImportance(const Influences<T>& influences, const glm::vec<3, T>& x,
                          const glm::vec<3, T>* jointPositions, const T* jointInitialRadii, T sigma) {
    T numerator = T(0), denominator = T(0);
    for (int k = 0; k < influences.count; ++k) {
        const std::uint16_t j = influences.joints[k];
        const glm::vec<3, T> away = x - jointPositions[j];
        const T share = influences.weights[k] * jointInitialRadii[j];
        numerator += share * std::exp(-std::sqrt(glm::dot(away, away)) / sigma);
        denominator += share;
    }
    if (!(denominator > T(0))) return T(0);
    const T importance = numerator / denominator;
    return importance < T(1) ? (importance > T(0) ? importance : T(0)) : T(1);
}

/// Two quaternions one after the other, unit length: `turn` after `own`. `own` may have any length; of zero length or
/// not finite it counts as no rotation.
template <typename T>
ARS_HD glm::qua<T> turnedRotation(const glm::qua<T>& turn, glm::qua<T> own) {
    const T length2 = own.w * own.w + own.x * own.x + own.y * own.y + own.z * own.z;
    if (!(length2 > T(1e-20)) || !(length2 < T(1e20))) return turn;
    const glm::qua<T> q = turn * own;
    const T scale = T(1) / std::sqrt(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z);
    return glm::qua<T>(q.w * scale, q.x * scale, q.y * scale, q.z * scale);
}

/// q_bone = normalize(sum_j w_j V_j e_y) (supplement, Eq. boneup). Joint matrices are rigid, so V_j e_y is the second
/// column of M_j and the sum that of the blend. Where opposite turns cancel, the polar rotation's e_y stands in.
template <typename T>
ARS_HD glm::vec<3, T> boneDirection(const Affine<T>& blend, const glm::qua<T>& polar) {
    const glm::vec<3, T> sum(blend.row[0].y, blend.row[1].y, blend.row[2].y);
    const T length2 = glm::dot(sum, sum);
    if (!(length2 > T(1e-12)) || !(length2 < T(1e12))) {
        return rotateNormal(polar, glm::vec<3, T>(T(0), T(1), T(0)));
    }
    return sum * (T(1) / std::sqrt(length2));
}

/// A surfel after stage 4.
template <typename T>
struct PosedSurfel {
    glm::vec<3, T> mean;
    glm::qua<T> rotation;
    glm::vec<3, T> bone;
};

/// mu_o = R mu_c + T, r_o = R r_c with the blended matrix of linear blend skinning; R orthonormalised for the rotation.
template <typename T>
ARS_HD PosedSurfel<T> posedSurfel(const Affine<T>& blend, const glm::vec<3, T>& mean, const glm::qua<T>& rotation) {
    const glm::qua<T> polar = polarRotation(blend);
    return {transformPoint(blend, mean), turnedRotation(polar, rotation), boneDirection(blend, polar)};
}

} // namespace ars
