#include "engine/scene/command_arguments.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace ars::edit {
namespace {

std::size_t indexOf(BufferId id) { return static_cast<std::size_t>(id); }

/// A switch of the view with its own command.
Command toggle(const char* id, const char* label, const char* help, const char* shortcut, bool ViewSection::* member) {
    return {.id = id,
            .label = label,
            .group = CommandGroup::View,
            .help = help,
            .shortcut = shortcut,
            .arguments = {leftOut(flag("enabled", "Left out: the other way round."))},
            .apply =
                [member](Document& document, const Arguments& a, CommandContext&) {
                    document.view.*member = flagOr(a, "enabled", !(document.view.*member));
                    return Status();
                },
            .describe =
                [text = std::string(label)](const Arguments& a) {
                    if (!a.contains("enabled")) return text;
                    return fmt::format("{} {}", text, flagOf(a, "enabled") ? "on" : "off");
                }};
}

Status setStrip(Document& document, const Arguments& arguments, CommandContext&) {
    ARS_TRY(std::vector<BufferId> buffers, parseBuffers(textOf(arguments, "buffers")));
    if (buffers.empty()) return makeError(ErrorCode::InvalidArgument, "buffers", "expected at least one buffer");
    document.view.strip = std::move(buffers);
    return {};
}

Status setRange(Document& document, const Arguments& arguments, CommandContext&) {
    ARS_TRY(const BufferId id, bufferOf(textOf(arguments, "buffer")));
    const double low = numberOf(arguments, "minimum"), high = numberOf(arguments, "maximum");
    if (!(low < high)) {
        return makeError(ErrorCode::InvalidArgument, "minimum",
                         fmt::format("expected less than the maximum {:g}, found {:g}", high, low));
    }
    document.view.buffers[indexOf(id)].range = {static_cast<float>(low), static_cast<float>(high)};
    return {};
}

Status setColorMap(Document& document, const Arguments& arguments, CommandContext&) {
    ARS_TRY(const BufferId id, bufferOf(textOf(arguments, "buffer")));
    const std::string name = textOf(arguments, "map");
    for (const ColorMap map : {ColorMap::Gray, ColorMap::Viridis, ColorMap::Magma, ColorMap::Turbo, ColorMap::Signed}) {
        if (colorMapName(map) == name) document.view.buffers[indexOf(id)].colorMap = map;
    }
    return {};
}

/// Display-linear from sRGB-encoded (IEC 61966-2-1).
float decoded(double encoded) {
    return static_cast<float>(encoded <= 0.04045 ? encoded / 12.92 : std::pow((encoded + 0.055) / 1.055, 2.4));
}

Status setBackground(Document& document, const Arguments& arguments, CommandContext&) {
    document.view.tone.backgroundRed = decoded(numberOf(arguments, "red"));
    document.view.tone.backgroundGreen = decoded(numberOf(arguments, "green"));
    document.view.tone.backgroundBlue = decoded(numberOf(arguments, "blue"));
    return {};
}

std::vector<CommandVariant> bufferVariants() {
    static constexpr std::array<std::pair<BufferId, const char*>, 8> kKeys{{{BufferId::Beauty, "Alt+B"},
                                                                            {BufferId::Albedo, "Alt+A"},
                                                                            {BufferId::Roughness, "Alt+G"},
                                                                            {BufferId::Normal, "Alt+N"},
                                                                            {BufferId::Depth, "Alt+D"},
                                                                            {BufferId::AmbientOcclusion, "Alt+O"},
                                                                            {BufferId::Importance, "Alt+I"},
                                                                            {BufferId::Radius, "Alt+U"}}};
    std::vector<CommandVariant> variants;
    for (const BufferInfo& info : bufferCatalogue()) {
        const auto key = std::find_if(kKeys.begin(), kKeys.end(), [&](const auto& k) { return k.first == info.id; });
        variants.push_back({fmt::format("Show {}", info.label),
                            {{"name", std::string(info.name)}},
                            key == kKeys.end() ? "" : key->second});
    }
    return variants;
}

CommandArgument bufferName(const char* help) {
    CommandArgument argument = buffer(help);
    argument.info.name = "name";
    return argument;
}

std::vector<Command> bufferCommands() {
    return {
        {.id = "view.buffer",
         .label = "Show buffer",
         .group = CommandGroup::View,
         .help = "Which picture of the frame is shown.",
         .arguments = {bufferName("Which buffer.")},
         .apply = [](Document& document, const Arguments& a, CommandContext&) -> Status {
             ARS_TRY(document.view.buffer, bufferOf(textOf(a, "name")));
             return {};
         },
         .describe = [](const Arguments& a) { return "Show " + spoken(textOf(a, "name")); },
         .variants = bufferVariants()},
        {.id = "view.layout",
         .label = "Layout",
         .group = CommandGroup::View,
         .help = "One picture, two beside or over one another, or many.",
         .arguments = {enumWord<ViewLayout>("layout", "Which arrangement.")},
         .apply =
             [](Document& document, const Arguments& a, CommandContext&) {
                 document.view.layout = enumOf<ViewLayout>(a, "layout");
                 return Status();
             },
         .describe = [](const Arguments& a) { return "Layout " + spoken(textOf(a, "layout")); },
         .variants = {{"Single picture", {{"layout", "single"}}, "Alt+1"},
                      {"Side by side", {{"layout", "side_by_side"}}, "Alt+2"},
                      {"Split picture", {{"layout", "split"}}, "Alt+3"},
                      {"Blink", {{"layout", "blink"}}, "Alt+4"},
                      {"Difference", {{"layout", "difference"}}, "Alt+5"},
                      {"Picture with strip of buffers", {{"layout", "strip"}}, "Alt+6"},
                      {"Grid of buffers", {{"layout", "grid"}}, "Alt+7"}}},
        {.id = "view.strip",
         .label = "Buffers of strip",
         .group = CommandGroup::View,
         .help = "Which buffers stand in the strip and in the grid.",
         .arguments = {text("buffers", "Names with commas between them, or all.")},
         .apply = setStrip},
        {.id = "view.range",
         .label = "Range of buffer",
         .group = CommandGroup::View,
         .help = "The numbers that the ends of the colour map stand for.",
         .arguments = {buffer("Which buffer."), number("minimum", {-1e6, 1e6}, "", "Shown as the lowest colour."),
                       number("maximum", {-1e6, 1e6}, "", "Shown as the highest colour.")},
         .apply = setRange,
         .describe = [](const Arguments& a) { return "Range of " + spoken(textOf(a, "buffer")); }},
        {.id = "view.reset_range",
         .label = "Reset range",
         .group = CommandGroup::View,
         .help = "The range that the buffer has by itself.",
         .arguments = {buffer("Which buffer.")},
         .apply = [](Document& document, const Arguments& a, CommandContext&) -> Status {
             ARS_TRY(const BufferId id, bufferOf(textOf(a, "buffer")));
             document.view.buffers[indexOf(id)].range.reset();
             return {};
         }},
        {.id = "view.color_map",
         .label = "Colour map",
         .group = CommandGroup::View,
         .help = "How the numbers of a buffer become colours.",
         .arguments = {buffer("Which buffer."),
                       word("map", {"gray", "viridis", "magma", "turbo", "signed"}, "Colours.")},
         .apply = setColorMap,
         .describe = [](const Arguments& a) { return "Colour map of " + spoken(textOf(a, "buffer")); }},
    };
}

std::vector<Command> toneCommands() {
    return {
        {.id = "view.exposure",
         .label = "Exposure",
         .group = CommandGroup::View,
         .help = "Brightens or darkens the shown picture; the light stays as it is.",
         .arguments = {number("ev", {-16, 16}, "EV", "Stops; 1 doubles the brightness.")},
         .apply =
             [](Document& document, const Arguments& a, CommandContext&) {
                 return toneParameters().set(document.view.tone, "exposure", numberOf(a, "ev"));
             }},
        {.id = "view.tone_curve",
         .label = "Tone curve",
         .group = CommandGroup::View,
         .help = "How light becomes what a screen can show.",
         .arguments = {enumWord<ToneCurve>("curve", "none cuts at white, aces and agx roll off.")},
         .apply =
             [](Document& document, const Arguments& a, CommandContext&) {
                 document.view.tone.curve = enumOf<ToneCurve>(a, "curve");
                 return Status();
             },
         .variants = {{"Tone curve: none", {{"curve", "none"}}, ""},
                      {"Tone curve: ACES", {{"curve", "aces"}}, ""},
                      {"Tone curve: AgX", {{"curve", "agx"}}, ""}}},
        {.id = "view.background",
         .label = "Background colour",
         .group = CommandGroup::View,
         .help = "The colour behind the body where no environment is shown.",
         .arguments = {number("red", {0, 1}, "", "sRGB-encoded."), number("green", {0, 1}, "", "sRGB-encoded."),
                       number("blue", {0, 1}, "", "sRGB-encoded.")},
         .apply = setBackground},
    };
}

Status selectJoint(Document& document, const Arguments& arguments, CommandContext& context) {
    const std::string name = textOf(arguments, "joint");
    document.view.selectedJoint = -1;
    if (name.empty()) return {};
    ARS_TRY(document.view.selectedJoint, jointOf(context, name));
    return {};
}

Status selectPart(Document& document, const Arguments& arguments, CommandContext&) {
    const std::string name = textOf(arguments, "part");
    document.view.selectedPart = -1;
    if (name.empty()) return {};
    ARS_TRY(document.view.selectedPart, partOf(name));
    return {};
}

std::string selectLabel(const Arguments& arguments, const char* kind) {
    const std::string name = textOf(arguments, kind);
    return name.empty() ? fmt::format("Select no {}", kind) : "Select " + spoken(name);
}

} // namespace

