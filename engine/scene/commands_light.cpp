#include "engine/scene/command_arguments.h"
#include "engine/scene/command_edits.h"
#include "engine/scene/evaluate.h"

#include <fmt/format.h>

#include <cmath>

namespace ars::edit {
namespace {

constexpr std::size_t kMaxLamps = 64; ///< that generateStudio takes

Result<std::size_t> lampOf(const Document& document, const Arguments& arguments) {
    const auto index = static_cast<std::size_t>(wholeOf(arguments, "index"));
    const std::size_t count = document.light.studio.lamps.size();
    if (index < count) return index;
    return makeError(ErrorCode::InvalidArgument, "index", fmt::format("expected 0 to {}, found {}", count - 1, index));
}

Status hasLamps(const Document& document, const CommandContext&) {
    if (document.light.studio.lamps.empty()) return unavailable("the studio has no lamp");
    return {};
}

Status openLight(Document& document, const Arguments& arguments, CommandContext&) {
    const std::string file = textOf(arguments, "file");
    ARS_TRY_STATUS(needsAbsolute(file, "file"));
    document.light.file = file;
    document.light.kind = LightKind::File;
    return {};
}

Status setKind(Document& document, const Arguments& arguments, CommandContext&) {
    const auto kind = enumOf<LightKind>(arguments, "kind");
    if (kind == LightKind::File && document.light.file.empty()) {
        return unavailable("no environment file has been opened yet");
    }
    document.light.kind = kind;
    return {};
}

Status addLamp(Document& document, const Arguments& arguments, CommandContext&) {
    auto& lamps = document.light.studio.lamps;
    if (lamps.size() >= kMaxLamps) return unavailable(fmt::format("a studio has at most {} lamps", kMaxLamps));
    StudioLamp lamp;
    lamp.name = textOf(arguments, "name");
    if (lamp.name.empty()) lamp.name = fmt::format("lamp {}", lamps.size() + 1);
    lamps.push_back(std::move(lamp));
    document.light.kind = LightKind::Studio;
    return {};
}

Status removeLamp(Document& document, const Arguments& arguments, CommandContext&) {
    ARS_TRY(const std::size_t index, lampOf(document, arguments));
    auto& lamps = document.light.studio.lamps;
    lamps.erase(lamps.begin() + static_cast<std::ptrdiff_t>(index));
    return {};
}

Status setLamp(Document& document, const Arguments& arguments, CommandContext&) {
    ARS_TRY(const std::size_t index, lampOf(document, arguments));
    const std::string name = textOf(arguments, "name");
    for (const ParameterInfo& info : studioLampParameters().infos()) {
        if (info.name != name) continue;
        ARS_TRY(ParameterValue value, valueOf(info, arguments.at("value")));
        return studioLampParameters().set(document.light.studio.lamps[index], name, std::move(value));
    }
    return makeError(ErrorCode::NotFound, "name", fmt::format("a lamp has no \"{}\"", name));
}

/// The light goes around once or more, evenly, from the start of the range.
Status turntable(Document& document, const Arguments& arguments, CommandContext& context) {
    const double seconds = numberOf(arguments, "seconds"), turns = numberOf(arguments, "turns");
    TimelineSection& timeline = document.timeline;
    const float start = std::remainder(placementAt(document, context.timeS).rotationDeg, 360.0f);
    const auto end = static_cast<float>(static_cast<double>(start) + 360.0 * turns);
    timeline.lightRotationDeg = {{timeline.startS, start, KeyInterpolation::Linear},
                                 {timeline.startS + seconds, end, KeyInterpolation::Linear}};
    timeline.endS = timeline.startS + seconds;
    return {};
}

Status resetLight(Document& document, const Arguments&, CommandContext&) {
    document.light = LightSection();
    document.timeline.lightRotationDeg.clear();
    document.timeline.lightExposureEv.clear();
    return {};
}

std::vector<std::string> lampRows() {
    std::vector<std::string> names;
    for (const ParameterInfo& info : studioLampParameters().infos()) names.push_back(info.name);
    return names;
}

std::vector<CommandVariant> studioVariants() {
    return {{"Three-point studio", {{"name", "three_point"}}, ""},
            {"Rim-light studio", {{"name", "rim"}}, ""},
            {"Beauty studio", {{"name", "beauty"}}, ""},
            {"Overcast studio", {{"name", "overcast"}}, ""}};
}

std::vector<Command> lampCommands() {
    return {
        {.id = "light.studio_preset",
         .label = "Studio preset",
         .group = CommandGroup::Light,
         .help = "Builds one of the ready-made studios and lights with it.",
         .arguments = {enumWord<StudioPreset>("name", "Which studio.")},
         .apply =
             [](Document& document, const Arguments& a, CommandContext&) {
                 document.light.studio = studioPreset(enumOf<StudioPreset>(a, "name"));
                 document.light.kind = LightKind::Studio;
                 return Status();
             },
         .describe = [](const Arguments& a) { return "Studio " + spoken(textOf(a, "name")); },
         .variants = studioVariants()},
        {.id = "light.add_lamp",
         .label = "Add lamp",
         .group = CommandGroup::Light,
         .help = "Adds a soft box to the studio.",
         .arguments = {withDefault(text("name", "What it is called; empty: a number."), std::string())},
         .apply = addLamp},
        {.id = "light.remove_lamp",
         .label = "Remove lamp",
         .group = CommandGroup::Light,
         .help = "Takes a lamp out of the studio.",
         .arguments = {whole("index", {0, 63}, "Which lamp, from 0.")},
         .enabled = hasLamps,
         .apply = removeLamp},
        {.id = "light.lamp",
         .label = "Change lamp",
         .group = CommandGroup::Light,
         .help = "Sets one row of a lamp of the studio.",
         .arguments = {whole("index", {0, 63}, "Which lamp, from 0."), word("name", lampRows(), "Which row."),
                       any("value", "What the row takes.")},
         .enabled = hasLamps,
         .apply = setLamp,
         .describe = [](const Arguments& a) { return "Lamp " + spoken(textOf(a, "name")); }},
        {.id = "light.turntable",
         .label = "Turn light around",
         .group = CommandGroup::Light,
         .help = "Keys of the light's rotation that take it evenly around the body; the range becomes as long.",
         .arguments = {withDefault(number("seconds", {0.1, 600}, "s", "How long it takes."), 4.0),
                       withDefault(number("turns", {-20, 20}, "", "How often; negative turns the other way."), 1.0)},
         .apply = turntable},
    };
}

} // namespace

std::vector<Command> lightCommands() {
    std::vector<Command> all{
        {.id = "light.open",
         .label = "Open environment",
         .group = CommandGroup::Light,
         .help = "Lights with an environment picture (EXR, HDR, PNG, JPEG, a folder of six faces).",
         .arguments = {text("file", "Absolute path.")},
         .apply = openLight},
        {.id = "light.kind",
         .label = "Kind of light",
         .group = CommandGroup::Light,
         .help = "Where the light comes from.",
         .arguments = {enumWord<LightKind>("kind",
                                           "The opened file, the sky, the studio, or the same from everywhere.")},
         .apply = setKind,
         .describe = [](const Arguments& a) { return "Light from " + spoken(textOf(a, "kind")); },
         .variants = {{"Light from file", {{"kind", "file"}}, ""},
                      {"Light from sky", {{"kind", "sky"}}, ""},
                      {"Light from studio", {{"kind", "studio"}}, ""},
                      {"Uniform light", {{"kind", "uniform"}}, ""}}},
        {.id = "light.uniform",
         .label = "Uniform light",
         .group = CommandGroup::Light,
         .help = "The same radiance from everywhere.",
         .arguments = {number("radiance", {0, 100}, "", "Linear radiance; 1 shows a white body white.")},
         .apply =
             [](Document& document, const Arguments& a, CommandContext&) {
                 document.light.uniformRadiance = static_cast<float>(numberOf(a, "radiance"));
                 document.light.kind = LightKind::Uniform;
                 return Status();
             }},
        {.id = "light.rotate",
         .label = "Rotate light",
         .group = CommandGroup::Light,
         .help = "Turns the light about the vertical axis.",
         .arguments = {number("degrees", {-360, 360}, "deg",
                              "From the file's own front; positive takes the front to "
                              "the body's left.")},
         .apply =
             [](Document& document, const Arguments& a, CommandContext& context) {
                 writeLightRotation(document, context, static_cast<float>(numberOf(a, "degrees")));
                 return Status();
             }},
        {.id = "light.exposure",
         .label = "Strength of light",
         .group = CommandGroup::Light,
         .help = "Makes the light stronger or weaker.",
         .arguments = {number("ev", {-10, 10}, "EV", "Stops; 1 doubles it.")},
         .apply =
             [](Document& document, const Arguments& a, CommandContext& context) {
                 writeLightExposure(document, context, static_cast<float>(numberOf(a, "ev")));
                 return Status();
             }},
        {.id = "light.backdrop",
         .label = "Backdrop",
         .group = CommandGroup::Light,
         .help = "What is seen behind the body.",
         .arguments = {enumWord<BackdropKind>("kind", "The background colour, a checkerboard, or the light itself.")},
         .apply =
             [](Document& document, const Arguments& a, CommandContext&) {
                 document.light.backdrop = enumOf<BackdropKind>(a, "kind");
                 return Status();
             },
         .variants = {{"Backdrop: colour", {{"kind", "color"}}, ""},
                      {"Backdrop: checkerboard", {{"kind", "checkerboard"}}, ""},
                      {"Backdrop: environment", {{"kind", "environment"}}, ""}}},
        {.id = "light.backdrop_blur",
         .label = "Blur backdrop",
         .group = CommandGroup::Light,
         .help = "Softens the environment behind the body; the light stays as it is.",
         .arguments = {number("amount", {0, 1}, "", "0 sharp, 1 only large shapes.")},
         .apply =
             [](Document& document, const Arguments& a, CommandContext&) {
                 document.light.backdropBlur = static_cast<float>(numberOf(a, "amount"));
                 return Status();
             }},
    };
    for (Command& command : lampCommands()) all.push_back(std::move(command));
    all.push_back({.id = "light.reset",
                   .label = "Reset light",
                   .group = CommandGroup::Light,
                   .help = "The light of a new project, without keys.",
                   .apply = resetLight});
    return all;
}

} // namespace ars::edit
