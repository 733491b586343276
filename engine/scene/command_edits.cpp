#include "engine/scene/command_edits.h"

#include "engine/rig/skinning.h"
#include "engine/scene/command_arguments.h"
#include "engine/scene/evaluate.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace ars::edit {
namespace {

const glm::quat kIdentity(1.0f, 0.0f, 0.0f, 0.0f);

/// A pose of another skeleton (the avatar was changed) gives way to the present one's, with the keys of its joints.
void adoptSkeleton(Document& document, const CommandContext& context) {
    const Skeleton* skeleton = skeletonOf(context);
    if (!skeleton || static_cast<int>(document.pose.pose.rotations.size()) == skeleton->jointCount()) return;
    TimelineSection& timeline = document.timeline;
    timeline.joints.clear();
    timeline.root.clear();
    timeline.expression.clear();
    document.pose.pose = basePose(document, context.assets, context.timeS);
    document.pose.pose.rotations.resize(static_cast<std::size_t>(skeleton->jointCount()), kIdentity);
}

JointTrack* findTrack(TimelineSection& timeline, int joint) {
    for (JointTrack& track : timeline.joints) {
        if (track.joint == joint) return &track;
    }
    return nullptr;
}

JointTrack& trackOf(TimelineSection& timeline, int joint) {
    if (JointTrack* found = findTrack(timeline, joint)) return *found;
    auto place = timeline.joints.begin();
    while (place != timeline.joints.end() && place->joint < joint) ++place;
    JointTrack track;
    track.joint = joint;
    track.layer = timeline.clip.empty() ? JointLayer::Absolute : JointLayer::OnClip;
    return *timeline.joints.insert(place, std::move(track));
}

bool isNothing(const glm::quat& rotation) { return glm::length(axisAngleFromQuat(rotation)) < 1e-5f; }
bool isNothing(const glm::vec3& offset) { return glm::length(offset) < 1e-6f; }

/// A key of a correction to a clip. Where nothing is corrected yet it gets neighbours without effect, so that it comes
/// and goes around its time.
template <typename Value>
void setCorrection(Track<Value>& track, double timeS, const Value& value, const Value& nothing) {
    const bool alone = keyAt(track, timeS) < 0 && (track.empty() || isNothing(sampleTrack(track, timeS)));
    if (alone) {
        const auto inside = [&](double from, double to) {
            return std::any_of(track.begin(), track.end(),
                               [&](const Key<Value>& key) { return key.timeS > from && key.timeS < to; });
        };
        const bool before = inside(timeS - kGuardS - kKeyTimeTolerance, timeS);
        const bool after = inside(timeS, timeS + kGuardS + kKeyTimeTolerance);
        if (!before) setKey(track, timeS - kGuardS, nothing);
        if (!after) setKey(track, timeS + kGuardS, nothing);
    }
    setKey(track, timeS, value);
}

bool onTimeline(const TimelineSection& timeline, bool hasKeys) { return hasKeys || timeline.autoKey; }

void writeJoint(Document& document, const Pose& base, double timeS, int joint, const glm::quat& rotation) {
    TimelineSection& timeline = document.timeline;
    const auto j = static_cast<std::size_t>(joint);
    const bool keyed = findTrack(timeline, joint) != nullptr || !timeline.clip.empty();
    if (!onTimeline(timeline, keyed)) {
        document.pose.pose.rotations[j] = rotation;
        return;
    }
    JointTrack& track = trackOf(timeline, joint);
    if (track.layer == JointLayer::Absolute) {
        setKey(track.keys, timeS, rotation);
    } else {
        setCorrection(track.keys, timeS, glm::normalize(glm::inverse(base.rotations[j]) * rotation), kIdentity);
    }
}

void writeTranslation(Document& document, const Pose& base, double timeS, const glm::vec3& translation) {
    TimelineSection& timeline = document.timeline;
    if (!timeline.clip.empty()) {
        setCorrection(timeline.root, timeS, translation - base.translation, glm::vec3(0.0f));
    } else if (onTimeline(timeline, !timeline.root.empty())) {
        setKey(timeline.root, timeS, translation);
    } else {
        document.pose.pose.translation = translation;
    }
}

/// How far away the thing in front of a dataset camera is.
double viewDistance(const Document& document, const CommandContext& context, const Camera& camera) {
    const glm::dvec3 forward = glm::transpose(camera.rotation)[2];
    glm::dvec3 center = cameraAt(document, context.timeS).target;
    if (const Skeleton* skeleton = skeletonOf(context)) {
        const Pose pose = currentPose(document, context);
        center = glm::dvec3(jointWorldMatrices(*skeleton, pose)[0][3]);
    }
    const double distance = glm::dot(center - camera.centerWorld(), forward);
    return distance > 0.1 ? distance : 3.0;
}

const CalibratedCamera* datasetCamera(const Document& document, const CommandContext& context) {
    if (document.camera.datasetCamera.empty() || !context.assets.capture) return nullptr;
    for (const CalibratedCamera& camera : context.assets.capture->cameras) {
        if (camera.name == document.camera.datasetCamera) return &camera;
    }
    return nullptr;
}

std::vector<TrackPointer> jointTracks(TimelineSection& timeline) {
    std::vector<TrackPointer> tracks;
    for (JointTrack& track : timeline.joints) tracks.emplace_back(&track);
    return tracks;
}

bool hasKeys(const TrackPointer& track) {
    return std::visit(
        [](auto* pointer) {
            if constexpr (std::is_same_v<decltype(pointer), JointTrack*>) {
                return !pointer->keys.empty();
            } else {
                return !pointer->empty();
            }
        },
        track);
}

/// The tracks that a word names, with and without keys.
Result<std::vector<TrackPointer>> namedTracks(TimelineSection& timeline, const CommandContext& context,
                                              const std::string& word) {
    std::vector<TrackPointer> tracks;
    const bool all = word == "all";
    if (all || word == "pose") tracks = jointTracks(timeline);
    if (all || word == "pose" || word == "root") tracks.emplace_back(&timeline.root);
    if (all || word == "expression") tracks.emplace_back(&timeline.expression);
    if (all || word == "camera") tracks.emplace_back(&timeline.camera);
    if (all || word == "light_rotation") tracks.emplace_back(&timeline.lightRotationDeg);
    if (all || word == "light_exposure") tracks.emplace_back(&timeline.lightExposureEv);
    if (all || word == "radii") {
        for (Track<float>& radius : timeline.radii) tracks.emplace_back(&radius);
    }
    if (word.rfind("radius:", 0) == 0) {
        ARS_TRY(const int part, partOf(word.substr(7)));
        tracks.emplace_back(&timeline.radii[static_cast<std::size_t>(part)]);
    } else if (word.rfind("joint:", 0) == 0) {
        ARS_TRY(const int joint, jointOf(context, word.substr(6)));
        if (JointTrack* track = findTrack(timeline, joint)) tracks.emplace_back(track);
    } else if (tracks.empty() && word != "pose") {
        return makeError(ErrorCode::InvalidArgument, "track",
                         fmt::format("expected pose, joint:NAME, root, expression, camera, light_rotation, "
                                     "light_exposure, radius:PART, radii or all, found \"{}\"",
                                     word));
    }
    return tracks;
}

} // namespace

