#include "engine/rig/inverse_kinematics.h"
#include "engine/rig/joint_names.h"
#include "engine/scene/command_arguments.h"
#include "engine/scene/command_edits.h"
#include "engine/scene/evaluate.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace ars::edit {
namespace {

constexpr ParameterRange kTurnDeg{-3600.0, 3600.0};
constexpr ParameterRange kPlaceM{-100.0, 100.0};

glm::quat rotationOf(const Arguments& arguments) {
    return quatFromAxisAngle(glm::radians(glm::vec3(vectorOf(arguments, "x", "y", "z"))));
}

/// The nearest rotation within a SMPL-X joint's range of motion.
glm::quat limited(const glm::quat& rotation, int joint) {
    const JointLimit& limit = smplxJointLimits()[static_cast<std::size_t>(joint)];
    return rotationFromCoordinates(limit, glm::clamp(limitCoordinates(limit, rotation), limit.minimum, limit.maximum));
}

Status rotateJoint(Document& document, const Arguments& arguments, CommandContext& context) {
    ARS_TRY(const int joint, jointOf(context, textOf(arguments, "joint")));
    Pose pose = currentPose(document, context);
    glm::quat rotation = rotationOf(arguments);
    if (flagOf(arguments, "limits") && isSmplx(*skeletonOf(context))) rotation = limited(rotation, joint);
    pose.rotations[static_cast<std::size_t>(joint)] = rotation;
    writePose(document, context, pose);
    return {};
}

Status turnJoint(Document& document, const Arguments& arguments, CommandContext& context) {
    ARS_TRY(const int joint, jointOf(context, textOf(arguments, "joint")));
    Pose pose = currentPose(document, context);
    glm::quat& local = pose.rotations[static_cast<std::size_t>(joint)];
    // World orientation is A R with R the local rotation; Q A R = A R' gives R' = A^-1 Q A R.
    const glm::mat4 world = jointWorldMatrices(*skeletonOf(context), pose)[static_cast<std::size_t>(joint)];
    const glm::dquat r = glm::normalize(glm::dquat(local));
    const glm::dquat above = glm::normalize(glm::quat_cast(glm::dmat3(glm::mat3(world)))) * glm::inverse(r);
    const glm::dquat turn(rotationOf(arguments));
    local = glm::quat(glm::normalize(glm::inverse(above) * turn * above * r));
    writePose(document, context, pose);
    return {};
}

/// Wrists and ankles: what stands or holds something keeps its orientation.
bool isHandOrFoot(const Skeleton& skeleton, int joint) {
    const int meaning =
        isSmplx(skeleton) ? joint : smplxJointsForNames(skeleton.names)[static_cast<std::size_t>(joint)];
    if (meaning < 0) return false;
    const std::string_view name = smplxJointName(meaning);
    return name == "left_wrist" || name == "right_wrist" || name == "left_ankle" || name == "right_ankle";
}

Status dragJoint(Document& document, const Arguments& arguments, CommandContext& context) {
    ARS_TRY(const int joint, jointOf(context, textOf(arguments, "joint")));
    const Skeleton& skeleton = *skeletonOf(context);
    Pose pose = currentPose(document, context);
    IkOptions options;
    options.useLimits = flagOr(arguments, "limits", document.pose.useLimits);
    options.keepEndOrientation =
        flagOr(arguments, "keep_orientation", document.pose.keepOrientation && isHandOrFoot(skeleton, joint));
    ARS_TRY_STATUS(solveIk(skeleton, pose, joint, glm::vec3(vectorOf(arguments, "x", "y", "z")), options));
    writePose(document, context, pose);
    return {};
}

Status moveRoot(Document& document, const Arguments& arguments, CommandContext& context) {
    Pose pose = currentPose(document, context);
    pose.translation = glm::vec3(vectorOf(arguments, "x", "y", "z"));
    writePose(document, context, pose);
    return {};
}

Status mirror(Document& document, const Arguments&, CommandContext& context) {
    writePose(document, context, mirroredPose(currentPose(document, context)));
    return {};
}

Status mirrorSide(Document& document, const Arguments& arguments, CommandContext& context) {
    Pose pose = currentPose(document, context);
    const Pose mirrored = mirroredPose(pose);
    const std::string to = textOf(arguments, "from") == "left" ? "right_" : "left_";
    for (int j = 0; j < kSmplxJointCount; ++j) {
        const auto index = static_cast<std::size_t>(j);
        if (smplxJointName(j).substr(0, to.size()) == to) pose.rotations[index] = mirrored.rotations[index];
    }
    writePose(document, context, pose);
    return {};
}

Status placeDown(Document& document, const Arguments&, CommandContext& context) {
    Pose pose = currentPose(document, context);
    ARS_TRY_STATUS(placeOnFloor(context, pose));
    writePose(document, context, pose);
    return {};
}

Status hasExpression(const Document&, const CommandContext& context) {
    ARS_TRY_STATUS(needsAvatar(context));
    if (context.assets.avatar->expressionNames.empty())
        return unavailable("this avatar has no expression coefficients");
    return {};
}

Status setExpression(Document& document, const Arguments& arguments, CommandContext& context) {
    const auto index = static_cast<std::size_t>(wholeOf(arguments, "index"));
    const std::size_t count = context.assets.avatar->expressionNames.size();
    if (index >= count) {
        return makeError(ErrorCode::InvalidArgument, "index",
                         fmt::format("expected 0 to {}, found {}", count - 1, index));
    }
    std::vector<float> expression = currentPose(document, context).expression;
    if (expression.size() <= index) expression.resize(index + 1, 0.0f);
    expression[index] = static_cast<float>(numberOf(arguments, "value"));
    writeExpression(document, context, std::move(expression));
    return {};
}

Status loaded(const Document&, const CommandContext& context) { return needsAvatar(context); }

Status loadedSmplx(const Document&, const CommandContext& context) {
    ARS_TRY_STATUS(needsAvatar(context));
    return needsSmplx(context);
}

std::function<std::string(const Arguments&)> jointLabel(const char* what) {
    return [text = std::string(what)](const Arguments& a) { return text + " " + spoken(textOf(a, "joint")); };
}

std::vector<CommandArgument> turning(const char* what, const char* axes) {
    return {joint(what), number("x", kTurnDeg, "deg", fmt::format("Rotation vector, x, {}.", axes)),
            number("y", kTurnDeg, "deg", fmt::format("Rotation vector, y, {}.", axes)),
            number("z", kTurnDeg, "deg", fmt::format("Rotation vector, z, {}.", axes))};
}

std::vector<CommandArgument> place(const char* what) {
    return {number("x", kPlaceM, "m", fmt::format("{}, x (the body's left).", what)),
            number("y", kPlaceM, "m", fmt::format("{}, y (up).", what)),
            number("z", kPlaceM, "m", fmt::format("{}, z (the front).", what))};
}

std::vector<Command> jointCommands() {
    std::vector<CommandArgument> rotation = turning("Which joint.", "in the joint's rest axes");
    rotation.push_back(withDefault(flag("limits", "Keeps within the joint's range of motion."), false));
    std::vector<CommandArgument> drag = place("Where the joint shall go");
    drag.insert(drag.begin(), joint("Which joint; the root moves the whole body."));
    drag.push_back(leftOut(flag("limits", "Joints keep their range of motion; left out: as pose.limits has it.")));
    drag.push_back(leftOut(flag("keep_orientation", "The joint keeps its orientation in the world; left out: hands and "
                                                    "feet do as pose.keep_orientation has it.")));
    return {
        {.id = "pose.rotate_joint",
         .label = "Rotate joint",
         .group = CommandGroup::Pose,
         .help = "Sets a joint's rotation relative to its parent.",
         .arguments = rotation,
         .enabled = loaded,
         .apply = rotateJoint,
         .describe = jointLabel("Rotate")},
        {.id = "pose.turn_joint",
         .label = "Turn joint",
         .group = CommandGroup::Pose,
         .help = "Turns a joint further about the world's axes.",
         .arguments = turning("Which joint.", "in world axes"),
         .enabled = loaded,
         .apply = turnJoint,
         .describe = jointLabel("Turn")},
        {.id = "pose.drag_joint",
         .label = "Drag joint",
         .group = CommandGroup::Pose,
         .help = "Brings a joint to a place by turning the limb that it hangs on (inverse kinematics).",
         .arguments = drag,
         .enabled = loaded,
         .apply = dragJoint,
         .describe = jointLabel("Drag")},
        {.id = "pose.move_root",
         .label = "Move body",
         .group = CommandGroup::Pose,
         .help = "Sets the translation of the whole body.",
         .arguments = place("Translation from the rest pose"),
         .enabled = loaded,
         .apply = moveRoot},
    };
}

std::vector<Command> mirrorCommands() {
    return {
        {.id = "pose.mirror",
         .label = "Mirror pose",
         .group = CommandGroup::Pose,
         .help = "Exchanges left and right of the whole pose.",
         .shortcut = "Ctrl+M",
         .enabled = loadedSmplx,
         .apply = mirror},
        {.id = "pose.mirror_side",
         .label = "Copy side to side",
         .group = CommandGroup::Pose,
         .help = "Gives the limbs of one side the mirrored pose of the other.",
         .arguments = {word("from", {"left", "right"}, "The side that stays.")},
         .enabled = loadedSmplx,
         .apply = mirrorSide,
         .describe = [](const Arguments& a) { return fmt::format("Copy {} side to the other", textOf(a, "from")); },
         .variants = {{"Copy left side to right", {{"from", "left"}}, "Ctrl+Shift+L"},
                      {"Copy right side to left", {{"from", "right"}}, "Ctrl+Shift+R"}}},
        {.id = "pose.place_on_floor",
         .label = "Place on floor",
         .group = CommandGroup::Pose,
         .help = "Moves the body up or down until its lowest point touches the floor.",
         .shortcut = "Shift+F",
         .enabled = loaded,
         .apply = placeDown},
    };
}

Command poseSwitch(const char* id, const char* label, const char* help, bool PoseSection::* member) {
    return {.id = id,
            .label = label,
            .group = CommandGroup::Pose,
            .help = help,
            .arguments = {leftOut(flag("enabled", "Left out: the other way round."))},
            .apply = [member](Document& document, const Arguments& a, CommandContext&) {
                document.pose.*member = flagOr(a, "enabled", !(document.pose.*member));
                return Status();
            }};
}

} // namespace

