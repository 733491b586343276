#include "engine/rig/motion.h"

#include "engine/rig/body_model.h"
#include "tests/support/test_data.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

namespace ars {
namespace {

std::size_t at(int i) { return static_cast<std::size_t>(i); }

Array floats(std::vector<std::size_t> shape, float value = 0.0f) {
    std::size_t count = 1;
    for (std::size_t extent : shape) count *= extent;
    return Array::fromFloats(shape, std::vector<float>(count, value));
}

Array randomFloats(std::mt19937& random, std::vector<std::size_t> shape) {
    Array array = floats(std::move(shape));
    std::uniform_real_distribution<float> angle(-0.8f, 0.8f);
    for (float& v : array.as<float>()) v = angle(random);
    return array;
}

Array number(double value) {
    const double values[] = {value};
    return Array::fromDoubles({}, values);
}

NpzFile npz(std::vector<std::pair<std::string, Array>> arrays) {
    NpzFile file;
    for (auto& [key, array] : arrays) file.arrays.emplace(key, std::move(array));
    return file;
}

/// Rodrigues' formula, written out: R = I + sin a K + (1 - cos a) K^2.
glm::dmat3 rodrigues(const glm::dvec3& r) {
    const double a = glm::length(r);
    if (a < 1e-12) return glm::dmat3(1.0);
    const glm::dvec3 k = r / a;
    const glm::dmat3 cross(0, k.z, -k.y, -k.z, 0, k.x, k.y, -k.x, 0);
    return glm::dmat3(1.0) + std::sin(a) * cross + (1.0 - std::cos(a)) * cross * cross;
}

double distance(const glm::dmat3& a, const glm::dmat3& b) {
    double worst = 0.0;
    for (int c = 0; c < 3; ++c) worst = std::max(worst, glm::length(a[c] - b[c]));
    return worst;
}

glm::dmat3 matrixOf(const glm::quat& q) { return glm::dmat3(glm::mat3_cast(q)); }

float angle(const glm::quat& a, const glm::quat& b) {
    return 4.0f * std::asin(std::min(1.0f, 0.5f * std::min(glm::length(a - b), glm::length(a + b))));
}

/// Any 55 distinct joint positions.
Skeleton anySkeleton() {
    std::mt19937 random(5);
    std::uniform_real_distribution<float> place(-1.0f, 1.0f);
    std::vector<glm::vec3> joints(kSmplxJointCount);
    for (glm::vec3& p : joints) p = {place(random), place(random), place(random)};
    return smplxSkeleton(joints);
}

/// A sound smpl_params file of two frames.
std::vector<std::pair<std::string, Array>> smplParams() {
    return {{"betas", floats({1, 10})},          {"global_orient", floats({2, 3})},   {"transl", floats({2, 3})},
            {"body_pose", floats({2, 63})},      {"jaw_pose", floats({2, 3})},        {"expression", floats({2, 10})},
            {"left_hand_pose", floats({2, 45})}, {"right_hand_pose", floats({2, 45})}};
}

TEST(Motion, SmplParamsGoToTheJointsInTheModelsOrder) {
    auto arrays = smplParams();
    arrays[3].second.as<float>()[63 + 17 * 3 + 1] = 0.5f; // second frame, body joint 17 of 21: left elbow, about y
    arrays[4].second.as<float>()[0] = 0.2f;               // jaw, first frame, about x
    arrays[6].second.as<float>()[2] = -0.7f;              // left hand's first joint: left_index1, about z
    arrays[7].second.as<float>()[45 + 42 + 2] = 0.3f;     // right hand's last joint: right_thumb3
    arrays[2].second.as<float>()[4] = 1.5f;
    const auto motion = motionFromArrays(npz(arrays));
    ASSERT_TRUE(motion.ok()) << motion.error().describe();
    ASSERT_EQ(motion->frames.size(), 2u);
    EXPECT_EQ(motion->source, "smpl_params");
    EXPECT_DOUBLE_EQ(motion->framesPerSecond, 30.0);
    const auto& first = motion->frames[0].rotations;
    const auto& second = motion->frames[1].rotations;
    EXPECT_LT(distance(matrixOf(second[at(smplxJointIndex("left_elbow"))]), rodrigues({0, 0.5, 0})), 1e-6);
    EXPECT_LT(distance(matrixOf(first[at(smplxJointIndex("jaw"))]), rodrigues({0.2, 0, 0})), 1e-6);
    EXPECT_LT(distance(matrixOf(first[at(smplxJointIndex("left_index1"))]), rodrigues({0, 0, -0.7})), 1e-6);
    EXPECT_LT(distance(matrixOf(second[at(smplxJointIndex("right_thumb3"))]), rodrigues({0, 0, 0.3})), 1e-6);
    EXPECT_EQ(second[at(smplxJointIndex("left_index1"))], glm::quat(1, 0, 0, 0)) << "no hand mean is added";
    EXPECT_FLOAT_EQ(motion->frames[1].translation.y, 1.5f);
}

TEST(Motion, WrittenSmplParamsHaveTheEightKeysAndReadBackTheSame) {
    std::mt19937 random(1);
    auto arrays = smplParams();
    for (auto& [key, array] : arrays) array = randomFloats(random, array.shape);
    auto motion = motionFromArrays(npz(arrays));
    ASSERT_TRUE(motion.ok());
    motion->framesPerSecond = 25.0;
    const test::TemporaryFolder folder;
    ASSERT_TRUE(writeSmplParams(folder / "smpl_params.npz", *motion).ok());

    const auto file = readNpz(folder / "smpl_params.npz");
    ASSERT_TRUE(file.ok());
    EXPECT_EQ(file->arrays.size(), 9u) << "the eight keys and mocap_framerate; eyes at rest are left out";
    for (const auto& [key, wanted] : arrays) {
        const auto written = file->find(key);
        ASSERT_TRUE(written.ok()) << key;
        EXPECT_EQ((*written)->dtype, DType::F32) << key;
        EXPECT_EQ((*written)->shape, wanted.shape) << key;
        for (std::size_t i = 0; i < wanted.count(); ++i) {
            ASSERT_NEAR((*written)->as<float>()[i], wanted.as<float>()[i], 1e-6f) << key << " " << i;
        }
    }
    const auto again = readMotionNpz(folder / "smpl_params.npz");
    ASSERT_TRUE(again.ok());
    EXPECT_DOUBLE_EQ(again->framesPerSecond, 25.0);
    EXPECT_EQ(again->betas, motion->betas);
    EXPECT_EQ(again->name, "smpl_params");
}

TEST(Motion, EyesThatTurnAreKept) {
    Motion motion;
    motion.frames.push_back(restPose(kSmplxJointCount));
    motion.frames[0].rotations[24] = quatFromAxisAngle({0, 0.3f, 0});
    const test::TemporaryFolder folder;
    ASSERT_TRUE(writeSmplParams(folder / "eyes.npz", motion).ok());
    const auto again = readMotionNpz(folder / "eyes.npz");
    ASSERT_TRUE(again.ok());
    EXPECT_LT(angle(again->frames[0].rotations[24], motion.frames[0].rotations[24]), 1e-3f);
}

TEST(Motion, AmassWorldsAreTurnedAsARigidWhole) {
    // Joints of the z-up recording, played as it is, turned by hand: (x, y, z) -> (x, z, -y).
    const Skeleton skeleton = anySkeleton();
    std::mt19937 random(2);
    for (const std::size_t width : {165u, 156u}) {
        const Array poses = randomFloats(random, {3, width}), trans = randomFloats(random, {3, 3});
        MotionReadOptions options;
        options.recordedPelvisM = options.targetPelvisM = skeleton.restPositions[0];
        options.up = UpAxis::Y;
        const auto lying =
            motionFromArrays(npz({{"poses", poses}, {"trans", trans}, {"mocap_framerate", number(120)}}), options);
        options.up = UpAxis::Auto;
        const auto standing =
            motionFromArrays(npz({{"poses", poses}, {"trans", trans}, {"mocap_framerate", number(120)}}), options);
        ASSERT_TRUE(lying.ok() && standing.ok());
        EXPECT_DOUBLE_EQ(standing->framesPerSecond, 120.0);
        EXPECT_EQ(standing->source, width == 165 ? "amass smpl-x" : "amass smpl+h");
        for (std::size_t f = 0; f < 3; ++f) {
            const auto before = jointWorldMatrices(skeleton, lying->frames[f]);
            const auto after = jointWorldMatrices(skeleton, standing->frames[f]);
            for (std::size_t j = 0; j < before.size(); ++j) {
                const glm::vec3 p = before[j][3];
                EXPECT_LT(glm::distance(glm::vec3(after[j][3]), glm::vec3(p.x, p.z, -p.y)), 2e-6f);
            }
        }
    }
}

TEST(Motion, AmassSkinnedBodyEqualsTheRigidlyTurnedOne) {
    ARS_TEST_DATA_FILE(path, "open_body.npz");
    const auto body = readBodyModel(path);
    ASSERT_TRUE(body.ok()) << body.error().describe();
    std::mt19937 random(4);
    MotionReadOptions options;
    options.recordedPelvisM = options.targetPelvisM = bodySkeleton(*body, {}).restPositions[0];
    const NpzFile file = npz({{"poses", randomFloats(random, {1, 165})}, {"trans", randomFloats(random, {1, 3})}});
    options.up = UpAxis::Y;
    const auto lying = motionFromArrays(file, options);
    options.up = UpAxis::Z;
    const auto standing = motionFromArrays(file, options);
    ASSERT_TRUE(lying.ok() && standing.ok());
    const auto before = posedVertices(*body, {}, lying->frames[0]);
    const auto after = posedVertices(*body, {}, standing->frames[0]);
    float worst = 0.0f;
    for (std::size_t v = 0; v < before.size(); ++v) {
        worst = std::max(worst, glm::distance(after[v], glm::vec3(before[v].x, before[v].z, -before[v].y)));
    }
    EXPECT_LT(worst, 5e-6f);
}

TEST(Motion, AnotherBodysPelvisComesToTheSamePlace) {
    MotionReadOptions options;
    options.up = UpAxis::Y;
    options.recordedPelvisM = glm::vec3(0, -0.35f, 0);
    options.targetPelvisM = glm::vec3(0, 0.9f, 0);
    const auto motion = motionFromArrays(npz({{"poses", floats({1, 165})}, {"trans", floats({1, 3}, 1.35f)}}), options);
    ASSERT_TRUE(motion.ok());
    EXPECT_NEAR(motion->frames[0].translation.y + 0.9f, -0.35f + 1.35f, 1e-6f) << "height of the pelvis in the world";
}

TEST(Motion, StageiiKeysGiveTheSameAsOneRow) {
    std::mt19937 random(3);
    const Array poses = randomFloats(random, {2, 165});
    const auto part = [&](std::size_t begin, std::size_t width) {
        std::vector<float> values;
        for (std::size_t f = 0; f < 2; ++f) {
            for (std::size_t i = 0; i < width; ++i) values.push_back(poses.as<float>()[f * 165 + begin + i]);
        }
        return Array::fromFloats({2, width}, values);
    };
    const auto whole = motionFromArrays(npz({{"poses", poses}, {"mocap_frame_rate", number(60)}}));
    const auto parts = motionFromArrays(npz({{"root_orient", part(0, 3)},
                                             {"pose_body", part(3, 63)},
                                             {"pose_jaw", part(66, 3)},
                                             {"pose_eye", part(69, 6)},
                                             {"pose_hand", part(75, 90)},
                                             {"mocap_frame_rate", number(60)}}));
    ASSERT_TRUE(whole.ok() && parts.ok());
    EXPECT_DOUBLE_EQ(parts->framesPerSecond, 60.0);
    for (std::size_t f = 0; f < 2; ++f) EXPECT_EQ(whole->frames[f].rotations, parts->frames[f].rotations);
}

TEST(Motion, SmplHHandsGoToTheHandsAndItsShapeIsDropped) {
    Array poses = floats({1, 156});
    poses.as<float>()[66] = 0.4f;      // left hand
    poses.as<float>()[66 + 45] = 0.6f; // right hand
    const auto motion =
        motionFromArrays(npz({{"poses", poses}, {"betas", floats({16}, 1.0f)}, {"mocap_framerate", number(100)}}));
    ASSERT_TRUE(motion.ok());
    EXPECT_LT(distance(matrixOf(motion->frames[0].rotations[25]), rodrigues({0.4, 0, 0})), 1e-6);
    EXPECT_LT(distance(matrixOf(motion->frames[0].rotations[40]), rodrigues({0.6, 0, 0})), 1e-6);
    EXPECT_TRUE(motion->betas.empty()) << "SMPL+H's shape space is not SMPL-X's";
}

TEST(Motion, PlainPosesFindTheirUpAxis) {
    const auto facing = [](glm::vec3 root) {
        Array poses = floats({1, 165});
        for (std::size_t i = 0; i < 3; ++i) poses.as<float>()[i] = root[static_cast<int>(i)];
        return motionFromArrays(npz({{"poses", poses}}));
    };
    const float quarter = 1.57079633f;
    // A root turned by a quarter about x stands along z; half a turn stands on its head in a world with y down.
    for (const glm::vec3 root : {glm::vec3(0, 0, 0), glm::vec3(quarter, 0, 0), glm::vec3(2 * quarter, 0, 0)}) {
        const auto motion = facing(root);
        ASSERT_TRUE(motion.ok());
        const glm::vec3 up = motion->frames[0].rotations[0] * glm::vec3(0, 1, 0);
        EXPECT_NEAR(up.y, 1.0f, 1e-5f);
        EXPECT_LT(glm::length(motion->frames[0].translation), 1e-6f);
    }
}

TEST(Motion, RealPlainFilesStandUpright) {
    ARS_TEST_DATA_FILE(npy, "motion/smplx/example_smplx_poses.npy");
    ARS_TEST_DATA_FILE(codec, "motion/smplx/apose_to_handsFront_smplx.npz");
    const auto poses = readMotionNpz(npy);
    ASSERT_TRUE(poses.ok()) << poses.error().describe();
    EXPECT_EQ(poses->frames.size(), 8u);
    const auto hands = readMotionNpz(codec);
    ASSERT_TRUE(hands.ok()) << hands.error().describe();
    EXPECT_EQ(hands->frames.size(), 34u);
    EXPECT_EQ(hands->betas.size(), 10u);
    EXPECT_NEAR(hands->frames[0].translation.y, 1.3616f, 1e-3f) << "y-up already";
    for (const Motion* motion : {&*poses, &*hands}) {
        for (const Pose& pose : motion->frames) EXPECT_GT((pose.rotations[0] * glm::vec3(0, 1, 0)).y, 0.8f);
    }
}

TEST(Motion, CaptureParametersEqualTheNumbersInTheFile) {
    ARS_TEST_DATA_FILE(path, "capture/casual/smpl_params.npz");
    const auto motion = readMotionNpz(path);
    ASSERT_TRUE(motion.ok()) << motion.error().describe();
    ASSERT_EQ(motion->frames.size(), 26u);
    const auto file = readNpz(path);
    ASSERT_TRUE(file.ok());
    const auto body = file->arrays.at("body_pose").as<float>();
    for (std::size_t f = 0; f < 26; ++f) {
        for (std::size_t j = 0; j < 21; ++j) {
            const float* r = body.data() + f * 63 + j * 3;
            ASSERT_LT(distance(matrixOf(motion->frames[f].rotations[j + 1]), rodrigues({r[0], r[1], r[2]})), 2e-6);
        }
    }
    EXPECT_FLOAT_EQ(motion->frames[5].translation.y, file->arrays.at("transl").as<float>()[16]);
}

TEST(Motion, BrokenFilesGetOneClearSentence) {
    struct Case {
        const char* what;
        NpzFile file;
        const char* says;
    };
    const auto with = [](const char* key, Array array) {
        NpzFile file = npz(smplParams());
        file.arrays[key] = std::move(array);
        return file;
    };
    const auto without = [](const char* key) {
        NpzFile file = npz(smplParams());
        file.arrays.erase(key);
        return file;
    };
    Array nan = floats({2, 63});
    nan.as<float>()[63 + 4] = std::numeric_limits<float>::quiet_NaN();
    NpzFile pickled;
    pickled.unreadable.emplace("poses", makeError(ErrorCode::Unsupported, "poses", "an object array"));
    std::vector<Case> cases;
    cases.push_back({"nothing", {}, "no keys"});
    cases.push_back({"other keys", npz({{"v_template", floats({3, 3})}}), "v_template"});
    cases.push_back({"no root", without("global_orient"), "global_orient"});
    cases.push_back({"no body", without("body_pose"), "body_pose"});
    cases.push_back({"no translation", without("transl"), "transl"});
    cases.push_back({"narrow body", with("body_pose", floats({2, 60})), "(frames, 63)"});
    cases.push_back({"wide body", with("body_pose", floats({2, 69})), "(2, 69)"});
    cases.push_back({"hand coefficients", with("left_hand_pose", floats({2, 12})), "use_pca"});
    cases.push_back({"other frame count", with("right_hand_pose", floats({3, 45})), "expected 2 frames"});
    cases.push_back({"other translation count", with("transl", floats({1, 3})), "transl"});
    cases.push_back({"no frames", with("global_orient", floats({0, 3})), "global_orient"});
    cases.push_back({"NaN", with("body_pose", nan), "frame 1, number 4"});
    cases.push_back({"huge angle", with("jaw_pose", floats({2, 3}, 1e30f)), "rad"});
    cases.push_back({"infinite translation", with("transl", floats({2, 3}, INFINITY)), "transl"});
    cases.push_back({"text", with("global_orient", Array::fromTexts({2, 3}, std::vector<std::string>(6, "a"))),
                     "expected numbers"});
    cases.push_back({"wrong width", npz({{"poses", floats({4, 100})}}), "165 (SMPL-X)"});
    cases.push_back({"poses without frames", npz({{"poses", floats({0, 165})}}), "at least one frame"});
    cases.push_back(
        {"short trans", npz({{"poses", floats({4, 156})}, {"trans", floats({3, 3})}}), "expected 4 frames"});
    cases.push_back({"flat trans", npz({{"poses", floats({4, 156})}, {"trans", floats({4, 2})}}), "(frames, 3)"});
    cases.push_back(
        {"rate 0", npz({{"poses", floats({4, 156})}, {"mocap_framerate", number(0)}}), "frames per second"});
    cases.push_back(
        {"rate NaN", npz({{"poses", floats({4, 156})}, {"mocap_framerate", number(NAN)}}), "frames per second"});
    cases.push_back({"rates", npz({{"poses", floats({4, 156})}, {"mocap_framerate", floats({2})}}), "one number"});
    cases.push_back({"pickle", pickled, "object array"});
    cases.push_back({"root without body", npz({{"root_orient", floats({4, 3})}}), "pose_body"});
    for (const Case& broken : cases) {
        const auto motion = motionFromArrays(broken.file);
        ASSERT_FALSE(motion.ok()) << broken.what;
        const std::string text = motion.error().describe();
        EXPECT_NE(text.find(broken.says), std::string::npos) << broken.what << ": " << text;
        EXPECT_EQ(text.find('\n'), std::string::npos) << broken.what;
    }
}

TEST(Motion, FramesBeyondTheLimitAreRefusedBeforeTheyTakeMemory) {
    ReadLimits limits;
    limits.maxBytes = 50000;
    const auto motion = motionFromArrays(npz({{"poses", floats({100, 165})}}), {}, limits);
    ASSERT_FALSE(motion.ok());
    EXPECT_EQ(motion.error().code, ErrorCode::LimitExceeded);
}

TEST(Motion, MissingFileAndWrongBytesNameThePath) {
    const test::TemporaryFolder folder;
    const auto missing = readMotionNpz(folder / "none.npz");
    ASSERT_FALSE(missing.ok());
    EXPECT_NE(missing.error().describe().find("none.npz"), std::string::npos);
    const test::TemporaryFolder other;
    ASSERT_TRUE(writeNpy(other / "flat.npy", floats({3, 7})).ok());
    const auto flat = readMotionNpz(other / "flat.npy");
    ASSERT_FALSE(flat.ok());
    EXPECT_NE(flat.error().describe().find("flat.npy"), std::string::npos);
    EXPECT_NE(flat.error().describe().find("(3, 7)"), std::string::npos);
}

/// Left elbow turning about y by `perFrame` radians a frame; translation rising 1 m a frame.
Motion ramp(std::size_t frames, double rate, float perFrame) {
    Motion motion;
    motion.framesPerSecond = rate;
    for (std::size_t f = 0; f < frames; ++f) {
        Pose pose = restPose(kSmplxJointCount);
        pose.rotations[18] = quatFromAxisAngle({0, perFrame * static_cast<float>(f), 0});
        pose.translation.y = static_cast<float>(f);
        motion.frames.push_back(pose);
    }
    return motion;
}

TEST(Motion, SamplesBetweenFramesAndStaysAtTheEnds) {
    const Motion motion = ramp(4, 10.0, 0.4f);
    const Pose middle = sampleMotion(motion, 0.125); // 1.25 frames
    EXPECT_LT(distance(matrixOf(middle.rotations[18]), rodrigues({0, 0.5, 0})), 1e-5);
    EXPECT_NEAR(middle.translation.y, 1.25f, 1e-5f);
    EXPECT_EQ(sampleMotion(motion, -5.0).translation.y, 0.0f);
    EXPECT_EQ(sampleMotion(motion, 99.0).translation.y, 3.0f);
    EXPECT_EQ(sampleMotion(motion, NAN).translation.y, 0.0f);
    EXPECT_EQ(sampleMotion(Motion{}, 1.0).rotations.size(), 55u);
}

TEST(Motion, ResamplingKeepsTimeAndEnds) {
    const Motion motion = ramp(13, 120.0, 0.1f);
    const Motion slow = resampleMotion(motion, 30.0);
    ASSERT_EQ(slow.frames.size(), 4u) << "frames 0, 4, 8, 12";
    EXPECT_NEAR(slow.frames[3].translation.y, 12.0f, 1e-4f);
    const Motion fast = resampleMotion(slow, 120.0);
    ASSERT_EQ(fast.frames.size(), 13u);
    for (std::size_t f = 0; f < 13; ++f) {
        EXPECT_LT(distance(matrixOf(fast.frames[f].rotations[18]), matrixOf(motion.frames[f].rotations[18])), 1e-4);
    }
    const Motion odd = resampleMotion(motion, 50.0); // 0.1 s are 5 steps
    EXPECT_EQ(odd.frames.size(), 6u);
    EXPECT_EQ(resampleMotion(Motion{}, 30.0).frames.size(), 0u);
}

TEST(Motion, ResamplingGoesTheShortWayAndKeepsSigns) {
    Motion motion = ramp(3, 30.0, 0.2f);
    motion.frames[1].rotations[18] = -motion.frames[1].rotations[18]; // the same rotation, other sign
    const Motion fine = resampleMotion(motion, 120.0);
    for (std::size_t f = 1; f < fine.frames.size(); ++f) {
        EXPECT_GT(glm::dot(fine.frames[f].rotations[18], fine.frames[f - 1].rotations[18]), 0.99f);
    }
}

} // namespace
} // namespace ars
