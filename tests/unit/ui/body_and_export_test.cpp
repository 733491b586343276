// What a person makes of the open body, its sliders of shape and expression, and the files that the File menu writes of
// it.
#include "engine/rig/gltf_rig.h"
#include "engine/rig/motion_import.h"
#include "engine/scene/evaluate.h"
#include "tests/unit/ui/look_support.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace ars::ui {
namespace {

constexpr float kElbowDeg = 60.0f;

float angleDeg(const glm::quat& q) { return glm::degrees(2.0f * std::acos(std::min(1.0f, std::abs(q.w)))); }

class BodyAndExport : public test::PanelTest {
protected:
    void SetUp() override {
        ::setenv("ARS_FILE_CHOOSER", "internal", 1);
        open("pose", "Pose");
        if (HasFatalFailure()) return;
        ASSERT_TRUE(studio_.window().settle(120.0));
    }
    void unfold(const char* section) {
        act([&](ImGuiTestContext* context) { context->ItemOpen(section); });
    }
    void type(const char* item, const char* text) {
        act([&](ImGuiTestContext* context) { context->ItemInputValue(item, text); });
    }
    const AvatarEvaluator& avatar() { return *session().assets().avatar->evaluator; }
    /// The file that an entry of the File menu writes.
    std::filesystem::path written(const char* entry, const char* name) {
        const std::filesystem::path file = studio_.folder() / name;
        studio_.act([&](ImGuiTestContext* person) {
            person->SetRef("##MainMenuBar");
            person->MenuClick((std::string("File/") + entry).c_str());
            person->Yield(3);
            person->ItemInputValue("//###FileChooser/Name", file.c_str());
            person->Yield(2);
        });
        EXPECT_TRUE(studio_.waitFor([&] { return std::filesystem::exists(file) && session().jobs().empty(); })) << name;
        return file;
    }
    void bendTheElbow() {
        const Status bent =
            session().run("pose.rotate_joint", {{"joint", "left_elbow"}, {"x", 0.0}, {"y", -kElbowDeg}, {"z", 0.0}});
        ASSERT_TRUE(bent.ok()) << bent.error().describe();
    }
    float elbowDeg(const Pose& pose) {
        return angleDeg(pose.rotations[static_cast<std::size_t>(smplxJointIndex("left_elbow"))]);
    }
};

TEST_F(BodyAndExport, AShapeSliderMakesAnotherBodyAndResetTheFirst) {
    const std::vector<glm::vec3> before = avatar().mesh().mesh.positions;
    unfold("Shape");
    type("**/###Weight", "1.5");
    const std::vector<float>& betas = document().avatar.betas;
    ASSERT_GE(betas.size(), 2u);
    EXPECT_FLOAT_EQ(betas[1], 1.5f) << "\"weight\" is the body's second direction";
    EXPECT_EQ(std::count(betas.begin(), betas.end(), 0.0f), static_cast<std::ptrdiff_t>(betas.size()) - 1);
    ASSERT_TRUE(studio_.waitFor([&] { return avatar().mesh().mesh.positions != before; }, 60.0));
    float widest = 0.0f;
    for (std::size_t i = 0; i < before.size(); ++i)
        widest = std::max(widest, glm::distance(before[i], avatar().mesh().mesh.positions[i]));
    EXPECT_GT(widest, 0.01f);
    click("**/Reset shape");
    EXPECT_TRUE(studio_.waitFor([&] { return avatar().mesh().mesh.positions == before; }, 60.0));
}

TEST_F(BodyAndExport, AnExpressionSliderMovesTheFaceAlone) {
    const auto before = session().frame()->surfelMeans;
    unfold("Expression");
    type("**/###Jaw open", "2");
    const Pose pose = poseAt(document(), session().assets(), 0.0);
    ASSERT_FALSE(pose.expression.empty());
    EXPECT_FLOAT_EQ(pose.expression[0], 2.0f);
    ASSERT_TRUE(studio_.window().settle(120.0));
    const auto after = session().frame()->surfelMeans;
    ASSERT_EQ(before->size(), after->size());
    // A jaw that opens wide reaches below the neck's joint, but never as far as the chest's.
    const int chest = avatar().rig().skeleton.find("spine3");
    const float below = session().frame()->jointWorld[static_cast<std::size_t>(chest)][3].y;
    std::size_t moved = 0;
    for (std::size_t i = 0; i < before->size(); ++i) {
        if ((*before)[i] == (*after)[i]) continue;
        ++moved;
        EXPECT_GT((*after)[i].y, below) << "a surfel below the head";
    }
    EXPECT_GT(moved, 10u);
    click("**/Reset expression");
    const std::vector<float> face = poseAt(document(), session().assets(), 0.0).expression;
    EXPECT_TRUE(std::all_of(face.begin(), face.end(), [](float value) { return value == 0.0f; }));
}

TEST_F(BodyAndExport, ThePoseIsWrittenWithTheBodysShape) {
    bendTheElbow();
    ASSERT_TRUE(session().run("avatar.shape", {{"index", 1}, {"value", 0.75}}).ok());
    const auto motion = readMotionNpz(written("Export pose...", "pose.npz"));
    ASSERT_TRUE(motion.ok()) << motion.error().describe();
    ASSERT_EQ(motion->frames.size(), 1u);
    EXPECT_NEAR(elbowDeg(motion->frames[0]), kElbowDeg, 0.01f);
    ASSERT_GE(motion->betas.size(), 2u);
    EXPECT_FLOAT_EQ(motion->betas[1], 0.75f);
}

TEST_F(BodyAndExport, TheTimelineIsWrittenFrameByFrameAsNpzAndAsBvh) {
    bendTheElbow();
    const TimelineSection& timeline = document().timeline;
    const auto frames =
        static_cast<std::size_t>(std::lround((timeline.endS - timeline.startS) * timeline.framesPerSecond)) + 1;
    const auto npz = readMotionNpz(written("Export motion...", "motion.npz"));
    ASSERT_TRUE(npz.ok()) << npz.error().describe();
    EXPECT_EQ(npz->frames.size(), frames);
    EXPECT_NEAR(elbowDeg(npz->frames.back()), kElbowDeg, 0.01f);
    MotionImportOptions asItIs;
    asItIs.skipLeadIn = false;
    const auto bvh = importMotion(written("Export motion as BVH...", "motion.bvh"), avatar().rig().skeleton, asItIs);
    ASSERT_TRUE(bvh.ok()) << bvh.error().describe();
    EXPECT_EQ(bvh->frames.size(), frames);
    EXPECT_NEAR(elbowDeg(bvh->frames.front()), kElbowDeg, 0.1f);
}

TEST_F(BodyAndExport, ThePosedAvatarIsAGltfOfTheSameMesh) {
    bendTheElbow();
    const auto rig = readGltfRig(written("Export posed avatar as glTF...", "posed.glb"));
    ASSERT_TRUE(rig.ok()) << rig.error().describe();
    EXPECT_EQ(rig->mesh.triangles.size(), avatar().mesh().mesh.triangles.size());
    EXPECT_EQ(rig->skeleton.jointCount(), avatar().rig().skeleton.jointCount());
    EXPECT_GE(rig->skeleton.find("left_elbow"), 0);
}

} // namespace
} // namespace ars::ui
