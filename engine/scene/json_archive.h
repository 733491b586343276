#pragma once

#include "engine/core/error.h"
#include "engine/core/parameters.h"
#include "engine/io/utf8.h"

#include <glm/glm.hpp>
#include <glm/gtc/quaternion.hpp>
#include <nlohmann/json.hpp>

#include <cmath>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

/// Internal to engine/scene: one description of a struct serves writing and reading JSON. Both classes stand at a place
/// in the file and have the same members; a description calls them in the order in which the file shows them.
namespace ars::detail {

using Json = nlohmann::ordered_json;

struct NumberRange {
    double minimum = 0.0;
    double maximum = 0.0;
};

/// JSON text with bounds on nesting, number of values and keys per object, found before memory is taken. BadFile with
/// line and column; LimitExceeded.
Result<Json> parseJsonText(std::string_view text);

/// "\"x\"", "12", "null", "a list of 3", "an object".
std::string foundText(const Json& json);
/// The double that is written in the fewest digits among those that round to this float.
double shortestDouble(float value);
/// Text of any bytes: a string where it is UTF-8, else {"bytes": hexadecimal}.
Json textToJson(const std::string& text);
std::optional<std::string> textFromJson(const Json& json);

/// Relative to `folder` where it lies below it or on the same volume, and comes back exactly; else as it is. "rest:"
/// in front and the word "open" stay.
std::string pathForFile(const std::string& path, const std::filesystem::path& folder);
std::string pathFromFile(const std::string& text, const std::filesystem::path& folder);

class JsonWriter {
public:
    template <typename T>
    using Ref = const T&;
    static constexpr bool kReads = false;

    JsonWriter(Json& json, const std::filesystem::path& folder) : json_(json), folder_(folder) {}
    JsonWriter(const JsonWriter&) = delete;
    JsonWriter& operator=(const JsonWriter&) = delete;

    JsonWriter at(std::string_view key) { return {json_[std::string(key)], folder_}; }
    bool object() {
        if (!json_.is_object()) json_ = Json::object();
        return true;
    }
    void flag(bool value) { json_ = value; }
    template <typename T>
    void number(const T& value, NumberRange) {
        if constexpr (std::is_same_v<T, float>) {
            json_ = shortestDouble(value);
        } else {
            json_ = value;
        }
    }
    template <typename T>
    void numbers(std::span<const T> values, NumberRange range) {
        json_ = Json::array();
        for (const T& value : values) JsonWriter(json_.emplace_back(nullptr), folder_).number(value, range);
    }
    void rotation(const glm::quat& q) {
        const float values[]{q.w, q.x, q.y, q.z};
        numbers(std::span<const float>(values), {});
    }
    void text(const std::string& value) { json_ = textToJson(value); }
    void path(const std::string& value) { json_ = textToJson(pathForFile(value, folder_)); }
    template <typename Enum>
    void word(const Enum& value, std::span<const std::string_view> words) {
        json_ = std::string(words[static_cast<std::size_t>(value)]);
    }
    template <typename T, typename Each>
    void list(const std::vector<T>& values, std::size_t, Each&& each) {
        json_ = Json::array();
        for (const T& value : values) each(JsonWriter(json_.emplace_back(nullptr), folder_), value);
    }
    template <typename Struct>
    void table(const ParameterTable<Struct>& rows, const Struct& params) {
        object();
        for (const ParameterInfo& info : rows.infos()) {
            const ParameterValue value = rows.get(params, info.name).value();
            std::visit([&](const auto& item) { json_[info.name] = item; }, value);
            if (const double* number = std::get_if<double>(&value)) {
                // Most rows are floats, which read shorter than the doubles that they come as.
                Struct copy = params;
                const double neat = shortestDouble(static_cast<float>(*number));
                if (rows.set(copy, info.name, neat).ok() && rows.get(copy, info.name).value() == value) {
                    json_[info.name] = neat;
                }
            } else if (const auto* words = std::get_if<std::string>(&value)) {
                json_[info.name] = textToJson(*words);
            }
        }
    }

private:
    Json& json_;
    const std::filesystem::path& folder_;
};

class JsonReader {
public:
    template <typename T>
    using Ref = T&;
    static constexpr bool kReads = true;

