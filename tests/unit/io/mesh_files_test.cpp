#include "engine/io/mesh.h"
#include "engine/io/obj.h"
#include "engine/io/ply.h"

#include "engine/core/file.h"
#include "tests/support/test_data.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>

namespace ars {
namespace {

std::span<const std::byte> asBytes(std::string_view text) { return std::as_bytes(std::span(text)); }

std::filesystem::path fixture(const char* name) { return test::sourceFolder() / "tests/unit/io/fixtures/mesh" / name; }

template <typename T>
void expectError(const Result<T>& result, ErrorCode code, std::string_view sentence) {
    ASSERT_FALSE(result.ok()) << "accepted, expected: " << sentence;
    EXPECT_EQ(errorCodeName(result.error().code), errorCodeName(code)) << result.error().describe();
    EXPECT_NE(result.error().describe().find(sentence), std::string::npos) << result.error().describe();
}

std::string with(std::string text, std::string_view from, std::string_view to) {
    const std::size_t at = text.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    return text.replace(at, from.size(), to);
}

TriangleMesh tetrahedron() {
    TriangleMesh mesh;
    mesh.name = "tetra";
    mesh.positions = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0.1f, 0.2f, 1.0f / 3.0f}};
    mesh.triangles = {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {2, 0, 3}};
    mesh.normals = vertexNormals(mesh.positions, mesh.triangles);
    mesh.uvs = {{0, 0}, {1, 0}, {0, 1}, {0.25f, 0.75f}};
    mesh.colors = {{1, 0, 0, 1}, {0, 1, 0, 1}, {0, 0, 1, 1}, {1, 1, 1, 0}};
    return mesh;
}

// ---------------------------------------------------------------------------------------------------------- mesh.h

TEST(Mesh, NormalsAreWeightedByArea) {
    // Vertex 0 belongs to a triangle of area 2 facing +z and one of area 1 facing +x.
    const std::vector<glm::vec3> positions = {{0, 0, 0}, {2, 0, 0}, {0, 2, 0}, {0, 1, 0}, {0, 0, 2}, {9, 9, 9}};
    const std::vector<glm::vec3> normals = vertexNormals(positions, {{0, 1, 2}, {0, 3, 4}});
    ASSERT_EQ(normals.size(), 6u);
    EXPECT_NEAR(glm::length(normals[0] - glm::normalize(glm::vec3(1, 0, 2))), 0.0f, 1e-6f);
    EXPECT_NEAR(glm::length(normals[1] - glm::vec3(0, 0, 1)), 0.0f, 1e-6f);
    EXPECT_EQ(normals[5], glm::vec3(0)); // no triangle touches it
}

TEST(Mesh, SphereNormalsPointOutwards) {
    const Result<TriangleMesh> sphere = readPlyMesh(fixture("sphere.ply"));
    ASSERT_TRUE(sphere.ok()) << sphere.error().describe();
    const auto normals = vertexNormals(sphere->positions, sphere->triangles);
    for (std::size_t i = 0; i < normals.size(); ++i) {
        // An icosphere is symmetric about each of its vertices up to the unequal triangles of the subdivision.
        EXPECT_GT(glm::dot(normals[i], glm::normalize(sphere->positions[i])), 0.999f);
    }
}

