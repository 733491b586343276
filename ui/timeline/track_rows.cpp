#include "ui/timeline/track_rows.h"

#include "ui/pose/joint_list.h"

#include <algorithm>
#include <cmath>

namespace ars::ui {
namespace {

constexpr std::string_view kJointPrefix = "joint:";
constexpr std::string_view kRadiusPrefix = "radius:";

template <typename Value>
std::vector<KeyMark> marks(const Track<Value>& track) {
    std::vector<KeyMark> keys;
    keys.reserve(track.size());
    for (const Key<Value>& key : track) keys.push_back({key.timeS, key.interpolation});
    return keys;
}

/// Sorted by time, each time once.
void unite(std::vector<KeyMark>& keys) {
    std::stable_sort(keys.begin(), keys.end(), [](const KeyMark& a, const KeyMark& b) { return a.timeS < b.timeS; });
    const auto same = [](const KeyMark& a, const KeyMark& b) { return b.timeS - a.timeS <= kKeyTimeTolerance; };
    keys.erase(std::unique(keys.begin(), keys.end(), same), keys.end());
}

template <typename Value>
void addMarks(const Track<Value>& track, std::vector<KeyMark>& keys) {
    for (const Key<Value>& key : track) keys.push_back({key.timeS, key.interpolation});
}

std::string jointName(const std::vector<std::string>& names, int joint) {
    const auto index = static_cast<std::size_t>(joint);
    return index < names.size() ? names[index] : std::string(smplxJointName(joint));
}

int partIndex(std::string_view name) {
    for (int part = 0; part < kBodyPartCount; ++part) {
        if (bodyPartName(static_cast<BodyPart>(part)) == name) return part;
    }
    return -1;
}

TrackRow row(std::string track, std::string label, std::vector<KeyMark> keys) {
    TrackRow made;
    made.track = std::move(track);
    made.label = std::move(label);
    made.keys = std::move(keys);
    return made;
}

TrackRow scalarRow(std::string track, std::string label, const Track<float>& keys,
                   const std::set<std::string>& unfolded) {
    TrackRow made = row(std::move(track), std::move(label), marks(keys));
    made.foldable = !keys.empty();
    made.unfolded = made.foldable && unfolded.count(made.track) > 0;
    made.curve = made.unfolded;
    return made;
}

void addPose(std::vector<TrackRow>& rows, const TimelineSection& timeline, const std::vector<std::string>& names,
             const std::set<std::string>& unfolded) {
    TrackRow pose = row("pose", "Pose", {});
    std::vector<TrackRow> joints{row("root", "Root", marks(timeline.root))};
    joints.front().depth = 1;
    pose.members.push_back("root");
    pose.keys = joints.front().keys;
    for (const JointTrack& track : timeline.joints) {
        if (track.keys.empty()) continue;
        const std::string name = jointName(names, track.joint);
        TrackRow joint = row(std::string(kJointPrefix) + name, friendlyName(name), marks(track.keys));
        joint.depth = 1;
        joint.onClip = track.layer == JointLayer::OnClip;
        pose.members.push_back(joint.track);
        pose.keys.insert(pose.keys.end(), joint.keys.begin(), joint.keys.end());
        joints.push_back(std::move(joint));
    }
    unite(pose.keys);
    pose.foldable = true;
    pose.unfolded = unfolded.count("pose") > 0;
    const bool open = pose.unfolded;
    rows.push_back(std::move(pose));
    if (open) rows.insert(rows.end(), joints.begin(), joints.end());
}

void addRadii(std::vector<TrackRow>& rows, const TimelineSection& timeline, const std::set<std::string>& unfolded) {
    TrackRow radii = row("radii", "Radii", {});
    std::vector<TrackRow> parts;
    for (int part = 0; part < kBodyPartCount; ++part) {
        const std::string name(bodyPartName(static_cast<BodyPart>(part)));
        TrackRow one = scalarRow(std::string(kRadiusPrefix) + name, friendlyName(name),
                                 timeline.radii[static_cast<std::size_t>(part)], unfolded);
        one.depth = 1;
        radii.members.push_back(one.track);
        radii.keys.insert(radii.keys.end(), one.keys.begin(), one.keys.end());
        parts.push_back(std::move(one));
    }
    unite(radii.keys);
    radii.foldable = true;
    radii.unfolded = unfolded.count("radii") > 0;
    const bool open = radii.unfolded;
    rows.push_back(std::move(radii));
    if (open) rows.insert(rows.end(), parts.begin(), parts.end());
}

} // namespace

std::vector<TrackRow> trackRows(const TimelineSection& timeline, const std::vector<std::string>& jointNames,
                                const std::set<std::string>& unfolded) {
    std::vector<TrackRow> rows;
    addPose(rows, timeline, jointNames, unfolded);
    rows.push_back(row("camera", "Camera", marks(timeline.camera)));
    rows.push_back(scalarRow("light_rotation", "Light rotation", timeline.lightRotationDeg, unfolded));
    rows.push_back(scalarRow("light_exposure", "Light exposure", timeline.lightExposureEv, unfolded));
    rows.push_back(row("expression", "Expression", marks(timeline.expression)));
    addRadii(rows, timeline, unfolded);
    return rows;
}

std::vector<KeyMark> trackKeys(const TimelineSection& timeline, const std::vector<std::string>& jointNames,
                               std::string_view track) {
    if (track.substr(0, kJointPrefix.size()) == kJointPrefix) {
        const std::string_view name = track.substr(kJointPrefix.size());
        for (const JointTrack& joint : timeline.joints) {
            if (jointName(jointNames, joint.joint) == name) return marks(joint.keys);
        }
        return {};
    }
    if (const Track<float>* scalar = scalarTrack(timeline, track)) return marks(*scalar);
    if (track == "root") return marks(timeline.root);
    if (track == "expression") return marks(timeline.expression);
    if (track == "camera") return marks(timeline.camera);
    return {};
}

const Track<float>* scalarTrack(const TimelineSection& timeline, std::string_view track) {
    if (track == "light_rotation") return &timeline.lightRotationDeg;
    if (track == "light_exposure") return &timeline.lightExposureEv;
    if (track.substr(0, kRadiusPrefix.size()) == kRadiusPrefix) {
        const int part = partIndex(track.substr(kRadiusPrefix.size()));
        if (part >= 0) return &timeline.radii[static_cast<std::size_t>(part)];
    }
    return nullptr;
}

const char* scalarFormat(std::string_view track) {
    if (track == "light_rotation") return "%.1f\xc2\xb0";
    if (track == "light_exposure") return "%+.2f EV";
    return "%.3f m";
}

std::vector<double> allKeyTimes(const TimelineSection& timeline) {
    std::vector<KeyMark> keys;
    for (const JointTrack& joint : timeline.joints) addMarks(joint.keys, keys);
    addMarks(timeline.root, keys);
    addMarks(timeline.expression, keys);
    addMarks(timeline.camera, keys);
    addMarks(timeline.lightRotationDeg, keys);
    addMarks(timeline.lightExposureEv, keys);
    for (const Track<float>& radius : timeline.radii) addMarks(radius, keys);
    unite(keys);
    std::vector<double> times;
    times.reserve(keys.size());
    for (const KeyMark& key : keys) times.push_back(key.timeS);
    return times;
}

bool previousKeyTime(const std::vector<double>& times, double timeS, double& found) {
    const auto after = std::lower_bound(times.begin(), times.end(), timeS - kKeyTimeTolerance);
    if (after == times.begin()) return false;
    found = *std::prev(after);
    return true;
}

bool nextKeyTime(const std::vector<double>& times, double timeS, double& found) {
    const auto after = std::upper_bound(times.begin(), times.end(), timeS + kKeyTimeTolerance);
    if (after == times.end()) return false;
    found = *after;
    return true;
}

std::vector<KeyRef> keysBehind(const TimelineSection& timeline, const std::vector<std::string>& jointNames,
                               const TrackRow& row, double timeS) {
    if (row.members.empty()) return {{row.track, timeS}};
    std::vector<KeyRef> refs;
    for (const std::string& member : row.members) {
        for (const KeyMark& key : trackKeys(timeline, jointNames, member)) {
            if (std::abs(key.timeS - timeS) <= kKeyTimeTolerance) refs.push_back({member, key.timeS});
        }
    }
    return refs;
}

} // namespace ars::ui
