#pragma once

#include "engine/core/error.h"
#include "engine/frame/avatar_evaluator.h"
#include "engine/light/cube_map.h"
#include "engine/maps/canonical_maps.h"
#include "engine/maps/pose_pca.h"
#include "engine/occlusion/ambient_occlusion.h"
#include "engine/rig/body_model.h"
#include "engine/rig/template_mesh.h"
#include "model/avatar/surfel_decoding.h"
#include "model/network/avatar_network.h"
#include "model/network/inference_network.h"

#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>

namespace ars {

/// What an avatar is, without its learned numbers: enough to build everything else. avatar.json.
struct AvatarSpec {
    AvatarNetworkConfig network;
    DecodingParams decoding;
    CanonicalMapOptions maps; ///< size 2 S, extent, centre
    PartRadii initialRadii = initialPartRadii();
    PartRadii radiusOffsets{}; ///< delta_g; r_g = r_init (1 + delta_g)
    // What its pictures were compared with in training; frames of it are made in the same way.
    SplatParams splat;         ///< kernel and depth
    bool occluded = true;      ///< false: shaded without occlusion
    OcclusionParams occlusion; ///< with the quality and the directions of a training step
    PoseSurfelsParams posing;
    std::string preset;
    std::string origin; ///< "run DIR, step N of capture DIR": for people
};

/// Everything of an avatar in memory: template, maps, networks, base, light, PCA.
struct AvatarModel {
    AvatarSpec spec;
    TemplateMesh mesh;
    CanonicalMaps maps;                    ///< size 2 S
    CanonicalMaps inputMaps;               ///< halvedMaps
    std::shared_ptr<const BodyModel> body; ///< for the prior s; shape and expression already in its template vertices
    std::shared_ptr<AvatarNetwork> network;
    SurfelBase base;
    at::Tensor pixels;                          ///< (P) int64: maps.pixels, for the networks
    std::shared_ptr<const SkinWeights> weights; ///< maps.weights, for posing
    std::optional<CubeMap> light;               ///< learned or given in training
    std::optional<PosePca> pca;
};

/// Network inputs of a pose.
struct PoseMaps {
    std::vector<glm::vec3> positions; ///< (p) of inputMaps' points, root-free
    std::vector<float> priors;        ///< (p, 5)
    float outOfRange = 0;             ///< PCA: how far outside the training poses, metres
};
/// Position and prior maps; with `project` and a PCA the positions are projected first and the priors follow.
Result<PoseMaps> poseMaps(const AvatarModel& model, const Pose& pose, bool project);
/// The same as the networks take them; constant canonical maps with AvatarNetworkConfig::canonicalOnly.
Result<AvatarNetworkInputs> networkInputs(const AvatarModel& model, const PoseMaps& maps);
/// View map of a camera (avatar reference 1.6): cosine of the angle between the skinned template's normal and the
/// direction to the camera, (2, V, S, S); with AvatarNetworkConfig::viewNormals the normal in the world follows, which
/// tells a turning person from a turning camera. `noise` (p) is added to the directions (training), or empty.
Result<at::Tensor> viewMap(const AvatarModel& model, const Pose& pose, const Camera& camera,
                           std::span<const glm::vec3> noise = {});
/// What stage 4 needs of a pose.
Result<PosingContext> posingContext(const AvatarModel& model, const Pose& pose, const PoseSurfelsParams& params = {});

/// A body at a shape, without shape directions: what AvatarModel::body holds.
BodyModel shapedBody(const BodyModel& body, const BodyShape& shape);
/// An avatar before any training. Errors of the maps; `spec.maps` gets the body's centre where it has none.
Result<AvatarModel> createAvatar(AvatarSpec spec, TemplateMesh mesh, std::shared_ptr<const BodyModel> body,
                                 std::uint64_t seed);
/// Input maps, networks drawn from the seed, base values: what follows from spec and maps.
Status completeAvatar(AvatarModel& model, std::uint64_t seed);

/// The files of an avatar into a folder that exists (a checkpoint's).
Status writeAvatarFiles(const std::filesystem::path& folder, const AvatarModel& model, const Image& preview);
/// Writes NAME.avatar/ (design section 5): avatar.json, weights.safetensors, template.glb, light.exr, pca.safetensors,
/// to a temporary name that is synced and renamed. `preview` (sRGB picture) may be empty. InvalidArgument where
/// something else than an avatar stands there; an avatar is replaced, and stays where the new one cannot be written.
Status writeAvatar(const std::filesystem::path& folder, const AvatarModel& model, const Image& preview);
/// Reads one, or a checkpoint of a run. Every error names the file.
Result<AvatarModel> readAvatar(const std::filesystem::path& folder);

/// r_g = r_init (1 + delta), kept in [0.2, 3] r_init.
PartRadii learnedRadii(const AvatarSpec& spec);
/// Occlusion as frames take it: how many directions a picture affords is theirs to say, not a training step's.
OcclusionParams shownOcclusion(const AvatarSpec& spec);
/// Posing as frames take it: without the radii that only a training needs.
PoseSurfelsParams shownPosing(const AvatarSpec& spec);

/// A trained avatar as frames use it. Evaluations are serialised by a lock of its own: any thread may call.
std::shared_ptr<AvatarEvaluator> makeTrainedAvatar(AvatarModel model, bool project,
                                                   NetworkPrecision precision = NetworkPrecision::Float32);

} // namespace ars
