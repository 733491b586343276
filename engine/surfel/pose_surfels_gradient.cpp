#include "engine/surfel/pose_surfels_gradient.h"

#include "engine/core/parallel.h"
#include "engine/rig/skinning_kernels.h"
#include "engine/surfel/pose_surfels_gradient_kernels.h"
#include "engine/surfel/pose_surfels_gradient_math.h"

#include <algorithm>
#include <array>

namespace ars {

namespace {

/// Pieces that sum the radii's gradients for themselves, so that the sum does not depend on threads.
constexpr std::size_t kPiece = 4096;

Error wrong(std::string message) {
    return makeError(ErrorCode::InvalidArgument, "posing gradient", std::move(message));
}

Status checkCount(std::string_view name, std::size_t found, std::size_t expected) {
    if (found == 0 || found == expected) return {};
    return wrong(fmt::format("{} has {} entries, expected {}", name, found, expected));
}

void backwardRadii(const PoseSurfelsGradientArrays& a) {
    const std::size_t pieces = (a.count + kPiece - 1) / kPiece;
    std::vector<std::array<double, kBodyPartCount>> sums(pieces);
    parallelFor(
        pieces,
        [&](std::size_t piece) {
            sums[piece].fill(0.0);
            for (std::size_t i = piece * kPiece; i < std::min(a.count, (piece + 1) * kPiece); ++i) {
                addPartRadii(a, i, sums[piece].data());
            }
        },
        1);
    for (std::size_t g = 0; g < kBodyPartCount; ++g) {
        double sum = 0.0;
        for (const auto& piece : sums) sum += piece[g];
        a.partRadii[g] = static_cast<float>(sum);
    }
}

} // namespace

namespace cpu {
void poseSurfelsBackward(const PoseSurfelsGradientArrays& arrays) {
    if (arrays.posedMeans || arrays.posedRotations) {
        parallelFor(arrays.count, [&](std::size_t i) { backwardPosedSurfel(arrays, i); });
    }
    if (arrays.posedRadii) backwardRadii(arrays);
}
} // namespace cpu

Status poseSurfelsBackwardOnDevice(const Device& device, const PoseSurfelsGradientArrays& arrays,
                                   PoseGradientWorkspace& workspace) {
    if (arrays.count == 0) return {};
    const bool geometry = arrays.posedMeans || arrays.posedRotations;
    if (!arrays.joints || !arrays.weights) return wrong("joints and weights must be given");
    if (geometry && !arrays.matrices) return wrong("joint matrices must be given");
    if (arrays.posedRotations && !arrays.rotations) return wrong("the canonical rotations must be given");
    if (arrays.posedRadii && !arrays.parts) return wrong("the joints' parts must be given");
    if (!arrays.means != !arrays.posedMeans || !arrays.gradRotations != !arrays.posedRotations ||
        !arrays.partRadii != !arrays.posedRadii) {
        return wrong("each gradient of means, rotations and radii needs its result, and no other");
    }
    if (device.kind == DeviceKind::Host) {
        cpu::poseSurfelsBackward(arrays);
        return {};
    }
#if defined(ARS_HAVE_CUDA)
    return cuda::poseSurfelsBackward(arrays, workspace, device);
#else
    (void)workspace;
    return makeError(ErrorCode::Unavailable, "posing gradient", "this program was built without CUDA");
#endif
}

Status poseSurfelsBackward(const SurfelPosing& posing, const SkinWeights& weights, const Surfels& canonical,
                           const PosedSurfelGradients& gradients, std::span<glm::vec3> gradMeans,
                           std::span<float> gradRotations, PartRadii& gradRadii) {
    const std::size_t n = canonical.count();
    if (weights.pointCount() != n)
        return wrong(fmt::format("weights of {} points for {} surfels", weights.pointCount(), n));
    ARS_TRY_STATUS(checkCount("dL/dmeans", gradients.means.size(), n));
    ARS_TRY_STATUS(checkCount("dL/drotations", gradients.rotations.size(), 4 * n));
    ARS_TRY_STATUS(checkCount("dL/dradii", gradients.radii.size(), n));
    if (gradMeans.size() < gradients.means.size() || gradRotations.size() < gradients.rotations.size()) {
        return wrong(fmt::format("room for {} means and {} rotations, expected {} and {}", gradMeans.size(),
                                 gradRotations.size() / 4, gradients.means.size(), gradients.rotations.size() / 4));
    }
    const std::size_t joints = std::min(posing.matrices.size(), posing.parts.size());
    if (n > 0 && largestJoint(weights.joints) >= joints) {
        return wrong(fmt::format("weights name joint {}, there are {}", largestJoint(weights.joints), joints));
    }
    const auto given = [](const auto& span) { return span.empty() ? nullptr : span.data(); };
    PoseSurfelsGradientArrays arrays;
    arrays.count = n;
    arrays.jointCount = joints;
    arrays.matrices = posing.matrices.data();
    arrays.parts = posing.parts.data();
    arrays.joints = weights.joints.data();
    arrays.weights = weights.weights.data();
    arrays.rotations = canonical.rotations.data();
    arrays.posedMeans = given(gradients.means);
    arrays.posedRotations = given(gradients.rotations);
    arrays.posedRadii = given(gradients.radii);
    arrays.means = gradMeans.data();
    arrays.gradRotations = gradRotations.data();
    arrays.partRadii = gradRadii.data();
    cpu::poseSurfelsBackward(arrays);
    return {};
}

} // namespace ars
