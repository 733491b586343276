#include "engine/rig/gltf_rig.h"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>

namespace ars {
namespace {

constexpr double kSamePositionM = 1e-4; ///< node pose and bind pose agree up to this
constexpr double kSameAngle = 5e-3;     ///< and up to this, radians

/// One mesh of the scene: where it is used.
struct Instance {
    int node = -1;
    int mesh = -1;
    int skin = -1; ///< -1: not skinned
};

bool isFinite(const glm::dmat4& m) {
    for (int c = 0; c < 4; ++c) {
        for (int r = 0; r < 4; ++r) {
            if (!std::isfinite(m[c][r])) return false;
        }
    }
    return true;
}

bool isFinite(const glm::vec3& v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }

/// Rotation nearest to the linear part of an affine matrix, whatever its scale and shear (orthogonal Procrustes).
glm::dquat nearestRotation(const glm::dmat4& matrix) {
    Eigen::Matrix3d m;
    for (int c = 0; c < 3; ++c) {
        const double length = glm::length(glm::dvec3(matrix[c]));
        for (int r = 0; r < 3; ++r) m(r, c) = length > 0.0 ? matrix[c][r] / length : 0.0;
    }
    const Eigen::JacobiSVD<Eigen::Matrix3d> svd(m, Eigen::ComputeFullU | Eigen::ComputeFullV);
    Eigen::Vector3d signs(1.0, 1.0, 1.0);
    if ((svd.matrixU() * svd.matrixV().transpose()).determinant() < 0.0) signs.z() = -1.0;
    const Eigen::Quaterniond q(Eigen::Matrix3d(svd.matrixU() * signs.asDiagonal() * svd.matrixV().transpose()));
    return glm::normalize(glm::dquat(q.w(), q.x(), q.y(), q.z()));
}

double angleBetween(const glm::dquat& a, const glm::dquat& b) {
    return 2.0 * std::acos(std::clamp(std::abs(glm::dot(a, b)), 0.0, 1.0));
}

/// Nodes of the scene, parents before children.
std::vector<int> sceneOrder(const GltfDocument& document) {
    std::vector<int> order;
    std::vector<int> stack(document.sceneRoots.rbegin(), document.sceneRoots.rend());
    std::vector<bool> seen(document.nodes.size(), false);
    while (!stack.empty()) {
        const int node = stack.back();
        stack.pop_back();
        if (seen[static_cast<std::size_t>(node)]) continue;
        seen[static_cast<std::size_t>(node)] = true;
        order.push_back(node);
        const std::vector<int>& children = document.nodes[static_cast<std::size_t>(node)].children;
        stack.insert(stack.end(), children.rbegin(), children.rend());
    }
    return order;
}

std::vector<Instance> sceneMeshes(const GltfDocument& document, const std::vector<int>& order) {
    std::vector<Instance> instances;
    for (const int n : order) {
        const GltfNode& node = document.nodes[static_cast<std::size_t>(n)];
        if (node.mesh >= 0) instances.push_back({n, node.mesh, node.skin});
    }
    return instances;
}

/// Vertices of all instances, before any of them is copied: a small file can place one large mesh many times.
Status checkSize(const GltfDocument& document, const std::vector<Instance>& instances, const ReadLimits& limits) {
    std::uint64_t vertices = 0, triangles = 0;
    for (const Instance& instance : instances) {
        for (const GltfPrimitive& primitive : document.meshes[static_cast<std::size_t>(instance.mesh)].primitives) {
            vertices += primitive.mesh.positions.size();
            triangles += primitive.mesh.triangles.size();
        }
        if (std::max(vertices, triangles) > limits.maxElements) {
            return makeError(ErrorCode::LimitExceeded, "scene",
                             fmt::format("its meshes have more than {} vertices or triangles", limits.maxElements));
        }
    }
    return {};
}

/// Collects transformed primitives end to end. Attributes that only some have are filled up.
class MeshMerger {
public:
    explicit MeshMerger(const GltfDocument& document) {
        for (const GltfMaterial& material : document.materials) mesh_.materialNames.push_back(material.name);
    }

