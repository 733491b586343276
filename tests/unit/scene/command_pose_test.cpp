#include "engine/core/file.h"
#include "engine/rig/inverse_kinematics.h"
#include "engine/scene/pose_library.h"
#include "tests/unit/scene/command_fixture.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace ars::test {
namespace {

/// World places of joints by the plain recursion, in double: nothing of the program's but names and rest positions.
struct PlainKinematics {
    std::vector<glm::dmat3> turns;
    std::vector<glm::dvec3> places;

    PlainKinematics(const Skeleton& skeleton, const Pose& pose) {
        for (std::size_t j = 0; j < skeleton.parents.size(); ++j) {
            const glm::dmat3 local = glm::mat3_cast(glm::normalize(glm::dquat(pose.rotations[j])));
            const glm::dvec3 rest(skeleton.restPositions[j]);
            if (skeleton.parents[j] < 0) {
                turns.push_back(local);
                places.push_back(rest + glm::dvec3(pose.translation));
            } else {
                const auto p = static_cast<std::size_t>(skeleton.parents[j]);
                turns.push_back(turns[p] * local);
                places.push_back(places[p] + turns[p] * (rest - glm::dvec3(skeleton.restPositions[p])));
            }
        }
    }
};

double biggestDifference(const glm::dmat3& a, const glm::dmat3& b) {
    double worst = 0.0;
    for (int c = 0; c < 3; ++c) {
        for (int r = 0; r < 3; ++r) worst = std::max(worst, std::abs(a[c][r] - b[c][r]));
    }
    return worst;
}

Arguments at(const char* joint, const glm::dvec3& v) { return {{"joint", joint}, {"x", v.x}, {"y", v.y}, {"z", v.z}}; }

double lowest(const AvatarAsset& avatar, const Pose& pose) {
    const auto vertices = posedTemplate(avatar.evaluator->mesh(), pose);
    double low = 1e9;
    for (const glm::vec3& v : vertices.value()) low = std::min(low, double(v.y));
    return low;
}

class Poses : public Commands {
protected:
    glm::dvec3 placeOf(const char* joint, double timeS = 0.0) const {
        return PlainKinematics(skeleton(), pose(timeS)).places[static_cast<std::size_t>(jointIndex(joint))];
    }
    glm::dmat3 turnOf(const char* joint) const {
        return PlainKinematics(skeleton(), pose()).turns[static_cast<std::size_t>(jointIndex(joint))];
    }
    void expectSame(const Pose& a, const Pose& b, double degrees, double metres) {
        for (std::size_t j = 0; j < a.rotations.size(); ++j) {
            EXPECT_LT(angleBetween(a.rotations[j], b.rotations[j]), degrees) << smplxJointName(static_cast<int>(j));
        }
        EXPECT_LT(glm::distance(a.translation, b.translation), metres);
    }
};

TEST_F(Poses, RotateSetsTheLocalRotation) {
    must("pose.rotate_joint", at("left_elbow", {0, -70, 0}));
    EXPECT_LT(angleBetween(rotation("left_elbow"), degreesAbout({0, 1, 0}, -70.0f)), 1e-3);
    EXPECT_EQ(editor.undoLabel(), "Rotate left elbow");
}

TEST_F(Poses, RotateKeepsTheRangeOfMotionWhereAsked) {
    Arguments backwards = at("left_elbow", {0, 90, 0}); // elbows do not bend that way
    must("pose.rotate_joint", backwards);
    EXPECT_LT(angleBetween(rotation("left_elbow"), degreesAbout({0, 1, 0}, 90.0f)), 1e-3);
    backwards["limits"] = true;
    must("pose.rotate_joint", backwards);
    const JointLimit limit = smplxJointLimits()[static_cast<std::size_t>(jointIndex("left_elbow"))];
    const glm::vec3 coordinates = limitCoordinates(limit, rotation("left_elbow"));
    for (int c = 0; c < 3; ++c) {
        EXPECT_GE(coordinates[c], limit.minimum[c] - 1e-4f);
        EXPECT_LE(coordinates[c], limit.maximum[c] + 1e-4f);
    }
}

TEST_F(Poses, TurnRotatesTheWorldOrientationByExactlyThat) {
    must("pose.rotate_joint", at("spine2", {10, 20, 5}));
    must("pose.rotate_joint", at("left_collar", {0, 15, -10}));
    const glm::dmat3 before = turnOf("left_shoulder");
    const glm::dvec3 place = placeOf("left_shoulder");
    const glm::dvec3 vector(25, -40, 70);
    must("pose.turn_joint", at("left_shoulder", vector));
    const double angle = glm::radians(glm::length(vector));
    const glm::dvec3 n = glm::normalize(vector);
    // Rodrigues' formula.
    const glm::dmat3 cross(glm::dvec3(0, n.z, -n.y), glm::dvec3(-n.z, 0, n.x), glm::dvec3(n.y, -n.x, 0));
    const glm::dmat3 turn = glm::dmat3(1.0) + std::sin(angle) * cross + (1.0 - std::cos(angle)) * (cross * cross);
    EXPECT_LT(biggestDifference(turnOf("left_shoulder"), turn * before), 1e-5);
    EXPECT_LT(glm::distance(placeOf("left_shoulder"), place), 1e-6);
}

TEST_F(Poses, DragBringsTheJointToItsTargetAndLeavesTheRest) {
    must("pose.limits", {{"enabled", false}});
    const Pose before = pose();
    const glm::dvec3 target = placeOf("left_wrist") + glm::dvec3(0.05, 0.25, 0.2);
    must("pose.drag_joint", at("left_wrist", target));
    EXPECT_LT(glm::distance(placeOf("left_wrist"), target), 2e-4); // IkOptions::toleranceM and float rotations
    const std::vector<std::string> moved{"left_shoulder", "left_elbow", "left_wrist"};
    for (int j = 0; j < kSmplxJointCount; ++j) {
        const bool may = std::find(moved.begin(), moved.end(), smplxJointName(j)) != moved.end();
        const auto index = static_cast<std::size_t>(j);
        EXPECT_TRUE(may || pose().rotations[index] == before.rotations[index]) << smplxJointName(j);
    }
}

TEST_F(Poses, DraggedHandsKeepTheirOrientationUnlessTheyNeedNot) {
    must("pose.limits", {{"enabled", false}});
    const glm::dmat3 before = turnOf("right_wrist");
    const glm::dvec3 target = placeOf("right_wrist") + glm::dvec3(-0.1, 0.3, 0.2);
    must("pose.drag_joint", at("right_wrist", target));
    EXPECT_LT(biggestDifference(turnOf("right_wrist"), before), 1e-4);
    Arguments freely = at("right_wrist", target + glm::dvec3(0.1, 0.1, 0.1));
    freely["keep_orientation"] = false;
    must("pose.drag_joint", freely);
    EXPECT_GT(biggestDifference(turnOf("right_wrist"), before), 1e-2);
}

TEST_F(Poses, DraggingTheRootMovesTheWholeBody) {
    const glm::dvec3 head = placeOf("head"), root = placeOf("pelvis");
    must("pose.drag_joint", at("pelvis", root + glm::dvec3(0.5, 0.1, -0.4)));
    EXPECT_LT(glm::distance(placeOf("head"), head + glm::dvec3(0.5, 0.1, -0.4)), 1e-5);
}

TEST_F(Poses, MirrorTwiceIsWhereItBegan) {
    must("pose.preset", {{"name", "fighter"}});
    const Pose before = pose();
    const glm::dvec3 left = placeOf("left_wrist");
    must("pose.mirror");
    const Skeleton& s = skeleton();
    // The open body is symmetrical: what the left hand did at x the right one does at -x.
    const glm::dvec3 right = placeOf("right_wrist");
    EXPECT_LT(glm::distance(right, glm::dvec3(-left.x, left.y, left.z)),
              2e-3 + 2.0 * std::abs(double(s.restPositions[0].x)));
    must("pose.mirror");
    expectSame(pose(), before, 1e-4, 1e-6);
}

TEST_F(Poses, MirrorSideCopiesOneSideToTheOther) {
    must("pose.preset", {{"name", "wave"}});
    const Pose before = pose();
    must("pose.mirror_side", {{"from", "right"}});
    const Pose after = pose(), mirrored = mirroredPose(after);
    expectSame(after, before.rotations.empty() ? before : [&] {
        Pose expected = before;
        for (int j = 0; j < kSmplxJointCount; ++j) {
            if (smplxJointName(j).substr(0, 5) == "left_") {
                const auto index = static_cast<std::size_t>(j);
                expected.rotations[index] = mirrored.rotations[index];
            }
        }
        return expected;
    }(), 1e-4, 1e-6);
    EXPECT_LT(angleBetween(after.rotations[static_cast<std::size_t>(jointIndex("right_elbow"))],
                           before.rotations[static_cast<std::size_t>(jointIndex("right_elbow"))]),
              1e-6);
}

TEST_F(Poses, PasteGivesBackWhatWasCopiedAlsoFlippedTwice) {
    EXPECT_EQ(refusal("pose.paste"), "no pose has been copied");
    must("pose.preset", {{"name", "run"}});
    const Pose copied = pose();
    must("pose.copy");
    must("pose.preset", {{"name", "sit"}});
    must("pose.paste", {{"flipped", true}});
    expectSame(pose(), mirroredPose(copied), 1e-4, 1e-6);
    must("pose.copy");
    must("pose.paste", {{"flipped", true}});
    expectSame(pose(), copied, 1e-4, 1e-6);
    must("pose.preset", {{"name", "sit"}});
    const Pose sitting = pose();
    must("pose.copy");
    must("pose.preset", {{"name", "run"}});
    must("pose.paste", {{"blend", 0.5}});
    EXPECT_LT(angleBetween(
                  rotation("left_knee"),
                  interpolatePoses(copied, sitting, 0.5f).rotations[static_cast<std::size_t>(jointIndex("left_knee"))]),
              0.05);
}

TEST_F(Poses, CopiedLimbIsPastedAlone) {
    must("pose.preset", {{"name", "wave"}});
    must("pose.copy", {{"joint", "right_shoulder"}});
    const Pose waving = pose();
    must("pose.preset", {{"name", "sit"}});
    const Pose sitting = pose();
    must("pose.paste", {{"flipped", true}});
    const Pose mirrored = mirroredPose(waving);
    for (int j = 0; j < kSmplxJointCount; ++j) {
        const std::string_view name = smplxJointName(j);
        const auto index = static_cast<std::size_t>(j);
        const bool arm = name == "left_shoulder" || name == "left_elbow" || name == "left_wrist" ||
                         (j >= jointIndex("left_index1") && j < jointIndex("right_index1"));
        const Pose& expected = arm ? mirrored : sitting;
        EXPECT_LT(angleBetween(pose().rotations[index], expected.rotations[index]), 1e-4) << name;
    }
}

TEST_F(Poses, ResetStandsOnTheSolesOrTouchesOneJoint) {
    must("pose.preset", {{"name", "fighter"}});
    must("pose.move_root", {{"x", 1.0}, {"y", 2.0}, {"z", -1.0}});
    const Pose before = pose();
    must("pose.reset", {{"joint", "left_shoulder"}});
    EXPECT_LT(angleBetween(rotation("left_shoulder"), glm::quat(1, 0, 0, 0)), 1e-6);
    EXPECT_TRUE(rotation("left_elbow") == before.rotations[static_cast<std::size_t>(jointIndex("left_elbow"))]);
    must("pose.reset", {{"joint", "left_shoulder"}, {"subtree", true}});
    EXPECT_LT(angleBetween(rotation("left_elbow"), glm::quat(1, 0, 0, 0)), 1e-6);
    EXPECT_EQ(refusal("pose.reset", {{"joint", "selected"}}), "no joint is selected");
    must("pose.reset");
    EXPECT_NEAR(lowest(*assets.avatar, pose()), 0.0, 1e-3);
    EXPECT_FLOAT_EQ(pose().translation.x, 1.0f);
}

TEST_F(Poses, PlaceOnFloorMovesTheLowestVertexToZero) {
    must("pose.preset", {{"name", "run"}});
    must("pose.move_root", {{"x", 0.3}, {"y", 1.7}, {"z", 0.2}});
    must("pose.place_on_floor");
    EXPECT_NEAR(lowest(*assets.avatar, pose()), 0.0, 1e-5);
    EXPECT_FLOAT_EQ(pose().translation.x, 0.3f);
}

TEST_F(Poses, JsonAppliesAndSaysWhatIsWrong) {
    must("pose.apply", {{"pose", R"({"rotations": {"head": [0, 30, 0]}, "translation": [0.1, 0.9, 0]})"}});
    EXPECT_LT(angleBetween(rotation("head"), degreesAbout({0, 1, 0}, 30.0f)), 1e-3);
    EXPECT_FLOAT_EQ(pose().translation.y, 0.9f);
    EXPECT_EQ(refusal("pose.apply", {{"pose", "left"}}), "pose: expected JSON, found something else");
    EXPECT_EQ(refusal("pose.apply", {{"pose", "{}"}}), "pose: expected a JSON object with \"rotations\"");
    EXPECT_EQ(refusal("pose.apply", {{"pose", R"({"rotations": {"tail": [0, 1, 2]}})"}}),
              "rotations: \"tail\": there is no joint of this name");
    EXPECT_EQ(refusal("pose.apply", {{"pose", R"({"rotations": {"head": [0, 1]}})"}}),
              "rotations: \"head\": expected a list of 3 numbers, found 2");
    EXPECT_EQ(refusal("pose.apply", {{"pose", R"({"rotations": {"head": [0, 1, 1e9]}})"}}),
              "rotations: \"head\": expected numbers within +-36000");
    EXPECT_NE(refusal("pose.apply", {{"pose", R"({"pose": 2, "rotations": {}})"}}), "");
}

TEST_F(Poses, TextOfAPoseReadsBack) {
    must("pose.preset", {{"name", "thinker"}});
    const std::string text = poseToJson(pose(), skeleton(), "Thinking");
    const auto read = parsePose(text, skeleton());
    ASSERT_TRUE(read) << read.error().describe();
    EXPECT_EQ(read.value().label, "Thinking");
    expectSame(read.value().pose, pose(), 1e-4, 1e-6);
}

TEST_F(Poses, ExpressionIsRefusedWhereThereIsNone) {
    auto face = std::make_shared<AvatarAsset>(*openBody());
    face->expressionNames.clear();
    assets.avatar = face;
    EXPECT_EQ(refusal("pose.expression", {{"index", 0}, {"value", 1.0}}), "this avatar has no expression coefficients");
    face = std::make_shared<AvatarAsset>(*openBody());
    face->expressionNames = {"smile", "frown", "wink"};
    assets.avatar = face;
    must("pose.expression", {{"index", 2}, {"value", 0.75}});
    EXPECT_EQ(pose().expression, (std::vector<float>{0.0f, 0.0f, 0.75f}));
    must("pose.reset_expression");
    EXPECT_TRUE(pose().expression.empty());
}

TEST_F(Poses, EveryPoseOfTheLibraryIsSoundAndStandsOnTheFloor) {
    const std::vector<PoseLibraryEntry> library = poseLibrary();
    EXPECT_GE(library.size(), 16u);
    for (const PoseLibraryEntry& entry : library) {
        must("pose.move_root", {{"x", 0.4}, {"y", 3.0}, {"z", -0.2}});
        must("pose.preset", {{"name", entry.name}});
        EXPECT_NEAR(lowest(*assets.avatar, pose()), 0.0, 1e-4) << entry.name;
        EXPECT_FLOAT_EQ(pose().translation.x, 0.4f) << entry.name;
        EXPECT_FALSE(entry.label.empty());
        if (entry.file.empty()) continue;
        // The file's own height fits the open body as well, for readers that do not move it.
        const auto read = readPoseFile(entry.file, skeleton());
        ASSERT_TRUE(read) << read.error().describe();
        EXPECT_NEAR(lowest(*assets.avatar, read.value().pose), 0.0, 2e-3) << entry.name;
    }
    EXPECT_NE(refusal("pose.preset", {{"name", "flying"}}), "");
}

TEST_F(Poses, OwnPosesJoinTheLibrary) {
    const TemporaryFolder folder;
    const char* old = std::getenv("ARS_STATE");
    const std::string before = old ? old : "";
    ::setenv("ARS_STATE", folder.path().c_str(), 1);
    must("pose.rotate_joint", at("head", {0, 45, 0}));
    const auto saved = saveLibraryPose("my look", pose(), skeleton());
    must("pose.reset");
    must("pose.preset", {{"name", "my look"}});
    const glm::quat head = rotation("head");
    const auto entries = poseLibrary();
    if (old)
        ::setenv("ARS_STATE", before.c_str(), 1);
    else
        ::unsetenv("ARS_STATE");
    ASSERT_TRUE(saved) << saved.error().describe();
    EXPECT_LT(angleBetween(head, degreesAbout({0, 1, 0}, 45.0f)), 1e-3);
    EXPECT_EQ(entries.back().name, "my look");
    EXPECT_TRUE(entries.back().ownedByUser);
    EXPECT_FALSE(saveLibraryPose("../escape", pose(), skeleton()));
    EXPECT_FALSE(saveLibraryPose("", pose(), skeleton()));
}

/// Three bones with names and rest axes of their own: what a skinned glTF may bring.
class PlainRig : public AvatarEvaluator {
public:
    PlainRig() {
        rig_.skeleton.names = {"root", "bone_a", "bone_b", "tip"};
        rig_.skeleton.parents = {-1, 0, 1, 2};
        rig_.skeleton.restPositions = {{0, 0, 0}, {0, 0.4f, 0}, {0, 0.8f, 0}, {0, 1.2f, 0}};
        rig_.skeleton.restOrientations.assign(4, degreesAbout({1, 0, 1}, 50.0f));
    }
    const AvatarRig& rig() const override { return rig_; }
    const TemplateMesh& mesh() const override { return mesh_; }
    std::string description() const override { return "four joints"; }
    bool dependsOnPose() const override { return false; }
    bool colorsDependOnView() const override { return false; }
    Status evaluate(const Pose&, const Camera*, Surfels&) override { return {}; }

private:
    AvatarRig rig_;
    TemplateMesh mesh_;
};

class OtherSkeletons : public Commands {
protected:
    void SetUp() override {
        auto avatar = std::make_shared<AvatarAsset>();
        avatar->evaluator = std::make_shared<PlainRig>();
        assets.avatar = avatar;
    }
    glm::dvec3 tip() const { return glm::dvec3(jointWorldMatrices(skeleton(), pose())[3][3]); }
};

TEST_F(OtherSkeletons, AreDraggedTurnedAndReset) {
    ASSERT_EQ(pose().rotations.size(), 4u);
    must("pose.drag_joint", at("tip", {0.5, 0.7, 0.1}));
    EXPECT_LT(glm::distance(tip(), glm::dvec3(0.5, 0.7, 0.1)), 1e-3);
    EXPECT_EQ(document().pose.pose.rotations.size(), 4u);
    const glm::dmat3 before(glm::mat3(jointWorldMatrices(skeleton(), pose())[1]));
    must("pose.turn_joint", at("bone_a", {0, 90, 0}));
    const glm::dmat3 turn(glm::dvec3(0, 0, -1), glm::dvec3(0, 1, 0), glm::dvec3(1, 0, 0));
    EXPECT_LT(biggestDifference(glm::dmat3(glm::mat3(jointWorldMatrices(skeleton(), pose())[1])), turn * before), 1e-5);
    must("view.select_joint", {{"joint", "bone_b"}});
    must("pose.reset");
    EXPECT_LT(glm::distance(tip(), glm::dvec3(0, 1.2, 0)), 1e-6);
}

TEST_F(OtherSkeletons, SayWhatNeedsTheSmplxOne) {
    const std::string needs = "this needs an avatar with a SMPL-X skeleton";
    EXPECT_EQ(refusal("pose.mirror"), needs);
    EXPECT_EQ(refusal("pose.mirror_side", {{"from", "left"}}), needs);
    EXPECT_EQ(refusal("timeline.open_clip", {{"file", "/clip.npz"}}), needs);
    EXPECT_EQ(refusal("camera.preset", {{"name", "left_hand"}}), "camera: the avatar has no left wrist");
    must("camera.preset", {{"name", "front"}});
    must("camera.focus", {{"joint", "bone_b"}});
}

} // namespace
} // namespace ars::test
