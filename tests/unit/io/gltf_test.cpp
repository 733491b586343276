#include "engine/io/gltf.h"

#include "engine/core/file.h"
#include "tests/support/test_data.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <cmath>
#include <cstring>
#include <fstream>
#include <functional>
#include <limits>

namespace ars {
namespace {

using nlohmann::json;

std::filesystem::path fixture(const char* name) { return test::sourceFolder() / "tests/unit/io/fixtures/mesh" / name; }

std::span<const std::byte> asBytes(std::string_view text) { return std::as_bytes(std::span(text)); }

template <typename T>
void expectError(const Result<T>& result, ErrorCode code, std::string_view sentence) {
    ASSERT_FALSE(result.ok()) << "accepted, expected: " << sentence;
    EXPECT_EQ(errorCodeName(result.error().code), errorCodeName(code)) << result.error().describe();
    EXPECT_NE(result.error().describe().find(sentence), std::string::npos) << result.error().describe();
}

void expectNear(const glm::vec3& found, const glm::vec3& expected, float tolerance = 1e-6f) {
    EXPECT_LE(glm::length(found - expected), tolerance) << found.x << " " << found.y << " " << found.z << " expected "
                                                        << expected.x << " " << expected.y << " " << expected.z;
}

// ------------------------------------------------------------------------------------------- files of other writers

/// What make_mesh_fixtures.py wrote; also used on our own rewriting of it.
void expectSkinnedStrip(const GltfDocument& document) {
    ASSERT_EQ(document.nodes.size(), 4u);
    EXPECT_EQ(document.nodes[0].name, "armature");
    EXPECT_EQ(document.nodes[0].children, (std::vector<int>{1, 3}));
    EXPECT_EQ(document.nodes[1].parent, 0);
    EXPECT_EQ(document.nodes[2].parent, 1);
    EXPECT_EQ(document.nodes[3].mesh, 0);
    EXPECT_EQ(document.nodes[3].skin, 0);
    EXPECT_EQ(document.sceneRoots, std::vector<int>{0});
    EXPECT_EQ(document.findNode("upper"), 2);
    // The armature turns y to z: the upper joint is at (0.5, 1, 0) below it, so at (0.5, 0, 1) in the world.
    const std::vector<glm::mat4> global = document.globalMatrices();
    expectNear(glm::vec3(global[2][3]), {0.5f, 0, 1});
    expectNear(glm::vec3(global[2][1]), {0, 0, 2}); // its y axis, scaled by 2

    ASSERT_EQ(document.skins.size(), 1u);
    EXPECT_EQ(document.skins[0].joints, (std::vector<int>{1, 2}));
    EXPECT_EQ(document.skins[0].skeletonRoot, 1);
    ASSERT_EQ(document.skins[0].inverseBindMatrices.size(), 2u);
    EXPECT_EQ(document.skins[0].inverseBindMatrices[1][3], glm::vec4(-0.5f, -1, 0, 1));

    ASSERT_EQ(document.meshes.size(), 1u);
    ASSERT_EQ(document.meshes[0].primitives.size(), 1u);
    EXPECT_EQ(document.meshes[0].morphWeights, std::vector<float>{0.125f});
    const GltfPrimitive& p = document.meshes[0].primitives[0];
    EXPECT_EQ(p.mesh.name, "strip");
    EXPECT_EQ(p.mesh.positions, (std::vector<glm::vec3>{{0, 0, 0}, {1, 0, 0}, {0, 2, 0}, {1, 2, 0}}));
    EXPECT_EQ(p.mesh.normals, std::vector<glm::vec3>(4, {0, 0, 1}));
    EXPECT_EQ(p.mesh.uvs, (std::vector<glm::vec2>{{0, 1}, {1, 1}, {0, 0}, {1, 0}}));
    EXPECT_EQ(p.mesh.triangles, (std::vector<glm::uvec3>{{0, 1, 2}, {1, 3, 2}})); // the strip's second triangle turns
    ASSERT_EQ(p.mesh.colors.size(), 4u);
    EXPECT_EQ(p.mesh.colors[1], glm::vec4(0, 1, 0, 1));
    EXPECT_FLOAT_EQ(p.mesh.colors[3].x, 0.2f);
    ASSERT_EQ(p.influences, 8);
    ASSERT_EQ(p.weights.size(), 32u);
    EXPECT_EQ(p.joints[0], 0);
    EXPECT_EQ(p.weights[0], 1.0f);
    EXPECT_EQ(p.joints[16], 1);
    EXPECT_FLOAT_EQ(p.weights[16], 0.8f);
    EXPECT_EQ(p.joints[20], 0);
    EXPECT_FLOAT_EQ(p.weights[20], 0.2f);
    ASSERT_EQ(p.morphTargets.size(), 1u);
    EXPECT_EQ(p.morphTargets[0].name, "widen");
    EXPECT_EQ(p.morphTargets[0].positions,
              (std::vector<glm::vec3>{{0, 0, 0}, {0.5f, 0, 0}, {0, 0, 0}, {0, 0, -0.25f}}));
    EXPECT_TRUE(p.morphTargets[0].normals.empty());

    ASSERT_EQ(document.materials.size(), 1u);
    const GltfMaterial& m = document.materials[0];
    EXPECT_EQ(m.name, "cloth");
    EXPECT_EQ(m.baseColorFactor, glm::vec4(0.25f, 0.5f, 0.75f, 1));
    EXPECT_EQ(m.metallicFactor, 0.125f);
    EXPECT_EQ(m.roughnessFactor, 0.625f);
    EXPECT_EQ(m.emissiveFactor, glm::vec3(0.5f, 0, 0));
    EXPECT_EQ(m.baseColorImage, 0);
    EXPECT_EQ(m.normalImage, -1);
    EXPECT_EQ(m.alphaMode, GltfAlphaMode::Mask);
    EXPECT_EQ(m.alphaCutoff, 0.25f);
    EXPECT_TRUE(m.doubleSided);
    ASSERT_EQ(document.images.size(), 1u);
    EXPECT_EQ(document.images[0].mimeType, "image/png");
    EXPECT_EQ(document.images[0].bytes.size(), 69u);
    EXPECT_EQ(document.images[0].bytes[0], std::byte{0x89});

    ASSERT_EQ(document.animations.size(), 1u);
    EXPECT_EQ(document.animations[0].name, "wave");
    EXPECT_EQ(document.animations[0].endS(), 2.0f);
    ASSERT_EQ(document.animations[0].channels.size(), 3u);
    const GltfChannel& turn = document.animations[0].channels[0];
    EXPECT_EQ(turn.node, 2);
    EXPECT_EQ(turn.path, GltfPath::Rotation);
    EXPECT_EQ(turn.interpolation, GltfInterpolation::Linear);
    EXPECT_EQ(turn.times, (std::vector<float>{0, 0.5f, 2}));
    EXPECT_EQ(turn.values, (std::vector<float>{0, 0, 0, 1, 0, 0, 1, 0, 0, 0, 0, -1}));
    const GltfChannel& move = document.animations[0].channels[1];
    EXPECT_EQ(move.interpolation, GltfInterpolation::CubicSpline);
    EXPECT_EQ(move.width, 3);
    ASSERT_EQ(move.values.size(), 27u);
    EXPECT_EQ(move.values[26], 26.0f);
    const GltfChannel& blend = document.animations[0].channels[2];
    EXPECT_EQ(blend.path, GltfPath::Weights);
    EXPECT_EQ(blend.interpolation, GltfInterpolation::Step);
    EXPECT_EQ(blend.width, 1);
    EXPECT_EQ(blend.values, (std::vector<float>{0, 1, 0.5f}));
}

TEST(Gltf, SkinnedFileOfAnotherWriter) {
    const Result<GltfDocument> document = readGltf(fixture("skinned_strip.glb"));
    ASSERT_TRUE(document.ok()) << document.error().describe();
    EXPECT_EQ(document->generator, "pygltflib");
    expectSkinnedStrip(*document);
    ASSERT_FALSE(document->notes.empty());
    EXPECT_EQ(document->notes[0], "the extension \"KHR_texture_transform\" is ignored");
}

TEST(Gltf, OurRewritingOfItSaysTheSame) {
    test::TemporaryFolder folder;
    const Result<GltfDocument> document = readGltf(fixture("skinned_strip.glb"));
    ASSERT_TRUE(document.ok());
    const Status status = writeGlb(folder / "strip.glb", *document);
    ASSERT_TRUE(status.ok()) << status.error().describe();
    const Result<GltfDocument> again = readGltf(folder / "strip.glb");
    ASSERT_TRUE(again.ok()) << again.error().describe();
    expectSkinnedStrip(*again);
    EXPECT_TRUE(again->notes.empty());
    // Written once more it is the same file, byte for byte.
    EXPECT_EQ(*encodeGlb(*document), *encodeGlb(*again));
}

TEST(Gltf, FilesBesideAGltfAreReadAndMissingPicturesAreNoted) {
    const Result<GltfDocument> document = readGltf(fixture("external.gltf"));
    ASSERT_TRUE(document.ok()) << document.error().describe();
    ASSERT_EQ(document->meshes.size(), 1u);
    ASSERT_EQ(document->meshes[0].primitives.size(), 1u); // the points are left out
    EXPECT_EQ(document->meshes[0].primitives[0].mesh.triangles,
              (std::vector<glm::uvec3>{{1, 2, 0}, {2, 3, 0}, {3, 4, 0}}));
    ASSERT_EQ(document->images.size(), 2u);
    EXPECT_EQ(document->images[0].bytes.size(), 69u);
    EXPECT_EQ(document->images[0].uri, "a%20pixel.png");
    EXPECT_TRUE(document->images[1].bytes.empty());
    ASSERT_EQ(document->notes.size(), 2u);
    EXPECT_EQ(document->notes[0], "images[1]: the file \"lost.png\" is not in the folder of this one");
    EXPECT_EQ(document->notes[1], "meshes[0].primitives[1]: points and lines are left out");

    const GltfNode& node = document->nodes[0];
    EXPECT_TRUE(node.hasMatrix);
    expectNear(node.translation, {5, 6, 7});
    expectNear(node.scale, {2, 3, 4});
    expectNear(node.rotation * glm::vec3(1, 0, 0), {0, 1, 0});
    expectNear(node.rotation * glm::vec3(0, 0, 1), {0, 0, 1});
    const glm::mat4 again = gltfLocalMatrix(node);
    for (int c = 0; c < 4; ++c) EXPECT_LE(glm::length(again[c] - node.localMatrix[c]), 1e-5f);

    const Result<std::vector<std::byte>> bytes = readFile(fixture("external.gltf"));
    ASSERT_TRUE(bytes.ok());
    expectError(parseGltf(*bytes), ErrorCode::NotFound, "buffers[0]: the file \"external.bin\" is not in the folder");
}

TEST(Gltf, MirroredMatrixIsDecomposedExactly) {
    GltfDocument document;
    document.nodes.resize(1);
    document.nodes[0].hasMatrix = true;
    document.nodes[0].localMatrix = glm::mat4(0, 0, 3, 0, 0, -2, 0, 0, 1, 0, 0, 0, 1, 2, 3, 1); // columns; det > 0
    document.nodes[0].localMatrix[0] *= -1.0f;                                                  // now mirrored
    const Result<std::vector<std::byte>> bytes = encodeGlb(document);
    ASSERT_TRUE(bytes.ok()) << bytes.error().describe();
    const Result<GltfDocument> again = parseGltf(*bytes);
    ASSERT_TRUE(again.ok()) << again.error().describe();
    ASSERT_TRUE(again->nodes[0].hasMatrix);
    EXPECT_EQ(again->nodes[0].localMatrix, document.nodes[0].localMatrix);
    const glm::mat4 composed = gltfLocalMatrix(again->nodes[0]);
    for (int c = 0; c < 4; ++c) EXPECT_LE(glm::length(composed[c] - document.nodes[0].localMatrix[c]), 1e-5f);
}

TEST(Gltf, SphereOfAnotherWriter) {
    const Result<GltfDocument> document = readGltf(fixture("sphere.glb"));
    ASSERT_TRUE(document.ok()) << document.error().describe();
    ASSERT_EQ(document->meshes.size(), 1u);
    const TriangleMesh& mesh = document->meshes[0].primitives.at(0).mesh;
    EXPECT_EQ(mesh.positions.size(), 42u);
    EXPECT_EQ(mesh.triangles.size(), 80u);
    EXPECT_TRUE(validateMesh(mesh).ok());
    for (const glm::vec3& p : mesh.positions) EXPECT_NEAR(glm::length(p), 0.5f, 1e-6f);
}

TEST(Gltf, ClothedTemplateOfTheTestData) {
    ARS_TEST_DATA_FILE(path, "capture/casual/template.glb");
    const Result<GltfDocument> document = readGltf(path);
    ASSERT_TRUE(document.ok()) << document.error().describe();
    ASSERT_EQ(document->skins.size(), 1u);
    EXPECT_EQ(document->skins[0].joints.size(), 55u);
    EXPECT_EQ(document->nodes[static_cast<std::size_t>(document->skins[0].joints[1])].name, "left_hip");
    // Numbers that pygltflib and numpy find in the same file.
    expectNear(document->nodes[static_cast<std::size_t>(document->skins[0].joints[1])].translation,
               {0.109765f, -0.005995005f, -0.01058f});
    expectNear(glm::vec3(document->skins[0].inverseBindMatrices[15][3]), {0, -0.78277f, -0.047f}, 1e-5f);
    std::size_t vertices = 0, triangles = 0;
    for (const GltfPrimitive& p : document->meshes.at(0).primitives) {
        vertices += p.mesh.positions.size();
        triangles += p.mesh.triangles.size();
        EXPECT_EQ(p.influences, 8);
        EXPECT_TRUE(validateMesh(p.mesh).ok());
    }
    EXPECT_EQ(vertices, 43307u); // 40,824 points, more where the texture has seams
    EXPECT_EQ(triangles, 80148u);
    glm::dvec3 sum(0);
    for (const glm::vec3& p : document->meshes[0].primitives[0].mesh.positions) sum += glm::dvec3(p);
    EXPECT_NEAR(sum.y, 6436.29601634, 1e-3);
    EXPECT_NEAR(sum.z, 612.30824, 1e-3);
    ASSERT_EQ(document->images.size(), 5u);
    for (const GltfImage& image : document->images) EXPECT_FALSE(image.bytes.empty()) << image.name;
    EXPECT_EQ(document->images[3].mimeType, "image/png");

    const Result<std::vector<std::byte>> bytes = encodeGlb(*document);
    ASSERT_TRUE(bytes.ok()) << bytes.error().describe();
    const Result<GltfDocument> again = parseGltf(*bytes);
    ASSERT_TRUE(again.ok()) << again.error().describe();
    EXPECT_EQ(again->skins[0].joints, document->skins[0].joints);
    EXPECT_EQ(again->skins[0].inverseBindMatrices, document->skins[0].inverseBindMatrices);
    for (std::size_t i = 0; i < document->meshes[0].primitives.size(); ++i) {
        const GltfPrimitive &was = document->meshes[0].primitives[i], &is = again->meshes[0].primitives[i];
        EXPECT_EQ(is.mesh.positions, was.mesh.positions);
        EXPECT_EQ(is.mesh.uvs, was.mesh.uvs);
        EXPECT_EQ(is.mesh.triangles, was.mesh.triangles);
        EXPECT_EQ(is.weights, was.weights);
        EXPECT_EQ(is.material, was.material);
    }
    EXPECT_EQ(again->images[2].bytes, document->images[2].bytes);
}

// ------------------------------------------------------------------------------------------------------ our writer

TEST(GltfWriter, MaterialsPerTriangleBecomePrimitives) {
    GltfDocument document;
    document.materials.resize(2);
    GltfPrimitive primitive;
    primitive.mesh.positions = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}};
    primitive.mesh.triangles = {{0, 1, 2}, {1, 3, 2}, {0, 2, 3}};
    primitive.mesh.materials = {1, 0, 1};
    primitive.influences = 4;
    for (int i = 0; i < 4; ++i) {
        primitive.joints.insert(primitive.joints.end(), {0, 0, 0, 0});
        primitive.weights.insert(primitive.weights.end(), {static_cast<float>(i) / 4, 0, 0, 0});
    }
    document.meshes.push_back({"quad", {primitive}, {}});
    const Result<std::vector<std::byte>> bytes = encodeGlb(document);
    ASSERT_TRUE(bytes.ok()) << bytes.error().describe();
    const Result<GltfDocument> again = parseGltf(*bytes);
    ASSERT_TRUE(again.ok()) << again.error().describe();
    ASSERT_EQ(again->meshes[0].primitives.size(), 2u);
    const GltfPrimitive& first = again->meshes[0].primitives[0];
    EXPECT_EQ(first.material, 0);
    EXPECT_EQ(first.mesh.positions, (std::vector<glm::vec3>{{1, 0, 0}, {1, 1, 0}, {0, 1, 0}}));
    EXPECT_EQ(first.mesh.triangles, (std::vector<glm::uvec3>{{0, 1, 2}}));
    EXPECT_EQ(first.weights[4], 0.75f);
    EXPECT_EQ(again->meshes[0].primitives[1].mesh.positions.size(), 4u);
    EXPECT_EQ(again->meshes[0].primitives[1].mesh.triangles.size(), 2u);
}

