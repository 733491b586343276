// Rigs are written down by hand with the answers that the glTF specification gives for them (3.7.3.3, skinned meshes:
// a vertex lies at sum over joints of weight * global(joint) * inverseBind(joint) * position).
#include "engine/core/file.h"
#include "engine/io/npz.h"
#include "engine/io/obj.h"
#include "engine/io/ply.h"
#include "engine/rig/gltf_rig.h"
#include "engine/rig/motion.h"
#include "engine/rig/posed_export.h"
#include "engine/rig/template_mesh.h"
#include "tests/support/test_data.h"

#include <gtest/gtest.h>

#include <glm/gtc/matrix_transform.hpp>
#include <glm/gtc/quaternion.hpp>

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <random>
#include <tuple>

namespace ars {
namespace {

void expectNear(const glm::vec3& found, const glm::vec3& expected, float tolerance = 1e-5f) {
    EXPECT_LT(glm::distance(found, expected), tolerance)
        << "(" << found.x << ", " << found.y << ", " << found.z << "), expected (" << expected.x << ", " << expected.y
        << ", " << expected.z << ")";
}

int addNode(GltfDocument& document, const std::string& name, int parent, const glm::mat4& local) {
    GltfNode node;
    node.name = name;
    node.parent = parent;
    node.localMatrix = local;
    node.hasMatrix = true;
    const int index = static_cast<int>(document.nodes.size());
    if (parent < 0) {
        document.sceneRoots.push_back(index);
    } else {
        document.nodes[static_cast<std::size_t>(parent)].children.push_back(index);
    }
    document.nodes.push_back(std::move(node));
    return index;
}

glm::mat4 translate(float x, float y, float z) { return glm::translate(glm::mat4(1.0f), glm::vec3(x, y, z)); }
glm::mat4 scale(float x, float y, float z) { return glm::scale(glm::mat4(1.0f), glm::vec3(x, y, z)); }
glm::mat4 rotateZ(float degrees) { return glm::rotate(glm::mat4(1.0f), glm::radians(degrees), glm::vec3(0, 0, 1)); }
glm::mat4 rotateX(float degrees) { return glm::rotate(glm::mat4(1.0f), glm::radians(degrees), glm::vec3(1, 0, 0)); }

/// A triangle on an upper arm (joint 0), one on a forearm (joint 1) along +x, elbow at x = 1.
GltfPrimitive armPrimitive() {
    GltfPrimitive primitive;
    primitive.mesh.positions = {{0.2f, 0, 0}, {0.8f, 0, 0}, {0.5f, 0.1f, 0},
                                {1.2f, 0, 0}, {1.8f, 0, 0}, {1.5f, 0.1f, 0}};
    primitive.mesh.triangles = {{0, 1, 2}, {3, 4, 5}};
    primitive.influences = 4;
    for (int v = 0; v < 6; ++v) {
        primitive.joints.insert(primitive.joints.end(), {static_cast<std::uint16_t>(v < 3 ? 0 : 1), 0, 0, 0});
        primitive.weights.insert(primitive.weights.end(), {1.0f, 0.0f, 0.0f, 0.0f});
    }
    return primitive;
}

/// Upper and lower arm below `parent`-less root transform `root`, bound in the pose of the nodes with the mesh's own
/// space being the arm's.
GltfDocument armDocument(const glm::mat4& root = glm::mat4(1.0f)) {
    GltfDocument document;
    const int top = addNode(document, "armature", -1, root);
    const int upper = addNode(document, "upper", top, glm::mat4(1.0f));
    const int lower = addNode(document, "lower", upper, translate(1, 0, 0));
    const int meshNode = addNode(document, "arm", -1, translate(9, 9, 9)); // a skinned mesh's own node does not count
    document.nodes[static_cast<std::size_t>(meshNode)].mesh = 0;
    document.nodes[static_cast<std::size_t>(meshNode)].skin = 0;
    document.meshes.push_back({"arm", {armPrimitive()}, {}});
    document.skins.push_back({"skin", {upper, lower}, {glm::mat4(1.0f), translate(-1, 0, 0)}, upper});
    return document;
}

std::vector<glm::vec3> posed(const RiggedMesh& rig, const Pose& pose) {
    std::vector<glm::vec3> points(rig.mesh.positions.size());
    EXPECT_TRUE(skinPoints(skinningMatrices(rig.skeleton, pose), rig.weights, rig.mesh.positions, points).ok());
    return points;
}

/// Vertices of a document's first skinned mesh by the specification's formula, with node transforms as they stand.
std::vector<glm::vec3> specificationVertices(const GltfDocument& document) {
    const std::vector<glm::mat4> global = document.globalMatrices();
    const GltfSkin& skin = document.skins.front();
    std::vector<glm::vec3> result;
    for (const GltfPrimitive& primitive : document.meshes.front().primitives) {
        for (std::size_t v = 0; v < primitive.mesh.positions.size(); ++v) {
            glm::dvec4 sum(0.0);
            for (int i = 0; i < primitive.influences; ++i) {
                const std::size_t slot =
                    v * static_cast<std::size_t>(primitive.influences) + static_cast<std::size_t>(i);
                const std::size_t j = primitive.joints[slot];
                sum += static_cast<double>(primitive.weights[slot]) *
                       (glm::dmat4(global[static_cast<std::size_t>(skin.joints[j])]) *
                        glm::dmat4(skin.inverseBindMatrices[j]) *
                        glm::dvec4(glm::dvec3(primitive.mesh.positions[v]), 1.0));
            }
            result.emplace_back(sum);
        }
    }
    return result;
}

/// Puts frame `key` of the first animation into the nodes.
void applyAnimation(GltfDocument& document, std::size_t key) {
    for (const GltfChannel& channel : document.animations.front().channels) {
        GltfNode& node = document.nodes[static_cast<std::size_t>(channel.node)];
        const float* v = &channel.values[key * static_cast<std::size_t>(channel.width)];
        if (channel.path == GltfPath::Rotation) node.rotation = glm::quat(v[3], v[0], v[1], v[2]);
        if (channel.path == GltfPath::Translation) node.translation = {v[0], v[1], v[2]};
        node.localMatrix = glm::translate(glm::mat4(1.0f), node.translation) * glm::mat4_cast(node.rotation) *
                           glm::scale(glm::mat4(1.0f), node.scale);
    }
}

TEST(GltfRig, ElbowBendsTheForearmAlone) {
    const auto rig = rigFromGltf(armDocument());
    ASSERT_TRUE(rig.ok()) << rig.error().describe();
    ASSERT_EQ(rig->skeleton.jointCount(), 2);
    EXPECT_EQ(rig->skeleton.names, (std::vector<std::string>{"upper", "lower"}));
    EXPECT_EQ(rig->skeleton.parents, (std::vector<int>{-1, 0}));
    EXPECT_EQ(rig->restSource, RestSource::NodeTransforms);
    EXPECT_FALSE(rig->isSmplx);
    expectNear(rig->skeleton.restPositions[1], {1, 0, 0});
    expectNear(rig->mesh.positions[4], {1.8f, 0, 0});
    Pose pose = restPose(2);
    const std::vector<glm::vec3> still = posed(*rig, pose);
    for (std::size_t v = 0; v < 6; ++v) expectNear(still[v], rig->mesh.positions[v], 1e-6f);
    pose.rotations[1] = glm::angleAxis(glm::radians(90.0f), glm::vec3(0, 0, 1));
    const std::vector<glm::vec3> bent = posed(*rig, pose);
    expectNear(bent[1], {0.8f, 0, 0});
    expectNear(bent[4], {1.0f, 0.8f, 0});
    expectNear(bent[5], {0.9f, 0.5f, 0});
}

TEST(GltfRig, CentimetreRigWithZUpBecomesMetresWithYUp) {
    // As exported by many tools: the armature carries 0.01 and a quarter turn, the mesh is in centimetres.
    GltfDocument document = armDocument(rotateX(-90) * scale(0.01f, 0.01f, 0.01f));
    document.nodes[2].localMatrix = translate(100, 0, 0);
    document.skins[0].inverseBindMatrices[1] = translate(-100, 0, 0);
    for (glm::vec3& p : document.meshes[0].primitives[0].mesh.positions) p *= 100.0f;
    document.meshes[0].primitives[0].mesh.positions[5] = {150, 0, 10}; // 10 cm up in a z-up file
    const auto rig = rigFromGltf(document);
    ASSERT_TRUE(rig.ok()) << rig.error().describe();
    EXPECT_EQ(rig->restSource, RestSource::NodeTransforms);
    expectNear(rig->skeleton.restPositions[1], {1, 0, 0});
    expectNear(rig->mesh.positions[5], {1.5f, 0.1f, 0});
    Pose pose = restPose(2);
    pose.rotations[1] = glm::angleAxis(glm::radians(90.0f), glm::vec3(0, 0, 1)); // in the joint's own, z-up axes
    expectNear(posed(*rig, pose)[4], {1, 0, -0.8f});
}

TEST(GltfRig, NonUniformScaleIsWorkedIntoTheMesh) {
    const auto rig = rigFromGltf(armDocument(scale(2.0f, 1.0f, 0.5f)));
    ASSERT_TRUE(rig.ok()) << rig.error().describe();
    expectNear(rig->mesh.positions[4], {3.6f, 0, 0});
    expectNear(rig->skeleton.restPositions[1], {2, 0, 0});
    Pose pose = restPose(2);
    pose.rotations[1] = glm::angleAxis(glm::radians(90.0f), glm::vec3(0, 0, 1));
    expectNear(posed(*rig, pose)[4], {2, 1.6f, 0}); // rigid: the forearm keeps its length
}

TEST(GltfRig, MirroredRootKeepsTrianglesFacingOutwards) {
    const auto rig = rigFromGltf(armDocument(scale(-1.0f, 1.0f, 1.0f)));
    ASSERT_TRUE(rig.ok()) << rig.error().describe();
    expectNear(rig->mesh.positions[4], {-1.8f, 0, 0});
    const glm::uvec3 t = rig->mesh.triangles[0];
    const glm::vec3 normal = glm::cross(rig->mesh.positions[t.y] - rig->mesh.positions[t.x],
                                        rig->mesh.positions[t.z] - rig->mesh.positions[t.x]);
    EXPECT_GT(normal.z, 0.0f);
    EXPECT_GT(rig->mesh.normals[0].z, 0.99f);
}

TEST(GltfRig, BindPoseWinsOverThePoseThatTheFileWasSavedIn) {
    GltfDocument document = armDocument();
    document.nodes[2].localMatrix = translate(1, 0, 0) * rotateZ(60);
    const auto rig = rigFromGltf(document);
    ASSERT_TRUE(rig.ok()) << rig.error().describe();
    EXPECT_EQ(rig->restSource, RestSource::BindMatrices);
    EXPECT_FALSE(rig->notes.empty());
    expectNear(rig->mesh.positions[4], {1.8f, 0, 0});
    EXPECT_NEAR(std::abs(rig->skeleton.restOrientations[1].w), 1.0f, 1e-5f);
    // A joint that was moved as well says how far.
    document.nodes[2].localMatrix = translate(0, 1, 0);
    EXPECT_NEAR(rigFromGltf(document)->restDisagreementM, std::sqrt(2.0f), 1e-4f);
}

TEST(GltfRig, BindMatricesThatSayNothingLeaveTheNodesPose) {
    GltfDocument document = armDocument();
    document.skins[0].inverseBindMatrices.assign(2, glm::mat4(1.0f));
    const auto rig = rigFromGltf(document);
    ASSERT_TRUE(rig.ok()) << rig.error().describe();
    EXPECT_EQ(rig->restSource, RestSource::NodeTransforms);
    expectNear(rig->skeleton.restPositions[1], {1, 0, 0});
    expectNear(rig->mesh.positions[4], {2.8f, 0, 0}); // the formula with identity matrices
}

TEST(GltfRig, NodesBetweenJointsBecomeJointsAndRigidMeshesFollow) {
    GltfDocument document;
    const int hips = addNode(document, "hips", -1, glm::mat4(1.0f));
    const int twist = addNode(document, "twist", hips, translate(0, 0.5f, 0));
    const int chest = addNode(document, "chest", twist, translate(0, 0.5f, 0));
    const int sword = addNode(document, "sword", chest, translate(0.2f, 0, 0) * scale(2, 2, 2));
    const int floor = addNode(document, "floor", -1, glm::mat4(1.0f));
    const int body = addNode(document, "body", -1, glm::mat4(1.0f));
    document.nodes[static_cast<std::size_t>(sword)].mesh = 1;
    document.nodes[static_cast<std::size_t>(floor)].mesh = 1;
    document.nodes[static_cast<std::size_t>(body)].mesh = 0;
    document.nodes[static_cast<std::size_t>(body)].skin = 0;
    document.meshes.push_back({"body", {armPrimitive()}, {}});
    GltfPrimitive blade;
    blade.mesh.positions = {{0, 0, 0}, {0.1f, 0, 0}, {0, 1, 0}};
    blade.mesh.triangles = {{0, 1, 2}};
    document.meshes.push_back({"blade", {blade}, {}});
    document.skins.push_back({"skin", {hips, chest}, {glm::mat4(1.0f), translate(0, -1, 0)}, hips});
    const auto rig = rigFromGltf(document);
    ASSERT_TRUE(rig.ok()) << rig.error().describe();
    EXPECT_EQ(rig->skeleton.names, (std::vector<std::string>{"hips", "twist", "chest"}));
    EXPECT_EQ(rig->skeleton.parents, (std::vector<int>{-1, 0, 1}));
    ASSERT_EQ(rig->mesh.positions.size(), 9u); // the floor hangs on no joint
    EXPECT_EQ(rig->notes.size(), 1u);
    const auto blade2 = std::find_if(rig->mesh.positions.begin(), rig->mesh.positions.end(), [](const glm::vec3& p) {
        return glm::distance(p, glm::vec3(0.2f, 3, 0)) < 1e-5f;
    });
    ASSERT_NE(blade2, rig->mesh.positions.end());
    const auto vertex = static_cast<std::size_t>(blade2 - rig->mesh.positions.begin());
    EXPECT_EQ(rig->weights.joints[vertex * kMaxInfluences], 2);
    EXPECT_FLOAT_EQ(rig->weights.weights[vertex * kMaxInfluences], 1.0f);
}

TEST(GltfRig, WeightsAreCutToEightAndWeightlessVerticesFollowTheTop) {
    GltfDocument document;
    std::vector<int> joints;
    std::vector<glm::mat4> inverse;
    for (int j = 0; j < 8; ++j) {
        joints.push_back(addNode(document, fmt::format("j{}", j), j - 1, translate(j > 0 ? 1.0f : 0.0f, 0, 0)));
        inverse.push_back(translate(static_cast<float>(-j), 0, 0));
    }
    const int body = addNode(document, "body", -1, glm::mat4(1.0f));
    document.nodes[static_cast<std::size_t>(body)].mesh = 0;
    document.nodes[static_cast<std::size_t>(body)].skin = 0;
    GltfPrimitive primitive;
    primitive.mesh.positions = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
    primitive.mesh.triangles = {{0, 1, 2}};
    primitive.influences = 8;
    for (int v = 0; v < 3; ++v) {
        for (int i = 0; i < 8; ++i) {
            primitive.joints.push_back(static_cast<std::uint16_t>(i / 2)); // every joint twice
            primitive.weights.push_back(v == 2 ? 0.0f : static_cast<float>(i + 1));
        }
    }
    document.meshes.push_back({"body", {primitive}, {}});
    document.skins.push_back({"skin", joints, inverse, 0});
    const auto rig = rigFromGltf(document);
    ASSERT_TRUE(rig.ok()) << rig.error().describe();
    EXPECT_EQ(rig->weights.joints[0], 3); // 7 + 8 of 36
    EXPECT_NEAR(rig->weights.weights[0], 15.0f / 36.0f, 1e-6f);
    EXPECT_NEAR(rig->weights.weights[1], 11.0f / 36.0f, 1e-6f);
    EXPECT_FLOAT_EQ(rig->weights.weights[4], 0.0f);
    EXPECT_EQ(rig->weights.joints[2 * kMaxInfluences], 0);
    EXPECT_FLOAT_EQ(rig->weights.weights[2 * kMaxInfluences], 1.0f);
    EXPECT_EQ(rig->notes.size(), 1u);
}

TEST(GltfRig, BadScenesAreOneClearError) {
    const auto code = [](const GltfDocument& document, const ReadLimits& limits = {}) {
        const auto rig = rigFromGltf(document, limits);
        return rig.ok() ? std::string("ok") : std::string(errorCodeName(rig.error().code));
    };
    EXPECT_EQ(code({}), "unsupported");
    GltfDocument document = armDocument();
    document.skins[0].inverseBindMatrices[1] = glm::mat4(0.0f);
    EXPECT_EQ(code(document), "bad_file");
    document = armDocument();
    document.meshes[0].primitives[0].joints[0] = 2;
    EXPECT_EQ(code(document), "bad_file");
    document = armDocument();
    document.skins[0].joints.clear();
    document.skins[0].inverseBindMatrices.clear();
    EXPECT_EQ(code(document), "bad_file");
    document = armDocument();
    document.meshes[0].primitives[0].mesh.positions[2].x = NAN;
    EXPECT_EQ(code(document), "bad_file");
    document = armDocument();
    document.sceneRoots = {3}; // the joints are not shown
    EXPECT_EQ(code(document), "bad_file");
    EXPECT_EQ(code(armDocument(), ReadLimits{.maxJoints = 1}), "limit_exceeded");
    EXPECT_EQ(code(armDocument(), ReadLimits{.maxElements = 5}), "limit_exceeded");
}

/// A SMPL-X rig of any shape with one triangle on every joint.
RiggedMesh smplxRig() {
    std::mt19937 random(11);
    std::uniform_real_distribution<float> offset(-0.2f, 0.2f);
    std::vector<glm::vec3> joints;
    TemplateMesh mesh;
    for (int j = 0; j < kSmplxJointCount; ++j) {
        const glm::vec3 parent = j == 0 ? glm::vec3(0) : joints[static_cast<std::size_t>(smplxJointParent(j))];
        joints.push_back(parent + glm::vec3(offset(random), offset(random), offset(random)));
        const auto first = static_cast<std::uint32_t>(mesh.mesh.positions.size());
        mesh.mesh.triangles.emplace_back(first, first + 1, first + 2);
        for (int c = 0; c < 3; ++c) {
            mesh.mesh.positions.push_back(joints.back() + 0.1f * glm::vec3(c == 0, c == 1, c == 2));
            const int other = (j + 7) % kSmplxJointCount;
            std::array<std::uint16_t, kMaxInfluences> row{static_cast<std::uint16_t>(j),
                                                          static_cast<std::uint16_t>(other)};
            std::array<float, kMaxInfluences> weights{0.75f, 0.25f};
            mesh.weights.joints.insert(mesh.weights.joints.end(), row.begin(), row.end());
            mesh.weights.weights.insert(mesh.weights.weights.end(), weights.begin(), weights.end());
        }
    }
    mesh.joints = joints;
    mesh.name = "smplx";
    return rigFromTemplate(mesh);
}

Motion randomMotion(int joints, int frames) {
    std::mt19937 random(5);
    std::normal_distribution<float> normal(0.0f, 0.4f);
    Motion motion;
    motion.framesPerSecond = 20.0;
    for (int f = 0; f < frames; ++f) {
        Pose pose = restPose(joints);
        for (glm::quat& q : pose.rotations) q = quatFromAxisAngle({normal(random), normal(random), normal(random)});
        pose.translation = {normal(random), normal(random), normal(random)};
        motion.frames.push_back(pose);
    }
    return motion;
}

TEST(GltfRig, ExportedAnimationPutsEveryVertexWhereSkinningDoes) {
    RiggedMesh rig = smplxRig();
    for (const bool turnedJoints : {false, true}) {
        if (turnedJoints) {
            std::mt19937 random(2);
            std::normal_distribution<float> normal;
            for (glm::quat& q : rig.skeleton.restOrientations) {
                q = quatFromAxisAngle({normal(random), normal(random), normal(random)});
            }
        }
        const Motion motion = randomMotion(kSmplxJointCount, 4);
        auto document = gltfFromRig(rig, &motion);
        ASSERT_TRUE(document.ok()) << document.error().describe();
        const auto bytes = encodeGlb(*document);
        ASSERT_TRUE(bytes.ok()) << bytes.error().describe();
        auto read = parseGltf(*bytes);
        ASSERT_TRUE(read.ok()) << read.error().describe();
        const std::vector<glm::vec3> rest = specificationVertices(*read);
        ASSERT_EQ(rest.size(), rig.mesh.positions.size());
        for (std::size_t v = 0; v < rest.size(); ++v) expectNear(rest[v], rig.mesh.positions[v], 2e-6f);
        for (std::size_t f = 0; f < motion.frames.size(); ++f) {
            applyAnimation(*read, f);
            const std::vector<glm::vec3> expected = specificationVertices(*read);
            const std::vector<glm::vec3> found = posed(rig, motion.frames[f]);
            for (std::size_t v = 0; v < found.size(); ++v) expectNear(found[v], expected[v], 1e-5f);
        }
        EXPECT_NEAR(read->animations[0].endS(), 3.0f / 20.0f, 1e-6f);
    }
}

TEST(GltfRig, SmplxNamesInAnyOrderComeBackInTheModelsOrder) {
    const RiggedMesh rig = smplxRig();
    auto document = gltfFromRig(rig);
    ASSERT_TRUE(document.ok()) << document.error().describe();
    // Other order of joints and children, eyes without suffix, a root above and a helper between.
    GltfSkin& skin = document->skins[0];
    std::vector<std::size_t> order(skin.joints.size());
    std::iota(order.begin(), order.end(), 0u);
    std::shuffle(order.begin(), order.end(), std::mt19937(1));
    const GltfSkin old = skin;
    std::vector<std::uint16_t> newIndex(order.size());
    for (std::size_t i = 0; i < order.size(); ++i) {
        skin.joints[i] = old.joints[order[i]];
        skin.inverseBindMatrices[i] = old.inverseBindMatrices[order[i]];
        newIndex[order[i]] = static_cast<std::uint16_t>(i);
    }
    for (GltfPrimitive& primitive : document->meshes[0].primitives) {
        for (std::uint16_t& joint : primitive.joints) joint = newIndex[joint];
    }
    for (GltfNode& node : document->nodes) std::reverse(node.children.begin(), node.children.end());
    document->nodes[23].name = "left_eye";
    const int root = addNode(*document, "root", -1, glm::mat4(1.0f));
    document->nodes[static_cast<std::size_t>(root)].children = {0};
    document->nodes[0].parent = root;
    std::erase(document->sceneRoots, 0);
    const int helper = addNode(*document, "helper", 18, glm::mat4(1.0f)); // below the left elbow
    skin.joints.push_back(root);
    skin.joints.push_back(helper);
    skin.inverseBindMatrices.push_back(glm::mat4(1.0f));
    skin.inverseBindMatrices.push_back(old.inverseBindMatrices[18]);
    document->meshes[0].primitives[0].joints[0] = static_cast<std::uint16_t>(skin.joints.size() - 1);
    const auto found = rigFromGltf(*document);
    ASSERT_TRUE(found.ok()) << found.error().describe();
    EXPECT_TRUE(found->isSmplx);
    ASSERT_EQ(found->skeleton.jointCount(), kSmplxJointCount);
    EXPECT_EQ(found->skeleton.parents, rig.skeleton.parents);
    for (int j = 0; j < kSmplxJointCount; ++j) {
        const auto i = static_cast<std::size_t>(j);
        EXPECT_EQ(found->skeleton.names[i], smplxJointName(j));
        expectNear(found->skeleton.restPositions[i], rig.skeleton.restPositions[i]);
        EXPECT_EQ(found->jointNodes[i], j);
        EXPECT_EQ(found->parts[i], smplxJointPart(j));
    }
    // The helper's weight went to the elbow; vertex 0 had belonged to the pelvis.
    EXPECT_EQ(found->weights.joints[0], 18);
    for (std::size_t i = kMaxInfluences; i < rig.weights.joints.size(); ++i) {
        EXPECT_EQ(found->weights.joints[i], rig.weights.joints[i]);
        EXPECT_NEAR(found->weights.weights[i], rig.weights.weights[i], 1e-6f);
    }
    // Same names in another tree are not SMPL-X.
    GltfDocument other = *gltfFromRig(rig);
    other.nodes[18].parent = 0;
    std::erase(other.nodes[16].children, 18);
    other.nodes[0].children.push_back(18);
    EXPECT_FALSE(rigFromGltf(other)->isSmplx);
}

TEST(GltfRig, RigsThatDoNotFitTogetherAreNotWritten) {
    RiggedMesh rig = smplxRig();
    Motion motion = randomMotion(54, 1);
    EXPECT_EQ(gltfFromRig(rig, &motion).error().code, ErrorCode::InvalidArgument);
    RiggedMesh broken = rig;
    broken.weights.joints[5] = 99;
    EXPECT_EQ(gltfFromRig(broken).error().code, ErrorCode::InvalidArgument);
    broken = rig;
    broken.weights.weights.resize(8);
    broken.weights.joints.resize(8);
    EXPECT_EQ(gltfFromRig(broken).error().code, ErrorCode::InvalidArgument);
    broken = rig;
    broken.mesh.materials.assign(broken.mesh.triangles.size(), 3);
    EXPECT_EQ(gltfFromRig(broken).error().code, ErrorCode::InvalidArgument);
}

TEST(GltfRig, StaticMeshesArePlacedByTheirNodes) {
    GltfDocument document;
    GltfPrimitive triangle;
    triangle.mesh.positions = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
    triangle.mesh.triangles = {{0, 1, 2}};
    document.meshes.push_back({"t", {triangle}, {}});
    const int top = addNode(document, "top", -1, translate(0, 5, 0));
    for (const float x : {1.0f, 2.0f}) {
        const int node = addNode(document, "n", top, translate(x, 0, 0) * rotateZ(90));
        document.nodes[static_cast<std::size_t>(node)].mesh = 0;
    }
    const auto mesh = staticMeshFromGltf(document);
    ASSERT_TRUE(mesh.ok()) << mesh.error().describe();
    ASSERT_EQ(mesh->positions.size(), 6u);
    expectNear(mesh->positions[1], {1, 6, 0});
    expectNear(mesh->positions[5], {1, 5, 0});
    EXPECT_EQ(staticMeshFromGltf(document, ReadLimits{.maxElements = 5}).error().code, ErrorCode::LimitExceeded);
    EXPECT_EQ(staticMeshFromGltf({}).error().code, ErrorCode::Unsupported);
}

TEST(GltfRig, ClothedTemplateGlbEqualsItsNpz) {
    ARS_TEST_DATA_FILE(glb, "capture/casual/template.glb");
    ARS_TEST_DATA_FILE(npz, "capture/casual/template.npz");
    const auto rig = readGltfRig(glb);
    ASSERT_TRUE(rig.ok()) << rig.error().describe();
    const auto given = readWeightedTemplate(npz);
    ASSERT_TRUE(given.ok()) << given.error().describe();
    EXPECT_TRUE(rig->isSmplx);
    EXPECT_EQ(rig->restSource, RestSource::NodeTransforms);
    EXPECT_EQ(rig->materials.size(), 6u);
    EXPECT_EQ(rig->images.size(), 5u);
    EXPECT_EQ(rig->materials[1].name, "shirt");
    EXPECT_NEAR(rig->materials[1].roughnessFactor, 0.8f, 1e-6f);
    EXPECT_EQ(rig->mesh.triangles.size(), 80148u);
    EXPECT_EQ(given->mesh.triangles.size(), 80148u);
    ASSERT_EQ(rig->mesh.positions.size(), 43307u);
    ASSERT_EQ(given->mesh.positions.size(), 43307u);
    for (std::size_t j = 0; j < kSmplxJointCount; ++j) {
        expectNear(rig->skeleton.restPositions[j], given->joints[j], 1e-6f);
    }
    // The same vertices in another order: found by position and texture coordinates, some of them several times.
    using Key = std::tuple<long, long, long, long, long>;
    const auto key = [](const TriangleMesh& mesh, std::size_t v) {
        const glm::vec3 p = mesh.positions[v] * 1e5f;
        const glm::vec2 t = mesh.uvs[v] * 1e4f;
        return Key{std::lround(p.x), std::lround(p.y), std::lround(p.z), std::lround(t.x), std::lround(t.y)};
    };
    std::map<Key, std::vector<std::size_t>> byKey;
    for (std::size_t v = 0; v < given->mesh.positions.size(); ++v) byKey[key(given->mesh, v)].push_back(v);
    const std::vector<float> a = denseWeights(rig->weights, kSmplxJointCount);
    const std::vector<float> b = denseWeights(given->weights, kSmplxJointCount);
    double worst = 0.0;
    std::size_t missing = 0;
    for (std::size_t v = 0; v < rig->mesh.positions.size(); ++v) {
        const auto found = byKey.find(key(rig->mesh, v));
        if (found == byKey.end()) {
            ++missing;
            continue;
        }
        double best = 1.0;
        for (const std::size_t other : found->second) {
            double difference = 0.0;
            for (std::size_t j = 0; j < kSmplxJointCount; ++j) {
                difference = std::max(difference, std::abs(static_cast<double>(a[v * kSmplxJointCount + j]) -
                                                           b[other * kSmplxJointCount + j]));
            }
            best = std::min(best, difference);
        }
        worst = std::max(worst, best);
    }
    std::printf(
        "template.glb against template.npz: %zu vertices, %zu without partner (rounding of the key), largest weight "
        "difference %.2e\n",
        rig->mesh.positions.size(), missing, worst);
    EXPECT_LT(missing, 200u);
    EXPECT_LT(worst, 1e-5);
    const std::vector<glm::vec3> still = posed(*rig, restPose(kSmplxJointCount));
    float moved = 0.0f;
    for (std::size_t v = 0; v < still.size(); ++v)
        moved = std::max(moved, glm::distance(still[v], rig->mesh.positions[v]));
    EXPECT_LT(moved, 1e-6f);
}

TEST(GltfRig, EveryCutOfAGlbIsRefused) {
    const auto document = gltfFromRig(smplxRig());
    ASSERT_TRUE(document.ok());
    const auto bytes = encodeGlb(*document);
    ASSERT_TRUE(bytes.ok());
    test::TemporaryFolder folder;
    for (std::size_t n = 0; n < 16; ++n) {
        const auto path = folder / "cut.glb";
        ASSERT_TRUE(writeFileAtomic(path, std::span(*bytes).first(bytes->size() * n / 16)).ok());
        const auto rig = readGltfRig(path);
        ASSERT_FALSE(rig.ok()) << n;
        EXPECT_NE(rig.error().describe().find("cut.glb"), std::string::npos) << rig.error().describe();
    }
}

TEST(PosedExport, EveryFormatHoldsThePosedMesh) {
    test::TemporaryFolder folder;
    RiggedMesh rig = smplxRig();
    for (std::size_t v = 0; v < rig.mesh.positions.size(); ++v) {
        rig.mesh.uvs.emplace_back(static_cast<float>(v) / 200.0f, 0.25f);
    }
    const Pose pose = randomMotion(kSmplxJointCount, 1).frames[0];
    const std::vector<glm::vec3> expected = posed(rig, pose);
    const auto joints = jointWorldMatrices(rig.skeleton, pose);
    for (const std::string name : {"a.obj", "a.ply", "a.npz", "a.glb"}) {
        const Status written = exportPosed(folder / name, rig, pose);
        ASSERT_TRUE(written.ok()) << written.error().describe();
    }
    const auto obj = readObj(folder / "a.obj");
    const auto ply = readPlyMesh(folder / "a.ply");
    const auto npz = readNpz(folder / "a.npz");
    auto glb = readGltf(folder / "a.glb");
    ASSERT_TRUE(obj.ok() && ply.ok() && npz.ok() && glb.ok());
    ASSERT_EQ(obj->mesh.positions.size(), expected.size());
    ASSERT_EQ(ply->positions.size(), expected.size());
    const auto v = npz->arrays.at("v").toFloat();
    const auto j = npz->arrays.at("joints").toFloat();
    applyAnimation(*glb, 0);
    const std::vector<glm::vec3> animated = specificationVertices(*glb);
    for (std::size_t i = 0; i < expected.size(); ++i) {
        const auto source = static_cast<std::size_t>(obj->mesh.sourceVertices[i]);
        expectNear(obj->mesh.positions[i], expected[source], 2e-6f);
        EXPECT_NEAR(obj->mesh.uvs[i].x, rig.mesh.uvs[source].x, 1e-6f);
        EXPECT_NEAR(obj->mesh.uvs[i].y, 0.25f, 1e-6f);
        expectNear(ply->positions[i], expected[i], 1e-6f);
        expectNear({(*v)[3 * i], (*v)[3 * i + 1], (*v)[3 * i + 2]}, expected[i], 1e-6f);
        expectNear(animated[i], expected[i], 1e-5f);
    }
    for (std::size_t i = 0; i < joints.size(); ++i) {
        expectNear({(*j)[3 * i], (*j)[3 * i + 1], (*j)[3 * i + 2]}, glm::vec3(joints[i][3]), 1e-6f);
    }
    EXPECT_EQ(npz->arrays.at("f").shape, (std::vector<std::size_t>{55, 3}));
    EXPECT_EQ(exportPosed(folder / "a.stl", rig, pose).error().code, ErrorCode::InvalidArgument);
    EXPECT_EQ(exportPosed(folder / "b.obj", rig, restPose(3)).error().code, ErrorCode::InvalidArgument);
    EXPECT_FALSE(std::filesystem::exists(folder / "b.obj"));
}

TEST(PosedExport, StaticGlbHasNoSkeleton) {
    test::TemporaryFolder folder;
    const RiggedMesh rig = smplxRig();
    const Pose pose = randomMotion(kSmplxJointCount, 1).frames[0];
    const auto mesh = poseRig(rig, pose);
    ASSERT_TRUE(mesh.ok());
    const Status written = writePosedMesh(folder / "a.glb", PosedFormat::Glb, *mesh);
    ASSERT_TRUE(written.ok()) << written.error().describe();
    const auto document = readGltf(folder / "a.glb");
    ASSERT_TRUE(document.ok()) << document.error().describe();
    EXPECT_TRUE(document->skins.empty());
    EXPECT_EQ(document->nodes.size(), 1u);
    const auto read = staticMeshFromGltf(*document);
    ASSERT_TRUE(read.ok());
    ASSERT_EQ(read->positions.size(), mesh->mesh.positions.size());
    for (std::size_t v = 0; v < read->positions.size(); ++v)
        expectNear(read->positions[v], mesh->mesh.positions[v], 1e-6f);
}

} // namespace
} // namespace ars