    /// Appends a primitive whose vertex v goes through transform(v). Returns the index of its first vertex.
    template <typename Transform>
    std::size_t append(const GltfMesh& owner, const GltfPrimitive& primitive, Transform&& transform) {
        const TriangleMesh& part = primitive.mesh;
        const std::size_t first = mesh_.positions.size();
        const std::vector<glm::vec3> positions = withMorphs(owner, primitive);
        const bool hasNormals = part.normals.size() == positions.size();
        const std::vector<glm::vec3> normals = hasNormals ? part.normals : vertexNormals(positions, part.triangles);
        bool mirrored = false;
        for (std::size_t v = 0; v < positions.size(); ++v) {
            const glm::dmat4 matrix = transform(v);
            const glm::dmat3 linear(matrix);
            mesh_.positions.emplace_back(matrix * glm::dvec4(glm::dvec3(positions[v]), 1.0));
            mesh_.normals.push_back(turnedNormal(linear, normals[v]));
            mesh_.uvs.push_back(v < part.uvs.size() ? part.uvs[v] : glm::vec2(0.0f));
            mesh_.colors.push_back(v < part.colors.size() ? part.colors[v] : glm::vec4(1.0f));
            mirrored = mirrored || glm::determinant(linear) < 0.0;
        }
        hasUvs_ = hasUvs_ || !part.uvs.empty();
        hasColors_ = hasColors_ || !part.colors.empty();
        for (glm::uvec3 triangle : part.triangles) {
            if (mirrored) std::swap(triangle.y, triangle.z);
            mesh_.triangles.push_back(triangle + static_cast<std::uint32_t>(first));
            mesh_.materials.push_back(primitive.material);
        }
        return first;
    }

    std::size_t vertexCount() const { return mesh_.positions.size(); }

    Result<TriangleMesh> finish(std::string name) {
        for (std::size_t v = 0; v < mesh_.positions.size(); ++v) {
            if (!isFinite(mesh_.positions[v])) {
                return makeError(ErrorCode::BadFile, fmt::format("vertex {}", v),
                                 "its position is not finite once nodes and skin have placed it");
            }
        }
        if (!hasUvs_) mesh_.uvs.clear();
        if (!hasColors_) mesh_.colors.clear();
        mesh_.name = std::move(name);
        return std::move(mesh_);
    }

private:
    static std::vector<glm::vec3> withMorphs(const GltfMesh& owner, const GltfPrimitive& primitive) {
        std::vector<glm::vec3> positions = primitive.mesh.positions;
        for (std::size_t m = 0; m < std::min(owner.morphWeights.size(), primitive.morphTargets.size()); ++m) {
            const std::vector<glm::vec3>& offsets = primitive.morphTargets[m].positions;
            if (owner.morphWeights[m] == 0.0f || offsets.size() != positions.size()) continue;
            for (std::size_t v = 0; v < positions.size(); ++v) positions[v] += owner.morphWeights[m] * offsets[v];
        }
        return positions;
    }

    static glm::vec3 turnedNormal(const glm::dmat3& linear, const glm::vec3& normal) {
        // The cofactor matrix is the inverse transpose up to a factor, and exists for flat scales too.
        const glm::dmat3 cofactor(glm::cross(linear[1], linear[2]), glm::cross(linear[2], linear[0]),
                                  glm::cross(linear[0], linear[1]));
        glm::dvec3 turned = cofactor * glm::dvec3(normal);
        if (glm::determinant(linear) < 0.0) turned = -turned;
        const double length = glm::length(turned);
        return length > 0.0 ? glm::vec3(turned / length) : glm::vec3(0.0f);
    }

    TriangleMesh mesh_;
    bool hasUvs_ = false, hasColors_ = false;
};

/// Turns one scene into a rig. The members fill up in the order of the steps in build().
class RigBuilder {
public:
    RigBuilder(const GltfDocument& document, const ReadLimits& limits) : document_(document), limits_(limits) {}

