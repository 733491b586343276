#include "engine/scene/command.h"

#include "engine/scene/command_arguments.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace ars {
namespace {

std::vector<Command> allCommands() {
    std::vector<Command> all;
    for (auto section : {edit::avatarCommands, edit::settingCommands, edit::poseCommands, edit::poseLibraryCommands,
                         edit::timelineCommands, edit::keyCommands, edit::cameraCommands, edit::captureCommands,
                         edit::lightCommands, edit::occlusionCommands, edit::viewCommands, edit::compareCommands}) {
        for (Command& command : section()) all.push_back(std::move(command));
    }
    return all;
}

std::string expectedOf(const ParameterInfo& info) {
    std::string text(info.typeName());
    if (!info.choices.empty()) text = fmt::format("one of {}", fmt::join(info.choices, ", "));
    if (info.range.minimum != info.range.maximum) {
        text += fmt::format(" in [{:g} .. {:g}]", info.range.minimum, info.range.maximum);
    }
    return info.unit.empty() ? text : text + " " + info.unit;
}

Error wrong(const Command& command, const std::string& argument, std::string message) {
    return makeError(ErrorCode::InvalidArgument, command.id + ": " + argument, std::move(message));
}

/// The name of `names` that is nearest to what was typed, or "".
std::string nearest(const std::vector<std::string>& names, const std::string& found) {
    std::vector<ParameterInfo> infos(names.size());
    for (std::size_t i = 0; i < names.size(); ++i) infos[i].name = names[i];
    return nearestParameter(infos, found);
}

Error unknownArgument(const Command& command, const std::string& name) {
    std::vector<std::string> names;
    for (const CommandArgument& argument : command.arguments) names.push_back(argument.info.name);
    const std::string near = nearest(names, name);
    if (!near.empty()) return wrong(command, name, fmt::format("there is no such argument; did you mean {}?", near));
    if (names.empty()) return wrong(command, name, "there is no such argument; this command takes none");
    return wrong(command, name, fmt::format("there is no such argument; expected {}", fmt::join(names, ", ")));
}

/// A word that is none of those that the document offers now.
Error notOffered(const Command& command, const CommandArgument& argument, const std::vector<std::string>& offered,
                 const std::string& found) {
    if (offered.empty()) return wrong(command, argument.info.name, fmt::format("there is no \"{}\"", found));
    const std::string near = nearest(offered, found);
    if (!near.empty()) {
        return wrong(command, argument.info.name, fmt::format("there is no \"{}\"; did you mean {}?", found, near));
    }
    constexpr std::size_t kListed = 12;
    const auto end = offered.begin() + static_cast<std::ptrdiff_t>(std::min(offered.size(), kListed));
    return wrong(command, argument.info.name,
                 fmt::format("expected one of {}{}, found \"{}\"", fmt::join(offered.begin(), end, ", "),
                             offered.size() > kListed ? " ..." : "", found));
}

bool isPlain(const nlohmann::json& value) { return value.is_boolean() || value.is_number() || value.is_string(); }

Result<nlohmann::json> checkArgument(const Command& command, const CommandArgument& argument,
                                     const nlohmann::json& value, const Document& document,
                                     const CommandContext& context) {
    if (argument.anyType) {
        if (isPlain(value)) return value;
        return wrong(command, argument.info.name,
                     fmt::format("expected a bool, a number or a text, found {}", value.type_name()));
    }
    auto checked = edit::valueOf(argument.info, value);
    if (!checked) return atPlace(std::move(checked).error(), command.id);
    if (argument.choices && std::holds_alternative<std::string>(checked.value())) {
        const auto& found = std::get<std::string>(checked.value());
        const bool none = found.empty() && !argument.required;
        if (!none) {
            const std::vector<std::string> offered = argument.choices(document, context);
            if (std::find(offered.begin(), offered.end(), found) == offered.end()) {
                return notOffered(command, argument, offered, found);
            }
        }
    }
    nlohmann::json result;
    std::visit([&result](const auto& item) { result = item; }, checked.value());
    return result;
}

} // namespace

std::string_view commandGroupName(CommandGroup group) {
    constexpr std::string_view names[]{"Avatar", "Pose", "Timeline", "Camera", "Light", "Occlusion", "View", "Compare"};
    return names[static_cast<std::size_t>(group)];
}

bool Command::runsWithDefaults() const {
    return std::none_of(arguments.begin(), arguments.end(), [](const CommandArgument& a) { return a.required; });
}

const std::vector<Command>& commands() {
    static const std::vector<Command> all = allCommands();
    return all;
}

const Command* findCommand(std::string_view id) {
    for (const Command& command : commands()) {
        if (command.id == id) return &command;
    }
    return nullptr;
}

Result<Arguments> checkArguments(const Command& command, const Arguments& arguments, const Document& document,
                                 const CommandContext& context) {
    if (!arguments.is_object() && !arguments.is_null()) {
        return makeError(ErrorCode::InvalidArgument, command.id,
                         fmt::format("expected arguments as a JSON object, found {}", arguments.type_name()));
    }
    for (const auto& item : arguments.items()) {
        const bool known = std::any_of(command.arguments.begin(), command.arguments.end(),
                                       [&](const CommandArgument& a) { return a.info.name == item.key(); });
        if (!known) return unknownArgument(command, item.key());
    }
    Arguments checked = Arguments::object();
    for (const CommandArgument& argument : command.arguments) {
        const std::string& name = argument.info.name;
        if (!arguments.is_object() || !arguments.contains(name)) {
            if (argument.required) {
                return wrong(command, name, fmt::format("is missing, expected {}", expectedOf(argument.info)));
            }
            if (!argument.optional) {
                std::visit([&](const auto& item) { checked[name] = item; }, argument.info.defaultValue);
            }
            continue;
        }
        ARS_TRY(checked[name], checkArgument(command, argument, arguments.at(name), document, context));
    }
    return checked;
}

} // namespace ars