std::vector<Command> viewCommands() {
    std::vector<Command> all = bufferCommands();
    for (Command& command : toneCommands()) all.push_back(std::move(command));
    using V = ViewSection;
    all.push_back(toggle("view.grid", "Grid", "Lines on the floor, one metre apart.", "G", &V::grid));
    all.push_back(toggle("view.skeleton", "Skeleton", "Joints and bones over the picture.", "K", &V::skeleton));
    all.push_back(toggle("view.parts", "Body parts", "The nine parts painted over the body.", "P", &V::parts));
    all.push_back(toggle("view.radius_spheres", "Radius spheres", "A sphere of the occlusion radius at every joint.",
                         "Shift+R", &V::radiusSpheres));
    all.push_back(
        toggle("view.surfel_discs", "Surfels as discs", "Every surfel as an opaque disc.", "Shift+D", &V::surfelDiscs));
    all.push_back(toggle("view.legend", "Legend", "Range and colours of a data buffer.", "Alt+L", &V::legend));
    all.push_back({.id = "view.select_joint",
                   .label = "Select joint",
                   .group = CommandGroup::View,
                   .help = "The joint that rings, numbers and keys are about.",
                   .arguments = {withDefault(joint("Left out: none."), std::string())},
                   .apply = selectJoint,
                   .describe = [](const Arguments& a) { return selectLabel(a, "joint"); }});
    all.push_back({.id = "view.select_part",
                   .label = "Select part",
                   .group = CommandGroup::View,
                   .help = "The part whose radius is looked at.",
                   .arguments = {leftOut(part("Left out: none."))},
                   .apply = selectPart,
                   .describe = [](const Arguments& a) { return selectLabel(a, "part"); }});
    return all;
}

} // namespace ars::edit