    Result<RiggedMesh> build() {
        order_ = sceneOrder(document_);
        instances_ = sceneMeshes(document_, order_);
        ARS_TRY_STATUS(checkSize(document_, instances_, limits_));
        ARS_TRY_STATUS(collectJoints());
        for (const glm::mat4& matrix : document_.globalMatrices()) global_.emplace_back(matrix);
        ARS_TRY_STATUS(findBindPoses());
        placeJoints();
        ARS_TRY_STATUS(mergeMeshes());
        rig_.materials = document_.materials;
        rig_.images = document_.images;
        rig_.jointNodes = jointNodes_;
        ARS_TRY_STATUS(validateSkeleton(rig_.skeleton));
        return std::move(rig_);
    }

private:
    const GltfNode& node(int index) const { return document_.nodes[static_cast<std::size_t>(index)]; }
    const GltfSkin& skin(int index) const { return document_.skins[static_cast<std::size_t>(index)]; }
    int jointOf(int nodeIndex) const { return jointOfNode_[static_cast<std::size_t>(nodeIndex)]; }
    glm::dmat4 global(int nodeIndex) const { return global_[static_cast<std::size_t>(nodeIndex)]; }

    /// Nearest joint at or above a node, or -1.
    int jointAbove(int nodeIndex) const {
        while (nodeIndex >= 0 && jointOf(nodeIndex) < 0) nodeIndex = node(nodeIndex).parent;
        return nodeIndex < 0 ? -1 : jointOf(nodeIndex);
    }

    /// Joints: those of the skins in use, and the nodes between them, in scene order.
    Status collectJoints() {
        std::vector<bool> isJoint(document_.nodes.size(), false);
        for (const Instance& instance : instances_) {
            if (instance.skin < 0) continue;
            if (std::find(skins_.begin(), skins_.end(), instance.skin) == skins_.end()) skins_.push_back(instance.skin);
        }
        for (const int s : skins_) {
            for (const int joint : skin(s).joints) isJoint[static_cast<std::size_t>(joint)] = true;
        }
        if (skins_.empty()) {
            return makeError(
                ErrorCode::Unsupported, "",
                "no mesh of the scene has a skin, a rig needs one (a node with both \"mesh\" and \"skin\")");
        }
        ARS_TRY_STATUS(checkSkins());
        fillGaps(isJoint);
        jointOfNode_.assign(document_.nodes.size(), -1);
        for (const int n : order_) {
            if (!isJoint[static_cast<std::size_t>(n)]) continue;
            jointOfNode_[static_cast<std::size_t>(n)] = static_cast<int>(jointNodes_.size());
            jointNodes_.push_back(n);
        }
        if (jointNodes_.size() > limits_.maxJoints) {
            return makeError(
                ErrorCode::LimitExceeded, "",
                fmt::format("the rig has {} joints, the limit is {}", jointNodes_.size(), limits_.maxJoints));
        }
        for (const int s : skins_) {
            for (const int joint : skin(s).joints) {
                if (jointOf(joint) >= 0) continue;
                return makeError(
                    ErrorCode::BadFile, fmt::format("skins[{}]", s),
                    fmt::format("its joint, node {} (\"{}\"), is not part of the scene", joint, node(joint).name));
            }
        }
        return {};
    }

    /// A mesh can be shown with another skin than the one it was checked against.
    Status checkSkins() const {
        for (const Instance& instance : instances_) {
            if (instance.skin < 0) continue;
            const std::size_t joints = skin(instance.skin).joints.size();
            const std::string place = fmt::format("nodes[{}]", instance.node);
            if (joints == 0) return makeError(ErrorCode::BadFile, place, "its skin has no joints");
            for (const GltfPrimitive& primitive :
                 document_.meshes[static_cast<std::size_t>(instance.mesh)].primitives) {
                for (std::size_t i = 0; i < primitive.joints.size(); ++i) {
                    if (primitive.joints[i] < joints) continue;
                    return makeError(
                        ErrorCode::BadFile, place,
                        fmt::format("its mesh names joint {}, its skin has {}", primitive.joints[i], joints));
                }
            }
        }
        return {};
    }

    /// Nodes between two joints become joints: an animation may move them. In scene order every node knows whether a
    /// joint stands above it; going back, whether one hangs below.
    void fillGaps(std::vector<bool>& isJoint) const {
        std::vector<bool> below(isJoint), above(document_.nodes.size(), false);
        for (const int n : order_) {
            const int parent = node(n).parent;
            if (parent < 0) continue;
            const auto p = static_cast<std::size_t>(parent);
            above[static_cast<std::size_t>(n)] = above[p] || isJoint[p];
        }
        for (auto n = order_.rbegin(); n != order_.rend(); ++n) {
            const int parent = node(*n).parent;
            if (parent >= 0 && below[static_cast<std::size_t>(*n)]) below[static_cast<std::size_t>(parent)] = true;
        }
        for (const int n : order_) {
            const auto i = static_cast<std::size_t>(n);
            if (above[i] && below[i]) isJoint[i] = true;
        }
    }