TEST(Mesh, WhatDoesNotFitTogetherIsNamed) {
    const auto refused = [](auto&& change, std::string_view sentence) {
        TriangleMesh mesh = tetrahedron();
        change(mesh);
        const Status status = validateMesh(mesh);
        ASSERT_FALSE(status.ok()) << sentence;
        EXPECT_EQ(errorCodeName(status.error().code), errorCodeName(ErrorCode::InvalidArgument));
        EXPECT_NE(status.error().describe().find(sentence), std::string::npos) << status.error().describe();
    };
    EXPECT_TRUE(validateMesh(tetrahedron()).ok());
    EXPECT_TRUE(validateMesh({}).ok());
    refused([](TriangleMesh& m) { m.triangles[2].y = 4; }, "triangle 2: names vertex 4, the mesh has 4");
    refused([](TriangleMesh& m) { m.positions[1].z = std::nanf(""); }, "vertex 1: number 2 of its position is nan");
    refused([](TriangleMesh& m) { m.colors[3].w = INFINITY; }, "vertex 3: number 3 of its colour is inf");
    refused([](TriangleMesh& m) { m.normals[0].x = -INFINITY; }, "vertex 0: number 0 of its normal is -inf");
    refused([](TriangleMesh& m) { m.uvs[2].y = std::nanf(""); }, "vertex 2: number 1 of its texture coordinate is nan");
    refused([](TriangleMesh& m) { m.normals.pop_back(); }, "3 normals for 4 vertices");
    refused([](TriangleMesh& m) { m.materials = {0}; }, "1 material indices for 4 triangles");
    refused(
        [](TriangleMesh& m) {
            m.materialNames = {"skin"};
            m.materials = {0, -1, 0, 1};
        },
        "triangle 3: names material 1, the mesh has 1");
}

// ----------------------------------------------------------------------------------------------------------- ply.h

TEST(Ply, AllTypesAndListsOfAnotherWriterInThreeEncodings) {
    for (const char* name : {"all_types_ascii.ply", "all_types_little.ply", "all_types_big.ply"}) {
        const Result<PlyFile> file = readPly(fixture(name));
        ASSERT_TRUE(file.ok()) << file.error().describe();
        EXPECT_EQ(file->comments, std::vector<std::string>{"all types"}) << name;
        const PlyElement* numbers = file->find("numbers");
        ASSERT_NE(numbers, nullptr) << name;
        ASSERT_EQ(numbers->properties.size(), 8u);
        for (int i = 0; i < 3; ++i) {
            const double expected[8] = {-1.0 - i,      200.0 + i,        -1000.0 - i, 60000.0 + i,
                                        -100000.0 - i, 4000000000.0 + i, 0.5 + i,     0.1 * (i + 1)};
            for (std::size_t p = 0; p < 8; ++p) {
                EXPECT_EQ(numbers->properties[p].values[static_cast<std::size_t>(i)], expected[p])
                    << name << " " << numbers->properties[p].name;
            }
        }
        const PlyElement* lists = file->find("lists");
        ASSERT_NE(lists, nullptr);
        const PlyProperty* ids = lists->find("ids");
        ASSERT_TRUE(ids && ids->isList);
        EXPECT_EQ(ids->starts, (std::vector<std::uint64_t>{0, 3, 3, 7})) << name;
        EXPECT_EQ(ids->values, (std::vector<double>{0, 1, 2, 7, 8, 9, 10})) << name;
        EXPECT_EQ(lists->find("tag")->values, (std::vector<double>{5, 6, 7})) << name;
    }
}

TEST(Ply, GaussianColumnsAreFoundByName) {
    const Result<PlyFile> file = readPly(fixture("gaussians.ply"));
    ASSERT_TRUE(file.ok()) << file.error().describe();
    const PlyElement* vertices = file->find("vertex");
    ASSERT_NE(vertices, nullptr);
    const char* const names[] = {"x",       "y",       "z",       "f_dc_0", "f_dc_1", "f_dc_2", "opacity",
                                 "scale_0", "scale_1", "scale_2", "rot_0",  "rot_1",  "rot_2",  "rot_3"};
    for (std::size_t column = 0; column < std::size(names); ++column) {
        const Result<std::vector<float>> values = vertices->column(names[column]);
        ASSERT_TRUE(values.ok()) << values.error().describe();
        ASSERT_EQ(values->size(), 5u);
        for (std::size_t i = 0; i < 5; ++i)
            EXPECT_EQ((*values)[i], static_cast<float>(column) + static_cast<float>(i) / 8);
    }
    expectError(vertices->column("roughness"), ErrorCode::NotFound, "no property \"roughness\", it has: x y z f_dc_0");
}