TEST(GltfWriter, EmptyThingsAreWrittenAsTheyAre) {
    GltfDocument document;
    document.nodes.resize(2);
    document.materials.resize(1);
    document.images.resize(1); // a picture that was missing
    document.materials[0].normalImage = 0;
    document.animations.resize(1);
    const Result<std::vector<std::byte>> bytes = encodeGlb(document);
    ASSERT_TRUE(bytes.ok()) << bytes.error().describe();
    const Result<GltfDocument> again = parseGltf(*bytes);
    ASSERT_TRUE(again.ok()) << again.error().describe();
    EXPECT_EQ(again->nodes.size(), 2u);
    EXPECT_EQ(again->sceneRoots, (std::vector<int>{0, 1}));
    EXPECT_EQ(again->materials.size(), 1u);
    EXPECT_EQ(again->materials[0].normalImage, -1);
    EXPECT_TRUE(again->images.empty());
    EXPECT_TRUE(encodeGlb({}).ok());
    EXPECT_TRUE(parseGltf(*encodeGlb({})).ok());
}

TEST(GltfWriter, MeshesBeyond65535VerticesKeepTheirIndices) {
    GltfDocument document;
    GltfPrimitive primitive;
    for (int i = 0; i < 70000; ++i) primitive.mesh.positions.emplace_back(static_cast<float>(i), 0, 0);
    primitive.mesh.triangles = {{0, 65535, 65536}, {69999, 1, 2}};
    document.meshes.push_back({"large", {primitive}, {}});
    const Result<std::vector<std::byte>> bytes = encodeGlb(document);
    ASSERT_TRUE(bytes.ok());
    const Result<GltfDocument> again = parseGltf(*bytes);
    ASSERT_TRUE(again.ok()) << again.error().describe();
    EXPECT_EQ(again->meshes[0].primitives[0].mesh.triangles, primitive.mesh.triangles);
}

