#include "engine/scene/command_arguments.h"
#include "engine/scene/command_edits.h"
#include "engine/scene/evaluate.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>

namespace ars::edit {
namespace {

constexpr ParameterRange kTime{-3600.0, 36000.0};
constexpr const char* kSelected = "joint:selected"; ///< of timeline.key: whatever joint is selected

/// Every word that names tracks, with keys or without.
std::vector<std::string> trackWords(const Document&, const CommandContext& context) {
    std::vector<std::string> words{"pose",           "all",  "root", "expression", "camera", "light_rotation",
                                   "light_exposure", "radii"};
    for (int p = 0; p < kBodyPartCount; ++p) {
        words.push_back("radius:" + std::string(bodyPartName(static_cast<BodyPart>(p))));
    }
    for (const std::string& name : jointNames(context)) words.push_back("joint:" + name);
    words.emplace_back(kSelected);
    return words;
}

CommandArgument track() {
    CommandArgument argument = text("track", "joint:NAME, root, expression, camera, light_rotation, light_exposure, "
                                             "radius:PART; pose, radii or all for many at once.");
    argument.choices = trackWords;
    return argument;
}

std::string trackLabel(const Arguments& arguments) {
    std::string word = textOf(arguments, "track");
    if (const std::size_t colon = word.find(':'); colon != std::string::npos) {
        word = word[0] == 'r' ? "radius of " + word.substr(colon + 1) : word.substr(colon + 1);
    }
    return spoken(word);
}

/// A key where the track stands now, so that nothing is seen to change.
void keyJoint(TimelineSection& timeline, const Pose& base, const Pose& shown, double timeS, int joint) {
    const auto j = static_cast<std::size_t>(joint);
    auto place = std::find_if(timeline.joints.begin(), timeline.joints.end(),
                              [joint](const JointTrack& t) { return t.joint >= joint; });
    if (place == timeline.joints.end() || place->joint != joint) {
        JointTrack fresh;
        fresh.joint = joint;
        fresh.layer = timeline.clip.empty() ? JointLayer::Absolute : JointLayer::OnClip;
        place = timeline.joints.insert(place, std::move(fresh));
    }
    const bool absolute = place->layer == JointLayer::Absolute;
    setKey(place->keys, timeS,
           absolute ? shown.rotations[j] : glm::normalize(glm::inverse(base.rotations[j]) * shown.rotations[j]));
}

struct Moment {
    Document& document;
    const CommandContext& context;
    Pose base, shown;
};

/// Every joint, so that one pose after the other can be keyed; on a clip those that are corrected.
void keyPose(Moment& moment) {
    TimelineSection& timeline = moment.document.timeline;
    const bool onClip = !timeline.clip.empty();
    for (std::size_t j = 0; j < moment.shown.rotations.size(); ++j) {
        const auto joint = static_cast<int>(j);
        const bool keyed = std::any_of(timeline.joints.begin(), timeline.joints.end(),
                                       [joint](const JointTrack& t) { return t.joint == joint; });
        if (keyed || !onClip) keyJoint(timeline, moment.base, moment.shown, moment.context.timeS, joint);
    }
}

void keyRoot(Moment& moment) {
    const glm::vec3 clip = moment.document.timeline.clip.empty() ? glm::vec3(0.0f) : moment.base.translation;
    setKey(moment.document.timeline.root, moment.context.timeS, moment.shown.translation - clip);
}

void keyRadius(Moment& moment, std::size_t part) {
    const PartRadii radii = radiiAt(moment.document, moment.context.timeS);
    setKey(moment.document.timeline.radii[part], moment.context.timeS, radii[part]);
}

void keyLight(Moment& moment, bool rotation, bool exposure) {
    const TimelineSection& now = moment.document.timeline;
    const double timeS = moment.context.timeS;
    const float ev =
        now.lightExposureEv.empty() ? moment.document.light.exposureEv : sampleTrack(now.lightExposureEv, timeS);
    const float degrees = placementAt(moment.document, timeS).rotationDeg;
    if (rotation) setKey(moment.document.timeline.lightRotationDeg, timeS, degrees);
    if (exposure) setKey(moment.document.timeline.lightExposureEv, timeS, ev);
}

Result<int> jointToKey(const Document& document, const CommandContext& context, const std::string& word) {
    if (word != kSelected) return jointOf(context, word.substr(6));
    const int joint = document.view.selectedJoint;
    if (joint < 0 || joint >= static_cast<int>(jointNames(context).size())) return unavailable("no joint is selected");
    return joint;
}

Status key(Document& document, const Arguments& arguments, CommandContext& context) {
    const std::string word = textOf(arguments, "track");
    // A pose of another skeleton first becomes this one's.
    Pose shown = currentPose(document, context);
    if (document.pose.pose.rotations.size() != shown.rotations.size() && document.timeline.clip.empty()) {
        document.pose.pose = shown;
    }
    Moment moment{document, context, basePose(document, context.assets, context.timeS), std::move(shown)};
    const bool all = word == "all";
    if (all || word == "pose") keyPose(moment);
    if (all || word == "pose" || word == "root") keyRoot(moment);
    if (all || word == "expression") setKey(document.timeline.expression, context.timeS, moment.shown.expression);
    if (all || word == "camera") setKey(document.timeline.camera, context.timeS, currentCamera(document, context));
    keyLight(moment, all || word == "light_rotation", all || word == "light_exposure");
    for (std::size_t p = 0; p < kBodyPartCount; ++p) {
        const bool named = word == "radius:" + std::string(bodyPartName(static_cast<BodyPart>(p)));
        if (all || word == "radii" || named) keyRadius(moment, p);
    }
    if (word.rfind("joint:", 0) == 0) {
        ARS_TRY(const int joint, jointToKey(document, context, word));
        keyJoint(document.timeline, moment.base, moment.shown, context.timeS, joint);
    }
    return {};
}

/// Runs `work(keys, index)` for every named track that has a key at a time. NotFound where none has.
template <typename Work>
Status forKeysAt(Document& document, const CommandContext& context, const std::string& word, double timeS,
                 const Work& work) {
    ARS_TRY(const std::vector<TrackPointer> tracks, tracksOf(document, context, word));
    bool any = false;
    const auto one = [&](auto& keys) {
        const int index = keyAt(keys, timeS);
        if (index < 0) return;
        any = true;
        work(keys, static_cast<std::size_t>(index));
    };
    for (const TrackPointer& pointer : tracks) {
        std::visit(
            [&one](auto* track) {
                if constexpr (std::is_same_v<decltype(track), JointTrack*>) {
                    one(track->keys);
                } else {
                    one(*track);
                }
            },
            pointer);
    }
    if (!any) return makeError(ErrorCode::NotFound, word, fmt::format("has no key at {:.4g} s", timeS));
    dropEmptyTracks(document.timeline);
    return {};
}

template <typename Keys>
void removeKey(Keys& keys, std::size_t index) {
    keys.erase(keys.begin() + static_cast<std::ptrdiff_t>(index));
}

/// Puts a key at another time; one that is there gives way.
template <typename Keys>
void placeKey(Keys& keys, typename Keys::value_type key, double timeS) {
    if (const int there = keyAt(keys, timeS); there >= 0) removeKey(keys, static_cast<std::size_t>(there));
    key.timeS = timeS;
    const auto after = std::find_if(keys.begin(), keys.end(), [timeS](const auto& k) { return k.timeS > timeS; });
    keys.insert(after, std::move(key));
}

Status moveKey(Document& document, const Arguments& arguments, CommandContext& context) {
    const double to = numberOf(arguments, "to");
    return forKeysAt(document, context, textOf(arguments, "track"), numberOf(arguments, "from"),
                     [to](auto& keys, std::size_t index) {
                         auto key = keys[index];
                         removeKey(keys, index);
                         placeKey(keys, std::move(key), to);
                     });
}

Status copyKey(Document& document, const Arguments& arguments, CommandContext& context) {
    const double from = numberOf(arguments, "from"), to = numberOf(arguments, "to");
    if (std::abs(from - to) <= kKeyTimeTolerance) return {};
    return forKeysAt(document, context, textOf(arguments, "track"), from,
                     [to](auto& keys, std::size_t index) { placeKey(keys, keys[index], to); });
}

Status clearTrack(Document& document, const Arguments& arguments, CommandContext& context) {
    ARS_TRY(const std::vector<TrackPointer> tracks, tracksOf(document, context, textOf(arguments, "track")));
    for (const TrackPointer& pointer : tracks) {
        std::visit(
            [](auto* track) {
                if constexpr (std::is_same_v<decltype(track), JointTrack*>) {
                    track->keys.clear();
                } else {
                    track->clear();
                }
            },
            pointer);
    }
    dropEmptyTracks(document.timeline);
    return {};
}

CommandArgument time(const char* name, const char* help) { return number(name, kTime, "s", help); }

std::function<std::string(const Arguments&)> labelled(const char* what) {
    return [text = std::string(what)](const Arguments& a) { return text + " of " + trackLabel(a); };
}

std::vector<CommandVariant> keyVariants() {
    return {{"Key pose", {{"track", "pose"}}, "I"},
            {"Key selected joint", {{"track", kSelected}}, "Alt+K"},
            {"Key camera", {{"track", "camera"}}, "Shift+I"},
            {"Key rotation of light", {{"track", "light_rotation"}}, ""},
            {"Key strength of light", {{"track", "light_exposure"}}, ""},
            {"Key expression", {{"track", "expression"}}, ""},
            {"Key radii", {{"track", "radii"}}, ""},
            {"Key everything", {{"track", "all"}}, "Ctrl+I"}};
}

} // namespace

std::vector<Command> keyCommands() {
    const auto command = [](const char* id, const char* label, const char* help, std::vector<CommandArgument> arguments,
                            Status (*apply)(Document&, const Arguments&, CommandContext&)) {
        return Command{.id = id,
                       .label = label,
                       .group = CommandGroup::Timeline,
                       .help = help,
                       .arguments = std::move(arguments),
                       .apply = apply,
                       .describe = labelled(label)};
    };
    std::vector<Command> all{
        command("timeline.key", "Key", "Sets keys at the current time with what is seen now.", {track()}, key),
        command("timeline.delete_key", "Delete key", "Takes away the keys at a time.",
                {track(), time("time", "Of the keys.")},
                [](Document& document, const Arguments& a, CommandContext& context) {
                    return forKeysAt(document, context, textOf(a, "track"), numberOf(a, "time"),
                                     [](auto& keys, std::size_t index) { removeKey(keys, index); });
                }),
        command("timeline.move_key", "Move key", "Takes keys to another time; keys there give way.",
                {track(), time("from", "Of the keys."), time("to", "Where they go.")}, moveKey),
        command("timeline.copy_key", "Copy key", "Puts the same keys at another time; keys there give way.",
                {track(), time("from", "Of the keys."), time("to", "Where the copies go.")}, copyKey),
        command("timeline.clear_track", "Clear keys", "Takes away all keys.", {track()}, clearTrack),
        command(
            "timeline.interpolation", "Interpolation", "How the value goes from a key to the next.",
            {track(), time("time", "Of the keys."), enumWord<KeyInterpolation>("kind", "Holds, straight or smooth.")},
            [](Document& document, const Arguments& a, CommandContext& context) {
                const auto kind = enumOf<KeyInterpolation>(a, "kind");
                return forKeysAt(document, context, textOf(a, "track"), numberOf(a, "time"),
                                 [kind](auto& keys, std::size_t index) { keys[index].interpolation = kind; });
            }),
    };
    all.front().variants = keyVariants();
    return all;
}

} // namespace ars::edit
