#include "engine/core/parallel.h"
#include "engine/rig/skinning.h"
#include "engine/rig/skinning_kernels.h"

#include <vector>

namespace ars::cpu {
namespace {

constexpr std::size_t kGrain = 2048;

std::vector<Affine<float>> affineMatrices(const SkinArguments& arguments) {
    std::vector<Affine<float>> matrices(arguments.jointCount);
    for (std::size_t j = 0; j < matrices.size(); ++j) matrices[j] = affineFrom<float>(arguments.matrices[j]);
    return matrices;
}

} // namespace

void skin(const SkinArguments& arguments) {
    const std::vector<Affine<float>> matrices = affineMatrices(arguments);
    const SkinArguments a = arguments;
    const Affine<float>* table = matrices.data();
    parallelRanges(a.pointCount, kGrain, [&a, table](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            const Affine<float> blend =
                blendAffine(table, a.joints + i * kMaxInfluences, a.weights + i * kMaxInfluences, kMaxInfluences);
            a.points[i] = transformPoint(blend, a.restPoints[i]);
            if (a.normals) a.normals[i] = rotateNormal(polarRotation(blend), a.restNormals[i]);
        }
    });
}

void skinRotations(const SkinArguments& arguments, glm::quat* rotations) {
    const std::vector<Affine<float>> matrices = affineMatrices(arguments);
    const SkinArguments a = arguments;
    const Affine<float>* table = matrices.data();
    parallelRanges(a.pointCount, kGrain, [&a, table, rotations](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            rotations[i] = polarRotation(
                blendAffine(table, a.joints + i * kMaxInfluences, a.weights + i * kMaxInfluences, kMaxInfluences));
        }
    });
}

} // namespace ars::cpu
