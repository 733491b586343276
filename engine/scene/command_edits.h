#pragma once

#include "engine/scene/command.h"

#include <glm/glm.hpp>
#include <glm/gtc/quaternion.hpp>

#include <string>
#include <variant>
#include <vector>

namespace ars::edit {

/// How edits reach the document so that they are seen at the current time: as a key where the timeline has a say in the
/// thing (keys of its own, for the body a clip, or automatic keys), else in the section that holds otherwise.

/// Half the time over which a correction of a clip comes and goes, seconds.
inline constexpr double kGuardS = 0.5;

/// The pose on the screen, one rotation for each joint of the avatar.
Pose currentPose(const Document& document, const CommandContext& context);
/// Writes what differs between the pose on the screen and `wanted`; other joints stay as they are.
void writePose(Document& document, const CommandContext& context, const Pose& wanted);

/// The camera on the screen as a free one, also where a dataset camera is looked through.
SceneCamera currentCamera(const Document& document, const CommandContext& context);
/// Sets the camera and leaves a dataset camera.
void writeCamera(Document& document, const CommandContext& context, const SceneCamera& camera);

void writeLightRotation(Document& document, const CommandContext& context, float degrees);
void writeLightExposure(Document& document, const CommandContext& context, float ev);
/// Kept within the part's bounds.
void writeRadius(Document& document, const CommandContext& context, int part, float metres);
void writeExpression(Document& document, const CommandContext& context, std::vector<float> expression);

/// Where the avatar's feet are on the floor: y of Pose::translation for its rest pose.
float standingHeight(const CommandContext& context);
/// The avatar's vertices under a pose, world, metres; empty without an avatar.
Result<std::vector<glm::vec3>> posedVertices(const CommandContext& context, const Pose& pose);
/// Moves the pose up or down so that its lowest vertex touches the floor. Nothing without an avatar.
Status placeOnFloor(const CommandContext& context, Pose& pose);

/// Any track that a word of timeline commands names.
using TrackPointer =
    std::variant<JointTrack*, Track<glm::vec3>*, Track<std::vector<float>>*, Track<SceneCamera>*, Track<float>*>;
/// The tracks with keys that a word names: one, or those of "pose" (joints and root), "radii" or "all". NotFound where
/// none has keys, InvalidArgument for a word that is none.
Result<std::vector<TrackPointer>> tracksOf(Document& document, const CommandContext& context, const std::string& word);
/// Removes joints' tracks without keys.
void dropEmptyTracks(TimelineSection& timeline);

/// Index of the key at a time, or -1.
template <typename Value>
int keyAt(const Track<Value>& track, double timeS) {
    for (std::size_t i = 0; i < track.size(); ++i) {
        if (std::abs(track[i].timeS - timeS) <= kKeyTimeTolerance) return static_cast<int>(i);
    }
    return -1;
}

/// Puts a key in its place; one that is there keeps its time and interpolation.
template <typename Value>
void setKey(Track<Value>& track, double timeS, Value value) {
    if (const int found = keyAt(track, timeS); found >= 0) {
        track[static_cast<std::size_t>(found)].value = std::move(value);
        return;
    }
    auto place = track.begin();
    while (place != track.end() && place->timeS < timeS) ++place;
    track.insert(place, Key<Value>{timeS, std::move(value), KeyInterpolation::Smooth});
}

} // namespace ars::edit