Pose currentPose(const Document& document, const CommandContext& context) {
    return poseAt(document, context.assets, context.timeS);
}

void writePose(Document& document, const CommandContext& context, const Pose& wanted) {
    adoptSkeleton(document, context);
    const Pose base = basePose(document, context.assets, context.timeS);
    const Pose before = currentPose(document, context);
    const std::size_t joints = std::min(before.rotations.size(), wanted.rotations.size());
    for (std::size_t j = 0; j < joints; ++j) {
        if (before.rotations[j] == wanted.rotations[j]) continue;
        writeJoint(document, base, context.timeS, static_cast<int>(j), wanted.rotations[j]);
    }
    if (before.translation != wanted.translation) {
        writeTranslation(document, base, context.timeS, wanted.translation);
    }
    if (before.expression != wanted.expression) writeExpression(document, context, wanted.expression);
}

SceneCamera currentCamera(const Document& document, const CommandContext& context) {
    if (const CalibratedCamera* camera = datasetCamera(document, context)) {
        return sceneCameraOf(camera->camera, viewDistance(document, context, camera->camera));
    }
    return cameraAt(document, context.timeS);
}

void writeCamera(Document& document, const CommandContext& context, const SceneCamera& camera) {
    document.camera.datasetCamera.clear();
    if (onTimeline(document.timeline, !document.timeline.camera.empty())) {
        setKey(document.timeline.camera, context.timeS, camera);
    } else {
        document.camera.camera = camera;
    }
}

void writeLightRotation(Document& document, const CommandContext& context, float degrees) {
    if (onTimeline(document.timeline, !document.timeline.lightRotationDeg.empty())) {
        setKey(document.timeline.lightRotationDeg, context.timeS, degrees);
    } else {
        document.light.rotationDeg = degrees;
    }
}

