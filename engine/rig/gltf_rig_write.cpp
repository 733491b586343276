#include "engine/rig/gltf_rig.h"

#include <cmath>
#include <map>

namespace ars {
namespace {

Status checkRig(const RiggedMesh& rig, const Motion* motion) {
    ARS_TRY_STATUS(validateSkeleton(rig.skeleton));
    ARS_TRY_STATUS(validateMesh(rig.mesh));
    if (rig.weights.pointCount() != rig.mesh.positions.size()) {
        return makeError(
            ErrorCode::InvalidArgument, "rig",
            fmt::format("{} rows of weights for {} vertices", rig.weights.pointCount(), rig.mesh.positions.size()));
    }
    for (std::size_t i = 0; i < rig.weights.joints.size(); ++i) {
        if (rig.weights.joints[i] >= rig.skeleton.parents.size()) {
            return makeError(
                ErrorCode::InvalidArgument, fmt::format("rig: weights of vertex {}", i / kMaxInfluences),
                fmt::format("name joint {}, the rig has {}", rig.weights.joints[i], rig.skeleton.parents.size()));
        }
    }
    for (const std::int32_t material : rig.mesh.materials) {
        if (material < -1 || material >= static_cast<std::int32_t>(rig.materials.size())) {
            return makeError(ErrorCode::InvalidArgument, "rig",
                             fmt::format("a triangle has material {}, there are {}", material, rig.materials.size()));
        }
    }
    for (std::size_t f = 0; motion && f < motion->frames.size(); ++f) {
        if (motion->frames[f].rotations.size() == rig.skeleton.parents.size()) continue;
        return makeError(
            ErrorCode::InvalidArgument, fmt::format("motion: frame {}", f),
            fmt::format("{} joints, the rig has {}", motion->frames[f].rotations.size(), rig.skeleton.parents.size()));
    }
    return {};
}

glm::quat restOrientation(const Skeleton& skeleton, int joint) {
    if (joint < 0 || skeleton.restOrientations.empty()) return glm::quat(1.0f, 0.0f, 0.0f, 0.0f);
    return skeleton.restOrientations[static_cast<std::size_t>(joint)];
}

/// Rest transform of a joint relative to its parent.
glm::quat localRestRotation(const Skeleton& skeleton, int joint) {
    const int parent = skeleton.parents[static_cast<std::size_t>(joint)];
    return glm::normalize(glm::conjugate(restOrientation(skeleton, parent)) * restOrientation(skeleton, joint));
}

glm::vec3 localRestTranslation(const Skeleton& skeleton, int joint) {
    const int parent = skeleton.parents[static_cast<std::size_t>(joint)];
    const glm::vec3 position = skeleton.restPositions[static_cast<std::size_t>(joint)];
    if (parent < 0) return position;
    return glm::conjugate(restOrientation(skeleton, parent)) *
           (position - skeleton.restPositions[static_cast<std::size_t>(parent)]);
}

void addJointNodes(const Skeleton& skeleton, GltfDocument& document) {
    GltfSkin skin;
    skin.name = "skeleton";
    for (int j = 0; j < skeleton.jointCount(); ++j) {
        GltfNode node;
        node.name = skeleton.names[static_cast<std::size_t>(j)];
        node.parent = skeleton.parents[static_cast<std::size_t>(j)];
        node.children = skeleton.children(j);
        node.translation = localRestTranslation(skeleton, j);
        node.rotation = localRestRotation(skeleton, j);
        node.localMatrix = glm::mat4_cast(node.rotation);
        node.localMatrix[3] = glm::vec4(node.translation, 1.0f);
        if (node.parent < 0) document.sceneRoots.push_back(j);
        document.nodes.push_back(std::move(node));
        glm::dmat4 rest = glm::mat4_cast(glm::dquat(restOrientation(skeleton, j)));
        rest[3] = glm::dvec4(glm::dvec3(skeleton.restPositions[static_cast<std::size_t>(j)]), 1.0);
        skin.joints.push_back(j);
        skin.inverseBindMatrices.emplace_back(glm::inverse(rest));
    }
    if (document.sceneRoots.size() == 1) skin.skeletonRoot = document.sceneRoots.front();
    document.skins.push_back(std::move(skin));
}

/// The triangles of one material with the vertices that they use.
GltfPrimitive primitiveOf(const RiggedMesh& rig, int material, int influences) {
    const TriangleMesh& mesh = rig.mesh;
    GltfPrimitive primitive;
    primitive.material = material;
    primitive.influences = influences;
    std::vector<std::int64_t> newIndex(mesh.positions.size(), -1);
    const auto copy = [&](std::uint32_t v) {
        TriangleMesh& part = primitive.mesh;
        newIndex[v] = static_cast<std::int64_t>(part.positions.size());
        part.positions.push_back(mesh.positions[v]);
        if (!mesh.normals.empty()) part.normals.push_back(mesh.normals[v]);
        if (!mesh.uvs.empty()) part.uvs.push_back(mesh.uvs[v]);
        if (!mesh.colors.empty()) part.colors.push_back(mesh.colors[v]);
        const std::size_t base = static_cast<std::size_t>(v) * kMaxInfluences;
        for (std::size_t i = base; i < base + static_cast<std::size_t>(influences); ++i) {
            primitive.joints.push_back(rig.weights.joints[i]);
            primitive.weights.push_back(rig.weights.weights[i]);
        }
    };
    for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
        if ((mesh.materials.empty() ? -1 : mesh.materials[t]) != material) continue;
        glm::uvec3 triangle = mesh.triangles[t];
        for (int corner = 0; corner < 3; ++corner) {
            if (newIndex[triangle[corner]] < 0) copy(triangle[corner]);
            triangle[corner] = static_cast<std::uint32_t>(newIndex[triangle[corner]]);
        }
        primitive.mesh.triangles.push_back(triangle);
    }
    return primitive;
}

/// Smooth normals of a mesh without: viewers would shade it flat. Vertices that were split for their texture
/// coordinates share one normal.
std::vector<glm::vec3> normalsAcrossSeams(const TriangleMesh& mesh) {
    if (mesh.sourceVertices.empty()) return vertexNormals(mesh.positions, mesh.triangles);
    std::map<std::int32_t, std::uint32_t> firstOfSource;
    std::vector<std::uint32_t> shared(mesh.positions.size());
    for (std::size_t v = 0; v < shared.size(); ++v) {
        shared[v] = firstOfSource.try_emplace(mesh.sourceVertices[v], static_cast<std::uint32_t>(v)).first->second;
    }
    std::vector<glm::uvec3> triangles = mesh.triangles;
    for (glm::uvec3& t : triangles) t = {shared[t.x], shared[t.y], shared[t.z]};
    const std::vector<glm::vec3> normals = vertexNormals(mesh.positions, triangles);
    std::vector<glm::vec3> result(shared.size());
    for (std::size_t v = 0; v < shared.size(); ++v) result[v] = normals[shared[v]];
    return result;
}

void addSkinnedMesh(const RiggedMesh& rig, GltfDocument& document) {
    // Most rigs have four influences: half the bytes, and every viewer reads them.
    int influences = 4;
    for (std::size_t v = 0; v < rig.weights.pointCount(); ++v) {
        if (rig.weights.weights[v * kMaxInfluences + 4] > 0.0f) influences = kMaxInfluences;
    }
    GltfMesh mesh;
    mesh.name = rig.name.empty() ? "mesh" : rig.name;
    for (int material = -1; material < static_cast<int>(rig.materials.size()); ++material) {
        GltfPrimitive primitive = primitiveOf(rig, material, influences);
        if (!primitive.mesh.triangles.empty()) mesh.primitives.push_back(std::move(primitive));
    }
    GltfNode node;
    node.name = mesh.name;
    node.mesh = 0;
    node.skin = 0;
    document.sceneRoots.push_back(static_cast<int>(document.nodes.size()));
    document.nodes.push_back(std::move(node));
    document.meshes.push_back(std::move(mesh));
}

/// The rotations of one joint over the motion as a node has them. Empty when it stays in its rest pose.
std::vector<float> rotationKeys(const Skeleton& skeleton, const Motion& motion, int joint) {
    const glm::quat rest = localRestRotation(skeleton, joint);
    std::vector<float> keys;
    bool moves = false;
    glm::quat previous = rest;
    for (const Pose& pose : motion.frames) {
        glm::quat q = glm::normalize(rest * pose.rotations[static_cast<std::size_t>(joint)]);
        // Players interpolate the numbers: neighbouring keys must be on the same side of the sphere.
        if (glm::dot(q, previous) < 0.0f) q = -q;
        previous = q;
        const glm::quat change = q - rest;
        moves = moves || glm::dot(change, change) > 1e-12f;
        keys.insert(keys.end(), {q.x, q.y, q.z, q.w});
    }
    if (!moves) keys.clear();
    return keys;
}

void addAnimation(const Skeleton& skeleton, const Motion& motion, GltfDocument& document) {
    GltfAnimation animation;
    animation.name = motion.name.empty() ? "motion" : motion.name;
    std::vector<float> times;
    for (std::size_t f = 0; f < motion.frames.size(); ++f) {
        times.push_back(static_cast<float>(static_cast<double>(f) / motion.framesPerSecond));
    }
    for (int j = 0; j < skeleton.jointCount(); ++j) {
        GltfChannel rotation;
        rotation.node = j;
        rotation.path = GltfPath::Rotation;
        rotation.width = 4;
        rotation.times = times;
        rotation.values = rotationKeys(skeleton, motion, j);
        if (!rotation.values.empty()) animation.channels.push_back(std::move(rotation));
        if (skeleton.parents[static_cast<std::size_t>(j)] >= 0) continue;
        GltfChannel translation;
        translation.node = j;
        translation.path = GltfPath::Translation;
        translation.times = times;
        for (const Pose& pose : motion.frames) {
            const glm::vec3 p = skeleton.restPositions[static_cast<std::size_t>(j)] + pose.translation;
            translation.values.insert(translation.values.end(), {p.x, p.y, p.z});
        }
        animation.channels.push_back(std::move(translation));
    }
    document.animations.push_back(std::move(animation));
}

} // namespace

Result<GltfDocument> gltfFromRig(const RiggedMesh& rig, const Motion* motion) {
    ARS_TRY_STATUS(checkRig(rig, motion));
    GltfDocument document;
    document.generator = "ARS Studio";
    document.materials = rig.materials;
    document.images = rig.images;
    addJointNodes(rig.skeleton, document);
    if (rig.mesh.normals.empty()) {
        RiggedMesh smooth = rig;
        smooth.mesh.normals = normalsAcrossSeams(rig.mesh);
        addSkinnedMesh(smooth, document);
    } else {
        addSkinnedMesh(rig, document);
    }
    if (motion && !motion->frames.empty()) addAnimation(rig.skeleton, *motion, document);
    return document;
}

} // namespace ars