TEST(Ply, MeshOfAnotherWriter) {
    const Result<TriangleMesh> sphere = readPlyMesh(fixture("sphere.ply"));
    ASSERT_TRUE(sphere.ok()) << sphere.error().describe();
    EXPECT_EQ(sphere->positions.size(), 42u);
    EXPECT_EQ(sphere->triangles.size(), 80u);
    ASSERT_EQ(sphere->normals.size(), 42u);
    ASSERT_EQ(sphere->colors.size(), 42u);
    for (std::size_t i = 0; i < 42; ++i) {
        EXPECT_NEAR(glm::length(sphere->positions[i]), 0.5f, 1e-6f);
        EXPECT_NEAR(glm::length(sphere->normals[i] - 2.0f * sphere->positions[i]), 0.0f, 2e-2f);
        // sRGB 188 is 0.502886 linear (IEC 61966-2-1); alpha is not encoded.
        EXPECT_NEAR(sphere->colors[i].x, 1.0f, 1e-6f);
        EXPECT_NEAR(sphere->colors[i].y, 0.502886f, 1e-5f);
        EXPECT_NEAR(sphere->colors[i].z, 0.0f, 1e-6f);
        EXPECT_NEAR(sphere->colors[i].w, 128.0f / 255.0f, 1e-6f);
    }
}

const std::string kTextMesh = "ply\n"
                              "format ascii 1.0\n"
                              "comment a quad and a point that no face uses\n"
                              "element vertex 5\n"
                              "property float x\n"
                              "property float y\n"
                              "property float z\n"
                              "property float s\n"
                              "property float t\n"
                              "element face 2\n"
                              "property list uchar int vertex_index\n"
                              "end_header\n"
                              "0 0 0 0 0\n"
                              "1 0 0 1 0\n"
                              "1 1 0 1 1\n"
                              "0 1 0 0 1\n"
                              "5 5 5 0.5 0.25\n"
                              "4 0 1 2 3\n"
                              "2 0 1\n";

TEST(Ply, PolygonsBecomeFansAndTextureCoordinatesAreFlipped) {
    const Result<PlyFile> file = parsePly(asBytes(kTextMesh));
    ASSERT_TRUE(file.ok()) << file.error().describe();
    const Result<TriangleMesh> mesh = meshFromPly(*file);
    ASSERT_TRUE(mesh.ok()) << mesh.error().describe();
    EXPECT_EQ(mesh->triangles, (std::vector<glm::uvec3>{{0, 1, 2}, {0, 2, 3}})); // the two-cornered face is dropped
    EXPECT_EQ(mesh->uvs[0], glm::vec2(0, 1));
    EXPECT_EQ(mesh->uvs[4], glm::vec2(0.5f, 0.75f));
}

TEST(Ply, MeshSurvivesARoundTripInEveryEncoding) {
    test::TemporaryFolder folder;
    const TriangleMesh mesh = tetrahedron();
    for (const PlyFormat format : {PlyFormat::Ascii, PlyFormat::BinaryLittleEndian, PlyFormat::BinaryBigEndian}) {
        const auto path = folder / "tetra.ply";
        const Status status = writePlyMesh(path, mesh, format);
        ASSERT_TRUE(status.ok()) << status.error().describe();
        const Result<TriangleMesh> again = readPlyMesh(path);
        ASSERT_TRUE(again.ok()) << again.error().describe();
        EXPECT_EQ(again->positions, mesh.positions);
        EXPECT_EQ(again->normals, mesh.normals);
        EXPECT_EQ(again->triangles, mesh.triangles);
        EXPECT_EQ(again->uvs, mesh.uvs);
        EXPECT_EQ(again->colors, mesh.colors); // 0 and 1 are exact in bytes
    }
}

