#pragma once

#include "engine/scene/command.h"

#include <string>
#include <string_view>
#include <vector>

namespace ars::edit {

/// How commands describe and read their arguments. Arguments are required unless withDefault or leftOut says
/// otherwise.

CommandArgument number(std::string name, ParameterRange range, std::string unit, std::string help);
CommandArgument whole(std::string name, ParameterRange range, std::string help);
CommandArgument flag(std::string name, std::string help);
CommandArgument text(std::string name, std::string help);
CommandArgument word(std::string name, std::vector<std::string> choices, std::string help);
/// A bool, number or text.
CommandArgument any(std::string name, std::string help);
/// A joint of the avatar by name.
CommandArgument joint(std::string help);
/// One of the nine parts.
CommandArgument part(std::string help);
CommandArgument buffer(std::string help);

CommandArgument withDefault(CommandArgument argument, ParameterValue value);
CommandArgument leftOut(CommandArgument argument);

template <typename Enum>
CommandArgument enumWord(std::string name, std::string help) {
    std::vector<std::string> choices;
    for (const std::string_view item : EnumWords<Enum>::words) choices.emplace_back(item);
    return word(std::move(name), std::move(choices), std::move(help));
}

/// Reading checked arguments.
double numberOf(const Arguments& arguments, const char* name);
double numberOr(const Arguments& arguments, const char* name, double otherwise);
int wholeOf(const Arguments& arguments, const char* name);
bool flagOf(const Arguments& arguments, const char* name);
bool flagOr(const Arguments& arguments, const char* name, bool otherwise);
std::string textOf(const Arguments& arguments, const char* name); ///< "" when left out
glm::dvec3 vectorOf(const Arguments& arguments, const char* x, const char* y, const char* z);

template <typename Enum>
Enum enumOf(const Arguments& arguments, const char* name) {
    const std::string found = textOf(arguments, name);
    const auto& words = EnumWords<Enum>::words;
    for (std::size_t i = 0; i < words.size(); ++i) {
        if (words[i] == found) return static_cast<Enum>(i);
    }
    return Enum{};
}

/// A value as a parameter table takes it.
Result<ParameterValue> valueOf(const ParameterInfo& info, const Arguments& value);

/// "left elbow" from "left_elbow".
std::string spoken(std::string_view name);

/// Index of a joint by name; NotFound with the nearest.
Result<int> jointOf(const CommandContext& context, const std::string& name);
/// Index of a part by name; InvalidArgument lists the nine.
Result<int> partOf(const std::string& name);
Result<BufferId> bufferOf(const std::string& name);

/// "no avatar yet" while it loads.
Status needsAvatar(const CommandContext& context);
/// Unavailable where the avatar's skeleton is not SMPL-X's.
Status needsSmplx(const CommandContext& context);
/// Error of `enabled`.
Error unavailable(std::string reason);
/// InvalidArgument when `path` is not absolute.
Status needsAbsolute(const std::string& path, std::string_view what);

/// The skeleton of the avatar, or null.
const Skeleton* skeletonOf(const CommandContext& context);
bool isSmplx(const Skeleton& skeleton);

// The commands of each file, in the order of menus.
std::vector<Command> avatarCommands();
std::vector<Command> settingCommands();
std::vector<Command> poseCommands();
std::vector<Command> poseLibraryCommands();
std::vector<Command> timelineCommands();
std::vector<Command> keyCommands();
std::vector<Command> cameraCommands();
std::vector<Command> captureCommands();
std::vector<Command> lightCommands();
std::vector<Command> occlusionCommands();
std::vector<Command> viewCommands();
std::vector<Command> compareCommands();

} // namespace ars::edit
