#include "engine/scene/evaluate.h"
#include "engine/scene/pose_library.h"
#include "engine/scene/project.h"
#include "tests/unit/ui/look_support.h"
#include "ui/pose/joint_list.h"
#include "ui/pose/pose_pictures.h"
#include "ui/pose/rotation_numbers.h"

#include <gtest/gtest.h>

#include <glm/gtc/matrix_transform.hpp>

#include <cstdlib>
#include <random>
#include <set>

namespace ars::ui {
namespace {

// Poses and pictures of a person's own folder are none of a test's business: before anything asks where it is.
const ars::test::TemporaryFolder kFolder;
const int kFolderIsSet = ::setenv("ARS_STATE", kFolder.path().c_str(), 0);

TEST(JointSearch, PartsOfANameFindTheJoint) {
    EXPECT_TRUE(matchesSearch("left_wrist", "lwri"));
    EXPECT_TRUE(matchesSearch("left_wrist", "wrist"));
    EXPECT_TRUE(matchesSearch("left_wrist", "L Wr"));
    EXPECT_TRUE(matchesSearch("left_index1", "lin1"));
    EXPECT_TRUE(matchesSearch("spine2", "spine 2"));
    EXPECT_TRUE(matchesSearch("pelvis", ""));
}

TEST(JointSearch, LettersInTheMiddleOfAWordFindNothing) {
    EXPECT_FALSE(matchesSearch("left_wrist", "rwri"));
    EXPECT_FALSE(matchesSearch("left_shoulder", "hip"));
    EXPECT_FALSE(matchesSearch("left_wrist", "rist"));
    EXPECT_FALSE(matchesSearch("left_index1", "lin2"));
}

TEST(JointNames, ReadAsPeopleWriteThem) {
    EXPECT_EQ(friendlyName("left_wrist"), "Left wrist");
    EXPECT_EQ(friendlyName("right_index3"), "Right index 3");
    EXPECT_EQ(friendlyName("left_eye_smplhf"), "Left eye");
    EXPECT_EQ(friendlyName("jaw"), "Jaw");
}

TEST(JointTree, HoldsEveryJointOnceInItsGroup) {
    const JointTree tree = jointTree(smplxSkeleton(std::vector<glm::vec3>(kSmplxJointCount)));
    std::vector<int> seen(kSmplxJointCount, 0);
    for (int group = 0; group < kJointGroupCount; ++group) {
        std::vector<int> waiting = tree.beginners[static_cast<std::size_t>(group)];
        while (!waiting.empty()) {
            const int joint = waiting.back();
            waiting.pop_back();
            ++seen[static_cast<std::size_t>(joint)];
            const JointNode& node = tree.nodes[static_cast<std::size_t>(joint)];
            EXPECT_EQ(static_cast<int>(node.group), group) << node.label;
            waiting.insert(waiting.end(), node.children.begin(), node.children.end());
        }
    }
    for (int joint = 0; joint < kSmplxJointCount; ++joint) EXPECT_EQ(seen[static_cast<std::size_t>(joint)], 1) << joint;
    // 15 joints in each hand, jaw and two eyes, the other 22 in the body.
    EXPECT_EQ(tree.beginners[0].size(), 1u);
    EXPECT_EQ(tree.beginners[1].size(), 5u);
    EXPECT_EQ(tree.beginners[2].size(), 5u);
    EXPECT_EQ(tree.beginners[3].size(), 3u);
}

TEST(EulerAngles, AreThreeTurnsAboutFixedAxes) {
    // Rz Ry Rx made of matrices by the library.
    const glm::vec3 degrees(20.0f, -35.0f, 70.0f);
    const glm::mat4 x = glm::rotate(glm::mat4(1), glm::radians(degrees.x), glm::vec3(1, 0, 0));
    const glm::mat4 y = glm::rotate(glm::mat4(1), glm::radians(degrees.y), glm::vec3(0, 1, 0));
    const glm::mat4 z = glm::rotate(glm::mat4(1), glm::radians(degrees.z), glm::vec3(0, 0, 1));
    const glm::quat expected = glm::quat_cast(glm::mat3(z * y * x));
    EXPECT_LT(angleBetweenDeg(fromEulerDeg(degrees), expected), 1e-3f);
    const glm::vec3 back = eulerDeg(expected);
    for (int axis = 0; axis < 3; ++axis) EXPECT_NEAR(back[axis], degrees[axis], 1e-3f);
}

TEST(EulerAngles, GiveBackEveryRotationAlsoWhereAxesMeet) {
    std::mt19937 random(3);
    std::normal_distribution<float> normal;
    for (int i = 0; i < 2000; ++i) {
        const glm::quat q = glm::normalize(glm::quat(normal(random), normal(random), normal(random), normal(random)));
        EXPECT_LT(angleBetweenDeg(fromEulerDeg(eulerDeg(q)), q), 0.05f);
    }
    for (const float pitch : {90.0f, -90.0f}) {
        for (float roll = -170.0f; roll <= 170.0f; roll += 20.0f) {
            const glm::quat q = fromEulerDeg({roll, pitch, 25.0f});
            EXPECT_LT(angleBetweenDeg(fromEulerDeg(eulerDeg(q)), q), 0.1f) << pitch << " " << roll;
        }
    }
}

TEST(RotationVector, IsDegreesAboutItsDirection) {
    const glm::vec3 vector = rotationVectorDeg(glm::angleAxis(glm::radians(30.0f), glm::vec3(0, 1, 0)));
    EXPECT_NEAR(vector.x, 0.0f, 1e-4f);
    EXPECT_NEAR(vector.y, 30.0f, 1e-4f);
    EXPECT_NEAR(vector.z, 0.0f, 1e-4f);
}

TEST(LimitReading, KneeBendsOneWayAndSaysWhenItIsAtItsLimit) {
    const JointLimit* knee = limitOf("left_knee");
    ASSERT_NE(knee, nullptr);
    EXPECT_EQ(limitOf("mixamorig:LeftLeg"), nullptr);
    int axis = -1; // the one with the largest range is the one that bends
    for (int i = 0; i < 3; ++i) {
        if (axis < 0 || knee->maximum[i] - knee->minimum[i] > knee->maximum[axis] - knee->minimum[axis]) axis = i;
    }
    const glm::quat rest(1, 0, 0, 0);
    const float least = glm::degrees(knee->minimum[axis]);
    EXPECT_TRUE(readLimits(*knee, withCoordinate(*knee, rest, axis, least)).atLimit(axis));
    const float middle = 0.5f * glm::degrees(knee->minimum[axis] + knee->maximum[axis]);
    const glm::quat bent = withCoordinate(*knee, rest, axis, middle);
    const LimitReading reading = readLimits(*knee, bent);
    EXPECT_FALSE(reading.atLimit(axis));
    EXPECT_NEAR(reading.coordinateDeg[axis], middle, 1e-2f);
    EXPECT_NEAR(angleBetweenDeg(rest, bent), std::abs(middle), 1e-2f);
}

// ---- the panel, driven through its widgets

class PosePanelTest : public test::PanelTest {
protected:
    void SetUp() override {
        open("pose", "Pose");
        // What was not found stands in the output.
        auto* engine = static_cast<ImGuiTestEngine*>(studio_.window().testEngine());
        ImGuiTestEngine_GetIO(engine).ConfigLogToTTY = true;
    }