    /// rest_: the affine rest matrix of every joint in model space.
    Status findBindPoses() {
        rest_.assign(jointNodes_.size(), std::nullopt);
        // The skin with the most joints decides where the others disagree.
        std::stable_sort(skins_.begin(), skins_.end(),
                         [&](int a, int b) { return skin(a).joints.size() > skin(b).joints.size(); });
        for (const int s : skins_) ARS_TRY_STATUS(addSkin(s));
        for (std::size_t j = 0; j < rest_.size(); ++j) {
            if (rest_[j]) continue;
            const int parent = jointAbove(node(jointNodes_[j]).parent);
            const glm::dmat4 own = global(jointNodes_[j]);
            if (parent < 0) {
                rest_[j] = own;
            } else {
                const auto p = static_cast<std::size_t>(parent);
                rest_[j] = *rest_[p] * glm::inverse(global(jointNodes_[p])) * own;
            }
        }
        return {};
    }

    Status addSkin(int s) {
        const GltfSkin& bind = skin(s);
        for (std::size_t i = 0; i < bind.joints.size(); ++i) {
            const glm::dmat4 inverse = glm::inverse(glm::dmat4(bind.inverseBindMatrices[i]));
            if (!isFinite(inverse)) {
                return makeError(ErrorCode::BadFile, fmt::format("skins[{}].inverseBindMatrices[{}]", s, i),
                                 "the matrix cannot be inverted");
            }
        }
        const auto same = [&](const glm::mat4& matrix) { return matrix == bind.inverseBindMatrices.front(); };
        const bool saysNothing = bind.joints.size() > 1 &&
                                 std::all_of(bind.inverseBindMatrices.begin(), bind.inverseBindMatrices.end(), same);
        const glm::dmat4 place = meshPlace(bind);
        for (std::size_t i = 0; i < bind.joints.size(); ++i) {
            std::optional<glm::dmat4>& rest = rest_[static_cast<std::size_t>(jointOf(bind.joints[i]))];
            if (rest) continue;
            rest = saysNothing ? global(bind.joints[i]) : place * glm::inverse(glm::dmat4(bind.inverseBindMatrices[i]));
        }
        return {};
    }

    /// Takes a skin's mesh space to model space: by a joint whose rest matrix is known already, else by its topmost
    /// joint.
    glm::dmat4 meshPlace(const GltfSkin& bind) const {
        std::size_t top = 0;
        for (std::size_t i = 0; i < bind.joints.size(); ++i) {
            const int joint = jointOf(bind.joints[i]);
            if (rest_[static_cast<std::size_t>(joint)]) {
                return *rest_[static_cast<std::size_t>(joint)] * glm::dmat4(bind.inverseBindMatrices[i]);
            }
            if (joint < jointOf(bind.joints[top])) top = i;
        }
        glm::dmat4 place = global(bind.joints[top]) * glm::dmat4(bind.inverseBindMatrices[top]);
        const int above = jointAbove(node(bind.joints[top]).parent);
        if (above >= 0 && rest_[static_cast<std::size_t>(above)]) {
            const auto a = static_cast<std::size_t>(above);
            place = *rest_[a] * glm::inverse(global(jointNodes_[a])) * place;
        }
        return place;
    }

