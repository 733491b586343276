#include "engine/io/npz.h"
#include "tests/unit/cli/run_ars.h"

#include <sys/stat.h>
#include <unistd.h>

#include <cmath>
#include <limits>

namespace ars::test {
namespace {

namespace fs = std::filesystem;

constexpr const char* kTriangleObj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
constexpr const char* kTrianglePly =
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
constexpr const char* kBvh = "HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\nCHANNELS 3 Zrotation Xrotation Yrotation\n"
                             "End Site\n{\nOFFSET 0 1 0\n}\n}\nMOTION\nFrames: 2\nFrame Time: 0.1\n0 0 0\n0 0 90\n";
constexpr const char* kCamera =
    R"({"cam": {"K": [500,0,320, 0,500,240, 0,0,1], "R": [1,0,0, 0,1,0, 0,0,1], "T": [0,0,3],
                                 "imgSize": [640,480], "distCoeff": [0,0,0,0,0]}})";

nlohmann::json infoJson(const fs::path& path, int exitCode) {
    const ProcessResult result = runArs({"info", path.string(), "--json"});
    EXPECT_EQ(result.exitCode, exitCode) << result.output;
    return parsed(result);
}

TEST(Info, TellsFilesByContentWhateverTheyAreCalled) {
    const TemporaryFolder folder;
    struct Case {
        const char* name;
        std::string content;
        const char* kind;
        const char* format;
    };
    for (const Case& c : {Case{"a.txt", kTriangleObj, "mesh", "obj"}, Case{"b.png", kTrianglePly, "mesh", "ply"},
                          Case{"c", kBvh, "motion", "bvh"}, Case{"d.exr", kCamera, "calibration", "json"}}) {
        writeText(folder / c.name, c.content);
        const auto json = infoJson(folder / c.name, 0);
        EXPECT_EQ(json["kind"], c.kind) << c.name;
        EXPECT_EQ(json["format"], c.format) << c.name;
        EXPECT_EQ(json["sound"], true) << c.name;
    }
    EXPECT_EQ(infoJson(folder / "a.txt", 0)["warnings"].size(), 0u);
    EXPECT_EQ(infoJson(folder / "b.png", 0)["warnings"].size(), 1u);
}

TEST(Info, CountsOfHandWrittenFiles) {
    const TemporaryFolder folder;
    writeText(folder / "t.obj", kTriangleObj);
    const auto obj = infoJson(folder / "t.obj", 0);
    EXPECT_EQ(obj["vertices"], 3);
    EXPECT_EQ(obj["triangles"], 1);
    EXPECT_EQ(obj["extent"]["max"], (std::vector<double>{1, 1, 0}));
    writeText(folder / "m.bvh", kBvh);
    const auto bvh = infoJson(folder / "m.bvh", 0);
    EXPECT_EQ(bvh["joints"], 1);
    EXPECT_EQ(bvh["frames"], 2);
    EXPECT_NEAR(bvh["frames_per_second"].get<double>(), 10.0, 1e-6);
    writeText(folder / "c.json", kCamera);
    const auto camera = infoJson(folder / "c.json", 0);
    EXPECT_EQ(camera["cameras"], std::vector<std::string>{"cam"});
    // 2 atan(240 / 500), three metres from the origin
    EXPECT_NEAR(camera["vertical_field"][0].get<double>(), 51.282, 1e-3);
    EXPECT_NEAR(camera["distance"][0].get<double>(), 3.0, 1e-9);
}

TEST(Info, HumanOutputHasAHeadLineFactsAndAVerdict) {
    const TemporaryFolder folder;
    writeText(folder / "t.obj", kTriangleObj);
    const ProcessResult result = runArs({"info", (folder / "t.obj").string()});
    EXPECT_EQ(result.exitCode, 0);
    EXPECT_TRUE(result.output.starts_with((folder / "t.obj").string() + ": Wavefront OBJ, mesh\n  size"))
        << result.output;
    EXPECT_TRUE(result.output.ends_with("\n  sound\n")) << result.output;
    EXPECT_EQ(result.errors, "");
}

