#pragma once

#include "engine/core/error.h"
#include "engine/rig/body_model.h"
#include "engine/rig/gltf_rig.h"
#include "engine/rig/motion.h"
#include "engine/rig/template_mesh.h"

#include <filesystem>
#include <span>
#include <string_view>
#include <vector>

namespace ars {

/// Files that a posed rig can be written to.
enum class PosedFormat { Obj, Ply, Npz, Glb };

/// From a file name's extension. InvalidArgument lists what is known.
Result<PosedFormat> posedFormatFor(const std::filesystem::path& path);

/// A rig's mesh in one pose: positions, normals (where the mesh has any; turned with the skin) and joints.
/// InvalidArgument when the pose has another number of joints.
struct PosedMesh {
    TriangleMesh mesh;
    std::vector<glm::vec3> joints; ///< posed joint positions, metres
};
Result<PosedMesh> poseRig(const RiggedMesh& rig, const Pose& pose);

/// A body with all its deformations in one pose: shape, expression, pose blend shapes, skinning.
PosedMesh poseBody(const BodyModel& body, const BodyShape& shape, const Pose& pose);

/// Writes a posed mesh, without a skeleton: OBJ, PLY, or npz with v (N,3) f4, f (F,3) i8, joints (J,3) f4 and, where
/// the mesh has them, uv (N,2) f4. glb: a static mesh with the materials and pictures given.
Status writePosedMesh(const std::filesystem::path& path, PosedFormat format, const PosedMesh& posed,
                      std::span<const GltfMaterial> materials = {}, std::span<const GltfImage> images = {});

/// Writes a rig as glb with skeleton, skin, materials and pictures, standing in its rest pose, with an animation when
/// there is a motion. Opens in Blender. A single pose becomes an animation of one frame.
Status writeRiggedGlb(const std::filesystem::path& path, const RiggedMesh& rig, const Motion* motion = nullptr);

/// Export of one rig in one pose in any format: glb keeps skeleton and skin (the pose as an animation of one frame),
/// the others hold the posed mesh.
Status exportPosed(const std::filesystem::path& path, const RiggedMesh& rig, const Pose& pose);

} // namespace ars