TEST(Ply, ColumnsSurviveARoundTripBitForBit) {
    const std::vector<float> x = {0.1f, -0.0f, 1e-45f},
                             opacity = {3e38f, std::numeric_limits<float>::infinity(), -7.25f};
    PlyFile file;
    file.comments = {"two columns"};
    file.elements.push_back(plyColumns("vertex", {{"x", x}, {"opacity", opacity}}));
    for (const PlyFormat format : {PlyFormat::Ascii, PlyFormat::BinaryLittleEndian, PlyFormat::BinaryBigEndian}) {
        file.format = format;
        const Result<std::vector<std::byte>> bytes = encodePly(file);
        ASSERT_TRUE(bytes.ok()) << bytes.error().describe();
        const Result<PlyFile> again = parsePly(*bytes);
        ASSERT_TRUE(again.ok()) << again.error().describe();
        EXPECT_EQ(again->comments, file.comments);
        for (std::size_t i = 0; i < 3; ++i) {
            EXPECT_EQ(again->elements[0].properties[0].values[i], static_cast<double>(x[i]));
            EXPECT_EQ(again->elements[0].properties[1].values[i], static_cast<double>(opacity[i]));
        }
        // Non-finite numbers are kept by the file and refused by whoever asks for finite ones.
        expectError(again->elements[0].column("opacity"), ErrorCode::BadFile, "vertex 1: opacity is inf");
    }
}

TEST(Ply, BrokenFilesAreRefusedInOneSentence) {
    const auto refused = [](std::string_view from, std::string_view to, std::string_view sentence,
                            ErrorCode code = ErrorCode::BadFile) {
        expectError(parsePly(asBytes(with(kTextMesh, from, to))), code, sentence);
    };
    expectError(parsePly({}), ErrorCode::BadFile, "line 1: expected the word ply, found the end of the file");
    expectError(parsePly(asBytes("solid cube")), ErrorCode::BadFile, "expected the word ply, found \"solid cube\"");
    expectError(parsePly(asBytes("ply\n")), ErrorCode::BadFile, "the header ends without end_header");
    refused("format ascii 1.0\n", "", "no format line");
    refused("ascii 1.0", "ascii 2.0", "line 2: expected \"format ENCODING 1.0\"");
    refused("ascii 1.0", "utf8 1.0", "expected ascii, binary_little_endian or binary_big_endian");
    refused("vertex 5", "vertex -5", "line 4: expected an element with a count from 0");
    refused("vertex 5", "vertex 9223372036854775808", "9223372036854775808 elements \"vertex\"",
            ErrorCode::LimitExceeded);
    refused("vertex 5", "vertex 18446744073709551616", "expected an element with a count from 0");
    refused("vertex 5", "vertex 200000000", "expected 200000000 rows of at least 10 bytes");
    refused("element vertex 5\n", "", "line 4: a property before the first element");
    refused("element face 2", "element vertex 2", "line 10: element \"vertex\" stands twice");
    refused("property float y", "property float x", "line 6: property \"x\" stands twice");
    refused("property float y", "property quad y", "line 6: expected a property of known types");
    refused("list uchar int", "list float int", "line 11: expected a property of known types");
    refused("property float z", "properly float z", "expected format, comment, element, property or end_header");
    refused("1 1 0 1 1\n", "1 1 0 1 one\n", "vertex 2: line 15: expected float for t, found \"one\"");
    refused("4 0 1 2 3", "300 0 1 2 3", "face 0: line 18: expected uchar for vertex_index, found \"300\"");
    refused("4 0 1 2 3", "255 0 1 2 3", "face 0: list vertex_index has 255 entries");
    refused("4 0 1 2 3", "5 0 1 2 3", "line 19: expected the end of the file, found \"1\"");
    refused("4 0 1 2 3", "6 0 1 2 3", "face 1: line 20: expected int for vertex_index, found the end of the file");
    refused("4 0 1 2 3", "4 0 1.5 2 3", "expected int for vertex_index, found \"1.5\"");

    const auto noMesh = [](std::string_view from, std::string_view to, std::string_view sentence) {
        const Result<PlyFile> file = parsePly(asBytes(with(kTextMesh, from, to)));
        ASSERT_TRUE(file.ok()) << file.error().describe();
        expectError(meshFromPly(*file), ErrorCode::BadFile, sentence);
    };
    noMesh("4 0 1 2 3", "4 0 1 2 5", "face 0: names vertex 5, the file has 5");
    noMesh("4 0 1 2 3", "4 0 1 2 -1", "face 0: names vertex -1");
    noMesh("5 5 5", "5 nan 5", "vertex 4: y is nan, expected a finite number");
    noMesh("0.5 0.25", "inf 0.25", "vertex 4: s is inf, expected a finite number");
    noMesh("0.5 0.25", "0.5 1e50", "vertex 4: t is inf, expected a finite number");
    noMesh("int vertex_index", "int corners", "expected a list vertex_indices");
    noMesh("element vertex", "element point", "no element vertex");
}

