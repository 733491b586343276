#include "engine/scene/commands_camera.h"
#include "engine/scene/command_arguments.h"
#include "engine/scene/command_edits.h"
#include "engine/scene/evaluate.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace ars::edit {
namespace {

constexpr double kDegree = std::numbers::pi / 180.0;
constexpr double kHighestDeg = 89.0; ///< beyond, lookAtCamera takes another "up" and the picture would jump
constexpr double kNearestM = 0.02, kFarthestM = 1000.0;
constexpr ParameterRange kPlace{-1000.0, 1000.0};
constexpr ParameterRange kTurn{-3600.0, 3600.0};

/// A direction by its angles: azimuth from +z towards +x, elevation above the horizon.
struct Direction {
    double azimuth = 0.0, elevation = 0.0; ///< radians

    static Direction of(const glm::dvec3& v) { return {std::atan2(v.x, v.z), std::atan2(v.y, std::hypot(v.x, v.z))}; }
    glm::dvec3 vector() const {
        return {std::sin(azimuth) * std::cos(elevation), std::sin(elevation), std::cos(azimuth) * std::cos(elevation)};
    }
    /// Raised by an angle, but not over the pole; what is nearer to it already may stay there.
    void raise(double angle) {
        const double limit = std::max(kHighestDeg * kDegree, std::abs(elevation));
        elevation = std::clamp(elevation + angle, -limit, limit);
    }
};

Status setCamera(Document& document, const Arguments& arguments, CommandContext& context) {
    SceneCamera camera = currentCamera(document, context);
    camera.eye = vectorOf(arguments, "eye_x", "eye_y", "eye_z");
    camera.target = vectorOf(arguments, "target_x", "target_y", "target_z");
    camera.rollDeg = numberOr(arguments, "roll", camera.rollDeg);
    camera.verticalFieldDeg = numberOr(arguments, "field", camera.verticalFieldDeg);
    if (glm::distance(camera.eye, camera.target) < 1e-3) {
        return makeError(ErrorCode::InvalidArgument, "eye", "expected at least 1 mm away from the target");
    }
    writeCamera(document, context, camera);
    return {};
}

Status orbit(Document& document, const Arguments& arguments, CommandContext& context) {
    SceneCamera camera = currentCamera(document, context);
    const glm::dvec3 away = camera.eye - camera.target;
    Direction direction = Direction::of(away);
    direction.azimuth += numberOf(arguments, "yaw") * kDegree;
    direction.raise(numberOf(arguments, "pitch") * kDegree);
    camera.eye = camera.target + glm::length(away) * direction.vector();
    writeCamera(document, context, camera);
    return {};
}

Status look(Document& document, const Arguments& arguments, CommandContext& context) {
    SceneCamera camera = currentCamera(document, context);
    const glm::dvec3 ahead = camera.target - camera.eye;
    Direction direction = Direction::of(ahead);
    // Azimuths grow to the left of who looks along them.
    direction.azimuth -= numberOf(arguments, "yaw") * kDegree;
    direction.raise(numberOf(arguments, "pitch") * kDegree);
    camera.target = camera.eye + glm::length(ahead) * direction.vector();
    writeCamera(document, context, camera);
    return {};
}

/// Moves eye and target along the camera's own axes.
void shift(Document& document, CommandContext& context, double right, double up, double forward) {
    SceneCamera camera = currentCamera(document, context);
    const glm::dmat3 axes = glm::transpose(cameraOf(camera, 2, 2).rotation); // right, down, forward
    const glm::dvec3 step = right * axes[0] - up * axes[1] + forward * axes[2];
    camera.eye += step;
    camera.target += step;
    writeCamera(document, context, camera);
}

Status dolly(Document& document, const Arguments& arguments, CommandContext& context) {
    SceneCamera camera = currentCamera(document, context);
    const glm::dvec3 away = camera.eye - camera.target;
    const double distance = glm::length(away);
    const double wanted = std::clamp(distance * numberOf(arguments, "factor"), kNearestM, kFarthestM);
    camera.eye = camera.target + away * (wanted / distance);
    writeCamera(document, context, camera);
    return {};
}

Status usePreset(Document& document, const Arguments& arguments, CommandContext& context) {
    ARS_TRY(const SceneCamera camera,
            presetCamera(textOf(arguments, "name"), currentCamera(document, context), document, context));
    writeCamera(document, context, camera);
    return {};
}

Status focus(Document& document, const Arguments& arguments, CommandContext& context) {
    int joint = document.view.selectedJoint;
    if (const std::string name = textOf(arguments, "joint"); !name.empty()) {
        ARS_TRY(joint, jointOf(context, name));
    }
    ARS_TRY(const SceneCamera camera, focusedCamera(joint, currentCamera(document, context), document, context));
    writeCamera(document, context, camera);
    return {};
}

std::vector<CommandVariant> presetVariants() {
    return {{"Front view", {{"name", "front"}}, "1"},
            {"Back view", {{"name", "back"}}, "Ctrl+1"},
            {"View of the left side", {{"name", "left"}}, "3"},
            {"View of the right side", {{"name", "right"}}, "Ctrl+3"},
            {"View from above", {{"name", "top"}}, "7"},
            {"Three-quarter view", {{"name", "three_quarter"}}, "9"},
            {"View of the face", {{"name", "face"}}, "4"},
            {"View of the upper body", {{"name", "upper_body"}}, "5"},
            {"View of the left hand", {{"name", "left_hand"}}, "6"},
            {"View of the right hand", {{"name", "right_hand"}}, "Ctrl+6"},
            {"View of the feet", {{"name", "feet"}}, "8"}};
}

Command moving(const char* id, const char* label, const char* help, std::vector<CommandArgument> arguments,
               std::function<Status(Document&, const Arguments&, CommandContext&)> apply) {
    return {.id = id,
            .label = label,
            .group = CommandGroup::Viewpoint,
            .help = help,
            .arguments = std::move(arguments),
            .apply = std::move(apply)};
}

std::vector<Command> movingCommands() {
    return {
        moving("camera.set", "Place camera", "Puts eye and target of the free camera.",
               {number("eye_x", kPlace, "m", "Eye, x."), number("eye_y", kPlace, "m", "Eye, y."),
                number("eye_z", kPlace, "m", "Eye, z."), number("target_x", kPlace, "m", "Target, x."),
                number("target_y", kPlace, "m", "Target, y."), number("target_z", kPlace, "m", "Target, z."),
                leftOut(number("roll", {-360, 360}, "deg", "Left out: as it is.")),
                leftOut(number("field", {1, 170}, "deg", "Opening from top to bottom; left out: as it is."))},
               setCamera),
        moving("camera.orbit", "Orbit", "Turns the camera about its target.",
               {number("yaw", kTurn, "deg", "Positive moves the camera to its right."),
                number("pitch", kTurn, "deg", "Positive moves it up; it stops above the target.")},
               orbit),
        moving("camera.pan", "Pan", "Moves camera and target in the plane of the picture.",
               {number("x", kPlace, "m", "To the right."), number("y", kPlace, "m", "Upwards.")},
               [](Document& document, const Arguments& a, CommandContext& context) {
                   shift(document, context, numberOf(a, "x"), numberOf(a, "y"), 0.0);
                   return Status();
               }),
        moving("camera.dolly", "Dolly", "Moves the camera towards its target or away from it.",
               {number("factor", {0.01, 100}, "", "Of the distance; below 1 comes nearer.")}, dolly),
        moving("camera.fly", "Fly", "Moves camera and target along the camera's own axes.",
               {number("right", kPlace, "m", "To the right."), number("up", kPlace, "m", "Upwards."),
                number("forward", kPlace, "m", "Ahead.")},
               [](Document& document, const Arguments& a, CommandContext& context) {
                   shift(document, context, numberOf(a, "right"), numberOf(a, "up"), numberOf(a, "forward"));
                   return Status();
               }),
        moving("camera.look", "Look around", "Turns the camera about its own eye.",
               {number("yaw", kTurn, "deg", "Positive looks to the right."),
                number("pitch", kTurn, "deg", "Positive looks up.")},
               look),
        moving("camera.roll", "Roll camera", "Sets the turn about the line of sight.",
               {number("degrees", {-360, 360}, "deg", "Positive turns the picture clockwise.")},
               [](Document& document, const Arguments& a, CommandContext& context) {
                   SceneCamera camera = currentCamera(document, context);
                   camera.rollDeg = numberOf(a, "degrees");
                   writeCamera(document, context, camera);
                   return Status();
               }),
        moving("camera.field", "Field of view", "Sets the opening angle of the free camera.",
               {number("degrees", {1, 170}, "deg", "From top to bottom of the picture.")},
               [](Document& document, const Arguments& a, CommandContext& context) {
                   SceneCamera camera = currentCamera(document, context);
                   camera.verticalFieldDeg = numberOf(a, "degrees");
                   writeCamera(document, context, camera);
                   return Status();
               }),
    };
}

} // namespace

