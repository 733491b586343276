#include "engine/scene/evaluate.h"

#include "engine/scene/evaluate_tracks.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace ars {
namespace {

constexpr double kDegrees = 180.0 / std::numbers::pi;
/// Cameras of a capture whose file has no picture of use are taken as looking at something so far away.
constexpr double kSmallestDistance = 1e-6;

/// The pose that a skeleton of `joints` joints takes when the document's belongs to another one.
Pose standingRest(const AvatarAsset& avatar, int joints) {
    Pose pose = restPose(joints);
    pose.translation.y = -avatar.soleHeightM;
    return pose;
}

int jointCountOf(const SceneAssets& assets) {
    return assets.avatar && assets.avatar->evaluator ? assets.avatar->evaluator->rig().skeleton.jointCount() : 0;
}

bool fits(const Pose& pose, int joints) { return joints == 0 || static_cast<int>(pose.rotations.size()) == joints; }

} // namespace

Pose basePose(const Document& document, const SceneAssets& assets, double timeS) {
    const int joints = jointCountOf(assets);
    const TimelineSection& timeline = document.timeline;
    if (!timeline.clip.empty() && assets.clip && assets.clip->motion && !assets.clip->motion->frames.empty()) {
        Pose pose = sampleMotion(*assets.clip->motion, timeS - timeline.clipOffsetS);
        if (fits(pose, joints)) return pose;
    }
    const Pose& still = document.pose.pose;
    return fits(still, joints) ? still : standingRest(*assets.avatar, joints);
}

Pose poseAt(const Document& document, const SceneAssets& assets, double timeS) {
    const TimelineSection& timeline = document.timeline;
    Pose pose = basePose(document, assets, timeS);
    for (const JointTrack& track : timeline.joints) {
        if (track.keys.empty() || track.joint < 0 || track.joint >= static_cast<int>(pose.rotations.size())) continue;
        glm::quat& rotation = pose.rotations[static_cast<std::size_t>(track.joint)];
        const glm::quat key = sampleTrack(track.keys, timeS);
        rotation = track.layer == JointLayer::OnClip ? glm::normalize(rotation * key) : key;
    }
    if (!timeline.root.empty()) {
        // On a clip the root's keys are a correction like those of joints, so that the body goes on walking.
        const glm::vec3 key = sampleTrack(timeline.root, timeS);
        pose.translation = timeline.clip.empty() ? key : pose.translation + key;
    }
    if (!timeline.expression.empty()) pose.expression = sampleTrack(timeline.expression, timeS);
    return pose;
}

SceneCamera cameraAt(const Document& document, double timeS) {
    const Track<SceneCamera>& track = document.timeline.camera;
    return track.empty() ? document.camera.camera : sampleTrack(track, timeS);
}

PartRadii radiiAt(const Document& document, double timeS) {
    PartRadii radii = document.occlusion.radii;
    for (std::size_t p = 0; p < radii.size(); ++p) {
        const Track<float>& track = document.timeline.radii[p];
        if (!track.empty()) radii[p] = sampleTrack(track, timeS);
    }
    return radii;
}

EnvironmentPlacement placementAt(const Document& document, double timeS) {
    const TimelineSection& timeline = document.timeline;
    const LightSection& light = document.light;
    const float rotation =
        timeline.lightRotationDeg.empty() ? light.rotationDeg : sampleTrack(timeline.lightRotationDeg, timeS);
    const float exposure =
        timeline.lightExposureEv.empty() ? light.exposureEv : sampleTrack(timeline.lightExposureEv, timeS);
    return {rotation, std::exp2(exposure)};
}

Camera cameraOf(const SceneCamera& camera, int width, int height) {
    Camera result = lookAtCamera(camera.eye, camera.target, camera.verticalFieldDeg, width, height);
    if (camera.rollDeg != 0.0) {
        // Image axes are x right, y down: a positive angle takes x towards y, which is clockwise as people see it.
        const double angle = camera.rollDeg / kDegrees, c = std::cos(angle), s = std::sin(angle);
        const glm::dmat3 roll(glm::dvec3(c, s, 0.0), glm::dvec3(-s, c, 0.0), glm::dvec3(0.0, 0.0, 1.0));
        result.rotation = roll * result.rotation;
        result.translation = -(result.rotation * camera.eye);
    }
    return result;
}

SceneCamera sceneCameraOf(const Camera& camera, double distanceM) {
    SceneCamera result;
    const glm::dmat3 axes = glm::transpose(camera.rotation); // columns: right, down, forward in world space
    result.eye = camera.centerWorld();
    result.target = result.eye + std::max(distanceM, kSmallestDistance) * axes[2];
    result.verticalFieldDeg = 2.0 * std::atan(0.5 * camera.height / camera.fy) * kDegrees;
    const Camera upright = lookAtCamera(result.eye, result.target, result.verticalFieldDeg, 2, 2);
    const glm::dmat3 roll = camera.rotation * glm::transpose(upright.rotation);
    result.rollDeg = std::atan2(roll[0][1], roll[0][0]) * kDegrees;
    return result;
}

Camera frameCamera(const Document& document, const SceneAssets& assets, double timeS, int width, int height,
                   PixelRect* photographRect) {
    if (photographRect) *photographRect = {0.0, 0.0, static_cast<double>(width), static_cast<double>(height)};
    const std::string& name = document.camera.datasetCamera;
    if (name.empty() || !assets.capture) return cameraOf(cameraAt(document, timeS), width, height);
    for (const CalibratedCamera& candidate : assets.capture->cameras) {
        if (candidate.name != name) continue;
        Camera camera = candidate.camera;
        const double scale =
            std::min(static_cast<double>(width) / camera.width, static_cast<double>(height) / camera.height);
        const double left = 0.5 * (width - scale * camera.width), top = 0.5 * (height - scale * camera.height);
        if (photographRect) *photographRect = {left, top, scale * camera.width, scale * camera.height};
        camera.fx *= scale;
        camera.fy *= scale;
        camera.cx = camera.cx * scale + left;
        camera.cy = camera.cy * scale + top;
        camera.width = width;
        camera.height = height;
        return camera;
    }
    return cameraOf(cameraAt(document, timeS), width, height);
}

FrameInputs frameInputs(const Document& document, const SceneAssets& assets, double timeS, int width, int height) {
    FrameInputs inputs;
    inputs.pose = poseAt(document, assets, timeS);
    inputs.camera = frameCamera(document, assets, timeS, width, height);
    inputs.radii = radiiAt(document, timeS);
    inputs.placement = placementAt(document, timeS);
    inputs.splat = document.occlusion.splat;
    inputs.posing = document.occlusion.posing;
    inputs.occlusion = document.occlusion.settings;
    inputs.occlusion.screenSpace.quality = OcclusionQuality::Full;
    inputs.shading = document.occlusion.shading;
    return inputs;
}

} // namespace ars