TEST(Ply, BinaryListsThatLieAreRefused) {
    const std::string header =
        "ply\nformat binary_little_endian 1.0\nelement face 2\nproperty list int float v\nend_header\n";
    const auto body = [&](std::int32_t first, std::int32_t second) {
        std::string text = header;
        for (const std::int32_t count : {first, second}) {
            text.append(reinterpret_cast<const char*>(&count), 4);
            if (count == 1) text.append(4, '\0');
        }
        return text;
    };
    EXPECT_TRUE(parsePly(asBytes(body(1, 1))).ok());
    expectError(parsePly(asBytes(body(1, -1))), ErrorCode::BadFile, "face 1: list v has -1 entries");
    expectError(parsePly(asBytes(body(1, std::numeric_limits<std::int32_t>::max()))), ErrorCode::BadFile,
                "face 1: byte 100: expected 8589934588 bytes of v, the file ends after 0");
    expectError(parsePly(asBytes(body(1, 1).substr(0, header.size() + 6))), ErrorCode::BadFile,
                "expected 2 rows of at least 4 bytes, the file has 6 left");
    ReadLimits small;
    small.maxBytes = 20;
    expectError(parsePly(asBytes(body(1, 1)), small), ErrorCode::LimitExceeded, "the limit is 20");
}

TEST(Ply, TruncatedAtEverySixteenthIsRefused) {
    // In text the last number may be cut short unnoticed, so the text ends with more than a sixteenth behind it.
    for (const char* name : {"all_types_little.ply", "all_types_big.ply", "all_types_ascii.ply", "sphere.ply"}) {
        const Result<std::vector<std::byte>> bytes = readFile(fixture(name));
        ASSERT_TRUE(bytes.ok()) << name;
        for (std::size_t k = 0; k < 16; ++k) {
            EXPECT_FALSE(parsePly(std::span(*bytes).first(bytes->size() * k / 16)).ok()) << name << " " << k << "/16";
        }
    }
}

TEST(Ply, WhatCannotBeWrittenIsRefused) {
    PlyFile file;
    const std::vector<float> three = {1, 2, 300};
    file.elements.push_back(plyColumns("vertex", {{"x", three}}));
    PlyProperty& x = file.elements[0].properties[0];
    x.type = PlyType::U8;
    expectError(encodePly(file), ErrorCode::InvalidArgument, "element vertex, property x: 300 does not fit uchar");
    x.type = PlyType::F32;
    x.values.pop_back();
    expectError(encodePly(file), ErrorCode::InvalidArgument, "2 values for 3 rows");
    x.values.push_back(0);
    x.name = "a b";
    expectError(encodePly(file), ErrorCode::InvalidArgument, "a name must be one word");
    x.name = "x";
    x.isList = true;
    x.starts = {0, 1, 2};
    expectError(encodePly(file), ErrorCode::InvalidArgument, "the starts of 3 lists do not fit");
}