std::vector<Command> cameraCommands() {
    std::vector<Command> all = movingCommands();
    all.push_back({.id = "camera.preset",
                   .label = "Camera preset",
                   .group = CommandGroup::Viewpoint,
                   .help = "Shows the body from one side, or one part of it closely.",
                   .arguments = {word("name",
                                      {"front", "back", "left", "right", "top", "three_quarter", "face", "upper_body",
                                       "left_hand", "right_hand", "feet"},
                                      "What is shown.")},
                   .apply = usePreset,
                   .describe = [](const Arguments& a) { return "Camera: " + spoken(textOf(a, "name")); },
                   .variants = presetVariants()});
    all.push_back({.id = "camera.focus",
                   .label = "Focus",
                   .group = CommandGroup::Viewpoint,
                   .help = "Brings a joint, or the whole body, into the middle of the picture.",
                   .shortcut = "F",
                   .arguments = {withDefault(joint("Left out: the selected one, or the whole body."), std::string())},
                   .apply = focus});
    all.push_back({.id = "camera.reset",
                   .label = "Reset camera",
                   .group = CommandGroup::Viewpoint,
                   .help = "The camera of a new project.",
                   .shortcut = "Shift+Home",
                   .apply = [](Document& document, const Arguments&, CommandContext& context) {
                       writeCamera(document, context, newDocument().camera.camera);
                       return Status();
                   }});
    return all;
}

} // namespace ars::edit