TEST(GltfWriter, WhatDoesNotFitTogetherIsNamed) {
    const Result<GltfDocument> sound = readGltf(fixture("skinned_strip.glb"));
    ASSERT_TRUE(sound.ok());
    const auto refused = [&](const std::function<void(GltfDocument&)>& change, std::string_view sentence) {
        GltfDocument document = *sound;
        change(document);
        expectError(encodeGlb(document), ErrorCode::InvalidArgument, sentence);
    };
    refused([](auto& d) { d.nodes[0].parent = 2; }, "nodes[0]: the node is its own ancestor");
    refused([](auto& d) { d.nodes[0].parent = 4; }, "nodes[0].parent: names node 4, the document has 4");
    refused([](auto& d) { d.nodes[1].translation.x = std::nanf(""); }, "nodes[1]: its transform is not finite");
    refused([](auto& d) { d.skins[0].inverseBindMatrices.pop_back(); },
            "skins[0]: expected 2 inverse bind matrices, found 1");
    refused([](auto& d) { d.skins[0].joints[0] = 9; }, "skins[0]: names node 9");
    refused([](auto& d) { d.meshes[0].primitives[0].joints[3] = 2; }, "meshes[0]: names joint 2, its skin has 2");
    refused([](auto& d) { d.meshes[0].primitives[0].weights[8] = -1; }, "vertex 1 has the weight -1");
    refused([](auto& d) { d.meshes[0].primitives[0].weights.pop_back(); }, "expected 32 weights, found 31");
    refused([](auto& d) { d.meshes[0].primitives[0].mesh.triangles[0].x = 4; }, "triangle 0: names vertex 4");
    refused([](auto& d) { d.meshes[0].primitives[0].mesh.triangles.clear(); }, "at least one triangle");
    refused([](auto& d) { d.meshes[0].primitives[0].material = 1; }, "names material 1");
    refused([](auto& d) { d.materials[0].baseColorImage = 1; }, "materials[0]: names image 1");
    refused([](auto& d) { d.images[0].bytes[0] = std::byte{0}, d.images[0].mimeType = ""; }, "neither PNG nor JPEG");
    refused([](auto& d) { d.animations[0].channels[0].values.pop_back(); },
            "channels[0]: expected 12 numbers, found 11");
    refused([](auto& d) { d.animations[0].channels[0].times[1] = 0; }, "the times do not increase");
    refused([](auto& d) { d.nodes[0].name = "\xff"; }, "UTF-8");
}

