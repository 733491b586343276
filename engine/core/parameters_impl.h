#pragma once

#include "engine/core/parameters.h"

#include <nlohmann/json.hpp>

/// Templates of parameters.h; include that.
namespace ars {

template <typename Struct>
template <typename Member>
ParameterTable<Struct>::Row::Row(std::string name, Member Struct::* member, ParameterRange range, std::string unit,
                                 ParameterTier tier, std::string help) {
    info.name = std::move(name);
    info.range = range;
    info.unit = std::move(unit);
    info.tier = tier;
    info.help = std::move(help);
    if constexpr (std::is_enum_v<Member>) {
        for (std::string_view word : EnumWords<Member>::words) info.choices.emplace_back(word);
        get = [member](const Struct& object) {
            return ParameterValue(std::string(EnumWords<Member>::words[static_cast<std::size_t>(object.*member)]));
        };
        set = [member](Struct& object, const ParameterValue& value) {
            const auto& words = EnumWords<Member>::words;
            for (std::size_t i = 0; i < words.size(); ++i) {
                if (words[i] == std::get<std::string>(value)) object.*member = static_cast<Member>(i);
            }
        };
    } else if constexpr (std::is_same_v<Member, bool>) {
        get = [member](const Struct& object) { return ParameterValue(object.*member); };
        set = [member](Struct& object, const ParameterValue& value) { object.*member = std::get<bool>(value); };
    } else if constexpr (std::is_integral_v<Member>) {
        get = [member](const Struct& object) { return ParameterValue(static_cast<std::int64_t>(object.*member)); };
        set = [member](Struct& object, const ParameterValue& value) {
            object.*member = static_cast<Member>(std::get<std::int64_t>(value));
        };
    } else if constexpr (std::is_floating_point_v<Member>) {
        get = [member](const Struct& object) { return ParameterValue(static_cast<double>(object.*member)); };
        set = [member](Struct& object, const ParameterValue& value) {
            object.*member = static_cast<Member>(std::get<double>(value));
        };
    } else {
        static_assert(std::is_same_v<Member, std::string>, "a parameter is a bool, a number, a string or an enum");
        get = [member](const Struct& object) { return ParameterValue(object.*member); };
        set = [member](Struct& object, const ParameterValue& value) { object.*member = std::get<std::string>(value); };
    }
    info.defaultValue = get(Struct{});
}

template <typename Struct>
auto ParameterTable<Struct>::find(std::string_view name) const -> const Row* {
    for (const Row& row : rows_) {
        if (row.info.name == name) return &row;
    }
    return nullptr;
}

template <typename Struct>
Result<ParameterValue> ParameterTable<Struct>::get(const Struct& object, std::string_view name) const {
    const Row* row = find(name);
    if (!row) return detail::unknownParameter(infos_, name);
    return row->get(object);
}

template <typename Struct>
Status ParameterTable<Struct>::set(Struct& object, std::string_view name, ParameterValue value) const {
    const Row* row = find(name);
    if (!row) return detail::unknownParameter(infos_, name);
    ARS_TRY(const ParameterValue checked, checkParameter(row->info, std::move(value)));
    row->set(object, checked);
    return {};
}

template <typename Struct>
Status ParameterTable<Struct>::setText(Struct& object, std::string_view name, std::string_view text) const {
    const Row* row = find(name);
    if (!row) return detail::unknownParameter(infos_, name);
    ARS_TRY(const ParameterValue value, parseParameter(row->info, text));
    row->set(object, value);
    return {};
}

template <typename Struct>
nlohmann::json ParameterTable<Struct>::toJson(const Struct& object) const {
    std::vector<ParameterValue> values;
    for (const Row& row : rows_) values.push_back(row.get(object));
    return detail::writeParametersJson(infos_, values);
}

template <typename Struct>
Status ParameterTable<Struct>::fromJson(Struct& object, const nlohmann::json& json,
                                        std::vector<std::string>* unknown) const {
    std::vector<ParameterValue> values;
    for (const Row& row : rows_) values.push_back(row.get(object));
    std::vector<std::string> strangers;
    ARS_TRY_STATUS(detail::readParametersJson(infos_, json, values, strangers));
    for (std::size_t i = 0; i < rows_.size(); ++i) rows_[i].set(object, values[i]);
    if (unknown) *unknown = std::move(strangers);
    return {};
}

} // namespace ars
