#pragma once

#include "engine/rig/motion.h"
#include "engine/scene/command.h"
#include "engine/scene/editor.h"
#include "engine/scene/evaluate.h"
#include "tests/support/test_data.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <string>

namespace ars::test {

/// The open body with a few hundred surfels; read once.
inline std::shared_ptr<const AvatarAsset> openBody() {
    static const std::shared_ptr<const AvatarAsset> body = [] {
        AvatarSection section;
        section.rest.maxSurfels = 300;
        auto loaded = loadAvatarAsset(section);
        return loaded ? loaded.value() : nullptr;
    }();
    return body;
}

inline int jointIndex(const char* name) { return smplxJointIndex(name); }

inline glm::quat degreesAbout(const glm::vec3& axis, float degrees) {
    return quatFromAxisAngle(glm::radians(degrees) * glm::normalize(axis));
}

/// Two seconds of a person who walks along z and swings the left elbow.
inline Motion swingingClip() {
    Motion motion;
    motion.name = "swing";
    motion.framesPerSecond = 30.0;
    for (int f = 0; f <= 60; ++f) {
        Pose pose = restPose(kSmplxJointCount);
        pose.rotations[static_cast<std::size_t>(jointIndex("left_elbow"))] =
            degreesAbout({0, 1, 0}, -30.0f * std::sin(0.1f * static_cast<float>(f)));
        pose.translation = {0.0f, 0.8f, 0.02f * static_cast<float>(f)};
        motion.frames.push_back(std::move(pose));
    }
    return motion;
}

/// Three cameras around the body; the first with its principal point in the middle.
inline std::vector<CalibratedCamera> threeCameras() {
    std::vector<CalibratedCamera> cameras;
    const glm::dvec3 eyes[]{{0.3, 1.2, 3.0}, {2.5, 0.8, 1.0}, {-1.0, 1.5, -2.5}};
    for (int i = 0; i < 3; ++i) {
        CalibratedCamera camera;
        camera.name = "cam" + std::to_string(i);
        camera.camera = lookAtCamera(eyes[i], {0.05, 0.9, -0.1}, 40.0, 640, 480);
        if (i > 0) camera.camera.cx += 25.0;
        cameras.push_back(std::move(camera));
    }
    return cameras;
}

/// Runs commands as the session does, without its threads.
class Commands : public ::testing::Test {
protected:
    void SetUp() override {
        assets.avatar = openBody();
        ASSERT_TRUE(assets.avatar) << "the open body could not be loaded";
    }

    Status run(const std::string& id, const Arguments& arguments = Arguments::object()) {
        context.timeS = time < 0.0 ? editor.document().timeline.timeS : time;
        return editor.run(id, arguments, context);
    }
    /// Fails the test with the error's sentence.
    void must(const std::string& id, const Arguments& arguments = Arguments::object()) {
        const Status status = run(id, arguments);
        ASSERT_TRUE(status) << id << ": " << status.error().describe();
    }
    std::string refusal(const std::string& id, const Arguments& arguments = Arguments::object()) {
        const Document before = document();
        const Status status = run(id, arguments);
        EXPECT_TRUE(document() == before) << id << " changed the document though it failed";
        return status ? "" : status.error().describe();
    }
    const Document& document() const { return editor.document(); }
    Pose pose(double timeS = 0.0) const { return poseAt(document(), assets, timeS); }
    glm::quat rotation(const char* joint, double timeS = 0.0) const {
        return pose(timeS).rotations[static_cast<std::size_t>(jointIndex(joint))];
    }
    const Skeleton& skeleton() const { return assets.avatar->evaluator->rig().skeleton; }

    void openClip() {
        auto clip = std::make_shared<ClipAsset>();
        clip->motion = std::make_shared<const Motion>(swingingClip());
        TimelineSection timeline;
        timeline.clip = "/clips/swing.npz";
        clip->key = clipKey(timeline);
        assets.clip = clip;
        must("timeline.open_clip", {{"file", timeline.clip}});
    }
    void openCapture() {
        auto capture = std::make_shared<CaptureAsset>();
        capture->cameras = threeCameras();
        assets.capture = capture;
        must("camera.open_capture", {{"file", "/capture/calibration_full.json"}});
    }

    SceneAssets assets;
    Clipboard clipboard;
    CommandContext context{assets, clipboard, 0.0};
    Editor editor;
    double time = -1.0; ///< on the screen; negative: the document's
};

/// Angle between two rotations, degrees; exact for small ones, too.
inline double angleBetween(const glm::quat& a, const glm::quat& b) {
    const glm::dquat p = glm::normalize(glm::dquat(a)), q = glm::normalize(glm::dquat(b));
    const auto chord = [](const glm::dquat& u, const glm::dquat& v) {
        return std::sqrt((u.w - v.w) * (u.w - v.w) + (u.x - v.x) * (u.x - v.x) + (u.y - v.y) * (u.y - v.y) +
                         (u.z - v.z) * (u.z - v.z));
    };
    return glm::degrees(4.0 * std::asin(std::min(0.5 * std::min(chord(p, q), chord(p, -q)), 1.0)));
}

} // namespace ars::test