TEST(Info, BrokenFilesAreNotSoundWithOneSentence) {
    const TemporaryFolder folder;
    struct Case {
        const char* name;
        std::string content;
        std::vector<std::string> words;
    };
    const std::string camera = kCamera;
    std::string shortK = camera, mirrored = camera, noSize = camera;
    shortK.replace(shortK.find("500,0,320, "), 11, "500,0, ");
    mirrored.replace(mirrored.find("[1,0,0, 0,1,0"), 13, "[-1,0,0, 0,1,0");
    noSize.replace(noSize.find("imgSize"), 7, "imageSz");
    const std::vector<Case> cases{
        {"empty.npz", "", {"empty"}},
        {"garbage.bin", std::string("\x01\x02\x03\x00\x04", 5) + std::string(1000, '\x7f'), {"expected", "npz"}},
        {"face.obj", "v 0 0 0\nv 1 0 0\nf 1 2 9\n", {"line 3", "9"}},
        {"nan.ply",
         std::string(kTrianglePly).replace(std::string(kTrianglePly).find("1 0 0\n"), 5, "nan 0 0"),
         {"finite"}},
        {"short.bvh", std::string(kBvh).substr(0, std::string(kBvh).size() - 7), {"line"}},
        {"shortk.json", shortK, {"camera \"cam\"", "K has 8 numbers, expected 9"}},
        {"mirror.json", mirrored, {"camera \"cam\"", "R mirrors"}},
        {"nosize.json", noSize, {"camera \"cam\"", "imgSize is missing"}},
        {"broken.json", "{\"a\": [1, 2", {"JSON", "line 1"}},
        {"asset.gltf", R"({"asset": {"version": "2.0"}, "meshes": 5})", {"meshes"}},
        {"torch.npz", "\x80\x04\x95 pickle", {"pickle"}},
    };
    for (const Case& c : cases) {
        writeText(folder / c.name, c.content);
        const std::string path = (folder / c.name).string();
        std::vector<std::string> words = c.words;
        words.push_back(path + ": ");
        expectOneError(runArs({"info", path}), words, true);
        const auto json = infoJson(path, 1);
        EXPECT_NE(json["sound"], true) << c.name;
        EXPECT_FALSE(json["error"]["message"].get<std::string>().empty()) << c.name;
    }
}

TEST(Info, AbsentAndForbiddenPathsAreOneErrorAndNothingElse) {
    const TemporaryFolder folder;
    const std::string absent = (folder / "absent.npz").string();
    expectOneError(runArs({"info", absent}), {absent});
    EXPECT_EQ(infoJson(absent, 1)["error"]["code"], "not_found");
    expectOneError(runArs({"info", folder.path().string()}), {folder.path().string(), "calibration_full.json"}, true);
    ASSERT_EQ(::mkfifo((folder / "pipe").c_str(), 0600), 0);
    expectOneError(runArs({"info", (folder / "pipe").string()}), {"regular file"});
}

TEST(Info, PathsWithoutPermissionAreOneError) {
    const TemporaryFolder folder;
    fs::create_directory(folder / "locked");
    writeText(folder / "locked" / "t.obj", kTriangleObj);
    fs::permissions(folder / "locked", fs::perms::none);
    std::vector<std::string> command{programPath(), "info"};
    if (::geteuid() == 0) {
        // For root nothing is forbidden, unless it gives its capabilities away.
        const std::vector<std::string> without{"setpriv", "--bounding-set=-all", "--inh-caps=-all"};
        command.insert(command.begin(), without.begin(), without.end());
        const auto allowed = runProcess({without[0], without[1], without[2], "true"});
        if (!allowed || allowed->exitCode != 0) return notRun("root that cannot give its capabilities away");
    }
    for (const fs::path& path : {folder / "locked", folder / "locked" / "t.obj"}) {
        std::vector<std::string> whole = command;
        whole.push_back(path.string());
        const auto result = runProcess(whole);
        ASSERT_TRUE(result.ok());
        expectOneError(*result, {path.string(), "ermission denied"}, true);
    }
    fs::permissions(folder / "locked", fs::perms::owner_all);
}

TEST(Info, GoesOnAfterABadFile) {
    const TemporaryFolder folder;
    writeText(folder / "bad.obj", "v 0 0 0\nf 1 1 7\n");
    writeText(folder / "good.obj", kTriangleObj);
    const std::vector<std::string> files{(folder / "bad.obj").string(), (folder / "absent").string(),
                                         (folder / "good.obj").string()};
    const ProcessResult plain = runArs({"info", files[0], files[1], files[2]});
    EXPECT_EQ(plain.exitCode, 1);
    EXPECT_EQ(countLines(plain.errors), 2u) << plain.errors;
    EXPECT_NE(plain.output.find(files[2] + ": Wavefront OBJ"), std::string::npos);
    const ProcessResult asJson = runArs({"info", "--json", files[0], files[1], files[2]});
    EXPECT_EQ(asJson.exitCode, 1);
    const auto json = parsed(asJson);
    ASSERT_EQ(json.size(), 3u);
    EXPECT_EQ(json[0]["sound"], false);
    EXPECT_EQ(json[1]["kind"], "missing");
    EXPECT_EQ(json[2]["sound"], true);
    EXPECT_EQ(asJson.errors, "");
}

