#include "engine/scene/command_arguments.h"
#include "engine/scene/command_edits.h"
#include "engine/scene/evaluate.h"
#include "engine/scene/pose_library.h"

#include <fmt/format.h>

#include <algorithm>

namespace ars::edit {
namespace {

const glm::quat kIdentity(1.0f, 0.0f, 0.0f, 0.0f);
constexpr const char* kSelected = "selected";

/// A joint by name, or the selected one under the name "selected". Empty: all.
CommandArgument anyJoint(const char* help) {
    CommandArgument argument = withDefault(joint(help), std::string());
    argument.choices = [](const Document&, const CommandContext& context) {
        std::vector<std::string> names = jointNames(context);
        names.emplace_back(kSelected);
        return names;
    };
    return argument;
}

Result<int> jointNamed(const Document& document, const CommandContext& context, const std::string& name) {
    if (name != kSelected) return jointOf(context, name);
    const int joint = document.view.selectedJoint;
    if (joint < 0 || joint >= skeletonOf(context)->jointCount()) return unavailable("no joint is selected");
    return joint;
}

/// A joint and everything that hangs from it.
std::vector<int> subtree(const Skeleton& skeleton, int joint) {
    std::vector<int> joints{joint};
    for (int j = joint + 1; j < skeleton.jointCount(); ++j) {
        const int parent = skeleton.parents[static_cast<std::size_t>(j)];
        if (std::find(joints.begin(), joints.end(), parent) != joints.end()) joints.push_back(j);
    }
    return joints;
}

Status loaded(const Document&, const CommandContext& context) { return needsAvatar(context); }

Status canPaste(const Document&, const CommandContext& context) {
    ARS_TRY_STATUS(needsAvatar(context));
    if (!context.clipboard.pose) return unavailable("no pose has been copied");
    if (static_cast<int>(context.clipboard.pose->rotations.size()) != skeletonOf(context)->jointCount()) {
        return unavailable("the copied pose is of another skeleton");
    }
    return {};
}

Status copy(Document& document, const Arguments& arguments, CommandContext& context) {
    std::vector<int> joints;
    if (const std::string name = textOf(arguments, "joint"); !name.empty()) {
        ARS_TRY(const int joint, jointNamed(document, context, name));
        joints = subtree(*skeletonOf(context), joint);
    }
    context.clipboard.pose = currentPose(document, context);
    context.clipboard.joints = std::move(joints);
    return {};
}

/// The joint on the other side.
int opposite(const Skeleton& skeleton, int joint) {
    const std::string& name = skeleton.names[static_cast<std::size_t>(joint)];
    if (name.rfind("left_", 0) == 0) return skeleton.find("right_" + name.substr(5));
    if (name.rfind("right_", 0) == 0) return skeleton.find("left_" + name.substr(6));
    return joint;
}

Status paste(Document& document, const Arguments& arguments, CommandContext& context) {
    const bool flipped = flagOf(arguments, "flipped");
    if (flipped) ARS_TRY_STATUS(needsSmplx(context));
    const Skeleton& skeleton = *skeletonOf(context);
    const Pose source = flipped ? mirroredPose(*context.clipboard.pose) : *context.clipboard.pose;
    const Pose before = currentPose(document, context);
    Pose wanted = source;
    if (!context.clipboard.joints.empty()) {
        wanted = before;
        for (const int joint : context.clipboard.joints) {
            const auto j = static_cast<std::size_t>(flipped ? opposite(skeleton, joint) : joint);
            wanted.rotations[j] = source.rotations[j];
        }
    }
    const auto blend = static_cast<float>(numberOf(arguments, "blend"));
    writePose(document, context, blend >= 1.0f ? wanted : interpolatePoses(before, wanted, blend));
    return {};
}

Status reset(Document& document, const Arguments& arguments, CommandContext& context) {
    Pose pose = currentPose(document, context);
    if (const std::string name = textOf(arguments, "joint"); !name.empty()) {
        ARS_TRY(const int joint, jointNamed(document, context, name));
        std::vector<int> joints{joint};
        if (flagOf(arguments, "subtree")) joints = subtree(*skeletonOf(context), joint);
        for (const int j : joints) pose.rotations[static_cast<std::size_t>(j)] = kIdentity;
    } else {
        std::fill(pose.rotations.begin(), pose.rotations.end(), kIdentity);
        pose.translation.y = standingHeight(context);
    }
    writePose(document, context, pose);
    return {};
}

/// Where the body stood, on the floor in its new pose.
Status keepPlace(const CommandContext& context, const glm::vec3& place, Pose& pose) {
    pose.translation = place;
    return placeOnFloor(context, pose);
}

void writeBlended(Document& document, const CommandContext& context, const Pose& before, const Pose& wanted,
                  double blend) {
    writePose(document, context, blend >= 1.0 ? wanted : interpolatePoses(before, wanted, static_cast<float>(blend)));
}

Status applyPose(Document& document, const Arguments& arguments, CommandContext& context) {
    ARS_TRY(NamedPose named, parsePose(textOf(arguments, "pose"), *skeletonOf(context)));
    const Pose before = currentPose(document, context);
    if (flagOf(arguments, "keep_place")) {
        ARS_TRY_STATUS(keepPlace(context, before.translation, named.pose));
    } else if (!named.hasTranslation) {
        named.pose.translation = before.translation;
    }
    if (!named.hasExpression) named.pose.expression = before.expression;
    writeBlended(document, context, before, named.pose, numberOf(arguments, "blend"));
    return {};
}

Status usePreset(Document& document, const Arguments& arguments, CommandContext& context) {
    ARS_TRY(NamedPose named, libraryPose(textOf(arguments, "name"), *skeletonOf(context)));
    const Pose before = currentPose(document, context);
    ARS_TRY_STATUS(keepPlace(context, before.translation, named.pose));
    if (!named.hasExpression) named.pose.expression = before.expression;
    writeBlended(document, context, before, named.pose, numberOf(arguments, "blend"));
    return {};
}

std::string subjectLabel(const char* what, const Arguments& arguments) {
    const std::string name = textOf(arguments, "joint");
    return name.empty() ? fmt::format("{} pose", what) : fmt::format("{} {}", what, spoken(name));
}

CommandArgument blend() {
    return withDefault(number("blend", {0, 1}, "", "0 changes nothing, 1 takes it as it is."), 1.0);
}

CommandArgument presetName() {
    CommandArgument name = text("name", "Name of a pose of the library.");
    name.choices = [](const Document&, const CommandContext&) {
        std::vector<std::string> names;
        for (const PoseLibraryEntry& entry : poseLibrary()) names.push_back(entry.name);
        return names;
    };
    return name;
}

std::vector<Command> clipboardCommands() {
    return {
        {.id = "pose.copy",
         .label = "Copy pose",
         .group = CommandGroup::Pose,
         .help = "Remembers the pose, or that of a joint and what hangs from it.",
         .shortcut = "Ctrl+C",
         .arguments = {anyJoint("Left out: all joints.")},
         .enabled = loaded,
         .apply = copy,
         .describe = [](const Arguments& a) { return subjectLabel("Copy", a); },
         .variants = {{"Copy selected limb", {{"joint", kSelected}}, "Ctrl+Alt+C"}}},
        {.id = "pose.paste",
         .label = "Paste pose",
         .group = CommandGroup::Pose,
         .help = "Gives the body the copied pose.",
         .shortcut = "Ctrl+V",
         .arguments = {withDefault(flag("flipped", "Left and right exchanged."), false), blend()},
         .enabled = canPaste,
         .apply = paste,
         .describe = [](const Arguments& a) { return flagOf(a, "flipped") ? "Paste pose flipped" : "Paste pose"; },
         .variants = {{"Paste pose flipped", {{"flipped", true}}, "Ctrl+Shift+V"}}},
    };
}

} // namespace

std::vector<Command> poseLibraryCommands() {
    std::vector<Command> all = clipboardCommands();
    all.push_back({.id = "pose.reset",
                   .label = "Reset pose",
                   .group = CommandGroup::Pose,
                   .help = "Joints back to the rest pose; without a joint the whole body, standing on its soles.",
                   .shortcut = "Alt+Shift+R",
                   .arguments = {anyJoint("Left out: all joints."),
                                 withDefault(flag("subtree", "Also what hangs from the joint."), false)},
                   .enabled = loaded,
                   .apply = reset,
                   .describe = [](const Arguments& a) { return subjectLabel("Reset", a); },
                   .variants = {{"Reset selected joint", {{"joint", kSelected}}, "Alt+R"},
                                {"Reset selected limb", {{"joint", kSelected}, {"subtree", true}}, "Ctrl+Alt+R"}}});
    all.push_back(
        {.id = "pose.apply",
         .label = "Apply pose",
         .group = CommandGroup::Pose,
         .help = "Gives the body a pose written as JSON (rotation vectors in degrees by joint).",
         .arguments = {text("pose", "The JSON text of a pose file."), blend(),
                       withDefault(flag("keep_place", "The body stays where it stands, on the floor."), false)},
         .enabled = loaded,
         .apply = applyPose});
    all.push_back({.id = "pose.preset",
                   .label = "Pose of the library",
                   .group = CommandGroup::Pose,
                   .help = "Gives the body a pose of the library; it stays where it stands.",
                   .arguments = {presetName(), blend()},
                   .enabled = loaded,
                   .apply = usePreset,
                   .describe = [](const Arguments& a) { return "Pose: " + spoken(textOf(a, "name")); },
                   .variants = {{"Rest pose", {{"name", "rest"}}, ""}}});
    return all;
}

} // namespace ars::edit
