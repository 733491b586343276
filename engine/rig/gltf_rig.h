#pragma once

#include "engine/core/error.h"
#include "engine/core/limits.h"
#include "engine/io/gltf.h"
#include "engine/rig/body_parts.h"
#include "engine/rig/motion.h"
#include "engine/rig/skeleton.h"
#include "engine/rig/skinning.h"

#include <filesystem>
#include <string>
#include <vector>

namespace ars {

/// Where the rest pose of a rig's joints came from.
enum class RestSource {
    NodeTransforms, ///< nodes and inverse bind matrices agree (or the file has no inverse bind matrices)
    BindMatrices,   ///< they disagree: the file was saved in another pose; the bind pose is the rest pose
};

/// A skinned mesh with its skeleton, ready to pose: everything in one model space (metres, y up), rigid joints.
///
/// `mesh` is in the rest pose of `skeleton`, so skinning with restPose leaves it where it is. Scales of the file's
/// nodes (centimetre rigs, non-uniform ones) are worked into positions and joints; joints themselves turn and move
/// only.
struct RiggedMesh {
    std::string name;
    Skeleton skeleton;                   ///< parents before children
    TriangleMesh mesh;                   ///< all skinned parts, and rigid parts that hang on a joint
    SkinWeights weights;                 ///< one row per vertex of `mesh`
    std::vector<GltfMaterial> materials; ///< TriangleMesh::materials point here; -1: none
    std::vector<GltfImage> images;       ///< encoded pictures that the materials point to
    std::vector<BodyPart> parts;         ///< body part of each joint
    std::vector<int> jointNodes;         ///< glTF node of each joint, to find its animation; empty when not from a file
    bool isSmplx = false;                ///< the 55 SMPL-X joints in the model's order, all rest orientations identity
    RestSource restSource = RestSource::NodeTransforms;
    float restDisagreementM = 0.0f; ///< largest distance between a joint in the node pose and in the bind pose
    std::vector<std::string> notes; ///< what was left out or guessed, one sentence each
};

/// Any glTF or glb with at least one skin as a rig.
///
/// Joints are the skins' joints and the nodes between them. Where nodes and inverse bind matrices disagree, the inverse
/// bind matrices win (they are what the mesh was modelled in) and `restSource` says so; the mesh is placed in the scene
/// by its topmost joint's node. Meshes without a skin follow the nearest joint above them with weight 1; those with no
/// joint above are left out with a note. Weights are cut to the 8 largest; a vertex without any follows the topmost
/// joint, with a note. Default weights of blend shapes are applied. Inverse bind matrices that are all alike say
/// nothing about a bind pose; then the nodes' pose is the rest pose. A mirrored joint keeps the nearest proper
/// orientation.
///
/// A rig that has all 55 SMPL-X names, in any order, is brought into SMPL-X's order; further joints give their weights
/// to the nearest SMPL-X joint above them.
///
/// Unsupported when no mesh is skinned; BadFile for an inverse bind matrix that cannot be inverted and positions that
/// are not finite; LimitExceeded for more than `limits.maxJoints` joints or `limits.maxElements` vertices.
Result<RiggedMesh> readGltfRig(const std::filesystem::path& path, const ReadLimits& limits = defaultReadLimits());
Result<RiggedMesh> rigFromGltf(const GltfDocument& document, const ReadLimits& limits = defaultReadLimits());

/// Every mesh of the scene that has no skin, placed by its nodes, as one mesh in model space. For templates without
/// weights. Unsupported when there is none; LimitExceeded, BadFile as above.
Result<TriangleMesh> staticMeshFromGltf(const GltfDocument& document, const ReadLimits& limits = defaultReadLimits());

/// The way back: one node per joint, one skinned mesh with a primitive per material, materials and images; opens in
/// Blender. With a motion (same number of joints) an animation of rotations, and of the root's translation.
/// InvalidArgument when the rig's parts do not fit together or the motion has another number of joints.
Result<GltfDocument> gltfFromRig(const RiggedMesh& rig, const Motion* motion = nullptr);

} // namespace ars