// ----------------------------------------------------------------------------------------------------------- obj.h

Result<ObjFile> obj(std::string_view text) { return parseObj(asBytes(text)); }

TEST(Obj, EveryFormOfAFaceIsRead) {
    const Result<ObjFile> file = obj("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0.25\nvn 0 0 1\n"
                                     "f 1 2 3\nf 1/1 2/2 3/1\nf 1//1 2//1 3//1\nf 1/1/1 2/2/1 3/1/1\nf -4 -3 -2 -1\n");
    ASSERT_TRUE(file.ok()) << file.error().describe();
    const TriangleMesh& mesh = file->mesh;
    EXPECT_EQ(file->sourceVertexCount, 4u);
    ASSERT_EQ(mesh.triangles.size(), 6u);
    // The first face keeps the file's vertices, every other combination is a split of its own: 3 for each further face
    // with other attributes; the quad uses the plain ones again.
    EXPECT_EQ(mesh.positions.size(), 4u + 9u);
    EXPECT_EQ(mesh.triangles[0], glm::uvec3(0, 1, 2));
    EXPECT_EQ(mesh.triangles[4], glm::uvec3(0, 1, 2));
    EXPECT_EQ(mesh.triangles[5], glm::uvec3(0, 2, 3));
    for (std::size_t i = 0; i < mesh.positions.size(); ++i) {
        EXPECT_EQ(mesh.positions[i], mesh.positions[static_cast<std::size_t>(mesh.sourceVertices[i])]);
    }
    EXPECT_EQ(mesh.uvs[mesh.triangles[1].y], glm::vec2(1, 0.75f)); // v is flipped
    EXPECT_EQ(mesh.normals[mesh.triangles[2].x], glm::vec3(0, 0, 1));
    EXPECT_EQ(mesh.uvs[mesh.triangles[3].y], glm::vec2(1, 0.75f));
    EXPECT_EQ(mesh.normals[mesh.triangles[3].y], glm::vec3(0, 0, 1));
    EXPECT_TRUE(validateMesh(mesh).ok());
}

TEST(Obj, VerticesKeepTheirOrderAndOnlySeamsAreSplit) {
    // Two quads that share the edge 2-3 in space; on the texture they share only vertex 3.
    const Result<ObjFile> file = obj("v 9 9 9\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 2 0 0\nv 2 1 0\n"
                                     "vt 0 0\nvt .5 0\nvt .5 .5\nvt 0 .5\nvt .6 0\nvt 1 0\nvt 1 .5\n"
                                     "f 2/1 3/2 4/3 5/4\nf 3/5 6/6 7/7 4/3\n");
    ASSERT_TRUE(file.ok()) << file.error().describe();
    EXPECT_EQ(file->mesh.positions.size(), 8u);
    EXPECT_EQ(file->mesh.sourceVertices, (std::vector<std::int32_t>{0, 1, 2, 3, 4, 5, 6, 2}));
    EXPECT_EQ(file->mesh.positions[0], glm::vec3(9, 9, 9)); // no face uses it
    EXPECT_EQ(file->mesh.triangles[2], glm::uvec3(7, 5, 6));
    EXPECT_EQ(file->mesh.triangles[3], glm::uvec3(7, 6, 3));
}

