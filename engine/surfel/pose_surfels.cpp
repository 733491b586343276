#include "engine/surfel/pose_surfels.h"

#include "engine/core/parallel.h"
#include "engine/rig/skinning_kernels.h"
#include "engine/surfel/pose_surfels_check.h"
#include "engine/surfel/pose_surfels_kernels.h"

#include <algorithm>

#include <cmath>
#include <limits>

namespace ars {
namespace {

static_assert(sizeof(glm::vec3) == 12 && sizeof(glm::vec2) == 8, "surfel arrays hold tightly packed GLM types");

Error wrong(std::string message) { return makeError(ErrorCode::InvalidArgument, "pose surfels", std::move(message)); }

bool isFinite(const glm::mat4& m) {
    for (int c = 0; c < 4; ++c) {
        for (int r = 0; r < 4; ++r) {
            if (!std::isfinite(m[c][r])) return false;
        }
    }
    return true;
}

Status checkParams(const PoseSurfelsParams& params) {
    if (!(params.importanceFalloffM > 0.0f) || !std::isfinite(params.importanceFalloffM)) {
        return wrong(
            fmt::format("the importance falls off over {} m, expected a positive length", params.importanceFalloffM));
    }
    if (!(params.radiusStepFraction >= 0.0f) || !(params.minRadiusStepM >= 0.0f)) {
        return wrong(fmt::format("radius steps are {} r and at least {} m, neither may be negative",
                                 params.radiusStepFraction, params.minRadiusStepM));
    }
    return {};
}

Status checkWeights(const SkinWeights& weights, std::size_t count, std::size_t jointCount) {
    if (weights.pointCount() != count || weights.joints.size() != count * kMaxInfluences ||
        weights.weights.size() != count * kMaxInfluences) {
        return wrong(
            fmt::format("skinning weights for {} points, but there are {} surfels", weights.pointCount(), count));
    }
    if (count > 0 && largestJoint(weights.joints) >= jointCount) {
        return wrong(fmt::format("a surfel follows joint {}, but there are only {} joints",
                                 largestJoint(weights.joints), jointCount));
    }
    return {};
}

Result<JointRadii> jointRadii(const SurfelPosing& posing) {
    JointRadii radii;
    for (const BodyPart part : posing.parts) {
        const auto index = static_cast<std::size_t>(part);
        if (index >= posing.radii.size()) return wrong(fmt::format("there is no body part {}", index));
        const float radius = posing.radii[index];
        if (!(radius > 0.0f) || !std::isfinite(radius)) {
            return wrong(
                fmt::format("the radius of the {} is {} m, expected a positive length", bodyPartName(part), radius));
        }
        radii.now.push_back(radius);
        radii.initial.push_back(bodyPartInitialRadiusM(part));
    }
    return radii;
}

/// Sizes the radius arrays and points `arrays` at them.
void aimRadii(const PoseSurfelsParams& params, std::size_t count, PosedSurfels& posed, PoseSurfelsArrays& arrays) {
    const std::size_t training = params.trainingRadii ? count : 0;
    posed.radii.resize(count);
    posed.radiiPlus.resize(training);
    posed.radiiMinus.resize(training);
    arrays.radii = posed.radii.data();
    arrays.radiiPlus = training ? posed.radiiPlus.data() : nullptr;
    arrays.radiiMinus = training ? posed.radiiMinus.data() : nullptr;
}

template <typename T>
bool aligned16(const T* pointer) {
    return reinterpret_cast<std::uintptr_t>(pointer) % 16 == 0;
}

} // namespace

const ParameterTable<PoseSurfelsParams>& poseSurfelsParameters() {
    static const ParameterTable<PoseSurfelsParams> table{
        {"importance_falloff",
         &PoseSurfelsParams::importanceFalloffM,
         {0.01, 2},
         "m",
         ParameterTier::Expert,
         "Distance from a joint over which the sample importance falls to 1/e [sigma]."},
        {"training_radii",
         &PoseSurfelsParams::trainingRadii,
         {},
         "",
         ParameterTier::Expert,
         "Also splat the radii r + epsilon and r - epsilon that the radius gradient needs."},
        {"radius_step",
         &PoseSurfelsParams::radiusStepFraction,
         {0, 0.5},
         "",
         ParameterTier::Expert,
         "Step of the radius gradient as a fraction of the radius [epsilon]."},
        {"min_radius_step",
         &PoseSurfelsParams::minRadiusStepM,
         {0, 0.1},
         "m",
         ParameterTier::Expert,
         "Smallest step of the radius gradient."},
    };
    return table;
}

PartRadii initialPartRadii() {
    PartRadii radii{};
    for (int part = 0; part < kBodyPartCount; ++part) {
        radii[static_cast<std::size_t>(part)] = bodyPartInitialRadiusM(static_cast<BodyPart>(part));
    }
    return radii;
}

PartRadii uniformPartRadii(float radiusM) {
    PartRadii radii{};
    radii.fill(radiusM);
    return radii;
}

Result<std::vector<glm::mat4>> canonicalToPosed(std::span<const glm::mat4> posed,
                                                std::span<const glm::mat4> canonical) {
    if (!canonical.empty() && canonical.size() != posed.size()) {
        return wrong(fmt::format("{} posed joint matrices and {} canonical ones", posed.size(), canonical.size()));
    }
    std::vector<glm::mat4> matrices(posed.begin(), posed.end());
    for (std::size_t j = 0; j < canonical.size(); ++j) {
        // In double: an inverse in float costs a tenth of a millimetre at arm's length.
        const glm::dmat4 own(canonical[j]);
        const double determinant = glm::determinant(own);
        if (!isFinite(canonical[j]) || !(std::abs(determinant) > 1e-12)) {
            return wrong(fmt::format("the canonical matrix of joint {} has no inverse", j));
        }
        matrices[j] = glm::mat4(glm::dmat4(posed[j]) * glm::inverse(own));
    }
    return matrices;
}

std::vector<glm::vec3> posedJointPositions(const Skeleton& skeleton, const Pose& pose) {
    std::vector<glm::vec3> positions;
    for (const glm::mat4& world : jointWorldMatrices(skeleton, pose)) positions.emplace_back(world[3]);
    return positions;
}

Result<JointRadii> checkPosing(const PoseSurfelsParams& params, const SurfelPosing& posing, const SkinWeights& weights,
                               std::size_t count) {
    const std::size_t joints = posing.matrices.size();
    ARS_TRY_STATUS(checkParams(params));
    ARS_TRY_STATUS(checkWeights(weights, count, joints));
    if (posing.jointPositions.size() != joints || posing.parts.size() != joints) {
        return wrong(fmt::format("{} joint matrices, {} joint positions and {} parts, expected equal counts", joints,
                                 posing.jointPositions.size(), posing.parts.size()));
    }
    return jointRadii(posing);
}

Status poseSurfels(const PoseSurfelsParams& params, const SurfelPosing& posing, const SkinWeights& weights,
                   const Surfels& canonical, PosedSurfels& posed) {
    const std::size_t count = canonical.count();
    const std::size_t joints = posing.matrices.size();
    ARS_TRY(const JointRadii radii, checkPosing(params, posing, weights, count));
    if (canonical.rotations.size() != 4 * count) {
        return wrong(fmt::format("rotations has {} numbers, expected {} for {} surfels", canonical.rotations.size(),
                                 4 * count, count));
    }
    posed.means.resize(count);
    posed.rotations.resize(4 * count);
    posed.importances.resize(count);
    posed.bones.resize(count);

    PoseSurfelsArrays arrays;
    aimRadii(params, count, posed, arrays);
    arrays.count = count;
    arrays.jointCount = joints;
    arrays.matrices = posing.matrices.data();
    arrays.jointPositions = posing.jointPositions.data();
    arrays.jointRadii = radii.now.data();
    arrays.jointInitialRadii = radii.initial.data();
    arrays.joints = weights.joints.data();
    arrays.weights = weights.weights.data();
    arrays.means = canonical.means.data();
    arrays.rotations = canonical.rotations.data();
    arrays.posedMeans = posed.means.data();
    arrays.posedRotations = posed.rotations.data();
    arrays.importances = posed.importances.data();
    arrays.bones = posed.bones.data();
    cpu::poseSurfels(params, arrays);
    return {};
}

Status poseRadii(const PoseSurfelsParams& params, const SurfelPosing& posing, const SkinWeights& weights,
                 PosedSurfels& posed) {
    ARS_TRY_STATUS(checkParams(params));
    ARS_TRY_STATUS(checkWeights(weights, posed.count(), posing.parts.size()));
    ARS_TRY(const JointRadii radii, jointRadii(posing));
    PoseSurfelsArrays arrays;
    aimRadii(params, posed.count(), posed, arrays);
    arrays.count = posed.count();
    arrays.jointCount = posing.parts.size();
    arrays.jointRadii = radii.now.data();
    arrays.joints = weights.joints.data();
    arrays.weights = weights.weights.data();
    cpu::poseSurfels(params, arrays);
    return {};
}

SurfelView liveView(const Surfels& canonical, const PosedSurfels& posed) {
    assert(canonical.count() == posed.count());
    auto pointer = [](const auto& values) { return values.empty() ? nullptr : values.data(); };
    SurfelView view = viewOf(canonical);
    view.means = pointer(posed.means);
    view.rotations = pointer(posed.rotations);
    view.radii = pointer(posed.radii);
    view.radiiPlus = pointer(posed.radiiPlus);
    view.radiiMinus = pointer(posed.radiiMinus);
    view.importances = pointer(posed.importances);
    view.bones = pointer(posed.bones);
    return view;
}

Surfels liveSurfels(const Surfels& canonical, const PosedSurfels& posed) {
    assert(canonical.count() == posed.count());
    Surfels live = canonical;
    live.means = posed.means;
    live.rotations = posed.rotations;
    live.radii = posed.radii;
    live.radiiPlus = posed.radiiPlus;
    live.radiiMinus = posed.radiiMinus;
    live.importances = posed.importances;
    live.bones = posed.bones;
    return live;
}

Status poseSurfelsOnDevice(const PoseSurfelsParams& params, const Device& device, const PoseSurfelsArrays& arrays) {
    ARS_TRY_STATUS(checkParams(params));
    if (arrays.count == 0) return {};
    const bool geometry = arrays.posedMeans || arrays.posedRotations || arrays.importances || arrays.bones;
    if (geometry && (!arrays.posedMeans || !arrays.posedRotations)) {
        return wrong("posed means and posed rotations must be given together");
    }
    if (!arrays.joints || !arrays.weights || !aligned16(arrays.joints) || !aligned16(arrays.weights)) {
        return wrong("joints and weights must be given, aligned to 16 bytes");
    }
    if (geometry && (!arrays.matrices || !arrays.means || !arrays.rotations)) {
        return wrong("joint matrices, means and rotations must be given");
    }
    if (arrays.importances && (!arrays.jointPositions || !arrays.jointInitialRadii)) {
        return wrong("importance needs joint positions and initial radii");
    }
    if ((arrays.radii && !arrays.jointRadii) || ((arrays.radiiPlus || arrays.radiiMinus) && !arrays.radii)) {
        return wrong("radii need the joints' radii, and R+ and R- need radii");
    }
    if (device.kind == DeviceKind::Host) {
        for (std::size_t i = 0; i < arrays.count * kMaxInfluences; ++i) {
            if (arrays.joints[i] < arrays.jointCount) continue;
            return wrong(fmt::format("surfel {} follows joint {}, but there are only {} joints", i / kMaxInfluences,
                                     arrays.joints[i], arrays.jointCount));
        }
        cpu::poseSurfels(params, arrays);
        return {};
    }
#if defined(ARS_HAVE_CUDA)
    return cuda::poseSurfels(params, arrays, device.index);
#else
    return makeError(ErrorCode::Unavailable, "pose surfels", "this program was built without CUDA");
#endif
}

} // namespace ars