    /// What one reading has found out.
    struct Report {
        std::filesystem::path folder;
        std::optional<Error> error; ///< the first; everything after it is passed over
        std::vector<std::string> notes;
    };

    JsonReader(const Json& json, Report& report) : json_(&json), report_(&report) {}
    JsonReader(const JsonReader&) = delete;
    JsonReader& operator=(const JsonReader&) = delete;
    ~JsonReader(); ///< notes the keys of an object that nobody asked for

    /// The value of a key; where it is missing, everything read from it keeps its value.
    JsonReader at(std::string_view key);
    bool present() const { return json_ != nullptr && !report_->error; }
    bool isNull() const { return present() && json_->is_null(); }
    /// Whether there is an object to read from; anything else that is there is an error.
    bool object();
    /// Leaves these keys to others.
    void passOver(std::string_view key) { known_.emplace_back(key); }

    void flag(bool& value);
    void number(double& value, NumberRange range);
    void number(float& value, NumberRange range);
    void number(int& value, NumberRange range);
    template <typename T>
    void numbers(std::span<T> values, NumberRange range) {
        if (!expectList(values.size(), values.size())) return;
        for (std::size_t i = 0; i < values.size(); ++i) item(i).number(values[i], range);
    }
    /// Unit length within 1e-3 stays as it is, other lengths are made 1 with a note.
    void rotation(glm::quat& value);
    void text(std::string& value);
    void path(std::string& value);
    template <typename Enum>
    void word(Enum& value, std::span<const std::string_view> words) {
        std::size_t index = 0;
        if (choose(words, index)) value = static_cast<Enum>(index);
    }
    template <typename T, typename Each>
    void list(std::vector<T>& values, std::size_t maximum, Each&& each) {
        if (!expectList(0, maximum)) return;
        std::vector<T> read(json_->size());
        for (std::size_t i = 0; i < read.size() && !report_->error; ++i) each(item(i), read[i]);
        values = std::move(read);
    }
    template <typename Struct>
    void table(const ParameterTable<Struct>& rows, Struct& params) {
        if (!object()) return;
        for (const ParameterInfo& info : rows.infos()) {
            JsonReader member = at(info.name);
            std::optional<ParameterValue> value = member.parameter(info);
            if (!value) continue;
            if (const Status set = rows.set(params, info.name, std::move(*value)); !set) {
                member.fail(set.error().message);
            }
        }
    }

    void note(std::string_view text);
    /// Keeps the first error, at this place: "expected ..., found ...".
    void fail(std::string message, ErrorCode code = ErrorCode::BadFile);
    void failExpected(std::string_view expected);

private:
    JsonReader(const Json* json, Report& report, const JsonReader* parent, std::string_view key, std::size_t index)
        : json_(json), report_(&report), parent_(parent), key_(key), index_(index) {}
    JsonReader item(std::size_t index) { return {&(*json_)[index], *report_, this, {}, index}; }
    std::string place() const;
    /// Null stands for a number that was none when it was written: the value stays, with a note.
    bool passNull();
    bool expectList(std::size_t minimum, std::size_t maximum);
    bool choose(std::span<const std::string_view> words, std::size_t& index);
    bool readNumber(double& value, NumberRange range, std::string_view what);
    std::optional<ParameterValue> parameter(const ParameterInfo& info);
    std::optional<std::string> readText();

    const Json* json_ = nullptr; ///< null: missing
    Report* report_ = nullptr;
    const JsonReader* parent_ = nullptr;
    std::string_view key_; ///< of the parent's member, or empty for an item of a list
    std::size_t index_ = 0;
    bool isObject_ = false;
    std::vector<std::string_view> known_;
};

/// Of a description's second parameter: constant when writing.
template <typename Node, typename T>
using Ref = typename std::remove_reference_t<Node>::template Ref<T>;

} // namespace ars::detail
