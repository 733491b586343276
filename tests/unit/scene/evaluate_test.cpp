#include "engine/scene/evaluate.h"

#include "tests/unit/scene/command_fixture.h"

#include <algorithm>
#include <cmath>
#include <random>

namespace ars::test {
namespace {

template <typename Value>
Track<Value> track(std::initializer_list<std::pair<double, Value>> keys,
                   KeyInterpolation interpolation = KeyInterpolation::Smooth) {
    Track<Value> result;
    for (const auto& [time, value] : keys) result.push_back({time, value, interpolation});
    return result;
}

TEST(SampleTrack, GivesTheKeysThemselvesAndHoldsThemOutside) {
    for (const auto kind : {KeyInterpolation::Step, KeyInterpolation::Linear, KeyInterpolation::Smooth}) {
        const Track<float> keys = track<float>({{1.0, 3.0f}, {2.0, -1.0f}, {4.5, 7.0f}}, kind);
        for (const auto& key : keys) EXPECT_FLOAT_EQ(sampleTrack(keys, key.timeS), key.value);
        EXPECT_FLOAT_EQ(sampleTrack(keys, -5.0), 3.0f);
        EXPECT_FLOAT_EQ(sampleTrack(keys, 99.0), 7.0f);
    }
}

TEST(SampleTrack, StepHoldsAndLinearGoesStraight) {
    EXPECT_FLOAT_EQ(sampleTrack(track<float>({{0, 2.0f}, {1, 4.0f}}, KeyInterpolation::Step), 0.999), 2.0f);
    EXPECT_FLOAT_EQ(sampleTrack(track<float>({{0, 2.0f}, {1, 4.0f}}, KeyInterpolation::Linear), 0.25), 2.5f);
    const glm::vec3 between =
        sampleTrack(track<glm::vec3>({{0, {0, 1, 2}}, {2, {4, 1, 0}}}, KeyInterpolation::Linear), 0.5);
    EXPECT_FLOAT_EQ(between.x, 1.0f);
    EXPECT_FLOAT_EQ(between.y, 1.0f);
    EXPECT_FLOAT_EQ(between.z, 1.5f);
}

Track<float> randomTrack(std::mt19937& random) {
    std::uniform_real_distribution<double> gap(0.05, 1.5);
    std::uniform_real_distribution<float> value(-3.0f, 3.0f);
    Track<float> keys;
    double time = 0.0;
    for (int k = 0; k < 8; ++k) {
        keys.push_back({time, value(random), KeyInterpolation::Smooth});
        time += gap(random);
    }
    return keys;
}

TEST(SampleTrack, SmoothNumbersNeverLeaveTheRangeOfTheirTwoKeys) {
    std::mt19937 random(3);
    for (int round = 0; round < 50; ++round) {
        const Track<float> keys = randomTrack(random);
        for (std::size_t k = 0; k + 1 < keys.size(); ++k) {
            const auto [low, high] = std::minmax(keys[k].value, keys[k + 1].value);
            for (int i = 0; i <= 40; ++i) {
                const double t = keys[k].timeS + (keys[k + 1].timeS - keys[k].timeS) * i / 40.0;
                const float v = sampleTrack(keys, t);
                ASSERT_GE(v, low - 1e-5f);
                ASSERT_LE(v, high + 1e-5f);
            }
        }
    }
}

TEST(SampleTrack, SmoothNumbersHaveOneSlopeOnBothSidesOfAKeyAndNoneAtTheEnds) {
    // A ramp that never turns back, so that slopes are not zero by the limiter alone.
    const Track<float> keys = track<float>({{0, 0.0f}, {0.7, 1.0f}, {1.0, 2.0f}, {2.2, 3.0f}});
    const auto slope = [&](double a, double b) {
        return (double(sampleTrack(keys, b)) - double(sampleTrack(keys, a))) / (b - a);
    };
    constexpr double kStep = 1e-3; // float values of order 1: differences are good to about 1e-4
    for (const double t : {0.7, 1.0}) {
        EXPECT_NEAR(slope(t - kStep, t), slope(t, t + kStep), 0.05) << t;
        EXPECT_GT(slope(t, t + kStep), 0.5) << t;
    }
    EXPECT_NEAR(slope(0.0, kStep), 0.0, 0.02);
    EXPECT_NEAR(slope(2.2 - kStep, 2.2), 0.0, 0.02);
}

TEST(SampleTrack, SmoothIsExactForAStraightLineInside) {
    // Three equal steps: the middle segment of a parabola through collinear points is the line itself.
    const Track<float> keys = track<float>({{0, 0.0f}, {1, 1.0f}, {2, 2.0f}, {3, 3.0f}});
    for (const double t : {1.1, 1.25, 1.5, 1.9}) EXPECT_NEAR(sampleTrack(keys, t), t, 1e-6);
}

TEST(SampleTrack, RotationsAboutOneAxisMoveLikeTheirAngle) {
    std::mt19937 random(11);
    const glm::vec3 axis = glm::normalize(glm::vec3(0.3f, -0.8f, 0.5f));
    for (int round = 0; round < 20; ++round) {
        Track<float> angles = randomTrack(random); // neighbours less than half a turn apart after scaling
        Track<glm::quat> rotations;
        for (auto& key : angles) {
            key.value *= 0.5f;
            rotations.push_back({key.timeS, quatFromAxisAngle(key.value * axis), key.interpolation});
        }
        for (double t = 0.0; t < angles.back().timeS; t += 0.037) {
            // Slopes are limited axis by axis, which is the same as for the angle up to a common factor of the axis.
            const glm::quat expected = quatFromAxisAngle(sampleTrack(angles, t) * axis);
            ASSERT_LT(angleBetween(sampleTrack(rotations, t), expected), 0.05) << "at " << t;
        }
    }
}

TEST(SampleTrack, RotationsTakeTheShorterWayWhateverTheSign) {
    const glm::quat a = degreesAbout({0, 1, 0}, 10.0f), b = degreesAbout({0, 1, 0}, 50.0f);
    for (const auto kind : {KeyInterpolation::Linear, KeyInterpolation::Smooth}) {
        const Track<glm::quat> keys = track<glm::quat>({{0, a}, {1, -b}}, kind);
        EXPECT_LT(angleBetween(sampleTrack(keys, 0.5), degreesAbout({0, 1, 0}, 30.0f)), 0.02);
    }
}

TEST(SampleTrack, SmoothRotationsTurnWithoutAJerkAtKeys) {
    Track<glm::quat> keys;
    const glm::quat turns[]{degreesAbout({0, 1, 0}, 0.0f), degreesAbout({0.1f, 1, 0.1f}, 40.0f),
                            degreesAbout({0.3f, 1, 0.2f}, 95.0f), degreesAbout({0.3f, 1, 0.5f}, 140.0f)};
    const double times[]{0.0, 0.5, 1.3, 1.9};
    for (int k = 0; k < 4; ++k) keys.push_back({times[k], turns[k], KeyInterpolation::Smooth});
    // Body-fixed angular velocity by differences.
    const auto velocity = [&](double a, double b) {
        return glm::dvec3(axisAngleFromQuat(glm::inverse(sampleTrack(keys, a)) * sampleTrack(keys, b))) / (b - a);
    };
    constexpr double kStep = 4e-3;
    for (const double t : {0.5, 1.3}) {
        const glm::dvec3 left = velocity(t - kStep, t), right = velocity(t, t + kStep);
        EXPECT_GT(glm::length(left), 0.3) << t;
        EXPECT_LT(glm::length(left - right), 0.03 * glm::length(left) + 0.02) << t;
    }
}

TEST(SampleTrack, CamerasGoAroundTheirTargetOnACircle) {
    SceneCamera a, b, c;
    a.target = b.target = c.target = {0.1, 0.9, -0.2};
    const auto eye = [](double azimuthDeg) {
        const double angle = glm::radians(azimuthDeg);
        return glm::dvec3(0.1 + 3.0 * std::sin(angle), 1.5, -0.2 + 3.0 * std::cos(angle));
    };
    a.eye = eye(-170.0); // 340 degrees apart as numbers, 20 on the circle
    b.eye = eye(170.0);
    c.eye = eye(80.0);
    const Track<SceneCamera> keys = track<SceneCamera>({{0, a}, {1, b}, {2, c}});
    const double radius = glm::distance(a.eye, a.target);
    double farthestFromBack = -10.0;
    for (double t = 0.0; t <= 2.0; t += 0.02) {
        const SceneCamera camera = sampleTrack(keys, t);
        EXPECT_NEAR(glm::distance(camera.eye, camera.target), radius, 1e-9);
        EXPECT_NEAR(camera.eye.y, 1.5, 1e-9);
        if (t <= 1.0) farthestFromBack = std::max(farthestFromBack, camera.eye.z);
    }
    EXPECT_LT(farthestFromBack, -0.2 - 2.9) << "between -170 and 170 degrees it stays behind";
}

TEST(CameraOf, RollTurnsThePictureClockwise) {
    SceneCamera camera;
    camera.eye = {0, 1, 3};
    camera.target = {0, 1, 0};
    camera.rollDeg = 90.0;
    const Camera rolled = cameraOf(camera, 200, 100);
    const glm::dvec2 above = rolled.project(rolled.toCamera(glm::dvec3(0, 1.2, 0)));
    EXPECT_GT(above.x, 110.0) << "what was above is on the right";
    EXPECT_NEAR(above.y, 50.0, 1e-9);
    EXPECT_NEAR(glm::distance(rolled.centerWorld(), camera.eye), 0.0, 1e-12);
}

TEST(CameraOf, SceneCameraOfTakesItBack) {
    std::mt19937 random(5);
    std::uniform_real_distribution<double> place(-2.0, 2.0), roll(-179.0, 179.0), field(10.0, 90.0);
    for (int i = 0; i < 50; ++i) {
        SceneCamera camera;
        camera.eye = {place(random), place(random), place(random)};
        camera.target = camera.eye + glm::dvec3(place(random), 0.5 * place(random), 2.5);
        camera.rollDeg = roll(random);
        camera.verticalFieldDeg = field(random);
        const SceneCamera back = sceneCameraOf(cameraOf(camera, 640, 480), glm::distance(camera.eye, camera.target));
        EXPECT_LT(glm::distance(back.eye, camera.eye), 1e-9);
        EXPECT_LT(glm::distance(back.target, camera.target), 1e-9);
        EXPECT_NEAR(back.rollDeg, camera.rollDeg, 1e-7);
        EXPECT_NEAR(back.verticalFieldDeg, camera.verticalFieldDeg, 1e-9);
    }
}

class Evaluate : public Commands {};

TEST_F(Evaluate, DatasetCameraFitsItsPhotographIntoTheFrame) {
    openCapture();
    must("camera.dataset", {{"name", "cam1"}});
    const Camera original = assets.capture->cameras[1].camera;
    const glm::dvec3 point(0.2, 1.1, 0.1);
    const glm::dvec2 inPhotograph = original.project(original.toCamera(point));
    struct Case {
        int width, height;
        double left, top, scale;
    };
    // Wider than the photograph: bars left and right; taller: above and below.
    for (const Case& c : {Case{1000, 480, 180.0, 0.0, 1.0}, Case{320, 400, 0.0, 80.0, 0.5}}) {
        PixelRect rect;
        const Camera camera = frameCamera(document(), assets, 0.0, c.width, c.height, &rect);
        EXPECT_NEAR(rect.x, c.left, 1e-9);
        EXPECT_NEAR(rect.y, c.top, 1e-9);
        EXPECT_NEAR(rect.width, c.scale * 640, 1e-9);
        EXPECT_NEAR(rect.height, c.scale * 480, 1e-9);
        const glm::dvec2 seen = camera.project(camera.toCamera(point));
        EXPECT_NEAR(seen.x, c.left + c.scale * inPhotograph.x, 1e-9);
        EXPECT_NEAR(seen.y, c.top + c.scale * inPhotograph.y, 1e-9);
        EXPECT_EQ(camera.width, c.width);
        EXPECT_EQ(camera.height, c.height);
    }
}

TEST_F(Evaluate, JointKeysReplaceOrTurnOnto) {
    Document d;
    d.pose.pose.rotations[5] = degreesAbout({1, 0, 0}, 30.0f);
    d.timeline.joints = {{5, JointLayer::OnClip, track<glm::quat>({{0, degreesAbout({1, 0, 0}, 12.0f)}})},
                         {7, JointLayer::Absolute, track<glm::quat>({{0, degreesAbout({0, 1, 0}, 9.0f)}})}};
    const Pose shown = poseAt(d, assets, 0.3);
    EXPECT_LT(angleBetween(shown.rotations[5], degreesAbout({1, 0, 0}, 42.0f)), 0.05);
    EXPECT_LT(angleBetween(shown.rotations[7], degreesAbout({0, 1, 0}, 9.0f)), 0.05);
}

TEST_F(Evaluate, ClipPlaysFromItsOffset) {
    openClip();
    must("timeline.clip_offset", {{"time", 0.5}});
    const Motion motion = swingingClip();
    const glm::quat expected = motion.frames[15].rotations[static_cast<std::size_t>(jointIndex("left_elbow"))];
    EXPECT_LT(angleBetween(rotation("left_elbow", 1.0), expected), 0.05);
    EXPECT_NEAR(pose(1.0).translation.z, 0.3f, 1e-5f);
}

TEST_F(Evaluate, PoseOfAnotherSkeletonIsReplacedByTheRestPoseOnItsSoles) {
    Document d;
    d.pose.pose = restPose(20);
    d.pose.pose.rotations[3] = degreesAbout({1, 0, 0}, 80.0f);
    const Pose shown = poseAt(d, assets, 0.0);
    ASSERT_EQ(shown.rotations.size(), 55u);
    EXPECT_LT(angleBetween(shown.rotations[3], glm::quat(1, 0, 0, 0)), 1e-3);
    EXPECT_FLOAT_EQ(shown.translation.y, -assets.avatar->soleHeightM);
}

TEST_F(Evaluate, FrameInputsHoldEverythingOfTheMoment) {
    Document d = newDocument();
    d.timeline.lightExposureEv = track<float>({{0, 0.0f}, {1, 2.0f}}, KeyInterpolation::Linear);
    d.timeline.lightRotationDeg = track<float>({{0, 0.0f}, {1, 90.0f}}, KeyInterpolation::Linear);
    d.timeline.radii[3] = track<float>({{0, 0.05f}, {1, 0.15f}}, KeyInterpolation::Linear);
    d.occlusion.splat.twoSided = true;
    d.occlusion.posing.importanceFalloffM = 0.3f;
    d.occlusion.shading.f0 = 0.08f;
    d.occlusion.settings.method = OcclusionMethod::MeshRays;
    d.occlusion.settings.screenSpace.quality = OcclusionQuality::Interactive;
    const FrameInputs inputs = frameInputs(d, assets, 0.5, 320, 240);
    EXPECT_FLOAT_EQ(inputs.placement.scale, 2.0f); // 2^1
    EXPECT_FLOAT_EQ(inputs.placement.rotationDeg, 45.0f);
    EXPECT_FLOAT_EQ(inputs.radii[3], 0.10f);
    EXPECT_FLOAT_EQ(inputs.radii[0], d.occlusion.radii[0]);
    EXPECT_TRUE(inputs.splat == d.occlusion.splat);
    EXPECT_TRUE(inputs.posing == d.occlusion.posing);
    EXPECT_TRUE(inputs.shading == d.occlusion.shading);
    EXPECT_EQ(inputs.occlusion.method, OcclusionMethod::MeshRays);
    EXPECT_EQ(inputs.occlusion.screenSpace.quality, OcclusionQuality::Full);
    EXPECT_EQ(inputs.camera.width, 320);
    EXPECT_EQ(inputs.pose.rotations.size(), 55u);
}

} // namespace
} // namespace ars::test
