#include "tests/unit/cli/motion_files.h"
#include "tests/unit/cli/run_ars.h"

namespace ars::test {
namespace {

namespace fs = std::filesystem;

void expectSuccess(const ProcessResult& result) { EXPECT_EQ(result.exitCode, 0) << result.output << result.errors; }

float largestDifference(const std::vector<float>& a, const std::vector<float>& b) {
    EXPECT_EQ(a.size(), b.size());
    float largest = a.size() == b.size() ? 0.0f : 1e9f;
    for (std::size_t i = 0; i < std::min(a.size(), b.size()); ++i) largest = std::max(largest, std::abs(a[i] - b[i]));
    return largest;
}

TEST(Import, SmplParamsComeBackUnchanged) {
    const TemporaryFolder folder;
    writeWalk(folder / "walk.npz", 20);
    expectSuccess(runArs({"import", (folder / "walk.npz").string(), "--out", (folder / "same.npz").string()}));
    for (const char* key : {"global_orient", "body_pose", "transl", "left_hand_pose"}) {
        EXPECT_LT(largestDifference(floatsOf(folder / "walk.npz", key), floatsOf(folder / "same.npz", key)), 1e-5f)
            << key;
    }
}

TEST(Import, ThroughBvhAndBackThePosesAreTheSame) {
    const TemporaryFolder folder;
    writeWalk(folder / "walk.npz", 20);
    expectSuccess(runArs({"import", (folder / "walk.npz").string(), "--out", (folder / "walk.bvh").string()}));
    const ProcessResult back =
        runArs({"import", "--json", (folder / "walk.bvh").string(), "--out", (folder / "back.npz").string(), "--map",
                "smplx", "--floor", "keep", "--keep-position", "--unit", "0.01"});
    expectSuccess(back);
    EXPECT_EQ(parsed(back)["joint_map"], "smplx");
    EXPECT_EQ(parsed(back)["body_joints"], 22);
    // A BVH holds degrees with float precision: 1e-3 rad and 1 mm are far above that and far below a wrong joint.
    EXPECT_LT(largestDifference(floatsOf(folder / "walk.npz", "body_pose"), floatsOf(folder / "back.npz", "body_pose")),
              1e-3f);
    EXPECT_LT(largestDifference(floatsOf(folder / "walk.npz", "transl"), floatsOf(folder / "back.npz", "transl")),
              1e-3f);
}

TEST(Import, AnotherRateKeepsTheDuration) {
    const TemporaryFolder folder;
    writeWalk(folder / "walk.npz", 31); // one second
    const ProcessResult result = runArs(
        {"import", "--json", (folder / "walk.npz").string(), "--out", (folder / "b.npz").string(), "--fps", "60"});
    expectSuccess(result);
    EXPECT_EQ(parsed(result)["frames"], 61);
    EXPECT_NEAR(parsed(result)["duration"].get<double>(), 1.0, 1e-9);
    EXPECT_EQ(floatsOf(folder / "b.npz", "transl").size(), 61u * 3);
    EXPECT_NEAR(floatsOf(folder / "b.npz", "transl")[30 * 3 + 2], 0.5f, 1e-5f) << "half way after half the time";
}

TEST(Import, FramesAreCutAfterResampling) {
    const TemporaryFolder folder;
    writeWalk(folder / "walk.npz", 31);
    const std::string in = (folder / "walk.npz").string(), out = (folder / "b.npz").string();
    expectSuccess(runArs({"import", in, "--out", out, "--fps", "60", "--frames", "30:40"}));
    const std::vector<float> transl = floatsOf(out, "transl");
    ASSERT_EQ(transl.size(), 10u * 3);
    EXPECT_NEAR(transl[2], 0.5f, 1e-5f);
    expectOneError(runArs({"import", in, "--out", (folder / "c.npz").string(), "--frames", "40:50"}),
                   {in, "31 frames"});
    EXPECT_FALSE(fs::exists(folder / "c.npz"));
}

TEST(Import, AmassStandsUpright) {
    // A z-up recording: the root turned by 90 degrees about x stands; it walks along -y, which is the front (+z) here.
    const TemporaryFolder folder;
    constexpr std::size_t kFrames = 12;
    std::vector<double> poses(kFrames * 156, 0.0), trans(kFrames * 3, 0.0);
    for (std::size_t f = 0; f < kFrames; ++f) {
        poses[f * 156] = 1.5707963267948966;
        trans[f * 3 + 1] = -0.01 * static_cast<double>(f);
        trans[f * 3 + 2] = 1.0;
    }
    ASSERT_TRUE(
        writeNpz(folder / "amass.npz", {{"poses", Array::fromDoubles({kFrames, 156}, poses)},
                                        {"trans", Array::fromDoubles({kFrames, 3}, trans)},
                                        {"betas", Array::fromDoubles({16}, std::vector<double>(16, 0.0))},
                                        {"mocap_framerate", Array::fromDoubles({}, std::vector<double>{120.0})}})
            .ok());
    const ProcessResult result =
        runArs({"import", "--json", (folder / "amass.npz").string(), "--out", (folder / "a.npz").string()});
    expectSuccess(result);
    EXPECT_EQ(parsed(result)["source"], "amass smpl+h");
    EXPECT_EQ(parsed(result)["frames_per_second"], 120.0);
    for (const float angle : floatsOf(folder / "a.npz", "global_orient")) EXPECT_NEAR(angle, 0.0f, 1e-5f);
    const std::vector<float> transl = floatsOf(folder / "a.npz", "transl");
    EXPECT_NEAR(transl[11 * 3 + 2] - transl[2], 0.11f, 1e-5f);
    EXPECT_NEAR(transl[11 * 3 + 1] - transl[1], 0.0f, 1e-5f);
}

TEST(Import, BrokenAndForeignFilesAreOneSentence) {
    const TemporaryFolder folder;
    writeWalk(folder / "walk.npz", 8);
    const std::string whole = readBytes(folder / "walk.npz"), out = (folder / "out.npz").string();
    writeText(folder / "cut.npz", whole.substr(0, whole.size() / 2));
    writeText(folder / "empty.bvh", "");
    writeText(folder / "garbage.bvh", std::string(3000, '\x01'));
    writeText(folder / "odd.bvh", "HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\nCHANNELS 3 Zrotation Xrotation Yrotation\nEnd "
                                  "Site\n{\nOFFSET 0 1 0\n}\n}\n"
                                  "MOTION\nFrames: 1\nFrame Time: 0.1\n0 0 0\n");
    for (const char* name : {"cut.npz", "empty.bvh", "garbage.bvh", "odd.bvh", "absent.bvh"}) {
        expectOneError(runArs({"import", (folder / name).string(), "--out", out}), {name});
    }
    expectOneError(runArs({"import", folder.path().string(), "--out", out}), {folder.path().string()});
    expectOneError(runArs({"import", (folder / "walk.npz").string(), "--out", out, "--body", "/nowhere.npz"}),
                   {"/nowhere.npz"});
    EXPECT_FALSE(fs::exists(out));
}

TEST(Import, CmuWalkKeepsItsSecondsAndItsWay) {
    ARS_TEST_DATA_FILE(bvh, "motion/cmu_bvh/02_01.bvh");
    const TemporaryFolder folder;
    const ProcessResult result = runArs(
        {"import", "--json", bvh.string(), "--out", (folder / "w.npz").string(), "--fps", "30", "--keep-lead-in"});
    expectSuccess(result);
    const auto json = parsed(result);
    EXPECT_EQ(json["joint_map"], "cmu");
    EXPECT_EQ(json["skipped_frames"], 0);
    EXPECT_GE(json["body_joints"], 19);
    // 344 frames at 120 fps are 2.86 s; a person walks 1 to 1.8 m/s, upright.
    EXPECT_NEAR(json["duration"].get<double>(), 343.0 / 120.0, 1.0 / 30.0);
    const std::vector<float> transl = floatsOf(folder / "w.npz", "transl");
    const std::size_t last = transl.size() - 3;
    const float way = std::hypot(transl[last] - transl[0], transl[last + 2] - transl[2]);
    EXPECT_GT(way, 2.0f);
    EXPECT_LT(way, 6.0f);
    EXPECT_LT(std::abs(transl[last + 1] - transl[1]), 0.15f);
    const ProcessResult human = runArs({"import", bvh.string(), "--out", (folder / "w.npz").string()});
    EXPECT_NE(human.output.find("joint map"), std::string::npos) << human.output;
}

} // namespace
} // namespace ars::test
