#include "engine/rig/retarget.h"

#include "engine/core/file.h"
#include "engine/rig/body_model.h"
#include "engine/rig/motion_import.h"
#include "tests/support/test_data.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>
#include <random>

namespace ars {
namespace {

namespace fs = std::filesystem;

std::size_t at(int i) { return static_cast<std::size_t>(i); }
int joint(const char* name) { return smplxJointIndex(name); }

std::span<const std::byte> bytesOf(const std::string& text) {
    return std::as_bytes(std::span(text.data(), text.size()));
}

float angle(const glm::quat& a, const glm::quat& b) {
    return 4.0f * std::asin(std::min(1.0f, 0.5f * std::min(glm::length(a - b), glm::length(a + b))));
}

float angleBetween(const glm::vec3& a, const glm::vec3& b) {
    return std::atan2(glm::length(glm::cross(a, b)), glm::dot(a, b));
}

/// A target person: hips at 0.9 m, legs straight down, arms along x.
Skeleton person() {
    std::vector<glm::vec3> p(kSmplxJointCount, glm::vec3(0.0f));
    const auto both = [&](const std::string& name, glm::vec3 place) {
        p[at(smplxJointIndex("left_" + name))] = place;
        p[at(smplxJointIndex("right_" + name))] = {-place.x, place.y, place.z};
    };
    p[0] = {0, 1.0f, 0};
    p[3] = {0, 1.1f, 0};
    p[6] = {0, 1.2f, 0};
    p[9] = {0, 1.3f, 0};
    p[12] = {0, 1.5f, 0};
    p[15] = {0, 1.6f, 0};
    p[22] = {0, 1.62f, 0.03f};
    both("eye_smplhf", {0.03f, 1.65f, 0.08f});
    both("hip", {0.1f, 0.9f, 0});
    both("knee", {0.1f, 0.5f, 0});
    both("ankle", {0.1f, 0.1f, 0});
    both("foot", {0.1f, 0.05f, 0.13f});
    both("collar", {0.02f, 1.45f, 0});
    both("shoulder", {0.2f, 1.45f, 0});
    both("elbow", {0.5f, 1.45f, 0});
    both("wrist", {0.75f, 1.45f, 0});
    float z = 0.03f;
    for (const char* finger : {"index", "middle", "ring", "pinky", "thumb"}) {
        for (int i = 1; i <= 3; ++i)
            both(finger + std::to_string(i), {0.82f + 0.03f * static_cast<float>(i), 1.45f, z});
        z -= 0.02f;
    }
    return smplxSkeleton(std::move(p));
}

/// A small rig of 16 joints in the "xsens" naming; every joint has Z X Y angles, the root a place as well.
struct Rig {
    std::vector<std::string> names{
        "Hips", "LeftHip", "LeftKnee",     "LeftAnkle", "RightHip",  "RightKnee",     "RightAnkle", "Chest",
        "Neck", "Head",    "LeftShoulder", "LeftElbow", "LeftWrist", "RightShoulder", "RightElbow", "RightWrist"};
    std::vector<int> parents{-1, 0, 1, 2, 0, 4, 5, 0, 7, 8, 7, 10, 11, 7, 13, 14};
    std::vector<glm::vec3> offsets;
    glm::mat3 axes{1.0f};                            ///< turns the rig's y-up, z-front offsets into the file's axes
    std::map<std::pair<int, int>, glm::vec3> angles; ///< (frame, joint): z, x, y degrees
    std::vector<glm::vec3> places{{0, 95, 0}};

    /// Arms at `degrees` below the horizontal in the rest pose; centimetres.
    explicit Rig(float degrees = 0.0f) {
        const float c = std::cos(glm::radians(degrees)), s = std::sin(glm::radians(degrees));
        offsets = {{0, 0, 0},
                   {10, 0, 0},
                   {0, -45, 0},
                   {0, -42, 0},
                   {-10, 0, 0},
                   {0, -45, 0},
                   {0, -42, 0},
                   {0, 20, 0},
                   {0, 30, 0},
                   {0, 10, 0},
                   {20, 25, 0},
                   {28 * c, -28 * s, 0},
                   {25 * c, -25 * s, 0},
                   {-20, 25, 0},
                   {-28 * c, -28 * s, 0},
                   {-25 * c, -25 * s, 0}};
    }

    int find(const std::string& name) const {
        return static_cast<int>(std::find(names.begin(), names.end(), name) - names.begin());
    }
    void set(int frame, const std::string& name, glm::vec3 zxy) { angles[{frame, find(name)}] = zxy; }

    void write(std::string& text, int j) const {
        const glm::vec3 o = axes * offsets[at(j)];
        text += fmt::format("{} {}\n{{\nOFFSET {} {} {}\n", parents[at(j)] < 0 ? "ROOT" : "JOINT", names[at(j)], o.x,
                            o.y, o.z);
        text += parents[at(j)] < 0 ? "CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\n"
                                   : "CHANNELS 3 Zrotation Xrotation Yrotation\n";
        bool leaf = true;
        for (int child = 0; child < static_cast<int>(parents.size()); ++child) {
            if (parents[at(child)] != j) continue;
            leaf = false;
            write(text, child);
        }
        if (leaf) text += "End Site\n{\nOFFSET 0 1 0\n}\n";
        text += "}\n";
    }

    std::string bvh() const {
        std::string text = "HIERARCHY\n";
        write(text, 0);
        text += fmt::format("MOTION\nFrames: {}\nFrame Time: 0.04\n", places.size());
        for (std::size_t f = 0; f < places.size(); ++f) {
            const glm::vec3 place = axes * places[f];
            text += fmt::format("{} {} {}", place.x, place.y, place.z);
            appendAngles(text, static_cast<int>(f), 0);
            text += "\n";
        }
        return text;
    }