TEST(Obj, MaterialsGroupsColoursAndContinuedLines) {
    const Result<ObjFile> file =
        obj("# a remark\r\nmtllib my body.mtl\r\no body\r\n"
            "v 0 0 0 1 0.5 0 # red\r\nv 1 0 0\r\nv 0 1 0 0 0 0\r\n"
            "g head\r\nusemtl skin #2\r\nf 1 2 3\r\ng empty\r\ng hands\r\nusemtl hair\r\ns off\r\n"
            "f 1 2 \\\r\n  3\r\nusemtl skin #2\r\nf 3 2 1");
    ASSERT_TRUE(file.ok()) << file.error().describe();
    EXPECT_EQ(file->materialLibraries, std::vector<std::string>{"my body.mtl"});
    EXPECT_EQ(file->mesh.name, "body");
    EXPECT_EQ(file->mesh.materialNames, (std::vector<std::string>{"skin #2", "hair"}));
    EXPECT_EQ(file->mesh.materials, (std::vector<std::int32_t>{0, 1, 0}));
    ASSERT_EQ(file->groups.size(), 2u);
    EXPECT_EQ(file->groups[0].name, "head");
    EXPECT_EQ(file->groups[0].triangleCount, 1u);
    EXPECT_EQ(file->groups[1].name, "hands");
    EXPECT_EQ(file->groups[1].firstTriangle, 1u);
    EXPECT_EQ(file->groups[1].triangleCount, 2u);
    ASSERT_EQ(file->mesh.colors.size(), 3u);
    EXPECT_NEAR(file->mesh.colors[0].y, 0.214041f, 1e-5f); // sRGB 0.5
    EXPECT_EQ(file->mesh.colors[1], glm::vec4(1));         // a vertex without a colour among others with one
    EXPECT_EQ(file->mesh.colors[2], glm::vec4(0, 0, 0, 1));
}

TEST(Obj, MeshOfAnotherWriter) {
    const Result<ObjFile> file = readObj(fixture("sphere.obj"));
    ASSERT_TRUE(file.ok()) << file.error().describe();
    EXPECT_EQ(file->mesh.positions.size(), 42u);
    EXPECT_EQ(file->mesh.triangles.size(), 80u);
    ASSERT_EQ(file->mesh.normals.size(), 42u);
    for (std::size_t i = 0; i < 42; ++i) {
        EXPECT_NEAR(glm::length(file->mesh.positions[i]), 0.5f, 1e-6f);
        EXPECT_NEAR(glm::length(file->mesh.normals[i] - 2.0f * file->mesh.positions[i]), 0.0f, 2e-2f);
    }
}

TEST(Obj, RoundTripIsExact) {
    test::TemporaryFolder folder;
    TriangleMesh mesh = tetrahedron();
    mesh.materialNames = {"skin", "hair"};
    mesh.materials = {0, 1, 1, 0};
    const Status status = writeObj(folder / "tetra.obj", mesh, "tetra.mtl");
    ASSERT_TRUE(status.ok()) << status.error().describe();
    const Result<ObjFile> again = readObj(folder / "tetra.obj");
    ASSERT_TRUE(again.ok()) << again.error().describe();
    EXPECT_EQ(again->mesh.name, "tetra");
    EXPECT_EQ(again->mesh.positions, mesh.positions);
    EXPECT_EQ(again->mesh.normals, mesh.normals);
    EXPECT_EQ(again->mesh.uvs, mesh.uvs);
    EXPECT_EQ(again->mesh.triangles, mesh.triangles);
    EXPECT_EQ(again->mesh.materials, mesh.materials);
    EXPECT_EQ(again->mesh.materialNames, mesh.materialNames);
    EXPECT_EQ(again->materialLibraries, std::vector<std::string>{"tetra.mtl"});
    mesh.materialNames[0] = "two\nlines";
    expectError(formatObj(mesh), ErrorCode::InvalidArgument, "with a line end");
    mesh.materialNames[0] = "goes on\\ ";
    expectError(formatObj(mesh), ErrorCode::InvalidArgument, "a backslash at its end");
    mesh.triangles[0].x = 77;
    expectError(formatObj(mesh), ErrorCode::InvalidArgument, "triangle 0: names vertex 77");
}

