#include "engine/scene/command_arguments.h"
#include "engine/scene/command_edits.h"
#include "engine/scene/evaluate.h"

#include <fmt/format.h>

#include <cmath>

namespace ars::edit {
namespace {

constexpr ParameterRange kTime{-3600.0, 36000.0};
constexpr double kShortestRangeS = 0.01;

/// Keys of the root are the body's place without a clip and a correction with one: what they mean together with the
/// document's own pose stays the same.
void turnRootKeys(Document& document, float sign) {
    for (Key<glm::vec3>& key : document.timeline.root) key.value += sign * document.pose.pose.translation;
}

Status openClip(Document& document, const Arguments& arguments, CommandContext& context) {
    const std::string file = textOf(arguments, "file");
    ARS_TRY_STATUS(needsAbsolute(file, "file"));
    TimelineSection& timeline = document.timeline;
    if (timeline.clip.empty()) turnRootKeys(document, -1.0f);
    timeline.clip = file;
    timeline.clipOffsetS = 0.0;
    const auto& clip = context.assets.clip;
    if (clip && clip->motion && clip->key == clipKey(timeline)) {
        timeline.startS = 0.0;
        timeline.endS = std::max(clip->motion->durationS(), kShortestRangeS);
        timeline.timeS = 0.0;
    }
    return {};
}

Status closeClip(Document& document, const Arguments&, CommandContext&) {
    turnRootKeys(document, 1.0f);
    document.timeline.clip.clear();
    document.timeline.clipOffsetS = 0.0;
    return {};
}

Status hasClip(const Document& document, const CommandContext&) {
    if (document.timeline.clip.empty()) return unavailable("no clip is open");
    return {};
}

Status setRange(Document& document, const Arguments& arguments, CommandContext&) {
    const double start = numberOf(arguments, "start"), end = numberOf(arguments, "end");
    if (end - start < kShortestRangeS) {
        return makeError(
            ErrorCode::InvalidArgument, "end",
            fmt::format("expected at least {:g} s after the start {:g}, found {:g}", kShortestRangeS, start, end));
    }
    document.timeline.startS = start;
    document.timeline.endS = end;
    return {};
}

Command numberCommand(const char* id, const char* label, const char* help, CommandArgument argument,
                      double TimelineSection::* member) {
    return {.id = id,
            .label = label,
            .group = CommandGroup::Timeline,
            .help = help,
            .arguments = {argument},
            .apply = [member, name = argument.info.name](Document& document, const Arguments& a, CommandContext&) {
                document.timeline.*member = numberOf(a, name.c_str());
                return Status();
            }};
}

Command switchCommand(const char* id, const char* label, const char* help, const char* shortcut,
                      bool TimelineSection::* member) {
    return {.id = id,
            .label = label,
            .group = CommandGroup::Timeline,
            .help = help,
            .shortcut = shortcut,
            .arguments = {leftOut(flag("enabled", "Left out: the other way round."))},
            .apply = [member](Document& document, const Arguments& a, CommandContext&) {
                document.timeline.*member = flagOr(a, "enabled", !(document.timeline.*member));
                return Status();
            }};
}

} // namespace

std::vector<Command> timelineCommands() {
    using T = TimelineSection;
    return {
        {.id = "timeline.open_clip",
         .label = "Open clip",
         .group = CommandGroup::Timeline,
         .help = "Moves the body by a motion file (npz, npy, BVH, glTF).",
         .arguments = {text("file", "Absolute path.")},
         .enabled = [](const Document&, const CommandContext& context) { return needsSmplx(context); },
         .apply = openClip},
        {.id = "timeline.close_clip",
         .label = "Close clip",
         .group = CommandGroup::Timeline,
         .help = "The body takes its own pose again; keys stay.",
         .enabled = hasClip,
         .apply = closeClip},
        numberCommand("timeline.clip_offset", "Shift clip", "When the clip begins.",
                      number("time", kTime, "s", "On the timeline."), &T::clipOffsetS),
        numberCommand("timeline.seek", "Go to time", "Shows another moment.",
                      number("time", kTime, "s", "On the timeline."), &T::timeS),
        {.id = "timeline.range",
         .label = "Range",
         .group = CommandGroup::Timeline,
         .help = "What plays and what a film shows.",
         .arguments = {number("start", kTime, "s", "First moment."), number("end", kTime, "s", "Last moment.")},
         .apply = setRange},
        numberCommand("timeline.rate", "Frame rate", "The grid of keys and the rate of films.",
                      number("fps", {1, 240}, "1/s", "Frames a second."), &T::framesPerSecond),
        numberCommand("timeline.speed", "Speed", "How fast it plays; films keep the true speed.",
                      number("factor", {0.05, 8}, "", "1 is the true speed."), &T::speed),
        switchCommand("timeline.loop", "Loop", "Begins again at the end of the range.", "Ctrl+L", &T::loop),
        switchCommand("timeline.auto_key", "Automatic keys", "Every edit becomes a key at the current time.", "Shift+K",
                      &T::autoKey),
    };
}

} // namespace ars::edit