    void run(const char* command, const Arguments& arguments) {
        const Status status = session().run(command, arguments);
        ASSERT_TRUE(status.ok()) << status.error().describe();
    }
    void select(const char* joint) {
        run("view.select_joint", {{"joint", joint}});
        studio_.window().step();
    }
    Pose shown() { return poseAt(document(), session().assets(), session().timeS()); }
    glm::quat rotation(const char* joint) {
        return shown().rotations[static_cast<std::size_t>(smplxJointIndex(joint))];
    }
    void type(const char* item, const char* text) {
        act([&](ImGuiTestContext* context) { context->ItemInputValue(item, text); });
    }
};

void expectSamePose(const Pose& a, const Pose& b, float toleranceDeg = 0.05f) {
    ASSERT_EQ(a.rotations.size(), b.rotations.size());
    for (std::size_t j = 0; j < a.rotations.size(); ++j) {
        EXPECT_LT(angleBetweenDeg(a.rotations[j], b.rotations[j]), toleranceDeg) << smplxJointName(static_cast<int>(j));
    }
}

TEST_F(PosePanelTest, AJointIsFoundByPartsOfItsNameAndChosen) {
    act([](ImGuiTestContext* context) {
        context->ItemInput("Search");
        context->KeyCharsReplace("lwri");
        context->ItemClick("**/left_wrist");
    });
    EXPECT_EQ(document().view.selectedJoint, smplxJointIndex("left_wrist"));
    act([](ImGuiTestContext* context) {
        context->ItemInput("Search");
        context->KeyCharsReplace("");
        context->KeyPress(ImGuiKey_Escape);
    });
}

TEST_F(PosePanelTest, TypedDegreesTurnTheChosenJointAloneAndUndoTakesThemBack) {
    select("left_elbow");
    const Pose before = shown();
    const std::size_t entriesBefore = entries();
    type("Rotation Y", "-40");
    Pose expected = before;
    glm::vec3 degrees = rotationVectorDeg(before.rotations[18]);
    degrees.y = -40.0f;
    expected.rotations[18] = fromRotationVectorDeg(degrees);
    expectSamePose(shown(), expected);
    EXPECT_EQ(entries(), entriesBefore + 1);
    session().undo();
    expectSamePose(shown(), before, 1e-3f);
}

TEST_F(PosePanelTest, EulerAnglesAreAnotherWayToReadTheSameRotation) {
    select("left_shoulder");
    run("pose.rotate_joint", {{"joint", "left_shoulder"}, {"x", 0}, {"y", 0}, {"z", 0}});
    click("Euler XYZ");
    type("Rotation X", "30");
    type("Rotation Z", "50");
    EXPECT_LT(angleBetweenDeg(rotation("left_shoulder"), fromEulerDeg({30.0f, 0.0f, 50.0f})), 0.1f);
    click("Euler XYZ");
    EXPECT_LT(angleBetweenDeg(rotation("left_shoulder"), fromEulerDeg({30.0f, 0.0f, 50.0f})), 0.1f);
}

TEST_F(PosePanelTest, ALimitBarStopsAtTheLimit) {
    select("left_knee");
    const JointLimit* knee = limitOf("left_knee");
    ASSERT_NE(knee, nullptr);
    act([](ImGuiTestContext* context) {
        context->MouseMove("Swing X");
        context->MouseDown();
        for (int i = 0; i < 40; ++i) {
            const ImVec2 at = ImGui::GetIO().MousePos;
            context->MouseMoveToPos(ImVec2(at.x + 25.0f, at.y));
        }
        context->MouseUp();
    });
    const LimitReading reading = readLimits(*knee, rotation("left_knee"));
    EXPECT_NEAR(reading.coordinateDeg.x, reading.maximumDeg.x, 0.6f);
    EXPECT_TRUE(reading.atLimit(0));
}

TEST_F(PosePanelTest, MirrorExchangesLeftAndRight) {
    run("pose.rotate_joint", {{"joint", "left_elbow"}, {"x", 0}, {"y", -60}, {"z", 0}});
    const Pose expected = mirroredPose(shown());
    click("Mirror");
    expectSamePose(shown(), expected);
}

TEST_F(PosePanelTest, OneSideTakesOverTheOther) {
    run("pose.rotate_joint", {{"joint", "left_elbow"}, {"x", 10}, {"y", -60}, {"z", 5}});
    const glm::quat left = rotation("left_elbow");
    click("Left to right");
    // Mirrored at x = 0: the axis' y and z change sign.
    EXPECT_LT(angleBetweenDeg(rotation("right_elbow"), glm::quat(left.w, left.x, -left.y, -left.z)), 0.05f);
    EXPECT_LT(angleBetweenDeg(rotation("left_elbow"), left), 0.05f);
}

TEST_F(PosePanelTest, CopiedPosesComeBackFlipped) {
    run("pose.rotate_joint", {{"joint", "left_elbow"}, {"x", 0}, {"y", -60}, {"z", 0}});
    const Pose copied = shown();
    click("Copy");
    click("Reset all");
    EXPECT_LT(angleBetweenDeg(rotation("left_elbow"), glm::quat(1, 0, 0, 0)), 1e-3f);
    click("Paste flipped");
    expectSamePose(shown(), mirroredPose(copied));
}

TEST_F(PosePanelTest, APoseOfTheLibraryIsTakenOverByAClick) {
    const auto expected = libraryPose("t_pose", session().assets().avatar->evaluator->rig().skeleton);
    ASSERT_TRUE(expected.ok()) << expected.error().describe();
    act([](ImGuiTestContext* context) { context->ItemClick("t_pose/Pose t_pose"); });
    expectSamePose(shown(), expected->pose);
}

TEST_F(PosePanelTest, EveryPoseOfTheLibraryGetsAPictureOnDisk) {
    const std::filesystem::path folder = stateFolder() / "thumbnails";
    std::set<std::string> keys; // some poses are the same under two names
    for (const PoseLibraryEntry& entry : poseLibrary()) {
        const auto pose = libraryPose(entry.name, session().assets().avatar->evaluator->rig().skeleton);
        ASSERT_TRUE(pose.ok()) << pose.error().describe();
        keys.insert(thumbnailKey(document().avatar.source, pose->pose));
    }
    const std::size_t wanted = keys.size();
    const auto count = [&] {
        std::size_t files = 0;
        std::error_code error;
        for (const auto& file : std::filesystem::directory_iterator(folder, error)) {
            files += file.path().extension() == ".png" ? 1 : 0;
        }
        return files;
    };
    EXPECT_GE(wanted, 5u);
    EXPECT_TRUE(studio_.waitFor([&] { return count() >= wanted; })) << count() << " of " << wanted;
}

TEST_F(PosePanelTest, OwnPosesAreSavedAndDeleted) {
    run("pose.rotate_joint", {{"joint", "head"}, {"x", 0}, {"y", 35}, {"z", 0}});
    const Pose saved = shown();
    act([](ImGuiTestContext* context) {
        context->ItemInput("Pose name");
        context->KeyCharsReplace("turned head");
        context->ItemClick("Save pose");
    });
    const Skeleton& skeleton = session().assets().avatar->evaluator->rig().skeleton;
    const auto read = libraryPose("turned head", skeleton);
    ASSERT_TRUE(read.ok()) << read.error().describe();
    expectSamePose(read->pose, saved);
    act([](ImGuiTestContext* context) {
        context->Yield(2);
        context->ItemClick("turned head/Pose turned head", ImGuiMouseButton_Right);
        context->ItemClick("//$FOCUSED/Delete");
        context->Yield(2);
        context->ItemClick("//Delete pose/Delete");
    });
    EXPECT_FALSE(libraryPose("turned head", skeleton).ok());
}

TEST_F(PosePanelTest, SwitchesBelongToTheDocument) {
    const bool limits = document().pose.useLimits;
    click("Joint limits");
    EXPECT_NE(document().pose.useLimits, limits);
    const bool keep = document().pose.keepOrientation;
    click("Keep orientation");
    EXPECT_NE(document().pose.keepOrientation, keep);
}

TEST_F(PosePanelTest, TheRootIsMovedInMetres) {
    select("pelvis");
    type("Position X", "0.25");
    EXPECT_NEAR(shown().translation.x, 0.25f, 1e-5f);
}

} // namespace
} // namespace ars::ui