    void placeJoints() {
        double moved = 0.0, turned = 0.0;
        for (std::size_t j = 0; j < jointNodes_.size(); ++j) {
            const glm::dmat4 posed = global(jointNodes_[j]);
            moved = std::max(moved, glm::distance(glm::dvec3(posed[3]), glm::dvec3((*rest_[j])[3])));
            turned = std::max(turned, angleBetween(nearestRotation(posed), nearestRotation(*rest_[j])));
        }
        rig_.restDisagreementM = static_cast<float>(moved);
        if (moved > kSamePositionM || turned > kSameAngle) {
            rig_.restSource = RestSource::BindMatrices;
            rig_.notes.push_back(fmt::format("the nodes stand in another pose than the mesh was bound in (joints up to "
                                             "{:.3f} m and {:.1f} degrees apart); the bind pose is used",
                                             moved, glm::degrees(turned)));
        }
        bool mirrored = false;
        Skeleton& skeleton = rig_.skeleton;
        for (std::size_t j = 0; j < jointNodes_.size(); ++j) {
            const std::string& name = node(jointNodes_[j]).name;
            skeleton.names.push_back(name.empty() ? fmt::format("joint_{}", j) : name);
            skeleton.parents.push_back(jointAbove(node(jointNodes_[j]).parent));
            skeleton.restPositions.emplace_back((*rest_[j])[3]);
            skeleton.restOrientations.emplace_back(nearestRotation(*rest_[j]));
            mirrored = mirrored || glm::determinant(glm::dmat3(*rest_[j])) < 0.0;
        }
        if (mirrored) rig_.notes.push_back("some joints are mirrored; animations of theirs will not look right");
    }

    Status mergeMeshes() {
        MeshMerger merger(document_);
        std::size_t leftOut = 0, weightless = 0;
        for (const Instance& instance : instances_) {
            const GltfMesh& mesh = document_.meshes[static_cast<std::size_t>(instance.mesh)];
            const int joint = instance.skin >= 0 ? topJoint(instance.skin) : jointAbove(instance.node);
            if (joint < 0) {
                ++leftOut;
                continue;
            }
            for (const GltfPrimitive& primitive : mesh.primitives) {
                if (instance.skin >= 0 && primitive.influences > 0) {
                    weightless += appendSkinned(merger, mesh, primitive, skin(instance.skin), joint);
                } else {
                    appendRigid(merger, mesh, primitive, instance, joint);
                }
            }
        }
        if (leftOut > 0) {
            rig_.notes.push_back(
                fmt::format("{} meshes without a skin and without a joint above were left out", leftOut));
        }
        if (weightless > 0) {
            rig_.notes.push_back(
                fmt::format("{} vertices have no weight; they follow \"{}\"", weightless, rig_.skeleton.names.front()));
        }
        ARS_TRY(rig_.mesh, merger.finish(instanceName()));
        rig_.name = rig_.mesh.name;
        return {};
    }

    std::string instanceName() const {
        for (const Instance& instance : instances_) {
            if (instance.skin < 0) continue;
            const std::string& meshName = document_.meshes[static_cast<std::size_t>(instance.mesh)].name;
            return meshName.empty() ? node(instance.node).name : meshName;
        }
        return {};
    }

    int topJoint(int s) const {
        int top = jointOf(skin(s).joints.front());
        for (const int joint : skin(s).joints) top = std::min(top, jointOf(joint));
        return top;
    }

    /// Returns the number of vertices without weight.
    std::size_t appendSkinned(MeshMerger& merger, const GltfMesh& mesh, const GltfPrimitive& primitive,
                              const GltfSkin& bind, int fallback) {
        std::vector<glm::dmat4> bindToModel;
        std::vector<int> joints;
        for (std::size_t i = 0; i < bind.joints.size(); ++i) {
            joints.push_back(jointOf(bind.joints[i]));
            bindToModel.push_back(*rest_[static_cast<std::size_t>(joints.back())] *
                                  glm::dmat4(bind.inverseBindMatrices[i]));
        }
        const auto influences = static_cast<std::size_t>(primitive.influences);
        const auto fallbackIndex =
            static_cast<std::size_t>(std::find(joints.begin(), joints.end(), fallback) - joints.begin());
        std::size_t weightless = 0;
        merger.append(mesh, primitive, [&](std::size_t v) {
            glm::dmat4 blended(0.0);
            std::vector<std::pair<float, int>> row;
            double sum = 0.0;
            for (std::size_t n = v * influences; n < (v + 1) * influences; ++n) {
                const float weight = primitive.weights[n];
                if (!(weight > 0.0f)) continue;
                const std::size_t joint = primitive.joints[n];
                blended += bindToModel[joint] * static_cast<double>(weight);
                row.emplace_back(weight, joints[joint]);
                sum += static_cast<double>(weight);
            }
            if (row.empty()) {
                ++weightless;
                row.emplace_back(1.0f, fallback);
                blended = bindToModel[fallbackIndex];
                sum = 1.0;
            }
            appendWeights(row);
            return blended * (1.0 / sum);
        });
        return weightless;
    }

