#pragma once

#include "engine/core/error.h"

#include <nlohmann/json_fwd.hpp>

#include <array>

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

namespace ars {

/// How far a parameter is from what most people touch; panels fold the rest away.
enum class ParameterTier { Basic, Advanced, Expert };

/// One row of a table of parameters: it feeds the struct, JSON, the command line, widgets, tooltips and help.
///
/// A table describes a plain struct:
/// ```
/// struct OcclusionParams { float thicknessM = 0.25f; int directions = 128; bool median = false; };
/// const ParameterTable<OcclusionParams>& occlusionParameters() {
///     static const ParameterTable<OcclusionParams> table{
///         {"thickness", &OcclusionParams::thicknessM, {0.01, 2}, "m", ParameterTier::Advanced, "Depth behind ..."},
///         ...
/// ```
/// The default is the member's own initialiser, so that it stands once.
struct ParameterRange {
    double minimum = 0; ///< in the parameter's unit
    double maximum = 0; ///< equal to minimum: no bounds
};

using ParameterValue = std::variant<bool, std::int64_t, double, std::string>;

/// What panels and help need to know of one parameter, without the struct.
struct ParameterInfo {
    std::string name;
    ParameterValue defaultValue;
    ParameterRange range;
    std::vector<std::string> choices; ///< for enums: the allowed words
    std::string unit;                 ///< "m", "deg", "" ...
    ParameterTier tier = ParameterTier::Basic;
    std::string help; ///< one sentence; the paper's symbol in brackets where there is one

    /// "float", "int", "bool", "text", "choice".
    std::string_view typeName() const;
};

/// Parses what a person typed ("0.25", "true", "body") as a value of this parameter; checks range and choices.
/// InvalidArgument names the parameter, what was expected and what was found.
Result<ParameterValue> parseParameter(const ParameterInfo& info, std::string_view text);

/// Range, type and choice check of a value that came from elsewhere.
Result<ParameterValue> checkParameter(const ParameterInfo& info, ParameterValue value);

/// "0.25", "true", "body".
std::string formatParameter(const ParameterValue& value);

/// One aligned help line per parameter: "thickness  float 0.25 m [0.01 .. 2]  Depth behind ...".
std::string describeParameters(const std::vector<ParameterInfo>& infos);

namespace detail {
Error unknownParameter(const std::vector<ParameterInfo>& infos, std::string_view name);
Status readParametersJson(const std::vector<ParameterInfo>& infos, const nlohmann::json& object,
                          std::vector<ParameterValue>& values, std::vector<std::string>& unknown);
nlohmann::json writeParametersJson(const std::vector<ParameterInfo>& infos, const std::vector<ParameterValue>& values);
} // namespace detail

/// The words of an enum parameter; specialise for each enum that stands in a table:
/// `template <> struct EnumWords<Kernel> { static constexpr std::array words{"gaussian", "ray_splat"}; };`
/// Word i names the enumerator of value i.
template <typename Enum>
struct EnumWords;

/// The rows of one struct. Build it once as a function-local static.
template <typename Struct>
class ParameterTable {
public:
    struct Row {
        ParameterInfo info;
        std::function<ParameterValue(const Struct&)> get;
        std::function<void(Struct&, const ParameterValue&)> set;

        template <typename Member>
        Row(std::string name, Member Struct::* member, ParameterRange range, std::string unit, ParameterTier tier,
            std::string help);
    };

    ParameterTable(std::initializer_list<Row> rows) : rows_(rows) {
        for (const Row& row : rows_) infos_.push_back(row.info);
    }

    const std::vector<ParameterInfo>& infos() const { return infos_; }

    /// NotFound with the nearest name when there is none of this name.
    Result<ParameterValue> get(const Struct& object, std::string_view name) const;
    Status set(Struct& object, std::string_view name, ParameterValue value) const;
    /// `--set name=text`.
    Status setText(Struct& object, std::string_view name, std::string_view text) const;

    nlohmann::json toJson(const Struct& object) const;
    /// Keys that are missing keep their value; nothing is changed when any is wrong. `unknown` receives keys that no
    /// row has, so that a file from a newer version survives a round trip.
    Status fromJson(Struct& object, const nlohmann::json& json, std::vector<std::string>* unknown = nullptr) const;

private:
    const Row* find(std::string_view name) const;
    std::vector<Row> rows_;
    std::vector<ParameterInfo> infos_;
};

/// The name among `infos` that is closest to `name` by edit distance, or "" when none is near.
std::string nearestParameter(const std::vector<ParameterInfo>& infos, std::string_view name);

} // namespace ars

#include "engine/core/parameters_impl.h"
