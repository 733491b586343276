// The open body and the clothed template of the shared test data are what the readers are held against.
#include "engine/core/file.h"
#include "engine/io/gltf.h"
#include "engine/io/npz.h"
#include "engine/io/obj.h"
#include "engine/io/ply.h"
#include "engine/rig/motion.h"
#include "engine/rig/posed_export.h"
#include "engine/rig/template_mesh.h"
#include "tests/support/test_data.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>

namespace ars {
namespace {

/// A body of boxes, one around every joint of a T-shaped skeleton: enough to find one's place on.
BodyModel boxBody() {
    BodyModel body;
    body.name = "boxes";
    std::vector<glm::vec3> joints(kSmplxJointCount);
    for (int j = 0; j < kSmplxJointCount; ++j) {
        const std::string_view name = smplxJointName(j);
        const float side = name.substr(0, 4) == "left" ? 1.0f : name.substr(0, 5) == "right" ? -1.0f : 0.0f;
        const glm::vec3 parent = j == 0 ? glm::vec3(0.0f) : joints[static_cast<std::size_t>(smplxJointParent(j))];
        const bool leg = name.find("hip") != name.npos || name.find("knee") != name.npos ||
                         name.find("ankle") != name.npos || name.find("foot") != name.npos;
        const glm::vec3 arm(0.13f * side, 0.0f, 0.0f), up(0.03f * side, 0.14f, 0.0f), down(0.02f * side, -0.3f, 0.0f);
        joints[static_cast<std::size_t>(j)] = j == 0 ? glm::vec3(0.0f)
                                                     : parent + (leg            ? down
                                                                 : side != 0.0f ? arm
                                                                                : up);
    }
    for (int j = 0; j < kSmplxJointCount; ++j) {
        const auto first = static_cast<unsigned>(body.templateVertices.size());
        for (int c = 0; c < 8; ++c) {
            const glm::vec3 corner((c & 1) * 2 - 1, ((c >> 1) & 1) * 2 - 1, (c >> 2) * 2 - 1);
            body.templateVertices.push_back(joints[static_cast<std::size_t>(j)] + 0.06f * corner);
            for (int i = 0; i < kMaxInfluences; ++i) {
                body.weights.joints.push_back(i == 0 ? static_cast<std::uint16_t>(j) : std::uint16_t{0});
                body.weights.weights.push_back(i == 0 ? 1.0f : 0.0f);
            }
        }
        for (const glm::uvec4& s :
             {glm::uvec4{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}}) {
            body.triangles.push_back(glm::uvec3(s.x, s.y, s.z) + first);
            body.triangles.push_back(glm::uvec3(s.x, s.z, s.w) + first);
        }
    }
    const std::size_t vertices = body.templateVertices.size();
    body.jointRegressor.assign(kSmplxJointCount * vertices, 0.0f);
    for (std::size_t j = 0; j < kSmplxJointCount; ++j) {
        for (std::size_t c = 0; c < 8; ++c) body.jointRegressor[j * vertices + j * 8 + c] = 0.125f;
        body.parents.push_back(smplxJointParent(static_cast<int>(j)));
        body.jointNames.emplace_back(smplxJointName(static_cast<int>(j)));
    }
    return body;
}

TriangleMesh meshOf(const BodyModel& body) {
    TriangleMesh mesh;
    mesh.positions = body.templateVertices;
    mesh.triangles = body.triangles;
    return mesh;
}

TemplateOptions quick() {
    TemplateOptions options;
    options.diffusion.resolution = 32;
    return options;
}

std::vector<std::byte> bytesOf(const std::filesystem::path& path) { return *readFile(path); }

void expectSoundWeights(const TemplateMesh& mesh) {
    ASSERT_TRUE(validateTemplate(mesh).ok());
    for (std::size_t v = 0; v < mesh.weights.pointCount(); ++v) {
        float sum = 0.0f;
        for (std::size_t i = v * kMaxInfluences; i < (v + 1) * kMaxInfluences; ++i) {
            ASSERT_GE(mesh.weights.weights[i], 0.0f) << v;
            sum += mesh.weights.weights[i];
        }
        ASSERT_NEAR(sum, 1.0f, 1e-5f) << v;
    }
}

TEST(Template, TheBodyItselfIsOne) {
    const BodyModel body = boxBody();
    const TemplateMesh mesh = templateFromBody(body);
    EXPECT_EQ(mesh.weightSource, WeightSource::Body);
    expectSoundWeights(mesh);
    Pose pose = restPose(kSmplxJointCount);
    pose.rotations[16] = quatFromAxisAngle({0.0f, 0.0f, -1.0f});
    pose.translation = {0.1f, 0.2f, 0.3f};
    const auto found = posedTemplate(mesh, pose);
    ASSERT_TRUE(found.ok());
    const std::vector<glm::vec3> expected = posedVertices(body, {}, pose);
    for (std::size_t v = 0; v < expected.size(); ++v) EXPECT_LT(glm::distance((*found)[v], expected[v]), 1e-5f);
    EXPECT_EQ(posedTemplate(mesh, restPose(3)).error().code, ErrorCode::InvalidArgument);
}

TEST(Template, EveryKindOfFileIsToldByItsContent) {
    const BodyModel body = boxBody();
    const TemplateMesh source = templateFromBody(body);
    test::TemporaryFolder folder;
    ASSERT_TRUE(writeObj(folder / "a", source.mesh).ok());
    ASSERT_TRUE(writePlyMesh(folder / "b", source.mesh).ok());
    ASSERT_TRUE(writeRiggedGlb(folder / "c", rigFromTemplate(source)).ok());
    const PosedMesh still{source.mesh, source.joints};
    ASSERT_TRUE(writePosedMesh(folder / "d", PosedFormat::Glb, still).ok());
    ASSERT_TRUE(writePosedMesh(folder / "e", PosedFormat::Npz, still).ok());
    for (const std::string name : {"a", "b", "c", "d", "e"}) {
        const auto read = readTemplate(folder / name, body, {}, quick());
        ASSERT_TRUE(read.ok()) << name << ": " << read.error().describe();
        EXPECT_EQ(read->weightSource, name == "c" ? WeightSource::Given : WeightSource::Diffused) << name;
        EXPECT_EQ(read->mesh.triangles.size(), source.mesh.triangles.size());
        expectSoundWeights(*read);
        // On the body's own surface the body's weights come back.
        for (std::size_t v = 0; v < read->mesh.positions.size(); ++v) {
            std::size_t nearest = 0;
            for (std::size_t o = 0; o < source.mesh.positions.size(); ++o) {
                if (glm::distance(source.mesh.positions[o], read->mesh.positions[v]) <
                    glm::distance(source.mesh.positions[nearest], read->mesh.positions[v])) {
                    nearest = o;
                }
            }
            ASSERT_LT(glm::distance(source.mesh.positions[nearest], read->mesh.positions[v]), 1e-5f);
            EXPECT_GT(read->weights.weights[v * kMaxInfluences], name == "c" ? 0.999f : 0.3f) << name;
        }
    }
    TemplateOptions ignore = quick();
    ignore.ignoreGivenWeights = true;
    EXPECT_EQ(readTemplate(folder / "c", body, {}, ignore)->weightSource, WeightSource::Diffused);
    EXPECT_TRUE(readWeightedTemplate(folder / "c").ok());
    EXPECT_EQ(readWeightedTemplate(folder / "a").error().code, ErrorCode::Unsupported);
    EXPECT_EQ(readTemplate(folder / "none", body).error().code, ErrorCode::NotFound);
}

TEST(Template, OtherUnitsPlacesAndAxesAreNamedWithNumbers) {
    const BodyModel body = boxBody();
    const auto message = [&](const std::function<glm::vec3(glm::vec3)>& change, TemplateOptions options = quick()) {
        TriangleMesh mesh = meshOf(body);
        for (glm::vec3& p : mesh.positions) p = change(p);
        const auto result = templateFromMesh(mesh, body, {}, options);
        return result.ok() ? std::string("ok") : result.error().describe();
    };
    EXPECT_EQ(message([](glm::vec3 p) { return p; }), "ok");
    const std::string centimetres = message([](glm::vec3 p) { return 100.0f * p; });
    EXPECT_NE(centimetres.find("centimetres"), std::string::npos) << centimetres;
    EXPECT_NE(centimetres.find("scale 0.01"), std::string::npos) << centimetres;
    const std::string inches = message([](glm::vec3 p) { return 39.37f * p; });
    EXPECT_NE(inches.find("scale 0.0254"), std::string::npos) << inches;
    const std::string odd = message([](glm::vec3 p) { return 0.01f * p; });
    EXPECT_NE(odd.find("scale 100"), std::string::npos) << odd;
    TemplateOptions scaled = quick();
    scaled.scale = 0.01f;
    EXPECT_EQ(message([](glm::vec3 p) { return 100.0f * p; }, scaled), "ok");
    const std::string elsewhere = message([](glm::vec3 p) { return p + glm::vec3(0, 1.2f, 0); });
    EXPECT_NE(elsewhere.find("stands elsewhere"), std::string::npos) << elsewhere;
    TemplateOptions matched = quick();
    matched.placement = TemplatePlacement::MatchBody;
    EXPECT_EQ(message([](glm::vec3 p) { return p + glm::vec3(0, 1.2f, 0); }, matched), "ok");
    const std::string lying = message([](glm::vec3 p) { return glm::vec3(p.x, -p.z, p.y); });
    EXPECT_NE(lying.find("z axis up"), std::string::npos) << lying;
    for (const float bad : {0.0f, -1.0f, NAN, INFINITY}) {
        TemplateOptions options = quick();
        options.scale = bad;
        EXPECT_NE(message([](glm::vec3 p) { return p; }, options).find("not a positive number"), std::string::npos);
    }
}

TEST(Template, MeshInTheCanonicalPoseComesBackInTheTPose) {
    ARS_TEST_DATA_FILE(path, "open_body.npz");
    const auto body = readBodyModel(path);
    ASSERT_TRUE(body.ok()) << body.error().describe();
    TriangleMesh mesh = meshOf(*body);
    mesh.positions = posedVertices(*body, {}, canonicalPose());
    mesh.normals = vertexNormals(mesh.positions, mesh.triangles);
    TemplateOptions options;
    options.pose = TemplatePose::Canonical;
    options.diffusion.resolution = 64;
    const auto found = templateFromMesh(mesh, *body, {}, options);
    ASSERT_TRUE(found.ok()) << found.error().describe();
    float worst = 0.0f;
    std::size_t turned = 0;
    const std::vector<glm::vec3> normals = vertexNormals(body->templateVertices, body->triangles);
    for (std::size_t v = 0; v < mesh.positions.size(); ++v) {
        worst = std::max(worst, glm::distance(found->mesh.positions[v], body->templateVertices[v]));
        if (glm::dot(found->mesh.normals[v], normals[v]) < 0.9f) ++turned;
    }
    std::printf("canonical to T-pose: largest distance to the T-pose %.3f mm, %zu normals off\n", 1e3 * worst, turned);
    EXPECT_LT(worst, 1e-3f);
    EXPECT_LT(turned, mesh.positions.size() / 100);
}

/// Arrays of a small sound npz template that a test then breaks.
std::vector<std::pair<std::string, Array>> soundArrays(const BodyModel& body) {
    const std::size_t vertices = body.templateVertices.size();
    std::vector<float> v, joints;
    std::vector<std::int64_t> f, material;
    for (const glm::vec3& p : body.templateVertices) v.insert(v.end(), {p.x, p.y, p.z});
    for (const glm::uvec3& t : body.triangles) {
        f.insert(f.end(), {t.x, t.y, t.z});
        material.push_back(static_cast<std::int64_t>(t.x % 2));
    }
    for (const glm::vec3& p : regressJoints(body, body.templateVertices)) joints.insert(joints.end(), {p.x, p.y, p.z});
    std::vector<std::string> names;
    for (int j = 0; j < kSmplxJointCount; ++j) names.emplace_back(smplxJointName(j));
    return {{"v", Array::fromFloats({vertices, 3}, v)},
            {"f", Array::fromInts({body.triangles.size(), 3}, f)},
            {"weights", Array::fromFloats({vertices, kSmplxJointCount}, denseWeights(body.weights, kSmplxJointCount))},
            {"joints", Array::fromFloats({kSmplxJointCount, 3}, joints)},
            {"joint_names", Array::fromTexts({kSmplxJointCount}, names)},
            {"uv", Array::fromFloats({4, 2}, std::vector<float>{0, 0, 1, 0, 0, 1, 0.25f, 0.75f})},
            {"uv_f", Array::fromInts({body.triangles.size(), 3}, std::vector<std::int64_t>(f.size(), 3))},
            {"material", Array::fromInts({body.triangles.size()}, material)},
            {"material_names", Array::fromTexts({2}, {"even", "odd"})}};
}

Array& arrayOf(std::vector<std::pair<std::string, Array>>& arrays, const std::string& key) {
    return std::find_if(arrays.begin(), arrays.end(), [&](const auto& a) { return a.first == key; })->second;
}

TEST(Template, NpzIsReadWithItsMaterialsAndTextureCoordinates) {
    const BodyModel body = boxBody();
    test::TemporaryFolder folder;
    auto arrays = soundArrays(body);
    // Columns in another order than SMPL-X's follow their names.
    Array& weights = arrayOf(arrays, "weights");
    for (std::size_t row = 0; row < weights.shape[0]; ++row) {
        std::swap(weights.as<float>()[row * kSmplxJointCount + 3], weights.as<float>()[row * kSmplxJointCount + 40]);
    }
    Array& joints = arrayOf(arrays, "joints");
    for (std::size_t c = 0; c < 3; ++c) std::swap(joints.as<float>()[9 + c], joints.as<float>()[120 + c]);
    std::swap(arrayOf(arrays, "joint_names").texts[3], arrayOf(arrays, "joint_names").texts[40]);
    ASSERT_TRUE(writeNpz(folder / "t.npz", arrays).ok());
    const auto read = readWeightedTemplate(folder / "t.npz");
    ASSERT_TRUE(read.ok()) << read.error().describe();
    EXPECT_EQ(read->name, "t");
    expectSoundWeights(*read);
    ASSERT_EQ(read->mesh.positions.size(), body.templateVertices.size());
    EXPECT_EQ(read->materials.size(), 2u);
    EXPECT_EQ(read->materials[1].name, "odd");
    for (std::size_t v = 0; v < read->mesh.positions.size(); ++v) {
        const auto source = static_cast<std::size_t>(read->mesh.sourceVertices[v]);
        EXPECT_EQ(read->mesh.positions[v], body.templateVertices[source]);
        EXPECT_EQ(read->weights.joints[v * kMaxInfluences], body.weights.joints[source * kMaxInfluences]);
        EXPECT_EQ(read->mesh.uvs[v], glm::vec2(0.25f, 0.25f)); // v counts from the bottom in the file
    }
    EXPECT_LT(glm::distance(read->joints[40], regressJoints(body, body.templateVertices)[40]), 1e-6f);
}

TEST(Template, BrokenNpzFilesAreOneClearError) {
    const BodyModel body = boxBody();
    test::TemporaryFolder folder;
    const auto message = [&](const std::function<void(std::vector<std::pair<std::string, Array>>&)>& breakIt) {
        auto arrays = soundArrays(body);
        breakIt(arrays);
        EXPECT_TRUE(writeNpz(folder / "t.npz", arrays).ok());
        const auto read = readTemplate(folder / "t.npz", body, {}, quick());
        return read.ok() ? std::string("ok") : read.error().describe();
    };
    using Arrays = std::vector<std::pair<std::string, Array>>;
    const auto expectPlace = [&](const std::string& place, const std::function<void(Arrays&)>& breakIt) {
        const std::string text = message(breakIt);
        EXPECT_NE(text.find("t.npz"), std::string::npos) << text;
        EXPECT_NE(text.find(place), std::string::npos) << text << "; expected " << place;
        EXPECT_EQ(text.find('\n'), std::string::npos) << text;
    };
    EXPECT_EQ(message([](Arrays&) {}), "ok");
    const auto drop = [](const std::string& key) {
        return [key](Arrays& arrays) { std::erase_if(arrays, [&](const auto& a) { return a.first == key; }); };
    };
    expectPlace("v", drop("v"));
    expectPlace("f", drop("f"));
    EXPECT_EQ(message(drop("joints")), "ok");
    EXPECT_EQ(message(drop("joint_names")), "ok");
    EXPECT_EQ(message(drop("material_names")), "ok");
    expectPlace("uv", drop("uv_f"));
    expectPlace("v[1]", [](Arrays& a) { arrayOf(a, "v").as<float>()[4] = NAN; });
    expectPlace("f[2]", [](Arrays& a) { arrayOf(a, "f").as<std::int64_t>()[7] = 440; });
    expectPlace("f[2]", [](Arrays& a) { arrayOf(a, "f").as<std::int64_t>()[7] = -1; });
    expectPlace("f[0]", [](Arrays& a) { arrayOf(a, "f").as<std::int64_t>()[0] = std::int64_t{1} << 62; });
    expectPlace("uv_f[0]", [](Arrays& a) { arrayOf(a, "uv_f").as<std::int64_t>()[0] = 4; });
    expectPlace("uv_f",
                [](Arrays& a) { arrayOf(a, "uv_f") = Array::fromInts({1, 3}, std::vector<std::int64_t>(3, 0)); });
    expectPlace("f", [](Arrays& a) { arrayOf(a, "f").shape = {arrayOf(a, "f").count()}; });
    expectPlace("triangles", [](Arrays& a) {
        arrayOf(a, "f") = arrayOf(a, "uv_f") = Array::fromInts({0, 3}, {});
        arrayOf(a, "material") = Array::fromInts({0}, {});
    });
    expectPlace("weights",
                [](Arrays& a) { arrayOf(a, "weights") = Array::fromFloats({1, 55}, std::vector<float>(55, 1)); });
    expectPlace("weights", [](Arrays& a) { std::ranges::fill(arrayOf(a, "weights").as<float>(), 0.0f); });
    expectPlace("weights", [](Arrays& a) { arrayOf(a, "weights").as<float>()[60] = INFINITY; });
    expectPlace("joint_names[7]", [](Arrays& a) { arrayOf(a, "joint_names").texts[7] = "tail"; });
    expectPlace("joint_names[1]", [](Arrays& a) { arrayOf(a, "joint_names").texts[1] = "pelvis"; });
    expectPlace("joint_names",
                [](Arrays& a) { arrayOf(a, "joint_names") = Array::fromFloats({55}, std::vector<float>(55)); });
    expectPlace("joints", [](Arrays& a) { arrayOf(a, "joints") = Array::fromFloats({2, 3}, std::vector<float>(6)); });
    expectPlace("material[0]", [](Arrays& a) { arrayOf(a, "material").as<std::int64_t>()[0] = 1 << 30; });
    expectPlace("material",
                [](Arrays& a) { arrayOf(a, "material") = Array::fromInts({2}, std::vector<std::int64_t>(2)); });
}

TEST(Template, CutAndForeignFilesAreRefused) {
    const BodyModel body = boxBody();
    test::TemporaryFolder folder;
    const TemplateMesh source = templateFromBody(body);
    ASSERT_TRUE(writeNpz(folder / "t.npz", soundArrays(body)).ok());
    ASSERT_TRUE(writeRiggedGlb(folder / "t.glb", rigFromTemplate(source)).ok());
    ASSERT_TRUE(writePlyMesh(folder / "t.ply", source.mesh).ok());
    for (const std::string name : {"t.npz", "t.glb", "t.ply"}) {
        const std::vector<std::byte> bytes = bytesOf(folder / name);
        for (std::size_t n = 0; n < 16; ++n) {
            const auto read = parseTemplate(std::span(bytes).first(bytes.size() * n / 16), body, {}, quick());
            EXPECT_FALSE(read.ok()) << name << " " << n;
        }
    }
    for (const std::string text : {"", "hello", "{", "{\"asset\":{\"version\":\"2.0\"}}", "glTF", "PK\x03\x04", "ply\n",
                                   "v 1 2 3\n", "v 1 2 3\nf 1 2 3\n", "v 0 0 0\nv 0 0 0\nv 0 0 0\nf 1 2 3\n"}) {
        const auto read = parseTemplate(std::as_bytes(std::span(text)), body, {}, quick());
        EXPECT_FALSE(read.ok()) << text;
    }
    RiggedMesh other = rigFromTemplate(source);
    other.skeleton.names[5] = "mixamorig:LeftLeg";
    other.isSmplx = false;
    ASSERT_TRUE(writeRiggedGlb(folder / "other.glb", other).ok());
    const auto foreign = readTemplate(folder / "other.glb", body, {}, quick());
    ASSERT_FALSE(foreign.ok());
    EXPECT_EQ(foreign.error().code, ErrorCode::Unsupported) << foreign.error().describe();
    EXPECT_EQ(templateFromRig(other).error().code, ErrorCode::Unsupported);
    TemplateOptions ignore = quick();
    ignore.ignoreGivenWeights = true;
    EXPECT_TRUE(readTemplate(folder / "other.glb", body, {}, ignore).ok());
}

TEST(Template, StoppingLeavesNothing) {
    const BodyModel body = boxBody();
    const auto stopped = templateFromMesh(meshOf(body), body, {}, quick(),
                                          [](double fraction, std::string_view) { return fraction < 0.3; });
    ASSERT_FALSE(stopped.ok());
    EXPECT_EQ(stopped.error().code, ErrorCode::Cancelled);
}

TEST(Template, RealSmplxTopologyReadsWithDiffusedWeights) {
    ARS_TEST_DATA_FILE(bodyPath, "open_body.npz");
    ARS_TEST_DATA_FILE(path, "bodies/smplx_topology/SMPLX-male.obj");
    const auto body = readBodyModel(bodyPath);
    ASSERT_TRUE(body.ok()) << body.error().describe();
    // It stands with its feet at the origin.
    const auto unplaced = readTemplate(path, *body);
    ASSERT_FALSE(unplaced.ok());
    EXPECT_NE(unplaced.error().describe().find("stands elsewhere"), std::string::npos) << unplaced.error().describe();
    TemplateOptions options;
    options.placement = TemplatePlacement::MatchBody;
    options.diffusion.resolution = 96;
    const auto read = readTemplate(path, *body, {}, options);
    ASSERT_TRUE(read.ok()) << read.error().describe();
    EXPECT_EQ(read->weightSource, WeightSource::Diffused);
    expectSoundWeights(*read);
    std::printf("smplx topology: %zu vertices, mean distance to the open body %.1f mm, largest %.1f mm, %zu notes\n",
                read->mesh.positions.size(), 1e3 * read->diffusion.meanBodyDistanceM,
                1e3 * read->diffusion.maxBodyDistanceM, read->notes.size());
    // A man's left hand follows a left hand's joints.
    const auto leftmost =
        static_cast<std::size_t>(std::max_element(read->mesh.positions.begin(), read->mesh.positions.end(),
                                                  [](const glm::vec3& a, const glm::vec3& b) { return a.x < b.x; }) -
                                 read->mesh.positions.begin());
    EXPECT_EQ(smplxJointName(read->weights.joints[leftmost * kMaxInfluences]).substr(0, 5), "left_");
}

TEST(Template, DiffusedWeightsOfRealClothesAreNearTheGivenOnes) {
    ARS_TEST_DATA_FILE(bodyPath, "open_body.npz");
    ARS_TEST_DATA_FILE(path, "capture/casual/template.npz");
    ARS_TEST_DATA_FILE(motionPath, "capture/casual/motions/walk_02_01.npz");
    const auto body = readBodyModel(bodyPath);
    ASSERT_TRUE(body.ok()) << body.error().describe();
    const auto given = readTemplate(path, *body);
    ASSERT_TRUE(given.ok()) << given.error().describe();
    EXPECT_EQ(given->weightSource, WeightSource::Given);
    TemplateOptions options;
    options.ignoreGivenWeights = true;
    const auto diffused = readTemplate(path, *body, {}, options);
    ASSERT_TRUE(diffused.ok()) << diffused.error().describe();
    ASSERT_EQ(given->mesh.positions, diffused->mesh.positions);

    const std::size_t vertices = given->mesh.positions.size();
    std::vector<int> material(vertices, -1);
    for (std::size_t t = 0; t < given->mesh.triangles.size(); ++t) {
        for (int c = 0; c < 3; ++c) material[given->mesh.triangles[t][c]] = given->mesh.materials[t];
    }
    const std::vector<float> a = denseWeights(given->weights, kSmplxJointCount);
    const std::vector<float> b = denseWeights(diffused->weights, kSmplxJointCount);
    std::vector<double> half(vertices, 0.0), worst(vertices, 0.0);
    for (std::size_t i = 0; i < a.size(); ++i) {
        const double d = std::abs(static_cast<double>(a[i]) - b[i]);
        half[i / kSmplxJointCount] += 0.5 * d;
        worst[i / kSmplxJointCount] = std::max(worst[i / kSmplxJointCount], d);
    }
    const auto motion = readMotionNpz(motionPath);
    ASSERT_TRUE(motion.ok()) << motion.error().describe();
    std::vector<double> moved(vertices, 0.0);
    const std::array<std::size_t, 3> frames = {0, motion->frames.size() / 3, motion->frames.size() / 2};
    for (const std::size_t f : frames) {
        const auto x = posedTemplate(*given, motion->frames[f]);
        const auto y = posedTemplate(*diffused, motion->frames[f]);
        ASSERT_TRUE(x.ok() && y.ok());
        for (std::size_t v = 0; v < vertices; ++v) moved[v] += 1e3 * glm::distance((*x)[v], (*y)[v]) / frames.size();
    }
    double skinWithin = 0.0, shirtMean = 0.0;
    for (int m = 0; m < static_cast<int>(given->materials.size()); ++m) {
        double sum = 0.0, within = 0.0, mm = 0.0, mmWorst = 0.0;
        std::size_t count = 0;
        for (std::size_t v = 0; v < vertices; ++v) {
            if (material[v] != m) continue;
            ++count;
            sum += half[v];
            within += worst[v] < 0.05 ? 1.0 : 0.0;
            mm += moved[v];
            mmWorst = std::max(mmWorst, moved[v]);
        }
        const auto n = static_cast<double>(std::max<std::size_t>(count, 1));
        std::printf(
            "  %-9s %6zu vertices: mean difference %.4f, %5.1f%% within 0.05, walking %.2f mm mean, %.1f mm largest\n",
            given->materials[static_cast<std::size_t>(m)].name.c_str(), count, sum / n, 100.0 * within / n, mm / n,
            mmWorst);
        if (given->materials[static_cast<std::size_t>(m)].name == "skin") skinWithin = within / n;
        if (given->materials[static_cast<std::size_t>(m)].name == "shirt") shirtMean = mm / n;
    }
    // Skin lies on the body, so its weights are the body's; a shirt's given weights are the body's nearby.
    EXPECT_GT(skinWithin, 0.98);
    EXPECT_LT(shirtMean, 5.0);
}

} // namespace
} // namespace ars
