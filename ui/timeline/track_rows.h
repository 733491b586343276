#pragma once

#include "engine/rig/skeleton.h"
#include "engine/scene/document.h"

#include <set>
#include <string>
#include <string_view>
#include <vector>

namespace ars::ui {

/// A key as the timeline shows it.
struct KeyMark {
    double timeS = 0.0;
    KeyInterpolation interpolation = KeyInterpolation::Smooth; ///< of a row for several tracks: that of its first one
};

/// One row of the timeline. `track` is the word that the commands know ("pose", "joint:left_wrist", "radius:hand");
/// rows for several tracks ("pose", "radii") list theirs in `members`.
struct TrackRow {
    std::string track;
    std::string label;
    int depth = 0;
    bool foldable = false;
    bool unfolded = false;
    bool curve = false;        ///< its values are drawn under it
    bool onClip = false;       ///< a joint whose keys are turned onto the clip
    std::vector<KeyMark> keys; ///< by time; of several tracks: every time that one of them has
    std::vector<std::string> members;
};

/// The rows in their order: pose (when unfolded: root and its keyed joints), camera, light rotation, light exposure,
/// expression, radii (when unfolded: the nine parts).
/// @param unfolded  tracks that are unfolded; a track of single numbers shows its curve
std::vector<TrackRow> trackRows(const TimelineSection& timeline, const std::vector<std::string>& jointNames,
                                const std::set<std::string>& unfolded);

/// Keys of one track of the commands; empty for unknown ones.
std::vector<KeyMark> trackKeys(const TimelineSection& timeline, const std::vector<std::string>& jointNames,
                               std::string_view track);

/// A track of single numbers, or null.
const Track<float>* scalarTrack(const TimelineSection& timeline, std::string_view track);
/// Its unit and how many digits it wants: "deg", "EV", "m".
const char* scalarFormat(std::string_view track);

/// Every time at which some track has a key, sorted, each once.
std::vector<double> allKeyTimes(const TimelineSection& timeline);
/// The nearest key time before or after a moment.
bool previousKeyTime(const std::vector<double>& times, double timeS, double& found);
bool nextKeyTime(const std::vector<double>& times, double timeS, double& found);

/// One key of one track.
struct KeyRef {
    std::string track;
    double timeS = 0.0;

    bool operator<(const KeyRef& other) const {
        return track != other.track ? track < other.track : timeS < other.timeS;
    }
    bool operator==(const KeyRef&) const = default;
};
/// The single keys behind a key of a row: itself, or those of the members at this time.
std::vector<KeyRef> keysBehind(const TimelineSection& timeline, const std::vector<std::string>& jointNames,
                               const TrackRow& row, double timeS);

} // namespace ars::ui
