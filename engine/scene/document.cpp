#include "engine/scene/document.h"

namespace ars {

namespace {

/// How far the soles of the open body lie below its model's origin; the body lies near y = 0 with its middle. A
/// constant, because a window opens before the body has been read; a test holds it against the body.
constexpr float kOpenBodySolesM = 0.8181f;

} // namespace

bool PoseSection::operator==(const PoseSection& other) const {
    return pose.rotations == other.pose.rotations && pose.translation == other.pose.translation &&
           pose.expression == other.pose.expression && useLimits == other.useLimits &&
           keepOrientation == other.keepOrientation;
}

bool CompareSection::operator==(const CompareSection& other) const {
    const bool sameHeld = held == other.held || (held && other.held && *held == *other.held);
    return sameHeld && kind == other.kind && buffer == other.buffer && file == other.file && layer == other.layer &&
           measure == other.measure && splitPosition == other.splitPosition;
}

Document newDocument() {
    Document document;
    Pose& pose = document.pose.pose;
    const auto turn = [&pose](const char* joint, const glm::vec3& axisAngle) {
        pose.rotations[static_cast<std::size_t>(smplxJointIndex(joint))] = quatFromAxisAngle(axisAngle);
    };
    // Arms hanging a little away from the body, elbows slightly bent: how people stand when they are looked at.
    turn("left_shoulder", {0.05f, 0.0f, -1.12f});
    turn("right_shoulder", {0.05f, 0.0f, 1.12f});
    turn("left_elbow", {0.0f, -0.22f, 0.0f});
    turn("right_elbow", {0.0f, 0.22f, 0.0f});
    pose.translation.y = kOpenBodySolesM;
    // The whole body of 1.75 m with some air above the head and below the feet.
    document.camera.camera.eye = {0.0, 1.0, 3.9};
    document.camera.camera.target = {0.0, 0.9, 0.0};
    return document;
}

} // namespace ars
