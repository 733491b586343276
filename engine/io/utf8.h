#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace ars {

/// The code points of UTF-8 text, or nothing where it is not UTF-8 (overlong forms, surrogates, beyond U+10FFFF).
std::optional<std::u32string> decodeUtf8(std::string_view text);

/// Whether decodeUtf8 would succeed.
bool isUtf8(std::string_view text);

/// Appends one code point; surrogates become U+FFFD. `codePoint` must not exceed U+10FFFF.
void appendUtf8(std::string& text, char32_t codePoint);

/// The text itself where it is UTF-8, else its bytes taken as Latin-1.
std::string utf8OrLatin1(std::string_view text);

} // namespace ars