// ---------------------------------------------------------------------------------------------------- broken files

std::string base64(std::string_view bytes) {
    constexpr char kDigits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    std::string text;
    for (std::size_t i = 0; i < bytes.size(); i += 3) {
        std::uint32_t group = 0;
        for (std::size_t k = 0; k < 3; ++k)
            group = group << 8 | (i + k < bytes.size() ? static_cast<unsigned char>(bytes[i + k]) : 0u);
        for (std::size_t k = 0; k < 4; ++k) text += i + k <= bytes.size() ? kDigits[group >> (18 - 6 * k) & 63] : '=';
    }
    return text;
}

template <typename T>
void append(std::string& bytes, std::initializer_list<T> values) {
    for (const T value : values) bytes.append(reinterpret_cast<const char*>(&value), sizeof(T));
}

/// One skinned, animated triangle. Buffer: 0 positions (36 bytes), 36 indices (u16 x 3, padded), 44 joints (u8 x 12),
/// 56 weights (48), 104 matrices (128), 232 times (8), 240 rotations (32); 272 bytes.
json triangleJson() {
    std::string bytes;
    append<float>(bytes, {0, 0, 0, 1, 0, 0, 0, 1, 0});
    append<std::uint16_t>(bytes, {0, 1, 2, 0});
    append<std::uint8_t>(bytes, {0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0});
    append<float>(bytes, {.5f, .5f, 0, 0, .5f, .5f, 0, 0, .5f, .5f, 0, 0});
    for (int i = 0; i < 2; ++i) append<float>(bytes, {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1});
    append<float>(bytes, {0, 1});
    append<float>(bytes, {0, 0, 0, 1, 0, 0, 1, 0});
    json root = json::parse(R"({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
        "nodes": [{"children": [1, 2]}, {"name": "a"}, {"name": "b", "children": [3]}, {"mesh": 0, "skin": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "JOINTS_0": 2, "WEIGHTS_0": 3}, "indices": 1, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "textures": [{"source": 0}],
        "images": [{"bufferView": 0, "mimeType": "image/png"}],
        "skins": [{"joints": [1, 2], "inverseBindMatrices": 4}],
        "animations": [{"channels": [{"sampler": 0, "target": {"node": 1, "path": "rotation"}}],
                        "samplers": [{"input": 5, "output": 6}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]},
            {"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"},
            {"bufferView": 2, "componentType": 5121, "count": 3, "type": "VEC4"},
            {"bufferView": 3, "componentType": 5126, "count": 3, "type": "VEC4"},
            {"bufferView": 4, "componentType": 5126, "count": 2, "type": "MAT4"},
            {"bufferView": 5, "componentType": 5126, "count": 2, "type": "SCALAR"},
            {"bufferView": 6, "componentType": 5126, "count": 2, "type": "VEC4"}],
        "bufferViews": [
            {"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 8},
            {"buffer": 0, "byteOffset": 44, "byteLength": 12}, {"buffer": 0, "byteOffset": 56, "byteLength": 48},
            {"buffer": 0, "byteOffset": 104, "byteLength": 128}, {"buffer": 0, "byteOffset": 232, "byteLength": 8},
            {"buffer": 0, "byteOffset": 240, "byteLength": 32}],
        "buffers": [{"byteLength": 272}]})");
    root["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64(bytes);
    return root;
}

/// The same with other bytes at an offset of the buffer.
json triangleWith(std::size_t offset, std::initializer_list<float> values) {
    json root = triangleJson();
    std::string bytes;
    append<float>(bytes, values);
    std::string text = root["buffers"][0]["uri"];
    const std::size_t comma = text.find(',') + 1;
    const std::size_t first = offset / 3 * 4;
    EXPECT_EQ(offset % 3, 0u);
    EXPECT_EQ(bytes.size() % 3, 0u);
    text.replace(comma + first, bytes.size() / 3 * 4, base64(bytes));
    root["buffers"][0]["uri"] = text;
    return root;
}

Result<GltfDocument> parse(const json& root, const ReadLimits& limits = {}) {
    return parseGltf(asBytes(root.dump()), {}, limits);
}

TEST(GltfBroken, TheTriangleItselfIsSound) {
    const Result<GltfDocument> document = parse(triangleJson());
    ASSERT_TRUE(document.ok()) << document.error().describe();
    EXPECT_EQ(document->meshes[0].primitives[0].weights[1], 0.5f);
    EXPECT_EQ(document->animations[0].channels.size(), 1u);
    EXPECT_EQ(document->images[0].bytes.size(), 36u);
    EXPECT_TRUE(document->notes.empty());
}

struct BrokenCase {
    const char* pointer; ///< where in the JSON
    json value;          ///< what stands there instead; null removes it
    ErrorCode code;
    const char* sentence;
};

TEST(GltfBroken, EveryWrongNumberIsRefusedInOneSentence) {
    constexpr ErrorCode kBad = ErrorCode::BadFile, kUnsupported = ErrorCode::Unsupported;
    const std::uint64_t huge = 1ull << 63;
    const BrokenCase cases[] = {
        {"/asset", nullptr, kBad, "asset.version: expected a version such as \"2.0\", found none"},
        {"/asset/version", "1.0", kUnsupported, "expected glTF 2.x, found \"1.0\""},
        {"/nodes", 7, kBad, "nodes: expected a list, found 7"},
        {"/nodes/1", 7, kBad, "nodes[1]: expected an object, found 7"},
        {"/nodes/0/children", {1, 2, 9}, kBad, "nodes[0].children: names node 9, the file has 4"},
        {"/nodes/0/children", {1, 2, -1}, kBad, "nodes[0].children[2]: expected a whole number from 0, found -1"},
        {"/nodes/0/children", {1, 1}, kBad, "node 1 already hangs below node 0"},
        {"/nodes/0/children", {0}, kBad, "nodes[0]: the node is its own ancestor"},
        {"/nodes/3/children", {2}, kBad, "node 2 already hangs below node"},
        {"/nodes/3/mesh", 1, kBad, "nodes[3]: names mesh 1, the file has 1"},
        {"/nodes/3/skin", 1, kBad, "nodes[3]: names skin 1, the file has 1"},
        {"/nodes/1/translation", {1, 2}, kBad, "nodes[1].translation: expected 3 numbers, found 2"},
        {"/nodes/1/translation", {1, 2, 1e300}, kBad, "1e+300 is beyond the range of a float"},
        {"/nodes/1/rotation", {0, 0, 0, 0}, kBad, "nodes[1].rotation: expected a quaternion of unit length"},
        {"/nodes/1/matrix", {1, 2}, kBad, "nodes[1].matrix: expected 16 numbers, found 2"},
        {"/scenes/0/nodes", {4}, kBad, "scenes[0].nodes: names node 4"},
        {"/scene", 1, kBad, "scene: names scene 1, the file has 1"},
        {"/accessors/0/count", huge, kBad,
         "accessors[0].count: expected at most 2147483647, found 9223372036854775808"},
        {"/accessors/0/count", -3, kBad, "accessors[0].count: expected a whole number from 0, found -3"},
        {"/accessors/0/count", 3.5, kBad, "expected a whole number from 0, found 3.5"},
        {"/accessors/0/count", "3", kBad, "expected a whole number from 0, found a text"},
        {"/accessors/0/count", 2147483647, ErrorCode::LimitExceeded,
         "POSITION: 2147483647 elements, the limit is 268435456"},
        {"/accessors/0/count", 4, kBad, "accessor 0 reaches to byte 48 of buffer view 0, which has 36"},
        {"/accessors/0/count", 2, kBad, "JOINTS_0: accessor 2 has 3 elements, expected 2"},
        {"/accessors/0/count", 0, kBad, "accessor 0 has no elements"},
        {"/accessors/0/byteOffset", 4, kBad, "accessor 0 reaches to byte 40 of buffer view 0, which has 36"},
        {"/accessors/0/byteOffset", 4294967295u, kBad, "accessor 0 reaches to byte 4294967331"},
        {"/accessors/0/bufferView", 9, kBad, "names buffer view 9, the file has 7"},
        {"/accessors/0/bufferView", nullptr, kBad, "accessor 0 has no buffer view"},
        {"/accessors/0/componentType", 5124, kBad, "accessor 0 has the component type 5124"},
        {"/accessors/0/componentType", 5130, kBad, "accessor 0 has the component type 5130"},
        {"/accessors/0/type", "VEC2", kBad, "attributes.POSITION: accessor 0 is VEC2, expected VEC3"},
        {"/accessors/1/componentType", 5122, kBad, "has the component type 5122, expected an unsigned integer"},
        {"/accessors/1/normalized", true, kBad, "indices: accessor 1 has the component type 5123"},
        {"/accessors/1/count", 4, kBad, "4 corners of triangles, expected a multiple of 3"},
        {"/accessors/4/count", 1, kBad, "skins[0].inverseBindMatrices: 1 matrices for 2 joints"},
        {"/accessors/6/count", 1, kBad, "animations[0].channels[0].output: accessor 6 has 1 elements, expected 2"},
        {"/bufferViews/0/buffer", 1, kBad, "bufferViews[0]: names a buffer that does not exist, the file has 1"},
        {"/bufferViews/0/byteLength", 273, kBad, "bufferViews[0]: bytes 0 to 273 of buffer 0, which has 272"},
        {"/bufferViews/0/byteLength", huge, kBad, "bufferViews[0].byteLength: expected at most 4294967295"},
        {"/bufferViews/0/byteOffset", 4294967295u, kBad, "bufferViews[0]: bytes 4294967295 to 4294967331"},
        {"/bufferViews/0/byteStride", 8, kBad, "accessor 0 has elements of 12 bytes every 8 bytes"},
        {"/bufferViews/0/byteStride", 16, kBad, "accessor 0 reaches to byte 44 of buffer view 0"},
        {"/buffers/0/byteLength", 4000000000u, kBad, "buffers[0]: expected 4000000000 bytes, its data: uri has"},
        {"/buffers/0/byteLength", 0, kBad, "buffers[0]: expected a byteLength above 0"},
        {"/buffers/0/uri", nullptr, kBad, "buffers[0]: has neither a uri nor a binary chunk"},
        {"/buffers/0/uri", "../secret.bin", ErrorCode::NotFound, "the file \"../secret.bin\" is not in the folder"},
        {"/meshes/0/primitives", 7, kBad, "meshes[0].primitives: expected a list"},
        {"/meshes/0/primitives/0/mode", 7, kBad, "meshes[0].primitives[0]: mode 7, expected 0 to 6"},
        {"/meshes/0/primitives/0/material", 1, kBad, "meshes[0].primitives[0]: names material 1"},
        {"/meshes/0/primitives/0/attributes/POSITION", 7, kBad, "names accessor 7, the file has 7"},
        {"/meshes/0/primitives/0/attributes/POSITION", -1, kBad, "attributes.POSITION: expected a whole number from 0"},
        {"/meshes/0/primitives/0/attributes/WEIGHTS_0", nullptr, kBad, "JOINTS_0 without WEIGHTS_0"},
        {"/meshes/0/primitives/0/extensions",
         {{"KHR_draco_mesh_compression", json::object()}},
         kUnsupported,
         "meshes[0].primitives[0]: the mesh is compressed with Draco"},
        {"/bufferViews/1/extensions",
         {{"EXT_meshopt_compression", json::object()}},
         kUnsupported,
         "bufferViews[1]: the data is compressed with meshopt"},
        {"/extensionsRequired", {"ACME_shape"}, kUnsupported, "cannot be read without the extension \"ACME_shape\""},
        {"/materials/0/pbrMetallicRoughness/baseColorTexture/index", 1, kBad, "baseColorTexture: names texture 1"},
        {"/textures/0/source", 1, kBad, "textures[0]: names image 1"},
        {"/images/0/bufferView", 7, kBad, "7"},
        {"/skins/0/joints", {1, 9}, kBad, "skins[0].joints: names node 9, the file has 4"},
        {"/skins/0/joints", {1, 1}, kBad, "skins[0].joints: names node 1 twice"},
        {"/skins/0/joints", json::array(), kBad, "skins[0]"},
        {"/skins/0/joints", {1}, kBad, "meshes[0].primitives[0]: vertex 0 names joint 1, its skin has 1"},
        {"/skins/0/skeleton", 4, kBad, "skins[0].skeleton: names node 4"},
        {"/animations/0/channels/0/sampler", 1, kBad, "animations[0].channels[0]: names sampler 1"},
        {"/animations/0/channels/0/target/node", 4, kBad, "channels[0].target: names node 4"},
        {"/animations/0/samplers/0/interpolation", "SMOOTH", kBad, "interpolation \"SMOOTH\", expected STEP"},
        {"/animations/0/samplers/0/input", 6, kBad, "accessor 6 is VEC4, expected SCALAR"},
        {"/animations/0/samplers/0/output", 5, kBad, "accessor 5 is SCALAR, expected VEC4"},
    };
    for (const BrokenCase& c : cases) {
        SCOPED_TRACE(std::string(c.pointer) + " = " + c.value.dump());
        json root = triangleJson();
        const json::json_pointer pointer(c.pointer);
        if (c.value.is_null()) {
            root[pointer.parent_pointer()].erase(pointer.back());
        } else {
            root[pointer] = c.value;
        }
        expectError(parse(root), c.code, c.sentence);
    }
}

TEST(GltfBroken, NumbersInTheBufferThatMakeNoSenseAreRefused) {
    const float nan = std::nanf(""), inf = std::numeric_limits<float>::infinity();
    expectError(parse(triangleWith(12, {nan, 0, 0})), ErrorCode::BadFile, "attributes.POSITION: element 1 is nan");
    expectError(parse(triangleWith(60, {inf, 0, 0})), ErrorCode::BadFile, "WEIGHTS_0: element 0 is inf");
    expectError(parse(triangleWith(72, {-1, 0, 0})), ErrorCode::BadFile, "WEIGHTS_0: vertex 1 has the weight -1");
    expectError(parse(triangleWith(108, {nan, 0, 0})), ErrorCode::BadFile, "inverseBindMatrices: element 0 is nan");
    expectError(parse(triangleWith(234, {0, 0, 0})), ErrorCode::BadFile, "input: time 1 is");
    json root = triangleJson();
    root["accessors"][1]["componentType"] = 5125; // the indices 0 1 2 0 read as two 32-bit numbers
    root["accessors"][1]["count"] = 2;
    root["meshes"][0]["primitives"][0]["mode"] = 5;
    expectError(parse(root), ErrorCode::BadFile, "indices: index 0 names vertex 65536, the primitive has 3");
}

TEST(GltfBroken, SparseAccessorsAreChecked) {
    const json sparse = json::parse(R"({"count": 2, "indices": {"bufferView": 1, "componentType": 5123},
                                        "values": {"bufferView": 3}})");
    json root = triangleJson();
    root["accessors"][0]["sparse"] = sparse;
    const Result<GltfDocument> document = parse(root);
    ASSERT_TRUE(document.ok()) << document.error().describe();
    // Elements 0 and 1 come from the weights: .5 .5 0 | 0 .5 .5
    EXPECT_EQ(document->meshes[0].primitives[0].mesh.positions[0], glm::vec3(0.5f, 0.5f, 0));
    EXPECT_EQ(document->meshes[0].primitives[0].mesh.positions[1], glm::vec3(0, 0.5f, 0.5f));
    EXPECT_EQ(document->meshes[0].primitives[0].mesh.positions[2], glm::vec3(0, 1, 0));
    const auto refused = [&](const char* pointer, const json& value, std::string_view sentence) {
        json broken = triangleJson();
        broken["accessors"][0]["sparse"] = sparse;
        broken["accessors"][0]["sparse"][json::json_pointer(pointer)] = value;
        expectError(parse(broken), ErrorCode::BadFile, sentence);
    };
    refused("/count", 4, "4 sparse elements of 3");
    refused("/count", 1u << 31, "sparse.count: expected at most 2147483647");
    refused("/indices/bufferView", 9, "names buffer view 9");
    refused("/indices/byteOffset", 6, "2 sparse elements do not fit in their buffer views");
    refused("/indices/componentType", 5126, "not unsigned integers");
    refused("/indices/componentType", 5125, "sparse element 0 replaces number 65536 of 3");
    refused("/values/bufferView", 5, "2 sparse elements do not fit");
}

TEST(GltfBroken, CyclesMillionsOfJointsAndDeepTreesMeetTheirLimits) {
    json root = triangleJson();
    root["nodes"][2]["children"] = json::array();
    root["nodes"].push_back({{"children", {5}}});
    root["nodes"].push_back({{"children", {4}}});
    expectError(parse(root), ErrorCode::BadFile, "nodes[4]: the node is its own ancestor");

    json many = triangleJson();
    for (int i = 0; i < 1'000'000; ++i) many["nodes"].push_back(json::object());
    expectError(parse(many), ErrorCode::LimitExceeded, "nodes: 1000004 nodes, the limit is 65536");

    json joints = triangleJson();
    json list = json::array();
    for (int i = 0; i < 1'000'000; ++i) list.push_back(i);
    joints["skins"][0]["joints"] = list;
    expectError(parse(joints), ErrorCode::LimitExceeded, "skins[0].joints: 1000000 joints, the limit is 4096");

    json chain = triangleJson();
    for (int i = 0; i < 300; ++i) chain["nodes"].push_back({{"children", {i + 5}}});
    chain["nodes"].push_back(json::object());
    expectError(parse(chain), ErrorCode::LimitExceeded, "nodes nested deeper than 256");

    std::string deep = "{\"asset\": {\"version\": \"2.0\"}, \"extras\": ";
    for (int i = 0; i < 1'000'000; ++i) deep += '[';
    expectError(parseGltf(asBytes(deep)), ErrorCode::LimitExceeded, "JSON: byte 295: nested deeper than 256");

    ReadLimits small;
    small.maxBytes = 64 << 10;
    std::string wide = "{\"asset\": {\"version\": \"2.0\"}, \"extras\": [0";
    for (int i = 0; i < 1000; ++i) wide += ",0";
    expectError(parseGltf(asBytes(wide + "]}"), {}, small), ErrorCode::LimitExceeded, "JSON: 1008 values");
}

TEST(GltfBroken, ManyReferencesToOneAccessorMeetTheMemoryLimit) {
    // 10,000 vertices at the origin, 120,000 bytes; each blend shape asks for them once more.
    json root = triangleJson();
    root["buffers"][0] = {{"byteLength", 120000},
                          {"uri", "data:application/octet-stream;base64," + std::string(160000, 'A')}};
    root["bufferViews"] = {{{"buffer", 0}, {"byteLength", 120000}}};
    root["accessors"] = {{{"bufferView", 0}, {"componentType", 5126}, {"count", 10000}, {"type", "VEC3"}}};
    root["meshes"] = {{{"primitives", {{{"attributes", {{"POSITION", 0}}}, {"mode", 5}}}}}};
    for (const char* unused : {"animations", "skins", "materials", "textures", "images"}) root.erase(unused);
    root["nodes"] = json::array();
    root.erase("scenes");
    root.erase("scene");
    ReadLimits small;
    small.maxBytes = 2 << 20;
    EXPECT_TRUE(parse(root, small).ok()) << parse(root, small).error().describe();
    for (int i = 0; i < 30; ++i) root["meshes"][0]["primitives"][0]["targets"].push_back({{"POSITION", 0}});
    expectError(parse(root, small), ErrorCode::LimitExceeded, "needs 120000 bytes of memory after");
}

TEST(GltfBroken, TruncatedAtEverySixteenthIsRefused) {
    for (const char* name : {"skinned_strip.glb", "sphere.glb", "external.gltf"}) {
        const Result<std::vector<std::byte>> bytes = readFile(fixture(name));
        ASSERT_TRUE(bytes.ok()) << name;
        for (std::size_t k = 0; k < 16; ++k) {
            const auto cut = std::span(*bytes).first(bytes->size() * k / 16);
            const Result<GltfDocument> document = parseGltf(cut, fixture(""));
            ASSERT_FALSE(document.ok()) << name << " " << k << "/16";
            EXPECT_EQ(errorCodeName(document.error().code), errorCodeName(ErrorCode::BadFile))
                << document.error().describe();
        }
    }
}

TEST(GltfBroken, ContainersThatLieAreRefused) {
    const Result<std::vector<std::byte>> sound = readFile(fixture("skinned_strip.glb"));
    ASSERT_TRUE(sound.ok());
    const auto patched = [&](std::size_t offset, std::uint32_t value) {
        std::vector<std::byte> bytes = *sound;
        std::memcpy(bytes.data() + offset, &value, 4);
        return parseGltf(bytes);
    };
    std::uint32_t jsonLength = 0;
    std::memcpy(&jsonLength, sound->data() + 12, 4);
    expectError(patched(0, 0x12345678), ErrorCode::BadFile, "not a glTF file");
    expectError(patched(4, 1), ErrorCode::Unsupported, "expected binary glTF version 2, found 1");
    expectError(patched(8, 0xffffffff), ErrorCode::BadFile,
                "expected 4294967295 bytes as its header says, the file has 4620");
    expectError(patched(8, 12), ErrorCode::BadFile, "expected 12 bytes as its header says");
    expectError(patched(12, 0xfffffffc), ErrorCode::BadFile, "byte 20: expected 4294967292 bytes of the JSON chunk");
    expectError(patched(16, 0), ErrorCode::BadFile, "expected a JSON chunk, found type 0x0");
    expectError(patched(20 + jsonLength, 0x7fffffff), ErrorCode::BadFile, "expected 2147483647 bytes of a chunk");
    expectError(patched(20 + jsonLength + 4, 0x12345678), ErrorCode::BadFile, "neither a uri nor a binary chunk");
    expectError(parseGltf({}), ErrorCode::BadFile, "not a glTF file");
    expectError(parseGltf(asBytes("{\"asset\": ")), ErrorCode::BadFile, "JSON: byte 11");
    expectError(parseGltf(asBytes("{}")), ErrorCode::BadFile, "asset.version");
}

TEST(GltfBroken, FilesOutsideTheFolderAreNeverOpened) {
    test::TemporaryFolder outer;
    const std::filesystem::path inner = outer / "inner";
    std::filesystem::create_directories(inner / "deeper");
    std::ofstream(outer / "secret.bin") << std::string(272, 'x');
    std::filesystem::create_symlink(outer / "secret.bin", inner / "link.bin");
    std::ofstream(inner / "deeper" / "data.bin") << std::string(272, '\0');
    const auto read = [&](const std::string& uri) {
        json root = triangleJson();
        root["buffers"][0]["uri"] = uri;
        std::ofstream(inner / "file.gltf") << root.dump();
        return readGltf(inner / "file.gltf");
    };
    const std::string absolute = (outer / "secret.bin").string();
    for (const std::string& uri :
         {std::string("../secret.bin"), std::string("..%2Fsecret.bin"), std::string("deeper/../../secret.bin"),
          absolute, "file://" + absolute, std::string("link.bin"), std::string("."), std::string("a%00b")}) {
        expectError(read(uri), ErrorCode::NotFound, "buffers[0]: the file");
    }
    // A folder below is allowed; these zeros fail later, for what they say.
    expectError(read("deeper/data.bin"), ErrorCode::BadFile, "input: time 1 is 0 s, not after 0 s");
    std::ofstream(inner / "short.bin") << "x";
    expectError(read("short.bin"), ErrorCode::BadFile,
                "buffers[0]: expected 272 bytes in \"short.bin\", the file has 1");
    expectError(readGltf(outer / "none.glb"), ErrorCode::NotFound, "none.glb");
}

TEST(Gltf, FolderGivenAsARelativePathWorks) {
    test::TemporaryFolder folder;
    json root = triangleJson();
    std::ofstream(folder / "data.bin") << std::string(272, '\0');
    root["buffers"][0]["uri"] = "data.bin";
    root.erase("animations");
    std::ofstream(folder / "file.gltf") << root.dump();
    const auto before = std::filesystem::current_path();
    std::filesystem::current_path(folder.path());
    const Result<GltfDocument> document = readGltf("file.gltf");
    std::filesystem::current_path(before);
    ASSERT_TRUE(document.ok()) << document.error().describe();
}

} // namespace
} // namespace ars
