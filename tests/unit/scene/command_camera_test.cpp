#include "tests/unit/scene/command_fixture.h"

#include <algorithm>
#include <cmath>

namespace ars::test {
namespace {

class Cameras : public Commands {
protected:
    const SceneCamera& camera() const { return document().camera.camera; }
    double distance() const { return glm::distance(camera().eye, camera().target); }
    /// Where a world point is seen, in a picture of 400x300.
    glm::dvec2 seen(const glm::dvec3& world) const {
        const Camera view = frameCamera(document(), assets, 0.0, 400, 300);
        return view.project(view.toCamera(world));
    }
    void start() {
        must("camera.set", {{"eye_x", 0.0},
                            {"eye_y", 1.0},
                            {"eye_z", 3.0},
                            {"target_x", 0.0},
                            {"target_y", 1.0},
                            {"target_z", 0.0},
                            {"field", 40.0}});
    }
};

TEST_F(Cameras, OrbitKeepsTheDistanceAndGoesToItsRight) {
    start();
    must("camera.orbit", {{"yaw", 90.0}, {"pitch", 0.0}});
    EXPECT_LT(glm::distance(camera().eye, glm::dvec3(3, 1, 0)), 1e-12);
    must("camera.orbit", {{"yaw", -33.0}, {"pitch", 25.0}});
    EXPECT_NEAR(distance(), 3.0, 1e-12);
    EXPECT_NEAR(camera().eye.y, 1.0 + 3.0 * std::sin(glm::radians(25.0)), 1e-12);
    EXPECT_EQ(camera().target, glm::dvec3(0, 1, 0));
}

TEST_F(Cameras, OrbitStopsBelowThePoleAndComesBackTheSameWay) {
    start();
    must("camera.orbit", {{"yaw", 30.0}, {"pitch", 500.0}});
    EXPECT_NEAR(camera().eye.y, 1.0 + 3.0 * std::sin(glm::radians(89.0)), 1e-9);
    must("camera.orbit", {{"yaw", -30.0}, {"pitch", -89.0}});
    EXPECT_LT(glm::distance(camera().eye, glm::dvec3(0, 1, 3)), 1e-9);
}

TEST_F(Cameras, LookTurnsAboutTheEye) {
    start();
    must("camera.look", {{"yaw", 90.0}, {"pitch", 0.0}});
    // It looked along -z; its right is +x.
    EXPECT_LT(glm::distance(camera().target, glm::dvec3(3, 1, 3)), 1e-12);
    EXPECT_EQ(camera().eye, glm::dvec3(0, 1, 3));
    must("camera.look", {{"yaw", 0.0}, {"pitch", 30.0}});
    EXPECT_NEAR(camera().target.y, 1.0 + 3.0 * 0.5, 1e-12);
}

TEST_F(Cameras, PanAndFlyMoveAlongThePicturesAxes) {
    start();
    must("camera.pan", {{"x", 0.5}, {"y", 0.25}});
    EXPECT_LT(glm::distance(camera().eye, glm::dvec3(0.5, 1.25, 3)), 1e-12);
    EXPECT_LT(glm::distance(camera().target, glm::dvec3(0.5, 1.25, 0)), 1e-12);
    start();
    must("camera.roll", {{"degrees", 90.0}}); // the picture turns clockwise, so its right is the world's up
    must("camera.fly", {{"right", 1.0}, {"up", 0.0}, {"forward", 2.0}});
    EXPECT_LT(glm::distance(camera().eye, glm::dvec3(0, 2, 1)), 1e-12);
    EXPECT_EQ(editor.undoLabel(), "Move camera") << "flights fold into one entry";
}

TEST_F(Cameras, DollyScalesTheDistance) {
    start();
    must("camera.dolly", {{"factor", 0.5}});
    EXPECT_LT(glm::distance(camera().eye, glm::dvec3(0, 1, 1.5)), 1e-12);
    for (int i = 0; i < 6; ++i) must("camera.dolly", {{"factor", 0.01}});
    EXPECT_NEAR(distance(), 0.02, 1e-12);
}

TEST_F(Cameras, FieldIsTheOpeningFromTopToBottom) {
    start();
    must("camera.field", {{"degrees", 90.0}});
    EXPECT_NEAR(seen({0, 4, 0}).y, 0.0, 1e-9); // 3 m above the axis at 3 m
    EXPECT_NE(refusal("camera.field", {{"degrees", 180.0}}), "");
    EXPECT_EQ(refusal("camera.set",
                      {{"eye_x", 1}, {"eye_y", 1}, {"eye_z", 1}, {"target_x", 1}, {"target_y", 1}, {"target_z", 1}}),
              "eye: expected at least 1 mm away from the target");
}

TEST_F(Cameras, PresetsShowTheWholeBody) {
    for (const char* pose : {"t_pose", "sit", "reach_up"}) {
        must("pose.preset", {{"name", pose}});
        const auto vertices = posedTemplate(assets.avatar->evaluator->mesh(), this->pose());
        for (const char* name : {"front", "back", "left", "right", "top", "three_quarter"}) {
            must("camera.preset", {{"name", name}});
            glm::dvec2 low(1e9), high(-1e9);
            for (const glm::vec3& vertex : vertices.value()) {
                const glm::dvec2 p = seen(glm::dvec3(vertex));
                low = glm::min(low, p);
                high = glm::max(high, p);
            }
            EXPECT_GE(std::min(low.x, low.y), 0.0) << pose << " " << name;
            EXPECT_LE(high.x, 400.0) << pose << " " << name;
            EXPECT_LE(high.y, 300.0) << pose << " " << name;
            EXPECT_GT(std::max((high.x - low.x) / 400.0, (high.y - low.y) / 300.0), 0.55) << pose << " " << name;
        }
    }
}

TEST_F(Cameras, PresetsLookFromTheirSide) {
    must("camera.preset", {{"name", "left"}});
    EXPECT_GT(camera().eye.x, 1.0);
    must("camera.preset", {{"name", "back"}});
    EXPECT_LT(camera().eye.z, -1.0);
    must("camera.preset", {{"name", "top"}});
    EXPECT_GT(camera().eye.y, 2.5);
}

TEST_F(Cameras, ClosePresetsHoldTheirPart) {
    must("pose.preset", {{"name", "contrapposto"}});
    const std::pair<const char*, const char*> cases[]{{"face", "head"},
                                                      {"left_hand", "left_middle1"},
                                                      {"right_hand", "right_middle1"},
                                                      {"feet", "left_ankle"},
                                                      {"upper_body", "spine3"}};
    for (const auto& [name, joint] : cases) {
        must("camera.preset", {{"name", name}});
        const auto world = jointWorldMatrices(skeleton(), pose());
        const glm::dvec2 p = seen(glm::dvec3(world[static_cast<std::size_t>(jointIndex(joint))][3]));
        EXPECT_GT(p.x, 80.0) << name;
        EXPECT_LT(p.x, 320.0) << name;
        EXPECT_GT(p.y, 40.0) << name;
        EXPECT_LT(p.y, 260.0) << name;
        EXPECT_LT(distance(), 2.5) << name;
    }
}

TEST_F(Cameras, FocusKeepsTheDirection) {
    start();
    must("camera.orbit", {{"yaw", 40.0}, {"pitch", 20.0}});
    const glm::dvec3 before = glm::normalize(camera().eye - camera().target);
    must("camera.focus", {{"joint", "left_wrist"}});
    EXPECT_LT(glm::distance(glm::normalize(camera().eye - camera().target), before), 1e-9);
    const auto world = jointWorldMatrices(skeleton(), pose());
    const glm::dvec3 hand(world[static_cast<std::size_t>(jointIndex("left_middle1"))][3]);
    EXPECT_LT(glm::distance(camera().target, hand), 0.08);
    must("camera.reset");
    EXPECT_EQ(camera(), newDocument().camera.camera);
}

TEST_F(Cameras, LeavingADatasetCameraChangesNothingToSee) {
    EXPECT_EQ(refusal("camera.dataset", {{"name", "cam0"}}), "no capture is open");
    openCapture();
    EXPECT_EQ(refusal("camera.leave_dataset"), "no dataset camera is looked through");
    must("camera.dataset", {{"name", "cam0"}});
    // A frame of the photograph's shape: only then do both cameras have the same field.
    const glm::dvec3 points[]{{0.2, 1.4, 0.1}, {-0.3, 0.2, -0.2}, {0.0, 0.9, 0.4}};
    std::vector<glm::dvec2> before;
    for (const glm::dvec3& p : points) before.push_back(seen(p));
    must("camera.leave_dataset");
    EXPECT_EQ(document().camera.datasetCamera, "");
    for (std::size_t i = 0; i < before.size(); ++i) EXPECT_LT(glm::distance(seen(points[i]), before[i]), 1e-6);
    EXPECT_LT(distance(), 4.0) << "its target lies near the body";
}

TEST_F(Cameras, MovingWhileADatasetCameraIsLookedThroughGoesOnFromThere) {
    openCapture();
    must("camera.dataset", {{"name", "cam1"}});
    must("camera.dolly", {{"factor", 1.0}});
    EXPECT_EQ(document().camera.datasetCamera, "");
    EXPECT_LT(glm::distance(camera().eye, assets.capture->cameras[1].camera.centerWorld()), 1e-9);
}

TEST_F(Cameras, NextAndPreviousGoAround) {
    openCapture();
    const auto name = [this] { return document().camera.datasetCamera; };
    must("camera.next_dataset");
    EXPECT_EQ(name(), "cam0");
    must("camera.previous_dataset");
    EXPECT_EQ(name(), "cam2");
    must("camera.next_dataset");
    EXPECT_EQ(name(), "cam0");
    must("camera.next_dataset");
    EXPECT_EQ(name(), "cam1");
    EXPECT_NE(refusal("camera.dataset", {{"name", "cam7"}}), "");
    must("camera.photograph", {{"frame", 3}});
    must("camera.close_capture");
    EXPECT_EQ(name(), "");
    EXPECT_EQ(document().camera.photograph, 0);
}

} // namespace
} // namespace ars::test
