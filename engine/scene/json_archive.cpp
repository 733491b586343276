#include "engine/scene/json_archive.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <limits>

namespace ars::detail {
namespace fs = std::filesystem;

namespace {

// A document nests eight deep; the longest object has some thirty keys (the JSON library looks keys up one by one);
// two million keys of a timeline take some twenty million values.
constexpr std::size_t kMaxNesting = 32;
constexpr std::size_t kMaxValues = 40'000'000;
constexpr std::size_t kMaxMembers = 512;
constexpr std::size_t kMaxTextLength = 32768;
constexpr std::size_t kMaxNotes = 50;

/// Nesting, values and members by counting punctuation outside of strings; the parser judges everything else.
Status checkJsonSize(std::string_view text) {
    std::array<std::size_t, kMaxNesting> members{};
    std::size_t depth = 0, values = 0;
    const auto tooLarge = [](const char* what, std::size_t limit) {
        return makeError(ErrorCode::LimitExceeded, "", fmt::format("{}, the limit is {}", what, limit));
    };
    for (std::size_t i = 0; i < text.size(); ++i) {
        switch (text[i]) {
        case '"':
            for (++i; i < text.size() && text[i] != '"'; ++i) i += text[i] == '\\' ? 1 : 0;
            break;
        case '{':
        case '[':
            if (depth == kMaxNesting) return tooLarge("lists and objects lie in each other too deeply", kMaxNesting);
            members[depth++] = 0;
            ++values;
            break;
        case '}':
        case ']':
            depth -= depth > 0 ? 1 : 0;
            break;
        case ',':
            ++values;
            break;
        case ':':
            if (depth > 0 && ++members[depth - 1] > kMaxMembers) {
                return tooLarge("an object has too many keys", kMaxMembers);
            }
            break;
        default:
            break;
        }
        if (values > kMaxValues) return tooLarge("there are too many values", kMaxValues);
    }
    return {};
}

int hexDigit(char c) {
    if (c >= '0' && c <= '9') return c - '0';
    if (c >= 'a' && c <= 'f') return c - 'a' + 10;
    return -1;
}

/// The volume that a folder lies on, or will when it has been made.
std::optional<dev_t> volumeOf(fs::path folder) {
    for (; !folder.empty(); folder = folder.parent_path()) {
        struct stat info{};
        if (::stat(folder.c_str(), &info) == 0 && S_ISDIR(info.st_mode)) return info.st_dev;
        if (folder == folder.parent_path()) break;
    }
    return std::nullopt;
}

constexpr std::string_view kRestPrefix = "rest:";
constexpr std::string_view kOpenBody = "open";

std::string withPrefixKept(const std::string& text, std::string (*change)(const std::string&, const fs::path&),
                           const fs::path& folder) {
    const bool rest = text.rfind(kRestPrefix, 0) == 0;
    const std::string path = rest ? text.substr(kRestPrefix.size()) : text;
    if (path.empty() || (rest && path == kOpenBody)) return text;
    return (rest ? std::string(kRestPrefix) : std::string()) + change(path, folder);
}

std::string makeRelative(const std::string& text, const fs::path& folder) {
    const fs::path path = text;
    if (!path.is_absolute() || !folder.is_absolute()) return text;
    const fs::path base = folder.lexically_normal();
    fs::path relative = path.lexically_relative(base);
    if (relative.empty()) return text;
    const bool below = *relative.begin() != "..";
    if (!below && volumeOf(path.parent_path()) != volumeOf(base)) return text;
    if ((base / relative).lexically_normal().string() != text) return text;
    if (relative == kOpenBody) relative = fs::path(".") / relative;
    return relative.string();
}

std::string makeAbsolute(const std::string& text, const fs::path& folder) {
    const fs::path path = text;
    if (path.is_absolute() || folder.empty()) return text;
    const fs::path plain = (folder / path).lexically_normal();
    std::error_code failure;
    if (fs::exists(plain, failure)) return plain.string();
    // Beside a folder that was reached through a link, ".." may mean where the link points to.
    const fs::path real = fs::canonical(folder, failure);
    if (!failure && fs::exists(real / path, failure)) return (real / path).lexically_normal().string();
    return plain.string();
}

std::string shortened(std::string text) {
    constexpr std::size_t kMost = 60;
    if (text.size() <= kMost) return text;
    std::size_t cut = kMost;
    while (cut > 0 && (static_cast<unsigned char>(text[cut]) & 0xC0u) == 0x80u) --cut;
    return text.substr(0, cut) + "...";
}

std::string rangeText(NumberRange range) {
    return fmt::format("a number in [{:g}, {:g}]", range.minimum, range.maximum);
}

} // namespace

Result<Json> parseJsonText(std::string_view text) {
    ARS_TRY_STATUS(checkJsonSize(text));
    try {
        return Json::parse(text.begin(), text.end());
    } catch (const Json::exception& error) {
        // "[json.exception.parse_error.101] parse error at line 1, column 8: ..." without what only programmers know
        std::string_view what = error.what();
        if (const std::size_t bracket = what.find("] "); bracket != std::string_view::npos) {
            what.remove_prefix(bracket + 2);
        }
        return makeError(ErrorCode::BadFile, "", fmt::format("is no sound JSON: {}", what));
    } catch (const std::bad_alloc&) {
        return makeError(ErrorCode::OutOfMemory, "",
                         fmt::format("not enough memory for {} bytes of JSON", text.size()));
    }
}

std::string foundText(const Json& json) {
    if (json.is_array()) return fmt::format("a list of {}", json.size());
    if (json.is_object()) return "an object";
    return shortened(json.dump(-1, ' ', false, Json::error_handler_t::replace));
}

double shortestDouble(float value) {
    std::array<char, 48> digits{};
    const auto written = std::to_chars(digits.data(), digits.data() + digits.size(), value);
    double result = 0.0;
    const auto read = std::from_chars(digits.data(), written.ptr, result);
    if (read.ec != std::errc() || static_cast<float>(result) != value) return static_cast<double>(value);
    return result;
}

Json textToJson(const std::string& text) {
    if (isUtf8(text)) return text;
    std::string digits;
    for (const char c : text) digits += fmt::format("{:02x}", static_cast<unsigned char>(c));
    return Json{{"bytes", digits}};
}

std::optional<std::string> textFromJson(const Json& json) {
    if (json.is_string()) return json.get_ref<const std::string&>();
    if (!json.is_object() || json.size() != 1) return std::nullopt;
    const auto bytes = json.find("bytes");
    if (bytes == json.end() || !bytes->is_string()) return std::nullopt;
    const std::string& digits = bytes->get_ref<const std::string&>();
    if (digits.size() % 2 != 0) return std::nullopt;
    std::string text;
    for (std::size_t i = 0; i < digits.size(); i += 2) {
        const int high = hexDigit(digits[i]), low = hexDigit(digits[i + 1]);
        if (high < 0 || low < 0) return std::nullopt;
        text.push_back(static_cast<char>(high * 16 + low));
    }
    return text;
}

std::string pathForFile(const std::string& path, const fs::path& folder) {
    return withPrefixKept(path, makeRelative, folder);
}

std::string pathFromFile(const std::string& text, const fs::path& folder) {
    return withPrefixKept(text, makeAbsolute, folder);
}

JsonReader::~JsonReader() {
    if (!isObject_ || report_->error) return;
    for (const auto& member : json_->items()) {
        if (std::find(known_.begin(), known_.end(), member.key()) != known_.end()) continue;
        note(fmt::format("the key \"{}\" is not known and was left out", shortened(member.key())));
    }
}

JsonReader JsonReader::at(std::string_view key) {
    if (!isObject_) return {nullptr, *report_, this, key, 0};
    known_.push_back(key);
    const auto found = json_->find(std::string(key));
    return {found == json_->end() ? nullptr : &*found, *report_, this, key, 0};
}

std::string JsonReader::place() const {
    if (!parent_) return {};
    std::string before = parent_->place();
    if (key_.empty()) return fmt::format("{}[{}]", before, index_);
    return before.empty() ? std::string(key_) : fmt::format("{}.{}", before, key_);
}

void JsonReader::note(std::string_view text) {
    if (report_->notes.size() == kMaxNotes) report_->notes.emplace_back("there is more of this kind");
    if (report_->notes.size() > kMaxNotes) return;
    const std::string where = place();
    report_->notes.push_back(where.empty() ? std::string(text) : fmt::format("{}: {}", where, text));
}

void JsonReader::fail(std::string message, ErrorCode code) {
    if (!report_->error) report_->error = makeError(code, place(), std::move(message));
}

void JsonReader::failExpected(std::string_view expected) {
    fail(fmt::format("expected {}, found {}", expected, json_ ? foundText(*json_) : "nothing"));
}

bool JsonReader::object() {
    if (!present()) return false;
    if (!json_->is_object()) {
        failExpected("an object");
        return false;
    }
    isObject_ = true;
    return true;
}

bool JsonReader::passNull() {
    if (!json_->is_null()) return false;
    note("is null, which stands for no number; the default was kept");
    return true;
}

bool JsonReader::expectList(std::size_t minimum, std::size_t maximum) {
    if (!present()) return false;
    if (json_->is_array() && json_->size() >= minimum && json_->size() <= maximum) return true;
    if (minimum == maximum) {
        failExpected(fmt::format("a list of {}", maximum));
    } else if (json_->is_array()) {
        fail(fmt::format("expected a list of at most {}, found {}", maximum, json_->size()), ErrorCode::LimitExceeded);
    } else {
        failExpected("a list");
    }
    return false;
}

void JsonReader::flag(bool& value) {
    if (!present()) return;
    if (!json_->is_boolean()) return failExpected("true or false");
    value = json_->get<bool>();
}

bool JsonReader::readNumber(double& value, NumberRange range, std::string_view what) {
    if (!present() || passNull()) return false;
    if (!json_->is_number()) {
        failExpected(what);
        return false;
    }
    double read = json_->get<double>();
    // A float that was set to a bound may lie a rounding beyond it.
    for (const double bound : {range.minimum, range.maximum}) {
        if (std::abs(read - bound) <= 1e-6 * std::abs(bound)) read = std::clamp(read, range.minimum, range.maximum);
    }
    if (!(read >= range.minimum && read <= range.maximum)) {
        failExpected(rangeText(range));
        return false;
    }
    value = read;
    return true;
}

void JsonReader::number(double& value, NumberRange range) { readNumber(value, range, "a number"); }

void JsonReader::number(float& value, NumberRange range) {
    if (double read = 0.0; readNumber(read, range, "a number")) value = static_cast<float>(read);
}

void JsonReader::number(int& value, NumberRange range) {
    double read = 0.0;
    if (!readNumber(read, range, "a whole number")) return;
    if (read != std::floor(read)) return failExpected("a whole number");
    value = static_cast<int>(read);
}

void JsonReader::rotation(glm::quat& value) {
    if (!present()) {
        if (value == glm::quat(0.0f, 0.0f, 0.0f, 0.0f)) value = glm::quat(1.0f, 0.0f, 0.0f, 0.0f); // none was ever set
        return;
    }
    std::array<float, 4> q{1.0f, 0.0f, 0.0f, 0.0f};
    numbers(std::span<float>(q), {-1e6, 1e6});
    if (report_->error) return;
    glm::quat read(q[0], q[1], q[2], q[3]);
    const float length = glm::length(read);
    if (!(length > 1e-6f)) return failExpected("a rotation w, x, y, z that is not zero");
    if (std::abs(length - 1.0f) > 1e-3f) {
        note(fmt::format("a rotation had the length {:g} and was made 1", length));
        read = glm::normalize(read);
    }
    value = read;
}

std::optional<std::string> JsonReader::readText() {
    if (!present()) return std::nullopt;
    std::optional<std::string> read = textFromJson(*json_);
    if (!read) {
        failExpected("text");
    } else if (read->size() > kMaxTextLength) {
        fail(fmt::format("expected text of at most {} bytes, found {}", kMaxTextLength, read->size()),
             ErrorCode::LimitExceeded);
        return std::nullopt;
    }
    return read;
}

void JsonReader::text(std::string& value) {
    if (std::optional<std::string> read = readText()) value = std::move(*read);
}

void JsonReader::path(std::string& value) {
    const std::optional<std::string> read = readText();
    if (!read) return;
    if (read->find('\0') != std::string::npos) return failExpected("a path without zero bytes");
    value = pathFromFile(*read, report_->folder);
}

bool JsonReader::choose(std::span<const std::string_view> words, std::size_t& index) {
    if (!present()) return false;
    if (json_->is_string()) {
        const auto found = std::find(words.begin(), words.end(), json_->get_ref<const std::string&>());
        index = static_cast<std::size_t>(found - words.begin());
        if (found != words.end()) return true;
    }
    failExpected(fmt::format("one of {}", fmt::join(words, ", ")));
    return false;
}

std::optional<ParameterValue> JsonReader::parameter(const ParameterInfo& info) {
    if (!present()) return std::nullopt;
    if (std::holds_alternative<std::string>(info.defaultValue)) {
        std::optional<std::string> read = readText();
        if (!read) return std::nullopt;
        return ParameterValue(std::move(*read));
    }
    if (std::holds_alternative<bool>(info.defaultValue)) {
        bool read = false;
        flag(read);
        if (report_->error) return std::nullopt;
        return ParameterValue(read);
    }
    constexpr double kLargest = std::numeric_limits<float>::max();
    NumberRange range{info.range.minimum, info.range.maximum};
    const bool whole = std::holds_alternative<std::int64_t>(info.defaultValue);
    if (range.minimum == range.maximum) range = whole ? NumberRange{-1e9, 1e9} : NumberRange{-kLargest, kLargest};
    double read = 0.0;
    if (!readNumber(read, range, whole ? "a whole number" : "a number")) return std::nullopt;
    if (!whole) return ParameterValue(read);
    if (read != std::floor(read)) {
        failExpected("a whole number");
        return std::nullopt;
    }
    return ParameterValue(static_cast<std::int64_t>(read));
}

} // namespace ars::detail
