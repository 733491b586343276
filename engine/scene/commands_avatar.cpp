#include "engine/scene/command_arguments.h"
#include "engine/scene/command_edits.h"
#include "engine/scene/setting_groups.h"

#include <fmt/format.h>

namespace ars::edit {
namespace {

constexpr ParameterRange kCoefficient{-5.0, 5.0}; ///< standard deviations of the body's training set

Status checkSource(const std::string& source) {
    const std::string file = source.rfind("rest:", 0) == 0 ? source.substr(5) : source;
    if (source == "rest:open" || std::filesystem::path(file).is_absolute()) return {};
    return makeError(
        ErrorCode::InvalidArgument, "source",
        fmt::format("expected rest:open, rest:/FILE or the absolute path of an avatar, found \"{}\"", source));
}

Status hasShape(const Document&, const CommandContext& context) {
    ARS_TRY_STATUS(needsAvatar(context));
    if (context.assets.avatar->shapeNames.empty()) return unavailable("this avatar has no shape coefficients");
    return {};
}

/// The avatar's asset where it is loaded.
const AvatarAsset* loadedAsset(const Document& document, const CommandContext& context) {
    const AvatarAsset* asset = context.assets.avatar.get();
    return asset && asset->key == avatarKey(document.avatar) ? asset : nullptr;
}

/// Bodies have their soles at different heights: one that is at hand already stands on the floor where it is opened.
Status standOnFloor(Document& document, const CommandContext& context) {
    const TimelineSection& timeline = document.timeline;
    const bool loaded = skeletonOf(context) && loadedAsset(document, context);
    if (!loaded || !timeline.clip.empty() || !timeline.root.empty()) return {};
    Pose pose = currentPose(document, context);
    ARS_TRY_STATUS(placeOnFloor(context, pose));
    document.pose.pose.translation.y = pose.translation.y;
    return {};
}

/// Occlusion as the avatar was trained with it, else the usual one. Quality and directions are the viewer's.
void adoptOcclusion(OcclusionSection& occlusion, const AvatarAsset::Trained& trained) {
    OcclusionParams& params = occlusion.settings.screenSpace;
    const OcclusionParams before = params;
    params = trained.occlusion;
    params.quality = before.quality;
    params.interactiveDirections = before.interactiveDirections;
    occlusion.posing = trained.posing;
    OcclusionMethod& method = occlusion.settings.method;
    if (!trained.occluded) {
        method = OcclusionMethod::Off;
    } else if (method == OcclusionMethod::Off) {
        method = OcclusionMethod::ScreenSpace;
    }
}

/// Radii, kernel and occlusion come with a trained avatar and go with it. Locked radii stay; of those that a rest:
/// avatar finds, the ones that were changed by hand.
void adoptLearned(Document& document, const AvatarAsset* asset, bool wasTrained) {
    OcclusionSection& occlusion = document.occlusion;
    const bool trained = asset && asset->trained;
    if (!trained && !wasTrained) return;
    const PartRadii radii = trained ? asset->trained->radii : initialPartRadii();
    for (std::size_t p = 0; p < radii.size(); ++p) {
        const bool untouched = trained || occlusion.radii[p] == occlusion.initial[p];
        if (untouched && !occlusion.locked[p]) occlusion.radii[p] = radii[p];
    }
    occlusion.initial = radii;
    occlusion.splat = trained ? asset->trained->splat : OcclusionSection().splat;
    adoptOcclusion(occlusion, trained ? *asset->trained : AvatarAsset::Trained());
}

Status openAvatar(Document& document, const Arguments& arguments, CommandContext& context) {
    const std::string source = textOf(arguments, "source");
    ARS_TRY_STATUS(checkSource(source));
    const bool wasTrained = namesTrainedAvatar(document.avatar.source);
    if (document.avatar.source == source) {
        // Read anew, a run may have a newer checkpoint with other radii.
        if (wasTrained) adoptLearned(document, loadedAsset(document, context), wasTrained);
        return {};
    }
    document.avatar.source = source;
    document.avatar.betas.clear(); // coefficients mean something else on another body
    document.view.selectedJoint = -1;
    adoptLearned(document, loadedAsset(document, context), wasTrained);
    return standOnFloor(document, context);
}

Status setShape(Document& document, const Arguments& arguments, CommandContext& context) {
    const auto index = static_cast<std::size_t>(wholeOf(arguments, "index"));
    const std::size_t count = context.assets.avatar->shapeNames.size();
    if (index >= count) {
        return makeError(ErrorCode::InvalidArgument, "index",
                         fmt::format("expected 0 to {}, found {}", count - 1, index));
    }
    std::vector<float>& betas = document.avatar.betas;
    if (betas.size() <= index) betas.resize(index + 1, 0.0f);
    betas[index] = static_cast<float>(numberOf(arguments, "value"));
    while (!betas.empty() && betas.back() == 0.0f) betas.pop_back();
    return {};
}

Result<const SettingGroup*> groupOf(const std::string& name) {
    if (const SettingGroup* group = findSettingGroup(name)) return group;
    return makeError(ErrorCode::NotFound, "group", fmt::format("there is no \"{}\"", name));
}

Status setSetting(Document& document, const Arguments& arguments, CommandContext&) {
    ARS_TRY(const SettingGroup* group, groupOf(textOf(arguments, "group")));
    const std::string name = textOf(arguments, "name");
    for (const ParameterInfo& info : group->infos) {
        if (info.name != name) continue;
        auto value = valueOf(info, arguments.at("value"));
        if (!value) return atPlace(std::move(value).error(), group->name);
        return group->set(document, name, std::move(value).value());
    }
    // For its sentence, which names the nearest row.
    return group->set(document, name, ParameterValue(false));
}

CommandArgument settingName() {
    CommandArgument name = text("name", "Row of the table, as it stands in project files.");
    std::vector<std::string> all;
    for (const SettingGroup& group : settingGroups()) {
        for (const ParameterInfo& info : group.infos) {
            if (std::find(all.begin(), all.end(), info.name) == all.end()) all.push_back(info.name);
        }
    }
    name.choices = [all](const Document&, const CommandContext&) { return all; };
    return name;
}

std::string settingLabel(const Arguments& arguments) {
    const SettingGroup* group = findSettingGroup(textOf(arguments, "group"));
    return fmt::format("{}: {}", group ? group->label : "Settings", spoken(textOf(arguments, "name")));
}

} // namespace

std::vector<Command> avatarCommands() {
    return {
        {.id = "avatar.open",
         .label = "Open avatar",
         .group = CommandGroup::Avatar,
         .help = "Shows another avatar, standing on the floor; pose, light and camera stay. A trained one brings its "
                 "learned radii and its splatting with it.",
         .arguments = {text("source", "rest:open for the open body, rest:/FILE for surfels of a skinned mesh, or the "
                                      "path of a trained avatar, a run or a checkpoint.")},
         .apply = openAvatar,
         .variants = {{"Open body", {{"source", "rest:open"}}, ""}}},
        {.id = "avatar.shape",
         .label = "Change shape",
         .group = CommandGroup::Avatar,
         .help = "Sets one shape coefficient of the body [beta].",
         .arguments = {whole("index", {0, 299}, "Which coefficient, from 0."),
                       number("value", kCoefficient, "sd", "Standard deviations from the mean person.")},
         .enabled = hasShape,
         .apply = setShape,
         .describe = [](const Arguments& a) { return fmt::format("Change shape {}", wholeOf(a, "index") + 1); }},
        {.id = "avatar.reset_shape",
         .label = "Reset shape",
         .group = CommandGroup::Avatar,
         .help = "All shape coefficients to 0, the mean person.",
         .apply =
             [](Document& document, const Arguments&, CommandContext&) {
                 document.avatar.betas.clear();
                 return Status();
             }},
    };
}

std::vector<Command> settingCommands() {
    std::vector<std::string> groups;
    for (const SettingGroup& group : settingGroups()) groups.push_back(group.name);
    return {
        {.id = "settings.set",
         .label = "Change setting",
         .group = CommandGroup::View,
         .help = "Sets one row of a table of parameters.",
         .arguments = {word("group", groups, "Which table."), settingName(), any("value", "What the row takes.")},
         .apply = setSetting,
         .describe = settingLabel},
    };
}

} // namespace ars::edit
