#include "engine/scene/command_arguments.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace ars {

std::vector<std::string> jointNames(const CommandContext& context) {
    if (const Skeleton* skeleton = edit::skeletonOf(context)) return skeleton->names;
    std::vector<std::string> names;
    for (int j = 0; j < kSmplxJointCount; ++j) names.emplace_back(smplxJointName(j));
    return names;
}

} // namespace ars

namespace ars::edit {
namespace {

CommandArgument argumentOf(std::string name, ParameterValue value, std::string help) {
    CommandArgument argument;
    argument.info.name = std::move(name);
    argument.info.defaultValue = std::move(value);
    argument.info.help = std::move(help);
    argument.required = true;
    return argument;
}

Error wrongType(const ParameterInfo& info, const Arguments& value) {
    return makeError(ErrorCode::InvalidArgument, info.name,
                     fmt::format("expected {}, found {}", info.typeName(), value.type_name()));
}

} // namespace

CommandArgument number(std::string name, ParameterRange range, std::string unit, std::string help) {
    CommandArgument argument = argumentOf(std::move(name), 0.0, std::move(help));
    argument.info.range = range;
    argument.info.unit = std::move(unit);
    return argument;
}

CommandArgument whole(std::string name, ParameterRange range, std::string help) {
    CommandArgument argument = argumentOf(std::move(name), std::int64_t{0}, std::move(help));
    argument.info.range = range;
    return argument;
}

CommandArgument flag(std::string name, std::string help) { return argumentOf(std::move(name), false, std::move(help)); }

CommandArgument text(std::string name, std::string help) {
    return argumentOf(std::move(name), std::string(), std::move(help));
}

CommandArgument word(std::string name, std::vector<std::string> choices, std::string help) {
    CommandArgument argument = argumentOf(std::move(name), choices.front(), std::move(help));
    argument.info.choices = std::move(choices);
    return argument;
}

CommandArgument any(std::string name, std::string help) {
    CommandArgument argument = text(std::move(name), std::move(help));
    argument.anyType = true;
    return argument;
}

CommandArgument joint(std::string help) {
    CommandArgument argument = text("joint", std::move(help));
    argument.choices = [](const Document&, const CommandContext& context) { return jointNames(context); };
    return argument;
}

CommandArgument part(std::string help) {
    std::vector<std::string> names;
    for (int p = 0; p < kBodyPartCount; ++p) names.emplace_back(bodyPartName(static_cast<BodyPart>(p)));
    return word("part", std::move(names), std::move(help));
}

CommandArgument buffer(std::string help) {
    std::vector<std::string> names;
    for (const BufferInfo& info : bufferCatalogue()) names.emplace_back(info.name);
    return word("buffer", std::move(names), std::move(help));
}

CommandArgument withDefault(CommandArgument argument, ParameterValue value) {
    argument.required = false;
    argument.info.defaultValue = std::move(value);
    return argument;
}

CommandArgument leftOut(CommandArgument argument) {
    argument.required = false;
    argument.optional = true;
    return argument;
}

double numberOf(const Arguments& arguments, const char* name) { return arguments.at(name).get<double>(); }

double numberOr(const Arguments& arguments, const char* name, double otherwise) {
    return arguments.contains(name) ? numberOf(arguments, name) : otherwise;
}

int wholeOf(const Arguments& arguments, const char* name) { return arguments.at(name).get<int>(); }

bool flagOf(const Arguments& arguments, const char* name) { return arguments.at(name).get<bool>(); }

bool flagOr(const Arguments& arguments, const char* name, bool otherwise) {
    return arguments.contains(name) ? flagOf(arguments, name) : otherwise;
}

std::string textOf(const Arguments& arguments, const char* name) {
    return arguments.contains(name) ? arguments.at(name).get<std::string>() : std::string();
}

glm::dvec3 vectorOf(const Arguments& arguments, const char* x, const char* y, const char* z) {
    return {numberOf(arguments, x), numberOf(arguments, y), numberOf(arguments, z)};
}

Result<ParameterValue> valueOf(const ParameterInfo& info, const Arguments& value) {
    if (value.is_boolean()) return checkParameter(info, value.get<bool>());
    if (value.is_string()) return checkParameter(info, value.get<std::string>());
    if (!value.is_number()) return wrongType(info, value);
    if (!std::holds_alternative<std::int64_t>(info.defaultValue)) return checkParameter(info, value.get<double>());
    const double found = value.get<double>();
    // 3.0 is a sound whole number: scripts in languages without integers write it.
    if (std::floor(found) == found && std::abs(found) < 9e15) {
        return checkParameter(info, static_cast<std::int64_t>(found));
    }
    return checkParameter(info, found);
}

std::string spoken(std::string_view name) {
    std::string result(name);
    std::replace(result.begin(), result.end(), '_', ' ');
    return result;
}

Result<int> jointOf(const CommandContext& context, const std::string& name) {
    const std::vector<std::string> names = jointNames(context);
    const auto found = std::find(names.begin(), names.end(), name);
    if (found != names.end()) return static_cast<int>(found - names.begin());
    std::vector<ParameterInfo> infos(names.size());
    for (std::size_t i = 0; i < names.size(); ++i) infos[i].name = names[i];
    const std::string near = nearestParameter(infos, name);
    return makeError(ErrorCode::NotFound, "joint",
                     fmt::format("there is no \"{}\"{}", name, near.empty() ? "" : "; did you mean " + near + "?"));
}

Result<int> partOf(const std::string& name) {
    std::vector<std::string_view> names;
    for (int p = 0; p < kBodyPartCount; ++p) {
        names.push_back(bodyPartName(static_cast<BodyPart>(p)));
        if (names.back() == name) return p;
    }
    return makeError(ErrorCode::InvalidArgument, "part",
                     fmt::format("expected one of {}, found \"{}\"", fmt::join(names, ", "), name));
}

Result<BufferId> bufferOf(const std::string& name) {
    for (const BufferInfo& info : bufferCatalogue()) {
        if (info.name == name) return info.id;
    }
    return makeError(ErrorCode::NotFound, "buffer", fmt::format("there is no \"{}\"", name));
}

Error unavailable(std::string reason) { return makeError(ErrorCode::Unavailable, "", std::move(reason)); }

Status needsAvatar(const CommandContext& context) {
    if (!skeletonOf(context)) return unavailable("no avatar is loaded yet");
    return {};
}

Status needsSmplx(const CommandContext& context) {
    const Skeleton* skeleton = skeletonOf(context);
    if (skeleton && !isSmplx(*skeleton)) return unavailable("this needs an avatar with a SMPL-X skeleton");
    return {};
}

Status needsAbsolute(const std::string& path, std::string_view what) {
    if (std::filesystem::path(path).is_absolute()) return {};
    return makeError(ErrorCode::InvalidArgument, std::string(what),
                     fmt::format("expected an absolute path, found \"{}\"", path));
}

const Skeleton* skeletonOf(const CommandContext& context) {
    const auto& avatar = context.assets.avatar;
    return avatar && avatar->evaluator ? &avatar->evaluator->rig().skeleton : nullptr;
}

bool isSmplx(const Skeleton& skeleton) {
    if (skeleton.jointCount() != kSmplxJointCount) return false;
    for (int j = 0; j < kSmplxJointCount; ++j) {
        if (skeleton.names[static_cast<std::size_t>(j)] != smplxJointName(j)) return false;
    }
    return true;
}

} // namespace ars::edit
