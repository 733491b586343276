#include "engine/core/parameters.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <numeric>

namespace ars {
namespace {

std::string rangeText(const ParameterInfo& info) {
    if (info.range.minimum == info.range.maximum) return {};
    return fmt::format("[{:g} .. {:g}]", info.range.minimum, info.range.maximum);
}

Error wrongValue(const ParameterInfo& info, std::string_view found) {
    std::string expected(info.typeName());
    if (!info.choices.empty()) expected = fmt::format("one of {}", fmt::join(info.choices, ", "));
    if (const std::string range = rangeText(info); !range.empty()) expected += " in " + range;
    if (!info.unit.empty()) expected += " " + info.unit;
    return makeError(ErrorCode::InvalidArgument, info.name, fmt::format("expected {}, found {}", expected, found));
}

std::size_t editDistance(std::string_view a, std::string_view b) {
    std::vector<std::size_t> row(b.size() + 1);
    std::iota(row.begin(), row.end(), std::size_t{0});
    for (std::size_t i = 0; i < a.size(); ++i) {
        std::size_t diagonal = row[0]++;
        for (std::size_t j = 0; j < b.size(); ++j) {
            const std::size_t replace = diagonal + (a[i] == b[j] ? 0 : 1);
            diagonal = row[j + 1];
            row[j + 1] = std::min({replace, row[j] + 1, row[j + 1] + 1});
        }
    }
    return row.back();
}

bool inRange(const ParameterInfo& info, double value) {
    if (!std::isfinite(value)) return false;
    return info.range.minimum == info.range.maximum || (value >= info.range.minimum && value <= info.range.maximum);
}

template <typename T>
bool parseNumber(std::string_view text, T& value) {
    const auto [end, failure] = std::from_chars(text.data(), text.data() + text.size(), value);
    return failure == std::errc() && end == text.data() + text.size();
}

} // namespace

std::string_view ParameterInfo::typeName() const {
    if (!choices.empty()) return "choice";
    constexpr std::string_view names[]{"bool", "int", "float", "text"};
    return names[defaultValue.index()];
}

Result<ParameterValue> checkParameter(const ParameterInfo& info, ParameterValue value) {
    // A whole number is a sound value for a float; JSON and scripts write 1 for 1.0.
    if (std::holds_alternative<double>(info.defaultValue) && std::holds_alternative<std::int64_t>(value)) {
        value = static_cast<double>(std::get<std::int64_t>(value));
    }
    if (value.index() != info.defaultValue.index()) return wrongValue(info, "\"" + formatParameter(value) + "\"");
    if (const auto* number = std::get_if<double>(&value); number && !inRange(info, *number)) {
        return wrongValue(info, formatParameter(value));
    }
    if (const auto* number = std::get_if<std::int64_t>(&value);
        number && !inRange(info, static_cast<double>(*number))) {
        return wrongValue(info, formatParameter(value));
    }
    if (!info.choices.empty()) {
        const auto& word = std::get<std::string>(value);
        if (std::find(info.choices.begin(), info.choices.end(), word) == info.choices.end()) {
            return wrongValue(info, "\"" + word + "\"");
        }
    }
    return value;
}

Result<ParameterValue> parseParameter(const ParameterInfo& info, std::string_view text) {
    ParameterValue value = std::string(text);
    if (std::holds_alternative<bool>(info.defaultValue)) {
        if (text == "true" || text == "on" || text == "yes" || text == "1") value = true;
        if (text == "false" || text == "off" || text == "no" || text == "0") value = false;
    } else if (std::holds_alternative<std::int64_t>(info.defaultValue)) {
        if (std::int64_t number = 0; parseNumber(text, number)) value = number;
    } else if (std::holds_alternative<double>(info.defaultValue)) {
        if (double number = 0; parseNumber(text, number)) value = number;
    }
    return checkParameter(info, std::move(value));
}

std::string formatParameter(const ParameterValue& value) {
    return std::visit([](const auto& item) { return fmt::format("{}", item); }, value);
}

std::string describeParameters(const std::vector<ParameterInfo>& infos) {
    std::size_t width = 0;
    for (const ParameterInfo& info : infos) width = std::max(width, info.name.size());
    std::string text;
    for (const ParameterInfo& info : infos) {
        std::string traits = fmt::format("{} {}", info.typeName(), formatParameter(info.defaultValue));
        if (!info.unit.empty()) traits += " " + info.unit;
        if (!info.choices.empty()) traits += fmt::format(" ({})", fmt::join(info.choices, "|"));
        if (const std::string range = rangeText(info); !range.empty()) traits += " " + range;
        text += fmt::format("{:<{}}  {:<32}  {}\n", info.name, width, traits, info.help);
    }
    return text;
}

std::string nearestParameter(const std::vector<ParameterInfo>& infos, std::string_view name) {
    std::string best;
    std::size_t bestDistance = std::max<std::size_t>(2, name.size() / 3) + 1;
    for (const ParameterInfo& info : infos) {
        const std::size_t distance = editDistance(name, info.name);
        if (distance < bestDistance) {
            bestDistance = distance;
            best = info.name;
        }
    }
    return best;
}

namespace detail {

Error unknownParameter(const std::vector<ParameterInfo>& infos, std::string_view name) {
    const std::string near = nearestParameter(infos, name);
    return makeError(ErrorCode::NotFound, std::string(name),
                     near.empty() ? std::string("there is no parameter of this name")
                                  : fmt::format("there is no parameter of this name; did you mean {}?", near));
}

Status readParametersJson(const std::vector<ParameterInfo>& infos, const nlohmann::json& object,
                          std::vector<ParameterValue>& values, std::vector<std::string>& unknown) {
    if (!object.is_object()) {
        return makeError(ErrorCode::InvalidArgument, "parameters",
                         fmt::format("expected a JSON object, found {}", object.type_name()));
    }
    for (const auto& item : object.items()) {
        const std::string& key = item.key();
        const nlohmann::json& json = item.value();
        const auto info = std::find_if(infos.begin(), infos.end(), [&](const auto& row) { return row.name == key; });
        if (info == infos.end()) {
            unknown.push_back(key);
            continue;
        }
        ParameterValue value;
        if (json.is_boolean())
            value = json.get<bool>();
        else if (json.is_number_integer())
            value = json.get<std::int64_t>();
        else if (json.is_number())
            value = json.get<double>();
        else if (json.is_string())
            value = json.get<std::string>();
        else
            return wrongValue(*info, json.type_name());
        ARS_TRY(values[static_cast<std::size_t>(info - infos.begin())], checkParameter(*info, std::move(value)));
    }
    return {};
}

nlohmann::json writeParametersJson(const std::vector<ParameterInfo>& infos, const std::vector<ParameterValue>& values) {
    nlohmann::json object = nlohmann::json::object();
    for (std::size_t i = 0; i < infos.size(); ++i) {
        std::visit([&](const auto& value) { object[infos[i].name] = value; }, values[i]);
    }
    return object;
}

} // namespace detail
} // namespace ars
