#include "tests/unit/cli/motion_files.h"
#include "tests/unit/cli/run_ars.h"

#include <signal.h>
#include <unistd.h>

#include <cstring>
#include <set>
#include <sstream>
#include <thread>

namespace ars::test {
namespace {

namespace fs = std::filesystem;

// Published sizes of the open body, see resources/bodies/README.md.
constexpr std::size_t kOpenBodyVertices = 13380;
constexpr std::size_t kOpenBodyTriangles = 26756;

std::size_t linesStartingWith(const std::string& text, const std::string& start) {
    std::istringstream lines(text);
    std::string line;
    std::size_t count = 0;
    while (std::getline(lines, line)) count += line.starts_with(start) ? 1 : 0;
    return count;
}

/// The JSON chunk of a .glb, by the letter of the format.
nlohmann::json glbJson(const fs::path& path) {
    const std::string bytes = readBytes(path);
    std::uint32_t length = 0;
    if (bytes.size() < 20 || bytes.substr(0, 4) != "glTF" || bytes.substr(16, 4) != "JSON") {
        ADD_FAILURE() << path << " is no glb";
        return nlohmann::json::object();
    }
    std::memcpy(&length, bytes.data() + 12, 4);
    return nlohmann::json::parse(bytes.substr(20, length));
}

void expectSuccess(const ProcessResult& result) { EXPECT_EQ(result.exitCode, 0) << result.output << result.errors; }

TEST(Export, RestingBodyAsObjPlyAndNpz) {
    const TemporaryFolder folder;
    for (const char* name : {"b.obj", "b.ply", "b.npz"})
        expectSuccess(runArs({"export", "--out", (folder / name).string()}));
    const std::string obj = readBytes(folder / "b.obj");
    EXPECT_EQ(linesStartingWith(obj, "v "), kOpenBodyVertices);
    EXPECT_EQ(linesStartingWith(obj, "f "), kOpenBodyTriangles);
    const std::string ply = readBytes(folder / "b.ply").substr(0, 400);
    EXPECT_NE(ply.find("element vertex 13380"), std::string::npos);
    EXPECT_NE(ply.find("element face 26756"), std::string::npos);
    EXPECT_EQ(floatsOf(folder / "b.npz", "v").size(), kOpenBodyVertices * 3);
    EXPECT_EQ(floatsOf(folder / "b.npz", "joints").size(), 55u * 3);
    EXPECT_EQ(namesIn(folder.path()), (std::vector<std::string>{"b.npz", "b.obj", "b.ply"}));
}

TEST(Export, CanonicalPoseSpreadsTheLegs) {
    const TemporaryFolder folder;
    expectSuccess(runArs({"export", "--pose", "canonical", "--out", (folder / "c.npz").string()}));
    expectSuccess(runArs({"export", "--pose", "rest", "--out", (folder / "r.npz").string()}));
    const std::vector<float> canonical = floatsOf(folder / "c.npz", "joints"),
                             rest = floatsOf(folder / "r.npz", "joints");
    // Ankles (7 left, 8 right): the hip turns by 25 degrees about z, so its leg swings out by about length * sin(25).
    const float leg = rest[1 * 3 + 1] - rest[7 * 3 + 1];
    EXPECT_NEAR(canonical[7 * 3] - rest[7 * 3], leg * std::sin(25.0f * 3.14159265f / 180.0f), 0.05f);
    EXPECT_LT(canonical[8 * 3], rest[8 * 3] - 0.2f);
    EXPECT_NEAR(canonical[20 * 3 + 1], rest[20 * 3 + 1], 1e-5f) << "the arms stay";
}

TEST(Export, ShapeCoefficientsChangeTheBody) {
    const TemporaryFolder folder;
    expectSuccess(runArs({"export", "--betas", "-1.5,0.5", "--out", (folder / "a.npz").string()}));
    expectSuccess(runArs({"export", "--out", (folder / "b.npz").string()}));
    EXPECT_NE(floatsOf(folder / "a.npz", "v"), floatsOf(folder / "b.npz", "v"));
    const std::string many = "1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1";
    const ProcessResult refused = runArs({"export", "--betas", many, "--out", (folder / "c.npz").string()});
    EXPECT_EQ(refused.exitCode, 2);
    EXPECT_NE(refused.errors.find("25 coefficients given"), std::string::npos) << refused.errors;
    EXPECT_FALSE(fs::exists(folder / "c.npz"));
}

TEST(Export, GlbHasSkeletonSkinAndAnimation) {
    const TemporaryFolder folder;
    writeWalk(folder / "walk.npz", 12);
    const std::string motion = (folder / "walk.npz").string();
    expectSuccess(runArs({"export", "--motion", motion, "--out", (folder / "w.glb").string()}));
    const auto json = glbJson(folder / "w.glb");
    ASSERT_EQ(json["skins"].size(), 1u);
    EXPECT_EQ(json["skins"][0]["joints"].size(), 55u);
    ASSERT_EQ(json["animations"].size(), 1u);
    // The time track runs from 0 to (12 - 1) / 30 s.
    double last = 0.0;
    for (const auto& sampler : json["animations"][0]["samplers"]) {
        last = std::max(last, json["accessors"][sampler["input"].get<int>()]["max"][0].get<double>());
    }
    EXPECT_NEAR(last, 11.0 / 30.0, 1e-5);
    expectSuccess(runArs({"export", "--out", (folder / "rest.glb").string()}));
    EXPECT_FALSE(glbJson(folder / "rest.glb").contains("animations"));
    expectSuccess(runArs({"info", (folder / "w.glb").string()}));
}

TEST(Export, FramesBecomeNumberedFiles) {
    const TemporaryFolder folder;
    writeWalk(folder / "walk.npz", 8);
    const ProcessResult result = runArs({"export", "--json", "--motion", (folder / "walk.npz").string(), "--frames",
                                         "2:5", "--out", (folder / "out" / "w.obj").string()});
    expectSuccess(result);
    EXPECT_EQ(namesIn(folder / "out"), (std::vector<std::string>{"w_0002.obj", "w_0003.obj", "w_0004.obj"}));
    const auto json = parsed(result);
    EXPECT_EQ(json["frames"], 3);
    EXPECT_EQ(json["files"].size(), 3u);
    EXPECT_EQ(json["vertices"], kOpenBodyVertices);
    EXPECT_NE(readBytes(folder / "out" / "w_0002.obj"), readBytes(folder / "out" / "w_0004.obj"));
}

TEST(Export, OneFrameOfAMotionIsThePoseOfThatFrame) {
    const TemporaryFolder folder;
    writeWalk(folder / "walk.npz", 8);
    const std::string motion = (folder / "walk.npz").string();
    expectSuccess(runArs({"export", "--motion", motion, "--frames", "5", "--out", (folder / "a.npz").string()}));
    expectSuccess(runArs({"export", "--pose", motion, "--frame", "5", "--out", (folder / "b.npz").string()}));
    const std::vector<float> a = floatsOf(folder / "a.npz", "v");
    EXPECT_EQ(a, floatsOf(folder / "b.npz", "v"));
    // The root turns about its own rest position, so the pelvis has moved by the translation alone.
    expectSuccess(runArs({"export", "--out", (folder / "r.npz").string()}));
    const std::vector<float> moved = floatsOf(folder / "a.npz", "joints"), rest = floatsOf(folder / "r.npz", "joints");
    EXPECT_NEAR(moved[1] - rest[1], 0.9f, 1e-5f);
    EXPECT_NEAR(moved[2] - rest[2], 5.0f / 30.0f, 1e-5f);
}

TEST(Export, FailuresAreOneSentenceAndLeaveNothing) {
    const TemporaryFolder folder;
    writeWalk(folder / "walk.npz", 8);
    writeText(folder / "broken.npz", readBytes(folder / "walk.npz").substr(0, 900));
    writeText(folder / "file", "in the way");
    const std::string motion = (folder / "walk.npz").string(), out = (folder / "x.obj").string();
    expectOneError(runArs({"export", "--motion", motion, "--frames", "5:99", "--out", out}),
                   {motion, "8 frames", "98"});
    expectOneError(runArs({"export", "--motion", (folder / "broken.npz").string(), "--out", out}), {"broken.npz"});
    expectOneError(runArs({"export", "--motion", (folder / "file").string(), "--out", out}), {"file"});
    expectOneError(runArs({"export", "--template", (folder / "file").string(), "--out", out}), {"file"});
    expectOneError(runArs({"export", "--body", motion, "--out", out}), {motion});
    expectOneError(runArs({"export", "--out", (folder / "file" / "x.obj").string()}), {"x.obj"});
    expectOneError(runArs({"export", "--motion", motion, "--out", (folder / "file" / "x.obj").string()}), {"x.obj"});
    EXPECT_EQ(namesIn(folder.path()), (std::vector<std::string>{"broken.npz", "file", "walk.npz"}));
}

TEST(Export, AnInterruptLeavesNothingBehind) {
    const TemporaryFolder folder;
    writeWalk(folder / "walk.npz", 4000);
    fs::create_directory(folder / "out");
    writeText(folder / "out" / "w_0000.obj", "from an earlier run");
    auto child = ChildProcess::start({programPath(), "export", "--motion", (folder / "walk.npz").string(), "--out",
                                      (folder / "out" / "w.obj").string()},
                                     folder / "log", false);
    ASSERT_TRUE(child.ok());
    // Wait until frames are being written.
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(120);
    while (namesIn(folder / "out").size() < 2 && std::chrono::steady_clock::now() < deadline && child->running()) {
        std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    ASSERT_TRUE(child->running()) << readBytes(folder / "log");
    ASSERT_TRUE(child->signal(SIGINT).ok());
    ASSERT_TRUE(child->wait(std::chrono::seconds(60)));
    EXPECT_EQ(child->exitCode(), 128 + SIGINT);
    EXPECT_EQ(namesIn(folder / "out"), (std::vector<std::string>{"w_0000.obj"}));
    EXPECT_EQ(readBytes(folder / "out" / "w_0000.obj"), "from an earlier run");
    EXPECT_NE(readBytes(folder / "log").find("error: "), std::string::npos);
    EXPECT_NE(readBytes(folder / "log").find("stopped on request"), std::string::npos);
}

TEST(Export, ATemplateKeepsItsTextures) {
    ARS_TEST_DATA_FILE(path, "capture/casual/template.glb");
    const TemporaryFolder folder;
    expectSuccess(
        runArs({"export", "--template", path.string(), "--pose", "canonical", "--out", (folder / "t.glb").string()}));
    const auto before = glbJson(path), after = glbJson(folder / "t.glb");
    EXPECT_EQ(after["images"].size(), before["images"].size());
    std::set<std::string> names;
    for (const auto& material : before["materials"]) names.insert(material["name"].get<std::string>());
    for (const auto& material : after["materials"]) {
        EXPECT_TRUE(names.contains(material["name"].get<std::string>()));
        EXPECT_TRUE(material["pbrMetallicRoughness"].contains("baseColorTexture"));
    }
    EXPECT_EQ(after["skins"][0]["joints"].size(), 55u);
}

TEST(Export, ABvhMovesTheTemplate) {
    ARS_TEST_DATA_FILE(glb, "capture/casual/template.glb");
    ARS_TEST_DATA_FILE(bvh, "motion/cmu_bvh/02_01.bvh");
    const TemporaryFolder folder;
    const ProcessResult result = runArs({"export", "--json", "--template", glb.string(), "--motion", bvh.string(),
                                         "--fps", "30", "--frames", "10:12", "--out", (folder / "w.ply").string()});
    expectSuccess(result);
    EXPECT_EQ(parsed(result)["joint_map"], "cmu");
    EXPECT_EQ(namesIn(folder.path()), (std::vector<std::string>{"w_0010.ply", "w_0011.ply"}));
}

} // namespace
} // namespace ars::test
