#pragma once

#include "engine/core/error.h"
#include "engine/core/limits.h"
#include "engine/core/progress.h"
#include "engine/io/gltf.h"
#include "engine/rig/body_model.h"
#include "engine/rig/gltf_rig.h"
#include "engine/rig/weight_diffusion.h"

#include <filesystem>
#include <span>
#include <string>
#include <vector>

namespace ars {

/// Where a template's weights came from.
enum class WeightSource { Body, Given, Diffused };
std::string_view weightSourceName(WeightSource source);

/// The mesh that an avatar is built on: a body or a clothed person in the T-pose, skinned to the 55 SMPL-X joints.
/// Metres, y up, +z front, +x the body's left.
struct TemplateMesh {
    std::string name;
    TriangleMesh mesh;                   ///< T-pose
    SkinWeights weights;                 ///< one row per vertex of `mesh`, joints 0..54
    std::vector<glm::vec3> joints;       ///< (55) rest positions
    std::vector<GltfMaterial> materials; ///< TriangleMesh::materials point here; -1: none
    std::vector<GltfImage> images;       ///< encoded pictures that the materials point to
    WeightSource weightSource = WeightSource::Given;
    DiffusionReport diffusion;      ///< filled when weightSource is Diffused
    std::vector<std::string> notes; ///< what was changed or guessed, one sentence each

    Skeleton skeleton() const { return smplxSkeleton(joints); }
};

/// Pose in which a file without weights holds its mesh.
enum class TemplatePose {
    TPose,
    Canonical, ///< canonicalPose(): hips turned out 25 degrees. The mesh is brought into the T-pose.
};

/// Where a file without weights holds its mesh.
enum class TemplatePlacement {
    AsGiven,   ///< in the body's own space
    MatchBody, ///< moved so that the centre of its bounding box comes to the body's
};

struct TemplateOptions {
    float scale = 1.0f; ///< file units to metres, for files without weights
    TemplatePose pose = TemplatePose::TPose;
    TemplatePlacement placement = TemplatePlacement::AsGiven;
    bool ignoreGivenWeights = false; ///< diffuse from the body even where the file has weights
    DiffusionOptions diffusion;
};

/// The body itself, at a shape, as a template.
TemplateMesh templateFromBody(const BodyModel& body, const BodyShape& shape = {});

/// Reads a template; what the file is, is told by its content:
///   - glTF/glb with a SMPL-X skin (all 55 names): mesh, weights, joints, materials and textures as given;
///   - npz with v (N,3), f (F,3), optional uv (M,2) + uv_f (F,3), weights (N,55), joints (55,3), joint_names (55),
///     material (F) + material_names;
///   - OBJ, PLY, glTF/glb without a skin, npz without weights: weights diffused from the body at `shape`.
///
/// Files that need the body's help must be in its pose and place (see TemplateOptions). Sizes that disagree are
/// InvalidArgument with both in metres and the option that would help ("is it in centimetres? scale 0.01").
Result<TemplateMesh> readTemplate(const std::filesystem::path& path, const BodyModel& body, const BodyShape& shape = {},
                                  const TemplateOptions& options = {}, const ProgressFunction& progress = {},
                                  const ReadLimits& limits = defaultReadLimits());

/// The same from memory. `folder` is where a .gltf looks for its buffers and pictures.
Result<TemplateMesh> parseTemplate(std::span<const std::byte> bytes, const BodyModel& body, const BodyShape& shape = {},
                                   const TemplateOptions& options = {}, const ProgressFunction& progress = {},
                                   const ReadLimits& limits = defaultReadLimits(),
                                   const std::filesystem::path& folder = {});

/// Templates whose file carries its own weights, without a body. Unsupported when it has none.
Result<TemplateMesh> readWeightedTemplate(const std::filesystem::path& path,
                                          const ReadLimits& limits = defaultReadLimits());

/// A mesh in the body's pose and place as a template: weights diffused.
Result<TemplateMesh> templateFromMesh(TriangleMesh mesh, const BodyModel& body, const BodyShape& shape = {},
                                      const TemplateOptions& options = {}, const ProgressFunction& progress = {},
                                      const ReadLimits& limits = defaultReadLimits());

/// InvalidArgument when mesh, weights, joints and materials do not fit together.
Status validateTemplate(const TemplateMesh& templateMesh);

/// The same thing as a rig, for posing and export, and back (isSmplx rigs only; Unsupported otherwise).
RiggedMesh rigFromTemplate(const TemplateMesh& templateMesh);
Result<TemplateMesh> templateFromRig(RiggedMesh rig);

/// Posed vertices (N): linear blend skinning of the template. InvalidArgument when the pose has not 55 joints.
Result<std::vector<glm::vec3>> posedTemplate(const TemplateMesh& templateMesh, const Pose& pose);

} // namespace ars
