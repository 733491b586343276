#include "engine/io/text_scanner.h"

#include <fmt/format.h>

#include <charconv>
#include <cstring>
#include <limits>
#include <system_error>

namespace ars {
namespace {

bool isBlank(char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\v' || c == '\f'; }

char lower(char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; }

std::string_view withoutPlus(std::string_view word) {
    if (word.size() > 1 && word[0] == '+' && word[1] != '-' && word[1] != '+') word.remove_prefix(1);
    return word;
}

template <typename T>
std::optional<T> parseWhole(std::string_view word) {
    word = withoutPlus(word);
    T value{};
    const auto [end, code] = std::from_chars(word.data(), word.data() + word.size(), value);
    if (code != std::errc() || end != word.data() + word.size()) return std::nullopt;
    return value;
}

} // namespace

std::string TextScanner::place() const { return fmt::format("line {}", line_); }

void TextScanner::skipSpace(bool sameLine) {
    for (; position_ < text_.size(); ++position_) {
        if (text_[position_] == '\n') {
            if (sameLine) return;
            ++line_;
        } else if (!isBlank(text_[position_])) {
            return;
        }
    }
}

std::string_view TextScanner::word(bool sameLine) {
    skipSpace(sameLine);
    const std::size_t begin = position_;
    while (position_ < text_.size() && text_[position_] != '\n' && !isBlank(text_[position_])) ++position_;
    return text_.substr(begin, position_ - begin);
}

std::string_view TextScanner::restOfLine() {
    skipSpace(true);
    const void* found = atEnd() ? nullptr : std::memchr(text_.data() + position_, '\n', remaining());
    const std::size_t end = found ? static_cast<const char*>(found) - text_.data() : text_.size();
    std::string_view rest = text_.substr(position_, end - position_);
    while (!rest.empty() && isBlank(rest.back())) rest.remove_suffix(1);
    position_ = end;
    if (found) {
        ++position_;
        ++line_;
    }
    return rest;
}

std::optional<double> parseDouble(std::string_view word) {
    word = withoutPlus(word);
    double value = 0;
    const auto [end, code] = std::from_chars(word.data(), word.data() + word.size(), value);
    if (end != word.data() + word.size() || word.empty()) return std::nullopt;
    if (code == std::errc::result_out_of_range) {
        // from_chars does not say on which side: a negative exponent, or no exponent and a leading zero, is the small
        // one.
        const std::size_t exponent = word.find_first_of("eE");
        const bool negative = word.front() == '-';
        const bool small = exponent != std::string_view::npos ? word.find('-', exponent) != std::string_view::npos
                                                              : word.substr(negative).front() == '0';
        value = small ? 0.0 : std::numeric_limits<double>::infinity();
        return negative ? -value : value;
    }
    if (code != std::errc()) return std::nullopt;
    return value;
}

std::optional<float> parseFloat(std::string_view word) {
    const std::string_view number = withoutPlus(word);
    float value = 0;
    const auto [end, code] = std::from_chars(number.data(), number.data() + number.size(), value);
    if (code == std::errc() && end == number.data() + number.size()) return value;
    if (code != std::errc::result_out_of_range) return std::nullopt;
    const std::optional<double> wide = parseDouble(word);
    if (!wide) return std::nullopt;
    // A double beyond the range of float has no defined conversion.
    if (*wide > std::numeric_limits<float>::max()) return std::numeric_limits<float>::infinity();
    if (*wide < std::numeric_limits<float>::lowest()) return -std::numeric_limits<float>::infinity();
    return static_cast<float>(*wide);
}

std::optional<std::int64_t> parseInt(std::string_view word) { return parseWhole<std::int64_t>(word); }
std::optional<std::uint64_t> parseUnsigned(std::string_view word) { return parseWhole<std::uint64_t>(word); }

bool equalIgnoringCase(std::string_view a, std::string_view b) {
    if (a.size() != b.size()) return false;
    for (std::size_t i = 0; i < a.size(); ++i) {
        if (lower(a[i]) != lower(b[i])) return false;
    }
    return true;
}

std::string quotedFound(std::string_view text) {
    if (text.empty()) return "the end of the file";
    std::string quoted = "\"";
    for (const char c : text.substr(0, 40)) {
        const auto byte = static_cast<unsigned char>(c);
        if (byte < 0x20 || byte >= 0x7f) {
            quoted += fmt::format("\\x{:02x}", byte);
        } else {
            quoted += c;
        }
    }
    return quoted + (text.size() > 40 ? "\"..." : "\"");
}

} // namespace ars
