#include "tests/unit/cli/run_ars.h"

#include <map>
#include <regex>

namespace ars::test {
namespace {

namespace fs = std::filesystem;

/// What a file of the shared data is, by its path: the first row that matches counts.
struct Expected {
    const char* pattern;
    const char* kind;
    bool sound; ///< false: recognised and not read
};

const std::vector<Expected>& expectations() {
    static const std::vector<Expected> rows{
        {R"(.*missing_img_files\.txt)", "missing_images", true},
        {R"(.*\.(md|py|txt|sh|toml))", "text", false},
        {R"((.*/)?LICENSE[^/]*)", "text", false},
        {R"(open_body\.npz)", "body_model", true},
        {R"(.*/template\.npz)", "template", true},
        {R"(.*\.npz)", "motion", true}, // smpl_params, capture motions, SMPL-X poses
        {R"(.*smplx_poses\.npy)", "motion", true},
        {R"(.*template\.glb)", "skinned_mesh", true},
        {R"(.*\.obj)", "mesh", true},
        {R"(.*\.bvh)", "motion", true},
        {R"(.*\.(exr|png|jpg))", "picture", true},
        {R"(.*calibration_full\.json)", "calibration", true},
        {R"(.*\.json)", "json", false},
        {R"(.*\.pth)", "checkpoint", false},
        {R"(.*\.mp4)", "video", false},
    };
    return rows;
}

const Expected* expectedFor(const std::string& relative) {
    for (const Expected& row : expectations()) {
        if (std::regex_match(relative, std::regex(row.pattern))) return &row;
    }
    return nullptr;
}

TEST(SharedData, InfoSaysTheRightThingOfEveryFile) {
    ARS_TEST_DATA_FILE(index, "INDEX.md");
    const fs::path root = dataFolder();
    std::vector<std::string> arguments{"info", "--json"};
    for (const auto& entry : fs::recursive_directory_iterator(root)) {
        if (entry.is_regular_file()) arguments.push_back(entry.path().string());
    }
    const ProcessResult result = runArs(arguments);
    EXPECT_EQ(result.exitCode, 1) << "text and videos are among them";
    const auto reports = parsed(result);
    ASSERT_EQ(reports.size(), arguments.size() - 2);
    std::map<std::string, int> kinds;
    for (const auto& report : reports) {
        const std::string relative = fs::relative(report["path"].get<std::string>(), root).string();
        ++kinds[report["kind"].get<std::string>()];
        const Expected* expected = expectedFor(relative);
        ASSERT_NE(expected, nullptr) << relative;
        EXPECT_EQ(report["kind"], expected->kind) << relative;
        if (expected->sound) {
            EXPECT_EQ(report["sound"], true) << relative << report.dump(2);
        } else {
            EXPECT_TRUE(report["sound"].is_null()) << relative;
            EXPECT_EQ(report["error"]["code"], "unsupported") << relative;
        }
    }
    for (const char* kind : {"body_model", "template", "motion", "skinned_mesh", "mesh", "picture", "calibration"}) {
        EXPECT_GT(kinds[kind], 0) << kind;
    }
}

nlohmann::json infoOf(const fs::path& path, int exitCode = 0) {
    const ProcessResult result = runArs({"info", "--json", path.string()});
    EXPECT_EQ(result.exitCode, exitCode) << result.output;
    return parsed(result);
}

// The numbers below are those of the data's own descriptions and of the files' writers.
TEST(SharedData, TheOpenBodyHasItsPublishedSizes) {
    ARS_TEST_DATA_FILE(path, "open_body.npz");
    const auto json = infoOf(path);
    EXPECT_EQ(json["vertices"], 13380);
    EXPECT_EQ(json["triangles"], 26756);
    EXPECT_EQ(json["joints"], 55);
    EXPECT_EQ(json["shape"], 10);
    EXPECT_EQ(json["expression"], 10);
    EXPECT_EQ(json["pose_blend_shapes"], false);
    const double height = json["extent"]["max"][1].get<double>() - json["extent"]["min"][1].get<double>();
    EXPECT_NEAR(height, 1.748, 0.001);
}

TEST(SharedData, TheTemplateIsASmplxRigWithPictures) {
    ARS_TEST_DATA_FILE(glb, "capture/casual/template.glb");
    const auto json = infoOf(glb);
    EXPECT_EQ(json["joints"], 55);
    EXPECT_EQ(json["smplx"], true);
    EXPECT_GE(json["images"].size(), 1u);
    ARS_TEST_DATA_FILE(npz, "capture/casual/template.npz");
    const auto arrays = infoOf(npz);
    EXPECT_EQ(arrays["triangles"], 80148);
    EXPECT_EQ(arrays["joints"], 55);
}

TEST(SharedData, MotionsHaveTheirFrames) {
    ARS_TEST_DATA_FILE(capture, "capture/casual/smpl_params.npz");
    EXPECT_EQ(infoOf(capture)["frames"], 26);
    EXPECT_EQ(infoOf(capture)["source"], "smpl_params");
    ARS_TEST_DATA_FILE(poses, "motion/smplx/example_smplx_poses.npy");
    EXPECT_EQ(infoOf(poses)["frames"], 8);
    ARS_TEST_DATA_FILE(clip, "motion/smplx/apose_to_handsFront_smplx.npz");
    EXPECT_EQ(infoOf(clip)["frames"], 34);
    ARS_TEST_DATA_FILE(bvh, "motion/aitviewer_sample.bvh");
    const auto json = infoOf(bvh);
    EXPECT_EQ(json["frames"], 1300);
    EXPECT_EQ(json["joints"], 23);
    EXPECT_GE(json["joint_map"]["body_joints"], 19);
}

TEST(SharedData, EveryBvhFindsAJointMap) {
    ARS_TEST_DATA_FILE(folder, "motion");
    for (const auto& entry : fs::recursive_directory_iterator(folder)) {
        if (entry.path().extension() != ".bvh") continue;
        EXPECT_GE(infoOf(entry.path())["joint_map"]["body_joints"], 17) << entry.path();
    }
}

TEST(SharedData, LightsAreLatLongFloatPictures) {
    ARS_TEST_DATA_FILE(path, "hdri/night.exr");
    const auto json = infoOf(path);
    EXPECT_EQ(json["pixels"], (std::vector<int>{1024, 512}));
    EXPECT_EQ(json["environment"], true);
    EXPECT_EQ(json["compression"], "dwab");
    EXPECT_EQ(json["values"]["nan"], 0);
    ARS_TEST_DATA_FILE(depth, "capture/casual_val/heldout_views/24110013/gt/depth/00000000.exr");
    const auto picture = infoOf(depth);
    EXPECT_EQ(picture["pixels"], (std::vector<int>{384, 512}));
    EXPECT_EQ(picture["channels"][0]["type"], "float");
}

TEST(SharedData, CaptureFoldersAreSound) {
    ARS_TEST_DATA_FILE(folder, "capture/casual");
    const auto json = infoOf(folder);
    EXPECT_EQ(json["kind"], "capture");
    EXPECT_EQ(json["cameras"].size(), 12u);
    EXPECT_EQ(json["frames"], 26);
    EXPECT_EQ(json["pictures"], 312);
    EXPECT_EQ(json["masks"], 312);
    ARS_TEST_DATA_FILE(held, "capture/casual_val/heldout_views");
    EXPECT_EQ(infoOf(held)["cameras"], (std::vector<std::string>{"24110013", "24110014"}));
}

TEST(SharedData, ADamagedCaptureSaysWhere) {
    ARS_TEST_DATA_FILE(held, "capture/casual_val/heldout_views");
    const TemporaryFolder folder;
    const fs::path copy = folder / "capture";
    fs::copy(held, copy, fs::copy_options::recursive);
    for (const auto& entry : fs::recursive_directory_iterator(copy))
        fs::permissions(entry.path(), fs::perms::owner_all);
    fs::permissions(copy, fs::perms::owner_all);
    const fs::path picture = copy / "24110014" / "00000002.jpg";
    const std::string bytes = readBytes(picture);
    writeText(picture, bytes.substr(0, bytes.size() / 2));
    EXPECT_NE(infoOf(copy, 1)["error"]["place"].get<std::string>().find("24110014/00000002.jpg"), std::string::npos);
    fs::remove(picture);
    EXPECT_NE(infoOf(copy, 1)["error"]["message"].get<std::string>().find("24110014/00000002.jpg"), std::string::npos);
    writeText(copy / "missing_img_files.txt", "somewhere\\24110014\\00000002.jpg\r\n");
    EXPECT_EQ(infoOf(copy, 0)["listed_missing"], 1);
}

} // namespace
} // namespace ars::test