    void appendRigid(MeshMerger& merger, const GltfMesh& mesh, const GltfPrimitive& primitive, const Instance& instance,
                     int joint) {
        const auto j = static_cast<std::size_t>(joint);
        const glm::dmat4 place = *rest_[j] * glm::inverse(global(jointNodes_[j])) * global(instance.node);
        merger.append(mesh, primitive, [&](std::size_t) {
            std::vector<std::pair<float, int>> row = {{1.0f, joint}};
            appendWeights(row);
            return place;
        });
    }

    /// One row of SkinWeights: the same joint added up, the largest eight, normalised.
    void appendWeights(std::vector<std::pair<float, int>>& row) {
        std::sort(row.begin(), row.end(), [](const auto& a, const auto& b) { return a.second < b.second; });
        std::size_t kept = 0;
        for (std::size_t i = 1; i < row.size(); ++i) {
            if (row[i].second == row[kept].second) {
                row[kept].first += row[i].first;
            } else {
                row[++kept] = row[i];
            }
        }
        row.resize(kept + 1);
        std::stable_sort(row.begin(), row.end(), [](const auto& a, const auto& b) { return a.first > b.first; });
        row.resize(std::min<std::size_t>(row.size(), kMaxInfluences));
        const float sum = std::accumulate(row.begin(), row.end(), 0.0f,
                                          [](float total, const auto& entry) { return total + entry.first; });
        for (std::size_t i = 0; i < kMaxInfluences; ++i) {
            rig_.weights.joints.push_back(i < row.size() ? static_cast<std::uint16_t>(row[i].second) : 0);
            rig_.weights.weights.push_back(i < row.size() ? row[i].first / sum : 0.0f);
        }
    }