TEST(Info, FastDecodesNothingAndCallsNothingSound) {
    const TemporaryFolder folder;
    const std::vector<float> values{1.0f, std::nanf("")};
    ASSERT_TRUE(writeNpz(folder / "a.npz", {{"x", Array::fromFloats({2}, values)}}, false).ok());
    const ProcessResult result = runArs({"info", "--fast", "--json", (folder / "a.npz").string()});
    EXPECT_EQ(result.exitCode, 0);
    const auto json = parsed(result);
    EXPECT_TRUE(json["sound"].is_null());
    EXPECT_EQ(json["arrays"]["x"]["shape"], std::vector<int>{2});
    EXPECT_EQ(json["warnings"].size(), 0u);
}

TEST(Info, ArraysThatAreNotFiniteAreTold) {
    const TemporaryFolder folder;
    const std::vector<float> values{1.0f, std::nanf(""), std::numeric_limits<float>::infinity()};
    ASSERT_TRUE(writeNpz(folder / "a.npz", {{"x", Array::fromFloats({3}, values)}}).ok());
    const auto json = infoJson(folder / "a.npz", 0);
    EXPECT_EQ(json["kind"], "arrays");
    ASSERT_EQ(json["warnings"].size(), 1u);
    EXPECT_EQ(json["warnings"][0], "x: 2 numbers are not finite");
}

TEST(Info, EveryTruncationOfAnArchiveIsRefused) {
    const TemporaryFolder folder;
    const std::vector<float> values(4096, 0.25f);
    ASSERT_TRUE(writeNpz(folder / "whole.npz", {{"x", Array::fromFloats({4096}, values)}}, false).ok());
    const std::string bytes = readBytes(folder / "whole.npz");
    for (std::size_t i = 1; i < 16; ++i) {
        writeText(folder / "cut.npz", bytes.substr(0, bytes.size() * i / 16));
        expectOneError(runArs({"info", (folder / "cut.npz").string()}), {"cut.npz: "}, true);
    }
}

TEST(Info, ControlCharactersOfAFileDoNotReachTheTerminal) {
    const TemporaryFolder folder;
    writeText(folder / "a.json", R"({"\u001b[31mred\u0007": 1})");
    const ProcessResult result = runArs({"info", (folder / "a.json").string()});
    EXPECT_NE(result.output.find("[31mred"), std::string::npos);
    for (const char c : result.output + result.errors) EXPECT_TRUE(c == '\n' || static_cast<unsigned char>(c) >= 0x20);
}

TEST(Info, TellsAvatarsAndRunsFromCaptures) {
    const TemporaryFolder folder;
    fs::create_directories(folder / "a.avatar");
    writeText(folder / "a.avatar" / "avatar.json",
              R"({"format": "ars.avatar", "version": 1, "preset": "compact", "origin": "step 5 of a training on zzr",
                  "maps": {"size": 256, "points": 20822}, "radii": {"hip": {"initial": 0.2, "offset": 0.5}}})");
    const ProcessResult fast = runArs({"info", "--fast", "--json", (folder / "a.avatar").string()});
    const auto json = parsed(fast);
    EXPECT_EQ(json["kind"], "avatar");
    EXPECT_EQ(json["preset"], "compact");
    EXPECT_EQ(json["surfels"], 20822);
    EXPECT_NEAR(json["radii"]["hip"].get<double>(), 0.3, 1e-9);
    EXPECT_EQ(json["light"], false);
    fs::create_directories(folder / "b.avatar");
    writeText(folder / "b.avatar" / "avatar.json", R"({"format": "ars.avatar", "maps": {"size": "large"}})");
    const auto odd = infoJson(folder / "b.avatar", 1);
    EXPECT_NE(odd["error"].dump().find("other kinds"), std::string::npos) << odd;
    // Its weights are not there: opened, it is not sound.
    const auto opened = infoJson(folder / "a.avatar", 1);
    EXPECT_EQ(opened["kind"], "avatar");
    EXPECT_EQ(opened["sound"], false);

    fs::create_directories(folder / "run");
    writeText(folder / "run" / "config.json", R"({"format": "ars.run", "sources": {"capture": "zzr"}})");
    writeText(folder / "run" / "status.json",
              R"({"state": "idle", "stage": "radiance", "step": 7, "total_steps": 60, "step_ms": 1, "eta_s": 53,
                  "memory_bytes": 1, "peak_memory_bytes": 1, "losses": {}, "error": "", "note": "", "process": 0,
                  "host": "", "updated_unix_s": 1, "checkpoint": ""})");
    const auto run = infoJson(folder / "run", 0);
    EXPECT_EQ(run["kind"], "run");
    EXPECT_EQ(run["state"], "idle");
    EXPECT_EQ(run["step"], 7);
    EXPECT_EQ(run["capture"], "zzr");
}

} // namespace
} // namespace ars::test