void writeLightExposure(Document& document, const CommandContext& context, float ev) {
    if (onTimeline(document.timeline, !document.timeline.lightExposureEv.empty())) {
        setKey(document.timeline.lightExposureEv, context.timeS, ev);
    } else {
        document.light.exposureEv = ev;
    }
}

void writeRadius(Document& document, const CommandContext& context, int part, float metres) {
    const auto p = static_cast<std::size_t>(part);
    const float initial = bodyPartInitialRadiusM(static_cast<BodyPart>(part));
    const float radius = std::clamp(metres, kMinRadiusFactor * initial, kMaxRadiusFactor * initial);
    if (onTimeline(document.timeline, !document.timeline.radii[p].empty())) {
        setKey(document.timeline.radii[p], context.timeS, radius);
    } else {
        document.occlusion.radii[p] = radius;
    }
}

void writeExpression(Document& document, const CommandContext& context, std::vector<float> expression) {
    adoptSkeleton(document, context);
    while (!expression.empty() && expression.back() == 0.0f) expression.pop_back();
    const bool clip = !document.timeline.clip.empty();
    if (onTimeline(document.timeline, clip || !document.timeline.expression.empty())) {
        setKey(document.timeline.expression, context.timeS, std::move(expression));
    } else {
        document.pose.pose.expression = std::move(expression);
    }
}

float standingHeight(const CommandContext& context) {
    return context.assets.avatar ? -context.assets.avatar->soleHeightM : 0.0f;
}

Result<std::vector<glm::vec3>> posedVertices(const CommandContext& context, const Pose& pose) {
    const Skeleton* skeleton = skeletonOf(context);
    if (!skeleton) return std::vector<glm::vec3>();
    const TemplateMesh& body = context.assets.avatar->evaluator->mesh();
    std::vector<glm::vec3> vertices(body.mesh.positions.size());
    ARS_TRY_STATUS(skinPoints(skinningMatrices(*skeleton, pose), body.weights, body.mesh.positions, vertices));
    return vertices;
}

Status placeOnFloor(const CommandContext& context, Pose& pose) {
    ARS_TRY(const std::vector<glm::vec3> vertices, posedVertices(context, pose));
    float lowest = std::numeric_limits<float>::max();
    for (const glm::vec3& vertex : vertices) lowest = std::min(lowest, vertex.y);
    if (!vertices.empty() && std::isfinite(lowest)) pose.translation.y -= lowest;
    return {};
}

Result<std::vector<TrackPointer>> tracksOf(Document& document, const CommandContext& context, const std::string& word) {
    ARS_TRY(std::vector<TrackPointer> tracks, namedTracks(document.timeline, context, word));
    tracks.erase(
        std::remove_if(tracks.begin(), tracks.end(), [](const TrackPointer& track) { return !hasKeys(track); }),
        tracks.end());
    if (tracks.empty()) return makeError(ErrorCode::NotFound, word, "has no keys");
    return tracks;
}

void dropEmptyTracks(TimelineSection& timeline) {
    auto& joints = timeline.joints;
    joints.erase(
        std::remove_if(joints.begin(), joints.end(), [](const JointTrack& track) { return track.keys.empty(); }),
        joints.end());
}

} // namespace ars::edit

namespace ars {

std::vector<std::string> keyedTracks(const Document& document, const CommandContext& context) {
    const TimelineSection& timeline = document.timeline;
    const std::vector<std::string> names = jointNames(context);
    std::vector<std::string> words;
    for (const JointTrack& track : timeline.joints) {
        const auto j = static_cast<std::size_t>(track.joint);
        if (!track.keys.empty() && j < names.size()) words.push_back("joint:" + names[j]);
    }
    if (!timeline.root.empty()) words.emplace_back("root");
    if (!timeline.expression.empty()) words.emplace_back("expression");
    if (!timeline.camera.empty()) words.emplace_back("camera");
    if (!timeline.lightRotationDeg.empty()) words.emplace_back("light_rotation");
    if (!timeline.lightExposureEv.empty()) words.emplace_back("light_exposure");
    for (std::size_t p = 0; p < timeline.radii.size(); ++p) {
        if (timeline.radii[p].empty()) continue;
        words.push_back("radius:" + std::string(bodyPartName(static_cast<BodyPart>(p))));
    }
    return words;
}

} // namespace ars
