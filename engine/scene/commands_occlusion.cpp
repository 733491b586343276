#include "engine/scene/command_arguments.h"
#include "engine/scene/command_edits.h"
#include "engine/scene/evaluate.h"

#include <fmt/format.h>

namespace ars::edit {
namespace {

Status refuseLocked(const Document& document, int part) {
    if (!document.occlusion.locked[static_cast<std::size_t>(part)]) return {};
    return unavailable(fmt::format("the radius of the {} is locked", bodyPartName(static_cast<BodyPart>(part))));
}

Status setRadius(Document& document, const Arguments& arguments, CommandContext& context) {
    ARS_TRY(const int part, partOf(textOf(arguments, "part")));
    ARS_TRY_STATUS(refuseLocked(document, part));
    writeRadius(document, context, part, static_cast<float>(numberOf(arguments, "metres")));
    return {};
}

Status lockRadius(Document& document, const Arguments& arguments, CommandContext&) {
    ARS_TRY(const int part, partOf(textOf(arguments, "part")));
    bool& locked = document.occlusion.locked[static_cast<std::size_t>(part)];
    locked = flagOr(arguments, "locked", !locked);
    return {};
}

Status resetRadius(Document& document, const Arguments& arguments, CommandContext& context) {
    if (const std::string name = textOf(arguments, "part"); !name.empty()) {
        ARS_TRY(const int part, partOf(name));
        ARS_TRY_STATUS(refuseLocked(document, part));
        writeRadius(document, context, part, document.occlusion.initial[static_cast<std::size_t>(part)]);
        return {};
    }
    for (int part = 0; part < kBodyPartCount; ++part) {
        const auto p = static_cast<std::size_t>(part);
        if (!document.occlusion.locked[p]) writeRadius(document, context, part, document.occlusion.initial[p]);
    }
    return {};
}

Status scaleRadii(Document& document, const Arguments& arguments, CommandContext& context) {
    const auto factor = static_cast<float>(numberOf(arguments, "factor"));
    const PartRadii radii = radiiAt(document, context.timeS);
    for (int part = 0; part < kBodyPartCount; ++part) {
        const auto p = static_cast<std::size_t>(part);
        if (!document.occlusion.locked[p]) writeRadius(document, context, part, factor * radii[p]);
    }
    return {};
}

Status usePreset(Document& document, const Arguments& arguments, CommandContext&) {
    ARS_TRY(document.occlusion.settings.screenSpace, occlusionPreset(textOf(arguments, "name")));
    return {};
}

std::string partLabel(const char* what, const Arguments& arguments) {
    const std::string part = textOf(arguments, "part");
    return part.empty() ? fmt::format("{} of all parts", what) : fmt::format("{} of {}", what, spoken(part));
}

} // namespace

std::vector<Command> occlusionCommands() {
    const double smallest = double(kMinRadiusFactor) * double(bodyPartInitialRadiusM(BodyPart::Hand));
    const double largest = double(kMaxRadiusFactor) * double(bodyPartInitialRadiusM(BodyPart::Torso));
    return {
        {.id = "occlusion.radius",
         .label = "Occlusion radius",
         .group = CommandGroup::Occlusion,
         .help = "How far a part looks for what hides it [r_g]; kept between 0.2 and 3 times its initial value.",
         .arguments = {part("Which part."), number("metres", {0.5 * smallest, 2.0 * largest}, "m", "The radius.")},
         .apply = setRadius,
         .describe = [](const Arguments& a) { return partLabel("Radius", a); }},
        {.id = "occlusion.lock",
         .label = "Lock radius",
         .group = CommandGroup::Occlusion,
         .help = "A locked radius is changed by nothing until it is unlocked.",
         .arguments = {part("Which part."), leftOut(flag("locked", "Left out: the other way round."))},
         .apply = lockRadius,
         .describe = [](const Arguments& a) { return partLabel("Lock radius", a); }},
        {.id = "occlusion.reset",
         .label = "Reset radii",
         .group = CommandGroup::Occlusion,
         .help = "Back to the initial radius; locked parts stay.",
         .arguments = {leftOut(part("Which part; left out: all."))},
         .apply = resetRadius,
         .describe = [](const Arguments& a) { return partLabel("Reset radius", a); }},
        {.id = "occlusion.scale",
         .label = "Scale radii",
         .group = CommandGroup::Occlusion,
         .help = "All radii that are not locked, times a factor.",
         .arguments = {number("factor", {0.05, 20}, "", "1 changes nothing.")},
         .apply = scaleRadii},
        {.id = "occlusion.method",
         .label = "Occlusion method",
         .group = CommandGroup::Occlusion,
         .help = "The paper's screen-space occlusion, or one that it is compared with.",
         .arguments = {enumWord<OcclusionMethod>("name", "Which method.")},
         .apply =
             [](Document& document, const Arguments& a, CommandContext&) {
                 document.occlusion.settings.method = enumOf<OcclusionMethod>(a, "name");
                 return Status();
             },
         .describe = [](const Arguments& a) { return "Occlusion " + spoken(textOf(a, "name")); },
         .variants = {{"Screen-space occlusion", {{"name", "screen_space"}}, ""},
                      {"Occlusion by rays against the mesh", {{"name", "mesh_rays"}}, ""},
                      {"Rasterised visibility (RAGA)", {{"name", "rasterised"}}, ""},
                      {"Baked visibility (GS-IR)", {{"name", "baked"}}, ""},
                      {"No occlusion", {{"name", "off"}}, ""}}},
        {.id = "occlusion.preset",
         .label = "Occlusion preset",
         .group = CommandGroup::Occlusion,
         .help = "All rows of screen-space occlusion: ours for bodies, or the constants of GI-GS.",
         .arguments = {word("name", {"body", "reference"}, "Which preset.")},
         .apply = usePreset,
         .variants = {{"Occlusion preset: body", {{"name", "body"}}, ""},
                      {"Occlusion preset: reference", {{"name", "reference"}}, ""}}},
    };
}

} // namespace ars::edit
