#include "engine/surfel/pose_surfels_gradient.h"

#include "engine/core/parallel.h"
#include "engine/surfel/pose_surfels_gradient_math.h"

#include <algorithm>
#include <array>

namespace ars {

namespace {

/// Pieces that sum the radii's gradients for themselves, so that the sum does not depend on threads.
constexpr std::size_t kPiece = 4096;

Status checkCount(std::string_view name, std::size_t found, std::size_t expected) {
    if (found == 0 || found == expected) return {};
    return makeError(ErrorCode::InvalidArgument, "posing gradient",
                     fmt::format("{} has {} entries, expected {}", name, found, expected));
}

Affine<float> blendOf(const std::vector<Affine<float>>& matrices, const SkinWeights& weights, std::size_t i) {
    return blendAffine(matrices.data(), weights.joints.data() + i * kMaxInfluences,
                       weights.weights.data() + i * kMaxInfluences, kMaxInfluences);
}

void backwardGeometry(const std::vector<Affine<float>>& matrices, const SkinWeights& weights, const Surfels& canonical,
                      const PosedSurfelGradients& gradients, std::span<glm::vec3> gradMeans,
                      std::span<float> gradRotations, std::size_t i) {
    const Affine<float> blend = blendOf(matrices, weights, i);
    if (!gradients.means.empty()) gradMeans[i] = transformPointBackward(blend, gradients.means[i]);
    if (gradients.rotations.empty()) return;
    const float* own = canonical.rotations.data() + 4 * i;
    const float* g = gradients.rotations.data() + 4 * i;
    const glm::quat result = turnedRotationBackward(polarRotation(blend), glm::quat(own[0], own[1], own[2], own[3]),
                                                    glm::quat(g[0], g[1], g[2], g[3]));
    const float values[4] = {result.w, result.x, result.y, result.z};
    std::copy(values, values + 4, gradRotations.begin() + static_cast<std::ptrdiff_t>(4 * i));
}

/// r_i = sum_j w_ij r_part(j): dL/dr_g = sum_i (sum over j in g of w_ij) dL/dr_i.
PartRadii backwardRadii(const SurfelPosing& posing, const SkinWeights& weights, std::span<const float> gradients) {
    const std::size_t pieces = (gradients.size() + kPiece - 1) / kPiece;
    std::vector<std::array<double, kBodyPartCount>> sums(pieces);
    parallelFor(
        pieces,
        [&](std::size_t piece) {
            std::array<double, kBodyPartCount>& sum = sums[piece];
            sum.fill(0.0);
            for (std::size_t i = piece * kPiece; i < std::min(gradients.size(), (piece + 1) * kPiece); ++i) {
                for (std::size_t k = i * kMaxInfluences; k < (i + 1) * kMaxInfluences; ++k) {
                    const BodyPart part = posing.parts[weights.joints[k]];
                    sum[static_cast<std::size_t>(part)] += static_cast<double>(weights.weights[k]) * gradients[i];
                }
            }
        },
        1);
    PartRadii result{};
    for (std::size_t g = 0; g < kBodyPartCount; ++g) {
        double sum = 0.0;
        for (const auto& piece : sums) sum += piece[g];
        result[g] = static_cast<float>(sum);
    }
    return result;
}

} // namespace

Status poseSurfelsBackward(const SurfelPosing& posing, const SkinWeights& weights, const Surfels& canonical,
                           const PosedSurfelGradients& gradients, std::span<glm::vec3> gradMeans,
                           std::span<float> gradRotations, PartRadii& gradRadii) {
    const std::size_t n = canonical.count();
    if (weights.pointCount() != n) {
        return makeError(ErrorCode::InvalidArgument, "posing gradient",
                         fmt::format("weights of {} points for {} surfels", weights.pointCount(), n));
    }
    ARS_TRY_STATUS(checkCount("dL/dmeans", gradients.means.size(), n));
    ARS_TRY_STATUS(checkCount("dL/drotations", gradients.rotations.size(), 4 * n));
    ARS_TRY_STATUS(checkCount("dL/dradii", gradients.radii.size(), n));
    if (gradMeans.size() < gradients.means.size() || gradRotations.size() < gradients.rotations.size()) {
        return makeError(ErrorCode::InvalidArgument, "posing gradient",
                         fmt::format("room for {} means and {} rotations, expected {} and {}", gradMeans.size(),
                                     gradRotations.size() / 4, gradients.means.size(), gradients.rotations.size() / 4));
    }
    const auto largest = std::max_element(weights.joints.begin(), weights.joints.end());
    const std::size_t joints = std::min(posing.matrices.size(), posing.parts.size());
    if (largest != weights.joints.end() && *largest >= joints) {
        return makeError(ErrorCode::InvalidArgument, "posing gradient",
                         fmt::format("weights name joint {}, there are {}", *largest, joints));
    }
    if (!gradients.means.empty() || !gradients.rotations.empty()) {
        std::vector<Affine<float>> matrices;
        for (const glm::mat4& matrix : posing.matrices) matrices.push_back(affineFrom<float>(matrix));
        parallelFor(n, [&](std::size_t i) {
            backwardGeometry(matrices, weights, canonical, gradients, gradMeans, gradRotations, i);
        });
    }
    if (!gradients.radii.empty()) gradRadii = backwardRadii(posing, weights, gradients.radii);
    return {};
}

} // namespace ars
