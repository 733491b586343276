#include "engine/core/parallel.h"
#include "engine/surfel/pose_surfels_kernels.h"
#include "engine/surfel/pose_surfels_math.h"

#include <vector>

namespace ars::cpu {
namespace {

constexpr std::size_t kGrain = 2048;

/// Influences of surfel i up to the last that has a weight: most surfels follow two or three joints, not eight.
Influences<float> influencesOf(const PoseSurfelsArrays& a, std::size_t i) {
    const float* weights = a.weights + i * kMaxInfluences;
    int count = kMaxInfluences;
    while (count > 1 && weights[count - 1] == 0.0f) --count;
    return {a.joints + i * kMaxInfluences, weights, count};
}

glm::quat readRotation(const float* q) { return glm::quat(q[0], q[1], q[2], q[3]); }

void writeRotation(float* to, const glm::quat& q) {
    to[0] = q.w;
    to[1] = q.x;
    to[2] = q.y;
    to[3] = q.z;
}

void writeRadii(const PoseSurfelsParams& params, const PoseSurfelsArrays& a, std::size_t i,
                const Influences<float>& influences) {
    const float radius = blendedRadius(influences, a.jointRadii);
    const float step = radiusStep(radius, params.radiusStepFraction, params.minRadiusStepM);
    a.radii[i] = radius;
    if (a.radiiPlus) a.radiiPlus[i] = radius + step;
    if (a.radiiMinus) a.radiiMinus[i] = radius - step;
}

} // namespace

void poseSurfels(const PoseSurfelsParams& params, const PoseSurfelsArrays& arrays) {
    std::vector<Affine<float>> matrices(arrays.matrices ? arrays.jointCount : 0);
    for (std::size_t j = 0; j < matrices.size(); ++j) matrices[j] = affineFrom<float>(arrays.matrices[j]);
    const PoseSurfelsArrays a = arrays;
    const Affine<float>* table = matrices.data();
    const bool geometry = a.posedMeans != nullptr;
    parallelRanges(a.count, kGrain, [&params, &a, table, geometry](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            const Influences<float> influences = influencesOf(a, i);
            if (a.radii) writeRadii(params, a, i, influences);
            if (!geometry) continue;
            const Affine<float> blend = blendAffine(table, influences.joints, influences.weights, influences.count);
            const PosedSurfel<float> posed = posedSurfel(blend, a.means[i], readRotation(a.rotations + 4 * i));
            a.posedMeans[i] = posed.mean;
            writeRotation(a.posedRotations + 4 * i, posed.rotation);
            if (a.bones) a.bones[i] = posed.bone;
            if (a.importances) {
                a.importances[i] = surfelImportance(influences, posed.mean, a.jointPositions, a.jointInitialRadii,
                                                    params.importanceFalloffM);
            }
        }
    });
}

} // namespace ars::cpu