    /// In the order of the hierarchy.
    void appendAngles(std::string& text, int frame, int j) const {
        const auto found = angles.find({frame, j});
        const glm::vec3 a = found == angles.end() ? glm::vec3(0.0f) : found->second;
        text += fmt::format(" {} {} {}", a.x, a.y, a.z);
        for (int child = 0; child < static_cast<int>(parents.size()); ++child) {
            if (parents[at(child)] == j) appendAngles(text, frame, child);
        }
    }
};

Motion transferred(const Rig& rig, RetargetReport* report = nullptr, MotionImportOptions options = {}) {
    options.startAtOrigin = false;
    options.floor = FloorPlacement::Keep;
    const std::string text = rig.bvh();
    auto motion = importMotionBytes(bytesOf(text), person(), options, report);
    EXPECT_TRUE(motion.ok()) << (motion.ok() ? "" : motion.error().describe());
    return motion.ok() ? *motion : Motion{"", 30, {restPose(kSmplxJointCount)}, {}, ""};
}

glm::vec3 direction(const Pose& pose, const char* from, const char* to) {
    const auto world = jointWorldMatrices(person(), pose);
    return glm::normalize(glm::vec3(world[at(joint(to))][3] - world[at(joint(from))][3]));
}

void expectDirection(const Pose& pose, const char* from, const char* to, glm::vec3 wanted) {
    const glm::vec3 found = direction(pose, from, to);
    EXPECT_LT(angleBetween(found, wanted), 1e-3f)
        << from << " to " << to << " points at " << found.x << " " << found.y << " " << found.z;
}

TEST(Retarget, TPoseGivesTheRestPose) {
    RetargetReport report;
    const Motion motion = transferred(Rig(), &report);
    ASSERT_EQ(motion.frames.size(), 1u);
    for (int j = 0; j < kSmplxJointCount; ++j)
        EXPECT_LT(angle(motion.frames[0].rotations[at(j)], glm::quat(1, 0, 0, 0)), 1e-4f) << smplxJointName(j);
    EXPECT_EQ(report.up, UpAxis::Y);
    EXPECT_EQ(report.mappedBodyJoints, 16);
    // Legs of 87 cm become legs of 80 cm.
    EXPECT_NEAR(report.metresPerUnit, 0.80 / 87.0, 1e-6);
    const auto world = jointWorldMatrices(person(), motion.frames[0]);
    EXPECT_NEAR(0.5f * (world[1][3].y + world[2][3].y), 95.0f * 0.80f / 87.0f, 1e-5f);
}

TEST(Retarget, RestPosesWithLoweredArmsGiveTheSameLimbsInSpace) {
    // T-pose, A-pose and hanging arms: the same picture in space needs different angles in each file.
    for (const float lowered : {0.0f, 45.0f, 90.0f}) {
        Rig rig(lowered);
        rig.set(0, "LeftShoulder", {lowered, 0, 0}); // back up to the horizontal
        rig.set(0, "RightShoulder", {-lowered, 0, 0});
        const Motion motion = transferred(rig);
        const Pose& pose = motion.frames[0];
        expectDirection(pose, "left_shoulder", "left_elbow", {1, 0, 0});
        expectDirection(pose, "left_elbow", "left_wrist", {1, 0, 0});
        expectDirection(pose, "right_shoulder", "right_wrist", {-1, 0, 0});
        const auto world = jointWorldMatrices(person(), pose);
        EXPECT_NEAR(world[16][1].y, 1.0f, 1e-3f) << "and the upper arm is not twisted, rest lowered by " << lowered;
    }
}

TEST(Retarget, RestPoseItselfIsReproduced) {
    const float c = std::sqrt(0.5f);
    const Motion motion = transferred(Rig(45.0f));
    expectDirection(motion.frames[0], "left_shoulder", "left_elbow", {c, -c, 0});
    expectDirection(motion.frames[0], "right_elbow", "right_wrist", {-c, -c, 0});
    const Motion hanging = transferred(Rig(90.0f));
    expectDirection(hanging.frames[0], "left_shoulder", "left_wrist", {0, -1, 0});
}

TEST(Retarget, AnglesTurnLimbsAsComputedByHand) {
    Rig rig;
    // Z X Y: R = Rz Rx Ry. Left elbow 90 degrees about -y: the forearm along +x comes to +z (forward).
    rig.set(0, "LeftElbow", {0, 0, -90});
    // Right hip -90 degrees about x: the leg along -y comes forward to +z; its knee +90 about x puts the shin down
    // again.
    rig.set(0, "RightHip", {0, -90, 0});
    rig.set(0, "RightKnee", {0, 90, 0});
    // Left shoulder: Rz(-60) Rx(30) leaves the arm's x axis to Rz alone.
    rig.set(0, "LeftShoulder", {-60, 30, 0});
    const Pose pose = transferred(rig).frames[0];
    expectDirection(pose, "right_hip", "right_knee", {0, 0, 1});
    expectDirection(pose, "right_knee", "right_ankle", {0, -1, 0});
    expectDirection(pose, "left_shoulder", "left_elbow", {0.5f, -std::sqrt(0.75f), 0});
    // Forearm: Rz(-60) Rx(30) (0,0,1) = Rz(-60) (0, -0.5, 0.8660) = (-0.4330, -0.25, 0.8660).
    expectDirection(pose, "left_elbow", "left_wrist", {-0.4330127f, -0.25f, 0.8660254f});
    EXPECT_LT(angle(pose.rotations[18], quatFromAxisAngle({0, -1.5707963f, 0})), 1e-4f);
}

TEST(Retarget, SpineJointsThatAreLeftOutShareTheTurn) {
    Rig rig;
    rig.set(0, "Chest", {0, 40, 0});
    MotionImportOptions options;
    options.map = "xsens"; // gives Chest to spine1; nothing above it bends
    const Pose pose = transferred(rig, nullptr, options).frames[0];
    EXPECT_LT(angle(pose.rotations[3], quatFromAxisAngle({0.698132f, 0, 0})), 1e-4f);

    const auto bvh = parseBvh(bytesOf(rig.bvh()));
    ASSERT_TRUE(bvh.ok());
    const auto clip = clipFromBvh(*bvh);
    ASSERT_TRUE(clip.ok());
    auto maps = readRetargetMaps();
    ASSERT_TRUE(maps.ok());
    RetargetMap map = *std::find_if(maps->begin(), maps->end(), [](const RetargetMap& m) { return m.name == "xsens"; });
    std::swap(map.joints[3], map.joints[9]); // Chest moves spine3 now
    map.joints[6].clear();
    const auto motion = retarget(*clip, map, person());
    ASSERT_TRUE(motion.ok());
    for (int spine : {3, 6, 9}) {
        EXPECT_LT(angle(motion->frames[0].rotations[at(spine)], quatFromAxisAngle({0.698132f / 3, 0, 0})), 1e-4f)
            << spine;
    }
}

TEST(Retarget, ZUpFilesAndOtherFrontsAreTurned) {
    // The file's axes: z up and front -y (x stays left); then y up with the person looking along +x, left along -z.
    const glm::mat3 zUp(glm::vec3(1, 0, 0), glm::vec3(0, 0, 1), glm::vec3(0, -1, 0));
    const glm::mat3 lookingAlongX(glm::vec3(0, 0, -1), glm::vec3(0, 1, 0), glm::vec3(1, 0, 0));
    for (const auto& [axes, up, front] :
         {std::tuple(zUp, UpAxis::Z, glm::vec3(0, -1, 0)), std::tuple(lookingAlongX, UpAxis::Y, glm::vec3(1, 0, 0))}) {
        Rig rig;
        rig.axes = axes;
        rig.places = {{0, 95, 0}, {0, 95, 100}}; // one metre forward
        RetargetReport report;
        const Motion motion = transferred(rig, &report);
        EXPECT_EQ(report.up, up);
        EXPECT_LT(glm::distance(report.fileFront, front), 1e-5f);
        for (int j = 0; j < 22; ++j) EXPECT_LT(angle(motion.frames[0].rotations[at(j)], glm::quat(1, 0, 0, 0)), 1e-4f);
        const glm::vec3 way = motion.frames[1].translation - motion.frames[0].translation;
        EXPECT_LT(glm::distance(way, glm::vec3(0, 0, 100 * 0.80f / 87.0f)), 1e-5f);
    }
}

TEST(Retarget, RootTurnsAboutTheVerticalOfTheFile) {
    Rig rig;
    rig.axes = glm::mat3(glm::vec3(1, 0, 0), glm::vec3(0, 0, 1), glm::vec3(0, -1, 0));
    rig.set(0, "Hips", {90, 0, 0}); // about the file's z, which is up: left turn
    const Pose pose = transferred(rig).frames[0];
    EXPECT_LT(angle(pose.rotations[0], quatFromAxisAngle({0, 1.5707963f, 0})), 1e-4f);
}

TEST(Retarget, RestThatIsNoPersonTakesTheFirstFrame) {
    // Every bone along +x at zero angles, as some exporters write; frame 0 stands.
    Rig rig;
    const Rig standing;
    for (std::size_t j = 1; j < rig.offsets.size(); ++j) rig.offsets[j] = {glm::length(standing.offsets[j]), 0, 0};
    rig.places = {{0, 95, 0}, {0, 95, 0}};
    for (int f : {0, 1}) {
        rig.set(f, "Hips", {0, 0, 0});
        rig.set(f, "LeftHip", {-90, 0, 0});
        rig.set(f, "RightHip", {-90, 0, 0});
        rig.set(f, "Chest", {90, 0, 0});
        rig.set(f, "LeftShoulder", {-90, 0, 0});
        rig.set(f, "RightShoulder", {90, 0, 0});
    }
    // Hips and shoulders need width: their offsets are the only ones that stay.
    for (const char* name : {"LeftHip", "RightHip", "Chest"})
        rig.offsets[at(rig.find(name))] = standing.offsets[at(rig.find(name))];
    rig.offsets[at(rig.find("LeftShoulder"))] = {25, -20, 0}; // the chest is turned by 90 degrees about z
    rig.offsets[at(rig.find("RightShoulder"))] = {25, 20, 0};
    rig.set(1, "LeftElbow", {0, 0, -90});
    RetargetReport report;
    const Motion motion = transferred(rig, &report);
    EXPECT_TRUE(report.firstFrameIsRest);
    expectDirection(motion.frames[0], "left_shoulder", "left_wrist", {1, 0, 0});
    expectDirection(motion.frames[0], "left_hip", "left_ankle", {0, -1, 0});
    expectDirection(motion.frames[1], "left_elbow", "left_wrist", {0, 0, 1});
    EXPECT_GT((motion.frames[0].rotations[0] * glm::vec3(0, 1, 0)).y, 0.99f);
}

TEST(Retarget, LeadInFromTheTPoseIsDropped) {
    Rig rig;
    rig.places.assign(60, {0, 95, 0});
    for (int f = 2; f < 60; ++f) rig.set(f, "LeftShoulder", {-70.0f + 0.2f * static_cast<float>(f), 0, 0});
    for (int f = 2; f < 60; ++f) rig.set(f, "RightShoulder", {70, 0, 0});
    rig.set(1, "LeftShoulder", {-35, 0, 0});
    RetargetReport report;
    EXPECT_EQ(transferred(rig, &report).frames.size(), 58u);
    EXPECT_EQ(report.skippedFrames, 2u);
    MotionImportOptions keep;
    keep.skipLeadIn = false;
    EXPECT_EQ(transferred(rig, &report, keep).frames.size(), 60u);
    MotionImportOptions chosen;
    chosen.firstFrame = 1;
    chosen.frameCount = 5;
    EXPECT_EQ(transferred(rig, &report, chosen).frames.size(), 5u);
}

TEST(Retarget, WholeBodyStandsOnTheFloorAndStartsAtTheOrigin) {
    Rig rig;
    rig.places = {{300, 500, -200}, {300, 530, -200}}; // a jump of 30 cm, floating five metres up
    const std::string text = rig.bvh();
    const auto motion = importMotionBytes(bytesOf(text), person());
    ASSERT_TRUE(motion.ok());
    const auto first = jointWorldMatrices(person(), motion->frames[0]),
               second = jointWorldMatrices(person(), motion->frames[1]);
    EXPECT_NEAR(first[0][3].x, 0.0f, 1e-5f);
    EXPECT_NEAR(first[0][3].z, 0.0f, 1e-5f);
    EXPECT_NEAR(first[10][3].y, 0.03f, 1e-4f) << "soles 3 cm below the foot joint";
    EXPECT_NEAR(second[10][3].y - first[10][3].y, 30.0f * 0.80f / 87.0f, 1e-4f) << "the jump stays";
}

TEST(Retarget, UnknownNamesAreRefusedWithTheJointsThatAreMissing) {
    Rig rig;
    for (std::size_t j = 0; j < rig.names.size(); ++j) rig.names[j] = fmt::format("node{}", j);
    const std::string text = rig.bvh();
    const auto motion = importMotionBytes(bytesOf(text), person());
    ASSERT_FALSE(motion.ok());
    EXPECT_EQ(motion.error().code, ErrorCode::NotFound);
    EXPECT_NE(motion.error().describe().find("left_hip"), std::string::npos) << motion.error().describe();
    EXPECT_NE(motion.error().describe().find("node1"), std::string::npos);
}

TEST(Retarget, AMapFileOfTheUserIsTaken) {
    Rig rig;
    std::string joints;
    for (std::size_t j = 0; j < rig.names.size(); ++j) rig.names[j] = fmt::format("node{}", j);
    const char* smplx[] = {"pelvis",      "left_hip",       "left_knee",   "left_ankle", "right_hip",     "right_knee",
                           "right_ankle", "spine1",         "neck",        "head",       "left_shoulder", "left_elbow",
                           "left_wrist",  "right_shoulder", "right_elbow", "right_wrist"};
    for (std::size_t j = 0; j < rig.names.size(); ++j)
        joints += fmt::format("{}\"{}\": \"NODE_{}\"", j ? ", " : "", smplx[j], j);
    const test::TemporaryFolder folder;
    ASSERT_TRUE(
        writeFileAtomic(folder / "mine.json", "{\"metres_per_unit\": 0.01, \"joints\": {" + joints + "}}").ok());
    rig.set(0, "node11", {0, 0, -90});
    MotionImportOptions options;
    options.map = (folder / "mine.json").string();
    RetargetReport report;
    const Motion motion = transferred(rig, &report, options);
    EXPECT_EQ(report.mapName, "mine");
    EXPECT_DOUBLE_EQ(report.metresPerUnit, 0.01f);
    expectDirection(motion.frames[0], "left_elbow", "left_wrist", {0, 0, 1});
}

TEST(Retarget, BrokenMapsNameTheKey) {
    const std::pair<const char*, const char*> cases[] = {
        {"", "JSON"},
        {"[1]", "object"},
        {"{\"joints\": 3}", "joints"},
        {"{}", "joints"},
        {"{\"joints\": {\"left_wing\": \"a\"}}", "left_wing"},
        {"{\"joints\": {\"pelvis\": 7}}", "joints.pelvis"},
        {"{\"joints\": {\"pelvis\": [1]}}", "joints.pelvis"},
        {"{\"up\": \"w\", \"joints\": {}}", "up"},
        {"{\"metres_per_unit\": -1, \"joints\": {}}", "metres_per_unit"},
        {"{\"metres_per_unit\": \"cm\", \"joints\": {}}", "metres_per_unit"},
        {"{\"joints\": {\"pelvis\": \"a\"}", "JSON"},
    };
    for (const auto& [text, says] : cases) {
        const auto map = parseRetargetMap(bytesOf(std::string(text)));
        ASSERT_FALSE(map.ok()) << text;
        EXPECT_NE(map.error().describe().find(says), std::string::npos) << text << ": " << map.error().describe();
    }
    const std::string deep(200000, '[');
    EXPECT_FALSE(parseRetargetMap(bytesOf(deep)).ok());
}

TEST(Retarget, ShippedMapsAreSoundAndCoverTheBody) {
    const auto maps = readRetargetMaps();
    ASSERT_TRUE(maps.ok()) << maps.error().describe();
    EXPECT_GE(maps->size(), 10u);
    for (const RetargetMap& map : *maps) {
        int body = 0;
        for (int j = 0; j < 22; ++j) body += !map.joints[at(j)].empty();
        EXPECT_GE(body, 20) << map.name;
        EXPECT_FALSE(map.about.empty()) << map.name;
        for (int j = 0; j < kSmplxJointCount; ++j) {
            // A left joint whose source speaks of the right side is a slip.
            const std::string name(smplxJointName(j));
            for (const std::string& source : map.joints[at(j)]) {
                const char* other = name.starts_with("left_") ? "Right" : name.starts_with("right_") ? "Left" : "\n";
                EXPECT_EQ(source.find(other), std::string::npos) << map.name << " " << name;
            }
        }
    }
}

TEST(Retarget, BvhOfAMotionReadsBackTheSame) {
    const Skeleton skeleton = person();
    std::mt19937 random(9);
    std::uniform_real_distribution<float> turn(-1.0f, 1.0f);
    Motion motion;
    motion.framesPerSecond = 50.0;
    for (int f = 0; f < 5; ++f) {
        Pose pose = restPose(kSmplxJointCount);
        for (glm::quat& q : pose.rotations) q = quatFromAxisAngle({turn(random), turn(random), turn(random)});
        pose.rotations[1] = quatFromAxisAngle({1.5707963f, 0, 0}); // gimbal lock of Z X Y
        pose.translation = {turn(random), turn(random), turn(random)};
        motion.frames.push_back(pose);
    }
    const test::TemporaryFolder folder;
    ASSERT_TRUE(writeMotionBvh(folder / "m.bvh", motion, skeleton).ok());
    MotionImportOptions options;
    options.floor = FloorPlacement::Keep;
    options.startAtOrigin = false;
    RetargetReport report;
    const auto again = importMotion(folder / "m.bvh", skeleton, options, &report);
    ASSERT_TRUE(again.ok()) << again.error().describe();
    EXPECT_EQ(report.mapName, "smplx");
    EXPECT_EQ(report.mappedJoints, 55);
    EXPECT_NEAR(again->framesPerSecond, 50.0, 1e-3);
    ASSERT_EQ(again->frames.size(), 5u);
    for (std::size_t f = 0; f < 5; ++f) {
        for (std::size_t j = 0; j < kSmplxJointCount; ++j) {
            EXPECT_LT(angle(again->frames[f].rotations[j], motion.frames[f].rotations[j]), 2e-4f)
                << f << " " << smplxJointName(static_cast<int>(j));
        }
        EXPECT_LT(glm::distance(again->frames[f].translation, motion.frames[f].translation), 1e-5f);
    }
    // And once more: BVH -> motion -> BVH.
    const auto first = bvhFromMotion(motion, skeleton), second = bvhFromMotion(*again, skeleton);
    ASSERT_TRUE(first.ok() && second.ok());
    const auto one = clipFromBvh(*first), two = clipFromBvh(*second);
    for (std::size_t i = 0; i < one->worldRotations.size(); ++i)
        EXPECT_LT(angle(one->worldRotations[i], two->worldRotations[i]), 1e-3f);
}

/// A glTF of the rig: nodes in centimetres below an armature node that scales by 0.01 and turns z-up into y-up, joints
/// with turned rest orientations, the left elbow animated in three ways.
GltfDocument gltfRig(GltfInterpolation interpolation) {
    const Rig rig;
    const glm::quat quarter = glm::angleAxis(glm::radians(-90.0f), glm::vec3(1, 0, 0)); // z-up to y-up
    const glm::quat restTurn = glm::angleAxis(glm::radians(70.0f), glm::normalize(glm::vec3(1, 2, 3)));
    GltfDocument document;
    GltfNode armature;
    armature.name = "Armature";
    armature.rotation = quarter;
    armature.scale = glm::vec3(0.01f);
    document.nodes.push_back(armature);
    const glm::mat3 zUp(glm::vec3(1, 0, 0), glm::vec3(0, 0, 1), glm::vec3(0, -1, 0));
    for (std::size_t j = 0; j < rig.names.size(); ++j) {
        GltfNode node;
        node.name = "mixed:" + rig.names[j];
        node.parent = rig.parents[j] + 1;
        const bool root = rig.parents[j] < 0;
        const glm::vec3 offset = zUp * (rig.offsets[j] + (root ? glm::vec3(0, 95, 0) : glm::vec3(0.0f)));
        node.translation = root ? offset : glm::inverse(restTurn) * offset; // all joints share one turned orientation
        node.rotation = root ? restTurn : glm::quat(1, 0, 0, 0);
        document.nodes[at(node.parent)].children.push_back(static_cast<int>(j) + 1);
        document.nodes.push_back(node);
    }
    for (GltfNode& node : document.nodes) {
        node.localMatrix = glm::mat4_cast(node.rotation);
        for (int i = 0; i < 3; ++i) node.localMatrix[i] *= node.scale[i];
        node.localMatrix[3] = glm::vec4(node.translation, 1.0f);
    }
    document.sceneRoots = {0};
    // The elbow turns by 90 degrees about the file's -z, the body's -y; told in the joint's own axes.
    const glm::vec3 axis = glm::inverse(restTurn) * glm::vec3(0, 0, -1);
    GltfChannel channel;
    channel.node = rig.find("LeftElbow") + 1;
    channel.path = GltfPath::Rotation;
    channel.interpolation = interpolation;
    channel.width = 4;
    channel.times = {0.0f, 1.0f};
    for (float degrees : {0.0f, 90.0f}) {
        const glm::quat q = glm::angleAxis(glm::radians(degrees), axis);
        if (interpolation == GltfInterpolation::CubicSpline) channel.values.insert(channel.values.end(), 4, 0.0f);
        channel.values.insert(channel.values.end(), {q.x, q.y, q.z, q.w});
        if (interpolation == GltfInterpolation::CubicSpline) channel.values.insert(channel.values.end(), 4, 0.0f);
    }
    GltfChannel others; // holds the rest of the body, so that it counts as joints
    document.animations.push_back({"wave", {channel}});
    for (std::size_t j = 0; j < rig.names.size(); ++j) {
        if (rig.names[j] == "LeftElbow") continue;
        others.node = static_cast<int>(j) + 1;
        others.path = GltfPath::Translation;
        others.times = {0.0f};
        const glm::vec3 t = document.nodes[j + 1].translation;
        others.values = {t.x, t.y, t.z};
        document.animations[0].channels.push_back(others);
    }
    return document;
}

TEST(Retarget, GltfAnimationsAreSampledInTheirThreeWays) {
    const std::pair<GltfInterpolation, float> cases[] = {
        {GltfInterpolation::Linear, 22.5f}, // a quarter of the way
        {GltfInterpolation::Step, 0.0f},
        // Hermite without tangents weighs the quaternions 27/32 and 5/32: atan(5/32 sin 45 / (27/32 + 5/32 cos 45)),
        // twice.
        {GltfInterpolation::CubicSpline,
         2.0f * glm::degrees(std::atan2(5.0f / 32 * std::sin(glm::radians(45.0f)),
                                        27.0f / 32 + 5.0f / 32 * std::cos(glm::radians(45.0f))))},
    };
    const auto maps = readRetargetMaps();
    ASSERT_TRUE(maps.ok());
    for (const auto& [interpolation, degrees] : cases) {
        const auto clip = clipFromGltf(gltfRig(interpolation), "wave", 4.0);
        ASSERT_TRUE(clip.ok()) << clip.error().describe();
        ASSERT_EQ(clip->frameCount, 5u);
        const auto map = chooseRetargetMap(clip->skeleton, *maps);
        ASSERT_TRUE(map.ok()) << map.error().describe();
        RetargetReport report;
        const auto motion = retarget(*clip, *map, person(), {}, &report);
        ASSERT_TRUE(motion.ok()) << motion.error().describe();
        EXPECT_EQ(report.up, UpAxis::Y);
        EXPECT_LT(angle(motion->frames[1].rotations[18], quatFromAxisAngle({0, -glm::radians(degrees), 0})), 1e-3f);
        EXPECT_LT(angle(motion->frames[4].rotations[18], quatFromAxisAngle({0, -1.5707963f, 0})), 1e-3f);
        EXPECT_LT(angle(motion->frames[4].rotations[16], glm::quat(1, 0, 0, 0)), 1e-3f);
        EXPECT_NEAR(report.metresPerUnit, 0.80 / 0.87, 1e-4);
    }
}

TEST(Retarget, GlbFilesAreImportedAtTheWantedRate) {
    const auto file = encodeGlb(gltfRig(GltfInterpolation::Linear));
    ASSERT_TRUE(file.ok()) << file.error().describe();
    MotionImportOptions options;
    options.animation = "wave";
    options.framesPerSecond = 10.0;
    const auto motion = importMotionBytes(*file, person(), options);
    ASSERT_TRUE(motion.ok()) << motion.error().describe();
    EXPECT_EQ(motion->name, "wave");
    EXPECT_EQ(motion->source, "gltf");
    ASSERT_EQ(motion->frames.size(), 11u) << "one second";
    EXPECT_LT(angle(motion->frames[5].rotations[18], quatFromAxisAngle({0, -0.785398f, 0})), 1e-3f);
}

TEST(Retarget, GltfBindPoseIsTheRestPose) {
    // The same file saved while the elbow was bent: the skin's bind matrices still say where it rests.
    GltfDocument document = gltfRig(GltfInterpolation::Linear);
    GltfSkin skin;
    const auto globals = document.globalMatrices();
    for (std::size_t n = 1; n < document.nodes.size(); ++n) {
        skin.joints.push_back(static_cast<int>(n));
        skin.inverseBindMatrices.push_back(glm::inverse(globals[n]));
    }
    document.skins.push_back(skin);
    GltfNode& shoulder = document.nodes[at(Rig().find("LeftShoulder") + 1)];
    shoulder.rotation = glm::angleAxis(1.0f, glm::vec3(0, 1, 0));
    shoulder.localMatrix = glm::mat4_cast(shoulder.rotation);
    shoulder.localMatrix[3] = glm::vec4(shoulder.translation, 1.0f);
    const auto clip = clipFromGltf(document, "0", 4.0);
    ASSERT_TRUE(clip.ok());
    const int elbow = clip->skeleton.find("mixed:LeftElbow");
    const glm::vec3 rest = clip->skeleton.restPositions[at(elbow)];
    EXPECT_LT(glm::distance(rest, glm::vec3(0.48f, 1.40f, 0)), 1e-4f) << "20 + 28 cm out, 95 + 20 + 25 cm up";
    EXPECT_GT(glm::distance(clip->positions(0)[at(elbow)], rest), 0.1f) << "the animation holds the saved pose";
}

TEST(Retarget, GltfAnimationsAreChosenByNameOrIndex) {
    const GltfDocument document = gltfRig(GltfInterpolation::Linear);
    EXPECT_TRUE(clipFromGltf(document, "0").ok());
    const auto none = clipFromGltf(document, "run");
    ASSERT_FALSE(none.ok());
    EXPECT_EQ(none.error().code, ErrorCode::NotFound);
    EXPECT_NE(none.error().describe().find("wave"), std::string::npos);
    GltfDocument still = document;
    still.animations.clear();
    EXPECT_EQ(clipFromGltf(still).error().code, ErrorCode::NotFound);
    GltfDocument endless = document;
    endless.animations[0].channels[0].times = {0.0f, 3e38f};
    EXPECT_EQ(clipFromGltf(endless).error().code, ErrorCode::LimitExceeded);
}

TEST(Retarget, BrokenBvhClipsAreRefused) {
    BvhFile file;
    EXPECT_EQ(clipFromBvh(file).error().code, ErrorCode::BadFile);
    Rig rig;
    rig.places = {{0, 0, 0}, {0, 0, 0}};
    std::string text = rig.bvh();
    text.replace(text.find("0.04"), 4, "0.00");
    const auto still = importMotionBytes(bytesOf(text), person());
    ASSERT_FALSE(still.ok());
    EXPECT_EQ(still.error().code, ErrorCode::BadFile);
    Rig flat;
    for (const char* name : {"LeftKnee", "LeftAnkle", "RightKnee", "RightAnkle"})
        flat.offsets[at(flat.find(name))] = glm::vec3(0.0f);
    const std::string legless = flat.bvh();
    EXPECT_EQ(importMotionBytes(bytesOf(legless), person()).error().code, ErrorCode::BadFile);
    ReadLimits small;
    small.maxBytes = 200;
    const std::string sound = Rig().bvh();
    EXPECT_EQ(importMotionBytes(bytesOf(sound), person(), {}, nullptr, small).error().code, ErrorCode::LimitExceeded);
}

TEST(Retarget, FormatsAreToldByContent) {
    EXPECT_EQ(recogniseMotion(bytesOf("HIERARCHY\nROOT a")), MotionFormat::Bvh);
    EXPECT_EQ(recogniseMotion(bytesOf("# a comment\n hierarchy\n")), MotionFormat::Bvh);
    EXPECT_EQ(recogniseMotion(bytesOf("PK\x03\x04")), MotionFormat::Npz);
    EXPECT_EQ(recogniseMotion(bytesOf("\x93NUMPY\x01")), MotionFormat::Npy);
    EXPECT_EQ(recogniseMotion(bytesOf("glTF....")), MotionFormat::Gltf);
    EXPECT_EQ(recogniseMotion(bytesOf("  {\"asset\": {}}")), MotionFormat::Gltf);
    EXPECT_EQ(recogniseMotion(bytesOf("")), MotionFormat::Unknown);
    EXPECT_EQ(recogniseMotion(bytesOf("#")), MotionFormat::Unknown);
    const std::string text = "hello";
    const auto other = importMotionBytes(bytesOf(text), person());
    EXPECT_EQ(other.error().code, ErrorCode::Unsupported);
    MotionImportOptions late;
    late.firstFrame = 5;
    const std::string sound = Rig().bvh();
    EXPECT_EQ(importMotionBytes(bytesOf(sound), person(), late).error().code, ErrorCode::InvalidArgument);
}

// ---- real files

struct OpenBody {
    Skeleton skeleton;
    float soleM = 0.0f;
};

OpenBody openBody(const fs::path& path) {
    const auto body = readBodyModel(path);
    EXPECT_TRUE(body.ok()) << (body.ok() ? "" : body.error().describe());
    OpenBody open{bodySkeleton(*body, {}), 0.0f};
    for (const glm::vec3& v : body->templateVertices) open.soleM = std::min(open.soleM, v.y);
    return open;
}

/// What a person watching a file would check.
struct Playback {
    float lowestFootM = 1e9f; ///< lowest foot joint above the floor, over all frames
    float meanHeightM = 0.0f; ///< of the pelvis
    int wrongSides = 0; ///< frames where the left hip is not on the pelvis' left, or the left shoulder not the chest's
    int backwardKnees =
        0; ///< frames where a knee bends forward by more than 25 degrees (one recording has knees overstretched by 17)
    glm::vec3 facing{0.0f}; ///< of the pelvis, mean
};

Playback watch(const Motion& motion, const OpenBody& body) {
    Playback seen;
    for (const Pose& pose : motion.frames) {
        const auto world = jointWorldMatrices(body.skeleton, pose);
        const auto place = [&](int j) { return glm::vec3(world[at(j)][3]); };
        const glm::mat3 pelvis(world[0]), chest(world[9]);
        for (int foot : {10, 11}) seen.lowestFootM = std::min(seen.lowestFootM, place(foot).y);
        seen.meanHeightM += place(0).y;
        seen.wrongSides +=
            glm::dot(pelvis[0], place(1) - place(2)) < 0.1f || glm::dot(chest[0], place(16) - place(17)) < 0.1f;
        const auto aboutX = [&](int j) { return axisAngleFromQuat(pose.rotations[at(j)]).x; };
        seen.backwardKnees += aboutX(4) < -0.44f || aboutX(5) < -0.44f;
        seen.facing += pelvis[2];
    }
    seen.meanHeightM /= static_cast<float>(motion.frames.size());
    seen.facing /= static_cast<float>(motion.frames.size());
    return seen;
}

TEST(Retarget, EveryMotionPlaysOnTheOpenBody) {
    ARS_TEST_DATA_FILE(bodyPath, "open_body.npz");
    ARS_TEST_DATA_FILE(folder, "motion");
    const OpenBody body = openBody(bodyPath);
    int files = 0;
    for (const auto& entry : fs::recursive_directory_iterator(folder)) {
        const std::string type = entry.path().extension().string();
        if (type != ".bvh" && type != ".npz" && type != ".npy") continue;
        ++files;
        MotionImportOptions options;
        options.soleHeightM = body.soleM;
        RetargetReport report;
        const auto motion = importMotion(entry.path(), body.skeleton, options, &report);
        ASSERT_TRUE(motion.ok()) << motion.error().describe();
        const Playback seen = watch(*motion, body);
        const std::string name = entry.path().filename().string();
        std::printf(
            "%-36s %4zu frames %6.2f fps  %-17s body %2d of 22, all %2d of 55  skipped %zu  lowest foot %+.3f m  "
            "wrong sides %d  facing %+.2f %+.2f %+.2f\n",
            name.c_str(), motion->frames.size(), motion->framesPerSecond, report.mapName.c_str(),
            report.mappedBodyJoints, report.mappedJoints, report.skippedFrames, seen.lowestFootM, seen.wrongSides,
            seen.facing.x, seen.facing.y, seen.facing.z);
        EXPECT_EQ(seen.wrongSides, 0) << name;
        EXPECT_EQ(seen.backwardKnees, 0) << name;
        EXPECT_GE(report.mappedBodyJoints, type == ".bvh" ? 19 : 0) << name;
        // Foot joints rest 3 cm above the soles. Handstands and flights have no foot on the floor.
        const bool handstand = name == "gym01.bvh", flight = name == "fly01.bvh";
        EXPECT_NEAR(seen.lowestFootM, handstand ? 2.1f : flight ? 0.18f : 0.03f, 0.07f) << name;
        EXPECT_GT(seen.meanHeightM, 0.1f) << name;
        EXPECT_LT(seen.meanHeightM, 1.4f) << name;
    }
    EXPECT_GE(files, 33);
}

TEST(Retarget, CmuClipsAgreeWithAnIndependentTransfer) {
    ARS_TEST_DATA_FILE(bodyPath, "open_body.npz");
    ARS_TEST_DATA_FILE(folder, "capture/casual/motions");
    ARS_TEST_DATA_FILE(clips, "motion/cmu_bvh");
    const OpenBody body = openBody(bodyPath);
    struct Case {
        const char* reference;
        const char* clip;
        std::size_t step; ///< frames of the clip per frame of the reference, which starts at the clip's frame 4
    };
    for (const Case& c :
         {Case{"walk_02_01", "02_01", 4}, Case{"run_02_03", "02_03", 4}, Case{"jump_02_04", "02_04", 4},
          Case{"dance_05_03", "05_03", 4}, Case{"jumping_jacks", "jumping_jacks_AnimatedDrawings", 1}}) {
        const auto reference = readMotionNpz(folder / (std::string(c.reference) + ".npz"));
        MotionImportOptions options;
        options.skipLeadIn = false;
        const auto ours = importMotion(clips / (std::string(c.clip) + ".bvh"), body.skeleton, options);
        ASSERT_TRUE(reference.ok() && ours.ok()) << c.clip;
        ASSERT_NEAR(ours->framesPerSecond / static_cast<double>(c.step), 30.0, 0.1);
        double sum = 0.0, worst = 0.0;
        std::size_t count = 0;
        for (std::size_t f = 0; f < reference->frames.size(); ++f) {
            ASSERT_LT(4 + f * c.step, ours->frames.size());
            const auto a = jointWorldMatrices(body.skeleton, reference->frames[f]);
            const auto b = jointWorldMatrices(body.skeleton, ours->frames[4 + f * c.step]);
            for (std::size_t j = 0; j < 22; ++j, ++count) {
                const glm::vec3 ra = glm::vec3(a[j][3] - a[0][3]), rb = glm::vec3(b[j][3] - b[0][3]);
                sum += glm::distance(ra, rb);
                worst = std::max(worst, static_cast<double>(glm::distance(ra, rb)));
            }
        }
        std::printf("%-14s mean %.1f mm, worst %.1f mm over %zu frames, 22 body joints relative to the pelvis\n",
                    c.reference, 1e3 * sum / static_cast<double>(count), 1e3 * worst, reference->frames.size());
        EXPECT_LT(sum / static_cast<double>(count), 0.01) << c.clip;
        EXPECT_LT(worst, 0.04) << c.clip;
    }
}

TEST(Retarget, WalkAlternatesLegsAndStaysOnTheFloor) {
    ARS_TEST_DATA_FILE(bodyPath, "open_body.npz");
    ARS_TEST_DATA_FILE(clip, "motion/cmu_bvh/02_01.bvh");
    const OpenBody body = openBody(bodyPath);
    MotionImportOptions options;
    options.soleHeightM = body.soleM;
    const auto walk = importMotion(clip, body.skeleton, options);
    ASSERT_TRUE(walk.ok());
    int changes = 0, leftAhead = -1;
    for (const Pose& pose : walk->frames) {
        const auto world = jointWorldMatrices(body.skeleton, pose);
        const float ahead = glm::dot(glm::vec3(world[0][2]), glm::vec3(world[7][3] - world[8][3]));
        if (std::abs(ahead) < 0.15f) continue;
        if (leftAhead >= 0 && leftAhead != (ahead > 0)) ++changes;
        leftAhead = ahead > 0;
        const float lowest = std::min(world[7][3].y, world[8][3].y) - (body.skeleton.restPositions[7].y - body.soleM);
        EXPECT_LT(lowest, 0.09f) << "one foot is always near the floor";
    }
    EXPECT_GE(changes, 4) << "steps in 2.8 s";
    // It walks forward, the way it faces.
    const glm::vec3 way = walk->frames.back().translation - walk->frames.front().translation;
    EXPECT_GT(way.z, 2.0f);
    EXPECT_LT(std::abs(way.y), 0.1f);
}

} // namespace
} // namespace ars