TEST(Obj, BrokenFilesAreRefusedInOneSentence) {
    const std::string v = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    const auto refused = [](const std::string& text, std::string_view sentence) {
        expectError(obj(text), ErrorCode::BadFile, sentence);
    };
    refused("", "no vertex (\"v\" line) in the whole file");
    refused("\x89PNG\r\n", "line 1: expected a statement such as v, vt, vn or f, found \"\\x89PNG\"");
    refused(v + "f 1 2 4\n", "line 4: a face names vertex 4, the file has 3");
    refused(v + "f 1 2 9223372036854775807\n", "a face names vertex 9223372036854775807, the file has 3");
    refused(v + "f 1 2 9223372036854775808\n", "expected an index from 1, or below 0, in a face");
    refused(v + "f 1/1 2/1 3/1\n", "line 4: a face names texture coordinate 1, the file has 0");
    refused(v + "f 1//2 2//2 3//2\n", "line 4: a face names normal 2, the file has 0");
    refused(v + "f 1 2 -4\n", "line 4: index -4 of a face reaches before the first of 3 so far");
    refused(v + "f 1 2 -9223372036854775808\n", "reaches before the first of 3 so far");
    refused(v + "f 1 2 0\n", "in a face, found \"0\"");
    refused(v + "f 1 2\n", "line 4: expected a face of at least 3 corners, found 2");
    refused(v + "f 1 2 three\n", "found \"three\"");
    refused("v 0 0\n", "line 1: expected 3 to 7 numbers for a vertex, found 2");
    refused("v 0 0 0 1 1\n", "expected 3, 4, 6 or 7 numbers for a vertex, found 5");
    refused("v 0 nan 0\n", "line 1: expected a finite number for a vertex, found \"nan\"");
    refused("v 0 0 1e60\n", "expected a finite number for a vertex, found \"1e60\"");
    refused("v 0 0 0 1e30 0 0\n", "line 1: a colour of 1e+30 is too large");
    refused("v 0 0 0x\n", "found \"0x\"");
    refused("vn 0 0\n", "expected 3 numbers for a normal, found 2");
    ReadLimits small;
    small.maxElements = 2;
    expectError(parseObj(asBytes(v), small), ErrorCode::LimitExceeded,
                "line 3: 3 vertices or triangles, the limit is 2");
}

TEST(Obj, CutAtEverySixteenthIsNeverAWrongMesh) {
    // A text that ends early can be a whole smaller file, so a cut either gives an error or a prefix of the mesh.
    const Result<std::vector<std::byte>> bytes = readFile(fixture("sphere.obj"));
    ASSERT_TRUE(bytes.ok());
    const Result<ObjFile> whole = parseObj(*bytes);
    ASSERT_TRUE(whole.ok());
    for (std::size_t k = 0; k < 16; ++k) {
        const Result<ObjFile> file = parseObj(std::span(*bytes).first(bytes->size() * k / 16));
        if (!file.ok()) continue;
        EXPECT_LT(file->mesh.triangles.size(), whole->mesh.triangles.size());
        EXPECT_TRUE(validateMesh(file->mesh).ok());
    }
}

TEST(Obj, BodiesWithSmplxTopologyKeepTheirVertexOrder) {
    for (const char* name : {"SMPLX-female.obj", "SMPLX-male.obj"}) {
        ARS_TEST_DATA_FILE(path, std::string("bodies/smplx_topology/") + name);
        const Result<ObjFile> file = readObj(path);
        ASSERT_TRUE(file.ok()) << file.error().describe();
        EXPECT_EQ(file->sourceVertexCount, 10475u);
        EXPECT_EQ(file->mesh.triangles.size(), 20908u);
        // 42,064 different v/vt/vn words stand on the face lines (counted by a script).
        EXPECT_EQ(file->mesh.positions.size(), 42064u);
        EXPECT_EQ(file->mesh.sourceVertices[10474], 10474);
        EXPECT_TRUE(validateMesh(file->mesh).ok());
        float low = 1e9f, high = -1e9f;
        for (const glm::vec3& p : file->mesh.positions) {
            low = std::min(low, p.y);
            high = std::max(high, p.y);
        }
        EXPECT_GT(high - low, 1.5f); // metres, y up
        EXPECT_LT(high - low, 2.0f);
    }
}

} // namespace
} // namespace ars
