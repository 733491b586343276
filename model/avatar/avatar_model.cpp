#include "model/avatar/avatar_model.h"

#include "engine/maps/position_maps.h"
#include "engine/surfel/pose_surfels.h"

#include <ATen/ATen.h>

#include <algorithm>

namespace ars {
namespace {

/// (p, width) values at the input maps' points as the networks take them: (2, width, S, S), 0 outside.
Result<at::Tensor> planesOf(const CanonicalMaps& maps, std::span<const float> values, int width) {
    at::Tensor planes = at::empty({2, width, maps.size, maps.size});
    ARS_TRY_STATUS(
        spreadPlanes(maps, values, width, {planes.data_ptr<float>(), static_cast<std::size_t>(planes.numel())}));
    return planes;
}

std::span<const float> numbersOf(const std::vector<glm::vec3>& values) {
    return {values.empty() ? nullptr : &values.front().x, 3 * values.size()};
}

} // namespace

PartRadii learnedRadii(const AvatarSpec& spec) {
    PartRadii radii = spec.initialRadii;
    for (std::size_t g = 0; g < radii.size(); ++g) radii[g] *= std::clamp(1.0f + spec.radiusOffsets[g], 0.2f, 3.0f);
    return radii;
}

OcclusionParams shownOcclusion(const AvatarSpec& spec) {
    OcclusionParams shown = spec.occlusion;
    const OcclusionParams unset;
    shown.quality = unset.quality;
    shown.interactiveDirections = unset.interactiveDirections;
    return shown;
}

PoseSurfelsParams shownPosing(const AvatarSpec& spec) {
    PoseSurfelsParams shown = spec.posing;
    shown.trainingRadii = false;
    return shown;
}

BodyModel shapedBody(const BodyModel& body, const BodyShape& shape) {
    BodyModel shaped = body;
    shaped.templateVertices = shapedVertices(body, shape);
    shaped.shapeDirs.clear();
    shaped.shapeCount = 0;
    shaped.shapeNames.clear();
    shaped.expressionDirs.clear();
    shaped.expressionCount = 0;
    shaped.expressionNames.clear();
    return shaped;
}

Result<AvatarModel> createAvatar(AvatarSpec spec, TemplateMesh mesh, std::shared_ptr<const BodyModel> body,
                                 std::uint64_t seed) {
    spec.maps.size = 2 * spec.network.inputSize;
    if (!spec.maps.centerM && body) spec.maps.centerM = canonicalCenter(*body);
    AvatarModel model;
    ARS_TRY(model.maps, canonicalMaps(mesh, spec.maps));
    model.spec = std::move(spec);
    model.mesh = std::move(mesh);
    model.body = std::move(body);
    ARS_TRY_STATUS(completeAvatar(model, seed));
    return model;
}

Status completeAvatar(AvatarModel& model, std::uint64_t seed) {
    const AvatarSpec& spec = model.spec;
    ARS_TRY(model.inputMaps, halvedMaps(model.maps));
    ARS_TRY(AvatarNetwork network, AvatarNetwork::create(spec.network, seed));
    model.network = std::make_shared<AvatarNetwork>(std::move(network));
    ARS_TRY(model.base, surfelBase(model.maps, spec.decoding));
    model.pixels = at::empty({static_cast<std::int64_t>(model.maps.pointCount())}, at::kLong);
    std::copy(model.maps.pixels.begin(), model.maps.pixels.end(), model.pixels.data_ptr<std::int64_t>());
    model.weights = std::make_shared<SkinWeights>(model.maps.weights);
    return {};
}

Result<PoseMaps> poseMaps(const AvatarModel& model, const Pose& pose, bool project) {
    PoseMaps maps;
    if (model.spec.network.canonicalOnly) {
        maps.positions = model.inputMaps.positions;
        maps.priors.assign(kPriorWidth * maps.positions.size(), 0.0f);
        return maps;
    }
    ARS_TRY(maps.positions, posedMapPoints(model.mesh.skeleton(), model.inputMaps, pose));
    if (project && model.pca) {
        ARS_TRY(const PcaProjection projection,
                projectPose(*model.pca, {&maps.positions.front().x, 3 * maps.positions.size()}));
        maps.outOfRange = projection.outOfRange;
    }
    if (model.spec.network.priors != PriorMode::Off) {
        std::vector<glm::vec3> bodyVertices;
        if (model.body) bodyVertices = mapBodyVertices(*model.body, {}, pose);
        maps.priors.resize(kPriorWidth * maps.positions.size());
        ARS_TRY_STATUS(deformationPriors(model.inputMaps, maps.positions, bodyVertices, maps.priors));
    }
    return maps;
}

Result<AvatarNetworkInputs> networkInputs(const AvatarModel& model, const PoseMaps& maps) {
    AvatarNetworkInputs inputs;
    ARS_TRY(inputs.positions, planesOf(model.inputMaps, numbersOf(maps.positions), 3));
    if (model.spec.network.priors != PriorMode::Off) {
        ARS_TRY(inputs.priors, planesOf(model.inputMaps, maps.priors, kPriorWidth));
    }
    return inputs;
}

Result<at::Tensor> viewMap(const AvatarModel& model, const Pose& pose, const Camera& camera,
                           std::span<const glm::vec3> noise) {
    const CanonicalMaps& maps = model.inputMaps;
    ARS_TRY(const std::vector<glm::mat4> matrices,
            canonicalToPosed(skinningMatrices(model.mesh.skeleton(), pose), maps.canonical));
    std::vector<glm::vec3> points(maps.pointCount()), normals(maps.pointCount());
    ARS_TRY_STATUS(skinPointsAndNormals(matrices, maps.weights, maps.positions, maps.normals, points, normals));
    const glm::vec3 eye(camera.centerWorld());
    const int channels = viewMapChannels(model.spec.network);
    std::vector<float> rows;
    rows.reserve(static_cast<std::size_t>(channels) * points.size());
    for (std::size_t i = 0; i < points.size(); ++i) {
        const glm::vec3 away = eye - points[i];
        glm::vec3 direction = away / std::max(glm::length(away), 1e-3f);
        if (!noise.empty()) direction = glm::normalize(direction + noise[i]);
        rows.push_back(glm::dot(normals[i], direction));
        if (channels == 1) continue;
        const glm::vec3 normal = normals[i] / std::max(glm::length(normals[i]), 1e-6f);
        for (int axis = 0; axis < 3; ++axis) rows.push_back(normal[axis]);
    }
    return planesOf(maps, rows, channels);
}

Result<PosingContext> posingContext(const AvatarModel& model, const Pose& pose, const PoseSurfelsParams& params) {
    const Skeleton skeleton = model.mesh.skeleton();
    PosingContext context;
    context.params = params;
    ARS_TRY(context.matrices, canonicalToPosed(skinningMatrices(skeleton, pose), model.maps.canonical));
    context.jointPositions = posedJointPositions(skeleton, pose);
    context.parts = jointParts(skeleton);
    context.weights = model.weights;
    return context;
}

} // namespace ars
