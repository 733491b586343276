#include "engine/rig/posed_export.h"

#include "engine/io/npz.h"
#include "engine/io/obj.h"
#include "engine/io/ply.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cstring>

namespace ars {
namespace {

std::vector<float> flat(const std::vector<glm::vec3>& points) {
    std::vector<float> numbers;
    numbers.reserve(points.size() * 3);
    for (const glm::vec3& p : points) numbers.insert(numbers.end(), {p.x, p.y, p.z});
    return numbers;
}

Status writePosedNpz(const std::filesystem::path& path, const PosedMesh& posed) {
    const TriangleMesh& mesh = posed.mesh;
    std::vector<std::int64_t> triangles;
    triangles.reserve(mesh.triangles.size() * 3);
    for (const glm::uvec3& t : mesh.triangles) triangles.insert(triangles.end(), {t.x, t.y, t.z});
    std::vector<std::pair<std::string, Array>> arrays;
    arrays.emplace_back("v", Array::fromFloats({mesh.positions.size(), 3}, flat(mesh.positions)));
    arrays.emplace_back("f", Array::fromInts({mesh.triangles.size(), 3}, triangles));
    arrays.emplace_back("joints", Array::fromFloats({posed.joints.size(), 3}, flat(posed.joints)));
    if (!mesh.uvs.empty()) {
        // From the bottom left, as the template reader expects it.
        std::vector<float> uvs;
        for (const glm::vec2& uv : mesh.uvs) uvs.insert(uvs.end(), {uv.x, 1.0f - uv.y});
        arrays.emplace_back("uv", Array::fromFloats({mesh.uvs.size(), 2}, uvs));
    }
    return writeNpz(path, arrays);
}

/// A rig of one joint that stands still is a static mesh once its skin is dropped.
Status writeStaticGlb(const std::filesystem::path& path, const PosedMesh& posed,
                      std::span<const GltfMaterial> materials, std::span<const GltfImage> images) {
    RiggedMesh rig;
    rig.name = posed.mesh.name.empty() ? "mesh" : posed.mesh.name;
    rig.mesh = posed.mesh;
    rig.materials.assign(materials.begin(), materials.end());
    rig.images.assign(images.begin(), images.end());
    rig.skeleton = {{"root"}, {-1}, {glm::vec3(0.0f)}, {glm::quat(1.0f, 0.0f, 0.0f, 0.0f)}};
    rig.weights.joints.assign(rig.mesh.positions.size() * kMaxInfluences, 0);
    rig.weights.weights.assign(rig.mesh.positions.size() * kMaxInfluences, 0.0f);
    for (std::size_t v = 0; v < rig.mesh.positions.size(); ++v) rig.weights.weights[v * kMaxInfluences] = 1.0f;
    ARS_TRY(GltfDocument document, gltfFromRig(rig));
    for (GltfPrimitive& primitive : document.meshes.front().primitives) {
        primitive.influences = 0;
        primitive.joints.clear();
        primitive.weights.clear();
    }
    document.skins.clear();
    document.nodes.erase(document.nodes.begin());
    document.nodes.front().skin = -1;
    document.sceneRoots = {0};
    return writeGlb(path, document);
}

} // namespace

Result<PosedFormat> posedFormatFor(const std::filesystem::path& path) {
    std::string extension = path.extension().string();
    std::transform(extension.begin(), extension.end(), extension.begin(),
                   [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    constexpr std::array<std::pair<std::string_view, PosedFormat>, 4> kKnown = {
        std::pair{std::string_view(".obj"), PosedFormat::Obj}, std::pair{std::string_view(".ply"), PosedFormat::Ply},
        std::pair{std::string_view(".npz"), PosedFormat::Npz}, std::pair{std::string_view(".glb"), PosedFormat::Glb}};
    for (const auto& [known, format] : kKnown) {
        if (extension == known) return format;
    }
    return makeError(ErrorCode::InvalidArgument, path.string(),
                     fmt::format("cannot write \"{}\" files, expected .obj, .ply, .npz or .glb", extension));
}

Result<PosedMesh> poseRig(const RiggedMesh& rig, const Pose& pose) {
    if (pose.rotations.size() != rig.skeleton.parents.size()) {
        return makeError(ErrorCode::InvalidArgument, "pose",
                         fmt::format("{} joints, the rig has {}", pose.rotations.size(), rig.skeleton.parents.size()));
    }
    PosedMesh posed;
    posed.mesh = rig.mesh;
    const std::vector<glm::mat4> matrices = skinningMatrices(rig.skeleton, pose);
    if (rig.mesh.normals.empty()) {
        ARS_TRY_STATUS(skinPoints(matrices, rig.weights, rig.mesh.positions, posed.mesh.positions));
    } else {
        ARS_TRY_STATUS(skinPointsAndNormals(matrices, rig.weights, rig.mesh.positions, rig.mesh.normals,
                                            posed.mesh.positions, posed.mesh.normals));
    }
    for (const glm::mat4& joint : jointWorldMatrices(rig.skeleton, pose)) posed.joints.emplace_back(joint[3]);
    return posed;
}

PosedMesh poseBody(const BodyModel& body, const BodyShape& shape, const Pose& pose) {
    PosedMesh posed;
    posed.mesh.name = body.name;
    posed.mesh.positions = posedVertices(body, shape, pose, &posed.joints);
    posed.mesh.triangles = body.triangles;
    posed.mesh.normals = vertexNormals(posed.mesh.positions, posed.mesh.triangles);
    return posed;
}

Status writePosedMesh(const std::filesystem::path& path, PosedFormat format, const PosedMesh& posed,
                      std::span<const GltfMaterial> materials, std::span<const GltfImage> images) {
    switch (format) {
    case PosedFormat::Obj:
        return writeObj(path, posed.mesh);
    case PosedFormat::Ply:
        return writePlyMesh(path, posed.mesh);
    case PosedFormat::Npz:
        return writePosedNpz(path, posed);
    case PosedFormat::Glb:
        return writeStaticGlb(path, posed, materials, images);
    }
    return {};
}

Status writeRiggedGlb(const std::filesystem::path& path, const RiggedMesh& rig, const Motion* motion) {
    Result<GltfDocument> document = gltfFromRig(rig, motion);
    if (!document) return atPlace(std::move(document).error(), path.string());
    return writeGlb(path, *document);
}

Status exportPosed(const std::filesystem::path& path, const RiggedMesh& rig, const Pose& pose) {
    ARS_TRY(const PosedFormat format, posedFormatFor(path));
    if (format == PosedFormat::Glb) {
        Motion motion;
        motion.name = "pose";
        motion.frames = {pose};
        return writeRiggedGlb(path, rig, &motion);
    }
    ARS_TRY(const PosedMesh posed, poseRig(rig, pose));
    return writePosedMesh(path, format, posed);
}

} // namespace ars