std::vector<Command> poseCommands() {
    std::vector<Command> all = jointCommands();
    for (Command& command : mirrorCommands()) all.push_back(std::move(command));
    all.push_back(
        {.id = "pose.expression",
         .label = "Change expression",
         .group = CommandGroup::Pose,
         .help = "Sets one expression coefficient of the face [psi].",
         .arguments = {whole("index", {0, 299}, "Which coefficient, from 0."),
                       number("value", {-5, 5}, "sd", "Standard deviations from the neutral face.")},
         .enabled = hasExpression,
         .apply = setExpression,
         .describe = [](const Arguments& a) { return fmt::format("Expression {}", wholeOf(a, "index") + 1); }});
    all.push_back({.id = "pose.reset_expression",
                   .label = "Reset expression",
                   .group = CommandGroup::Pose,
                   .help = "All expression coefficients to 0, the neutral face.",
                   .apply = [](Document& document, const Arguments&, CommandContext& context) {
                       writeExpression(document, context, {});
                       return Status();
                   }});
    all.push_back(poseSwitch("pose.limits", "Joint limits", "Drags keep within every joint's range of motion.",
                             &PoseSection::useLimits));
    all.push_back(poseSwitch("pose.keep_orientation", "Keep hands and feet level",
                             "A dragged hand or foot keeps its orientation in the world.",
                             &PoseSection::keepOrientation));
    return all;
}

} // namespace ars::edit
