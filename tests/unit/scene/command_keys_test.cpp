#include "tests/unit/scene/command_fixture.h"

#include <algorithm>
#include <cmath>

namespace ars::test {
namespace {

Arguments elbow(double y) { return {{"joint", "left_elbow"}, {"x", 0.0}, {"y", y}, {"z", 0.0}}; }

class Keys : public Commands {
protected:
    glm::quat clipElbow(double timeS) const {
        return sampleMotion(swingingClip(), timeS).rotations[static_cast<std::size_t>(jointIndex("left_elbow"))];
    }
    const JointTrack* track(const char* joint) const {
        for (const JointTrack& track : document().timeline.joints) {
            if (track.joint == jointIndex(joint)) return &track;
        }
        return nullptr;
    }
    void seek(double timeS) { must("timeline.seek", {{"time", timeS}}); }
};

TEST_F(Keys, AnEditOnAClipIsSeenAtItsTimeAndGoneOutsideItsGuards) {
    openClip();
    seek(1.0);
    must("pose.rotate_joint", elbow(-100.0));
    EXPECT_LT(angleBetween(rotation("left_elbow", 1.0), degreesAbout({0, 1, 0}, -100.0f)), 1e-3);
    for (const double t : {0.0, 0.3, 0.5, 1.5, 1.8, 2.0}) {
        EXPECT_LT(angleBetween(rotation("left_elbow", t), clipElbow(t)), 1e-3) << t;
    }
    EXPECT_GT(angleBetween(rotation("left_elbow", 0.8), clipElbow(0.8)), 5.0) << "it comes gradually";
    EXPECT_EQ(track("right_elbow"), nullptr) << "other joints have no keys";
    EXPECT_EQ(document().pose.pose.rotations, newDocument().pose.pose.rotations) << "the pose below is untouched";
}

TEST_F(Keys, ASecondCorrectionFarAwayFadesByItself) {
    openClip();
    seek(0.5);
    must("pose.rotate_joint", elbow(-100.0));
    seek(1.7);
    must("pose.rotate_joint", elbow(-120.0));
    for (const double t : {1.05, 1.15}) EXPECT_LT(angleBetween(rotation("left_elbow", t), clipElbow(t)), 1e-3) << t;
    EXPECT_LT(angleBetween(rotation("left_elbow", 0.5), degreesAbout({0, 1, 0}, -100.0f)), 1e-3);
    EXPECT_LT(angleBetween(rotation("left_elbow", 1.7), degreesAbout({0, 1, 0}, -120.0f)), 1e-3);
}

TEST_F(Keys, ADragOnAClipIsOneKeyBetweenTwoGuards) {
    openClip();
    seek(1.0);
    for (int i = 1; i <= 20; ++i) must("pose.rotate_joint", elbow(-5.0 * i));
    ASSERT_NE(track("left_elbow"), nullptr);
    EXPECT_EQ(track("left_elbow")->keys.size(), 3u);
    EXPECT_EQ(track("left_elbow")->layer, JointLayer::OnClip);
}

TEST_F(Keys, TheBodyGoesOnWalkingAroundACorrectionOfItsPlace) {
    openClip();
    seek(1.0);
    const glm::vec3 walking = pose(1.0).translation;
    must("pose.move_root", {{"x", 0.4}, {"y", 0.9}, {"z", double(walking.z)}});
    EXPECT_LT(glm::distance(pose(1.0).translation, glm::vec3(0.4f, 0.9f, walking.z)), 1e-5f);
    for (const double t : {0.2, 0.5, 1.5, 2.0}) {
        EXPECT_LT(glm::distance(pose(t).translation, sampleMotion(swingingClip(), t).translation), 1e-5f) << t;
    }
}

TEST_F(Keys, ClosingTheClipKeepsCorrectionsOnThePoseBelow) {
    must("pose.move_root", {{"x", 0.0}, {"y", 0.8}, {"z", 0.0}});
    openClip();
    seek(1.0);
    must("pose.move_root", {{"x", 0.4}, {"y", 0.8}, {"z", 0.6}});
    const glm::vec3 correction = pose(1.0).translation - sampleMotion(swingingClip(), 1.0).translation;
    must("timeline.close_clip");
    assets.clip = nullptr;
    EXPECT_LT(glm::distance(pose(1.0).translation, glm::vec3(0.0f, 0.8f, 0.0f) + correction), 1e-5f);
    EXPECT_EQ(refusal("timeline.close_clip"), "no clip is open");
}

TEST_F(Keys, WithoutClipAndKeysEditsChangeThePose) {
    seek(1.0);
    must("pose.rotate_joint", elbow(-50.0));
    must("camera.orbit", {{"yaw", 10.0}, {"pitch", 0.0}});
    must("light.rotate", {{"degrees", 40.0}});
    must("occlusion.radius", {{"part", "torso"}, {"metres", 0.3}});
    EXPECT_TRUE(document().timeline.joints.empty());
    EXPECT_TRUE(document().timeline.camera.empty());
    EXPECT_TRUE(document().timeline.lightRotationDeg.empty());
    EXPECT_LT(angleBetween(document().pose.pose.rotations[static_cast<std::size_t>(jointIndex("left_elbow"))],
                           degreesAbout({0, 1, 0}, -50.0f)),
              1e-3);
    EXPECT_FLOAT_EQ(document().light.rotationDeg, 40.0f);
}

TEST_F(Keys, AutomaticKeysTakeEveryEdit) {
    must("timeline.auto_key", {{"enabled", true}});
    const Document before = document();
    for (const double t : {0.0, 1.0}) {
        seek(t);
        must("pose.rotate_joint", elbow(-30.0 - 40.0 * t));
        must("light.rotate", {{"degrees", 90.0 * t}});
        must("light.exposure", {{"ev", t}});
        must("occlusion.radius", {{"part", "torso"}, {"metres", 0.2 + 0.1 * t}});
        must("camera.orbit", {{"yaw", 20.0}, {"pitch", 0.0}});
        must("pose.move_root", {{"x", t}, {"y", 0.8}, {"z", 0.0}});
    }
    EXPECT_TRUE(document().pose == before.pose);
    EXPECT_TRUE(document().light == before.light);
    EXPECT_TRUE(document().camera == before.camera);
    EXPECT_LT(angleBetween(rotation("left_elbow", 0.5), degreesAbout({0, 1, 0}, -50.0f)), 1e-3) << "half way";
    EXPECT_NEAR(placementAt(document(), 0.5).rotationDeg, 45.0f, 1e-3f);
    EXPECT_NEAR(placementAt(document(), 1.0).scale, 2.0f, 1e-5f);
    EXPECT_NEAR(radiiAt(document(), 0.5)[0], 0.25f, 1e-6f);
    EXPECT_NEAR(pose(0.5).translation.x, 0.5f, 1e-6f);
    EXPECT_EQ(document().timeline.camera.size(), 2u);
}

TEST_F(Keys, ATrackThatExistsTakesEditsWithoutAutomaticKeys) {
    must("timeline.key", {{"track", "light_rotation"}});
    seek(2.0);
    must("light.rotate", {{"degrees", 120.0}});
    EXPECT_EQ(document().timeline.lightRotationDeg.size(), 2u);
    EXPECT_FLOAT_EQ(placementAt(document(), 2.0).rotationDeg, 120.0f);
    EXPECT_FLOAT_EQ(placementAt(document(), 0.0).rotationDeg, 0.0f);
}

TEST_F(Keys, KeyingChangesNothingToSee) {
    must("pose.preset", {{"name", "fighter"}});
    const Pose before = pose(0.0);
    const SceneCamera camera = cameraAt(document(), 0.0);
    must("timeline.key", {{"track", "all"}});
    const Pose after = pose(0.0);
    EXPECT_EQ(after.rotations, before.rotations);
    EXPECT_EQ(after.translation, before.translation);
    EXPECT_EQ(cameraAt(document(), 0.0), camera);
    const std::vector<std::string> keyed = keyedTracks(document(), context);
    for (const char* track :
         {"joint:left_elbow", "root", "camera", "light_rotation", "light_exposure", "radius:knee"}) {
        EXPECT_NE(std::find(keyed.begin(), keyed.end(), track), keyed.end()) << track;
    }
}

TEST_F(Keys, PosesAreKeyedOneAfterTheOther) {
    must("pose.preset", {{"name", "t_pose"}});
    must("timeline.key", {{"track", "pose"}});
    seek(1.0);
    must("pose.preset", {{"name", "sit"}});
    const Pose sitting = pose(1.0);
    const auto knee = static_cast<std::size_t>(jointIndex("left_knee"));
    const double bend = angleBetween(sitting.rotations[knee], glm::quat(1, 0, 0, 0));
    EXPECT_GT(bend, 40.0);
    // A joint that was at rest when the first pose was keyed stays at rest there and bends on the way.
    EXPECT_LT(angleBetween(rotation("left_knee", 0.0), glm::quat(1, 0, 0, 0)), 1e-3);
    EXPECT_NEAR(angleBetween(rotation("left_knee", 0.5), glm::quat(1, 0, 0, 0)), 0.5 * bend, 0.1);
    EXPECT_LT(pose(1.0).translation.y, pose(0.0).translation.y - 0.3f) << "the body sits down";
}

TEST_F(Keys, MoveCopyAndDeleteSayWhichKeysTheyMean) {
    must("light.rotate", {{"degrees", 10.0}});
    must("timeline.key", {{"track", "light_rotation"}});
    must("timeline.copy_key", {{"track", "light_rotation"}, {"from", 0.0}, {"to", 2.0}});
    must("timeline.move_key", {{"track", "light_rotation"}, {"from", 2.0}, {"to", 3.0}});
    must("timeline.interpolation", {{"track", "light_rotation"}, {"time", 0.0}, {"kind", "step"}});
    const Track<float>& keys = document().timeline.lightRotationDeg;
    ASSERT_EQ(keys.size(), 2u);
    EXPECT_DOUBLE_EQ(keys[1].timeS, 3.0);
    EXPECT_FLOAT_EQ(keys[1].value, 10.0f);
    EXPECT_EQ(keys[0].interpolation, KeyInterpolation::Step);
    EXPECT_EQ(refusal("timeline.delete_key", {{"track", "light_rotation"}, {"time", 1.0}}),
              "light_rotation: has no key at 1 s");
    EXPECT_EQ(refusal("timeline.delete_key", {{"track", "camera"}, {"time", 0.0}}), "camera: has no keys");
    must("timeline.move_key", {{"track", "light_rotation"}, {"from", 3.0}, {"to", 0.0}});
    EXPECT_EQ(document().timeline.lightRotationDeg.size(), 1u) << "the key that was there gives way";
    must("timeline.delete_key", {{"track", "light_rotation"}, {"time", 0.0}});
    EXPECT_TRUE(document().timeline.lightRotationDeg.empty());
    must("timeline.key", {{"track", "joint:head"}});
    ASSERT_EQ(document().timeline.joints.size(), 1u);
    must("timeline.delete_key", {{"track", "all"}, {"time", 0.0}});
    EXPECT_TRUE(document().timeline.joints.empty()) << "a joint without keys has no track";
}

TEST_F(Keys, ClearingTakesThemAll) {
    must("timeline.key", {{"track", "all"}});
    must("timeline.clear_track", {{"track", "radii"}});
    for (const auto& track : document().timeline.radii) EXPECT_TRUE(track.empty());
    must("timeline.clear_track", {{"track", "all"}});
    EXPECT_TRUE(keyedTracks(document(), context).empty());
    EXPECT_EQ(refusal("timeline.clear_track", {{"track", "pose"}}), "pose: has no keys");
}

TEST_F(Keys, TheSelectedJointIsKeyed) {
    EXPECT_EQ(refusal("timeline.key", {{"track", "joint:selected"}}), "no joint is selected");
    must("view.select_joint", {{"joint", "neck"}});
    must("timeline.key", {{"track", "joint:selected"}});
    EXPECT_NE(track("neck"), nullptr);
}

TEST_F(Keys, OpeningAClipSetsTheRangeToIt) {
    openClip();
    EXPECT_DOUBLE_EQ(document().timeline.startS, 0.0);
    EXPECT_DOUBLE_EQ(document().timeline.endS, 2.0); // 61 frames at 30/s
    EXPECT_NE(refusal("timeline.range", {{"start", 2.0}, {"end", 2.0}}), "");
    must("timeline.range", {{"start", 0.5}, {"end", 1.5}});
    must("timeline.rate", {{"fps", 24.0}});
    must("timeline.speed", {{"factor", 0.5}});
    EXPECT_DOUBLE_EQ(document().timeline.framesPerSecond, 24.0);
    EXPECT_DOUBLE_EQ(document().timeline.speed, 0.5);
}

} // namespace
} // namespace ars::test