    const GltfDocument& document_;
    const ReadLimits& limits_;
    RiggedMesh rig_;
    std::vector<int> order_;
    std::vector<Instance> instances_;
    std::vector<int> skins_;
    std::vector<int> jointNodes_;
    std::vector<int> jointOfNode_;
    std::vector<glm::dmat4> global_;
    std::vector<std::optional<glm::dmat4>> rest_;
};

/// SMPL-X's index of a joint name; the eyes are also known without the suffix of the model file.
int smplxIndexOf(std::string_view name) {
    const int index = smplxJointIndex(name);
    if (index >= 0) return index;
    if (name == "left_eye") return smplxJointIndex("left_eye_smplhf");
    if (name == "right_eye") return smplxJointIndex("right_eye_smplhf");
    return -1;
}

/// For every joint of the rig the SMPL-X joint that it becomes; nothing when the rig is not SMPL-X's tree.
std::optional<std::vector<int>> smplxMapping(const RiggedMesh& rig, std::vector<int>& jointOfSmplx) {
    const Skeleton& skeleton = rig.skeleton;
    jointOfSmplx.assign(kSmplxJointCount, -1);
    std::vector<int> mapping(skeleton.parents.size(), -1);
    for (std::size_t j = 0; j < mapping.size(); ++j) {
        const int index = smplxIndexOf(skeleton.names[j]);
        if (index < 0) continue;
        int& slot = jointOfSmplx[static_cast<std::size_t>(index)];
        if (slot >= 0) return std::nullopt;
        slot = static_cast<int>(j);
        mapping[j] = index;
    }
    if (std::find(jointOfSmplx.begin(), jointOfSmplx.end(), -1) != jointOfSmplx.end()) return std::nullopt;
    for (std::size_t j = 0; j < mapping.size(); ++j) {
        const int parent = skeleton.parents[j];
        const int above = parent < 0 ? -1 : mapping[static_cast<std::size_t>(parent)];
        // What stands above the pelvis, or beside the body, has nothing of SMPL-X above it and moves with the pelvis.
        if (mapping[j] < 0) {
            mapping[j] = above;
        } else if (above != smplxJointParent(mapping[j])) {
            return std::nullopt;
        }
    }
    for (int& joint : mapping) joint = std::max(joint, 0);
    return mapping;
}

/// Moves weights to other joints; several may become one.
SkinWeights remappedWeights(const SkinWeights& weights, const std::vector<int>& mapping) {
    SkinWeights result;
    result.joints.assign(weights.joints.size(), 0);
    result.weights.assign(weights.weights.size(), 0.0f);
    for (std::size_t v = 0; v < weights.pointCount(); ++v) {
        const std::size_t base = v * kMaxInfluences;
        std::vector<std::pair<float, std::uint16_t>> row;
        for (std::size_t i = base; i < base + kMaxInfluences; ++i) {
            if (!(weights.weights[i] > 0.0f)) continue;
            const auto joint = static_cast<std::uint16_t>(mapping[weights.joints[i]]);
            const auto same = std::find_if(row.begin(), row.end(), [&](const auto& e) { return e.second == joint; });
            if (same == row.end()) {
                row.emplace_back(weights.weights[i], joint);
            } else {
                same->first += weights.weights[i];
            }
        }
        std::stable_sort(row.begin(), row.end(), [](const auto& a, const auto& b) { return a.first > b.first; });
        for (std::size_t i = 0; i < row.size(); ++i) {
            result.weights[base + i] = row[i].first;
            result.joints[base + i] = row[i].second;
        }
    }
    return result;
}

void bringIntoSmplxOrder(RiggedMesh& rig) {
    std::vector<int> jointOfSmplx;
    const std::optional<std::vector<int>> mapping = smplxMapping(rig, jointOfSmplx);
    if (!mapping) return;
    std::vector<glm::vec3> positions;
    std::vector<int> nodes;
    for (const int joint : jointOfSmplx) {
        positions.push_back(rig.skeleton.restPositions[static_cast<std::size_t>(joint)]);
        nodes.push_back(rig.jointNodes[static_cast<std::size_t>(joint)]);
    }
    if (rig.skeleton.parents.size() > kSmplxJointCount) {
        rig.notes.push_back(fmt::format("{} joints beyond the 55 of SMPL-X were joined to those above them",
                                        rig.skeleton.parents.size() - kSmplxJointCount));
    }
    rig.weights = remappedWeights(rig.weights, *mapping);
    rig.jointNodes = std::move(nodes);
    // SMPL-X turns every joint in the model's axes; how the file's bones were rolled does not matter for that.
    rig.skeleton = smplxSkeleton(std::move(positions));
    rig.isSmplx = true;
}

} // namespace

Result<RiggedMesh> rigFromGltf(const GltfDocument& document, const ReadLimits& limits) {
    ARS_TRY(RiggedMesh rig, RigBuilder(document, limits).build());
    bringIntoSmplxOrder(rig);
    rig.parts = jointParts(rig.skeleton);
    return rig;
}

Result<RiggedMesh> readGltfRig(const std::filesystem::path& path, const ReadLimits& limits) {
    ARS_TRY(const GltfDocument document, readGltf(path, limits));
    Result<RiggedMesh> rig = rigFromGltf(document, limits);
    if (!rig) return atPlace(std::move(rig).error(), path.string());
    if (rig->name.empty()) rig->name = path.stem().string();
    return rig;
}

Result<TriangleMesh> staticMeshFromGltf(const GltfDocument& document, const ReadLimits& limits) {
    std::vector<Instance> instances = sceneMeshes(document, sceneOrder(document));
    std::erase_if(instances, [](const Instance& instance) { return instance.skin >= 0; });
    ARS_TRY_STATUS(checkSize(document, instances, limits));
    if (instances.empty()) return makeError(ErrorCode::Unsupported, "", "the scene has no mesh without a skin");
    const std::vector<glm::mat4> global = document.globalMatrices();
    MeshMerger merger(document);
    std::string name;
    for (const Instance& instance : instances) {
        const GltfMesh& mesh = document.meshes[static_cast<std::size_t>(instance.mesh)];
        const glm::dmat4 place(global[static_cast<std::size_t>(instance.node)]);
        for (const GltfPrimitive& primitive : mesh.primitives) {
            merger.append(mesh, primitive, [&](std::size_t) { return place; });
        }
        if (name.empty()) name = mesh.name;
    }
    return merger.finish(std::move(name));
}

} // namespace ars
