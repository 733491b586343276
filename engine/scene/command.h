#pragma once

#include "engine/core/error.h"
#include "engine/core/parameters.h"
#include "engine/scene/assets.h"
#include "engine/scene/document.h"

#include <nlohmann/json.hpp>

#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace ars {

/// Arguments of a command: a flat object of name -> bool, number or text.
using Arguments = nlohmann::json;

/// Where a command stands in menus and the palette.
enum class CommandGroup { Avatar, Pose, Timeline, Viewpoint, Light, Occlusion, View, Compare };
std::string_view commandGroupName(CommandGroup group);

/// Copied poses; not part of the document, so that undo never takes them away.
struct Clipboard {
    std::optional<Pose> pose;
    std::vector<int> joints; ///< that were copied; empty: all
};

/// What a command may look at besides the document.
struct CommandContext {
    const SceneAssets& assets;
    Clipboard& clipboard;
    double timeS = 0.0; ///< what is on the screen while it plays; else the document's
};

/// One argument. Choices may depend on the document (joint names, dataset cameras): they are asked for.
struct CommandArgument {
    ParameterInfo info;    ///< name, type by its default, range, fixed choices, unit, help
    bool required = false; ///< without a default: leaving it out is an error
    bool optional = false; ///< without a default: left out it stays out, and `help` says what holds then
    bool anyType = false;  ///< a bool, a number or a text, as what it is for has it (settings.set, light.lamp)
    std::function<std::vector<std::string>(const Document&, const CommandContext&)> choices; ///< may be null
};

/// A call with arguments that stands in menus, the palette and the shortcuts by itself: "Front view" of camera.preset.
struct CommandVariant {
    std::string label{};
    Arguments arguments{};
    std::string shortcut{}; ///< default keys, or ""
};

/// One edit. `id` is stable ("pose.rotate_joint"): scripts, shortcuts and tests use it.
struct Command {
    std::string id{};
    std::string label{}; ///< for menus and the undo list: "Rotate joint"
    CommandGroup group = CommandGroup::View;
    std::string help{};     ///< one sentence
    std::string shortcut{}; ///< default keys, "Ctrl+M", or ""; runs it with its defaults
    std::vector<CommandArgument> arguments{};
    /// Whether it can do anything now ("no clip is open" otherwise). Null: always.
    std::function<Status(const Document&, const CommandContext&)> enabled{};
    /// Changes the document, or says why it cannot and leaves it as it was (the editor restores it anyway).
    std::function<Status(Document&, const Arguments&, CommandContext&)> apply{};
    /// The undo entry's text with the arguments in it ("Rotate left elbow"); null: the label.
    std::function<std::string(const Arguments&)> describe{};
    std::vector<CommandVariant> variants{};

    /// Whether it can be run without any argument (menus offer those directly).
    bool runsWithDefaults() const;
};

/// All commands that edit documents, in the order of menus.
const std::vector<Command>& commands();
/// Null when there is none of this id.
const Command* findCommand(std::string_view id);

/// The joints of the document's avatar: its skeleton's names, or SMPL-X's while it loads.
std::vector<std::string> jointNames(const CommandContext& context);
/// Words for timeline commands of everything that has keys now, in the order of an editor: "joint:left_elbow", "root",
/// "expression", "camera", "light_rotation", "light_exposure", "radius:knee".
std::vector<std::string> keyedTracks(const Document& document, const CommandContext& context);

/// Defaults filled in, types, ranges and choices checked. InvalidArgument names command, argument, expected and found;
/// unknown arguments are refused.
Result<Arguments> checkArguments(const Command& command, const Arguments& arguments, const Document& document,
                                 const CommandContext& context);

} // namespace ars
