#include "engine/io/utf8.h"

#include <cassert>

namespace ars {
namespace {

constexpr char32_t kReplacement = 0xFFFD;

bool isSurrogate(char32_t c) { return c >= 0xD800 && c <= 0xDFFF; }

/// Reads one code point at `position` and moves behind it; nothing where the bytes are not UTF-8.
std::optional<char32_t> nextCodePoint(std::string_view text, std::size_t& position) {
    const auto byteAt = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
    const unsigned char lead = byteAt(position);
    if (lead < 0x80) {
        ++position;
        return lead;
    }
    const int length = lead >= 0xF0 ? 4 : lead >= 0xE0 ? 3 : 2;
    if (lead < 0xC2 || lead > 0xF4 || text.size() - position < static_cast<std::size_t>(length)) return {};
    char32_t code = lead & (0x7Fu >> length);
    for (int i = 1; i < length; ++i) {
        const unsigned char next = byteAt(position + i);
        if ((next & 0xC0) != 0x80) return {};
        code = (code << 6) | (next & 0x3Fu);
    }
    constexpr char32_t kSmallest[] = {0, 0, 0x80, 0x800, 0x10000};
    if (code < kSmallest[length] || code > 0x10FFFF || isSurrogate(code)) return {};
    position += length;
    return code;
}

} // namespace

std::optional<std::u32string> decodeUtf8(std::string_view text) {
    std::u32string codes;
    codes.reserve(text.size());
    for (std::size_t position = 0; position < text.size();) {
        const auto code = nextCodePoint(text, position);
        if (!code) return {};
        codes.push_back(*code);
    }
    return codes;
}

bool isUtf8(std::string_view text) {
    for (std::size_t position = 0; position < text.size();) {
        if (!nextCodePoint(text, position)) return false;
    }
    return true;
}

void appendUtf8(std::string& text, char32_t codePoint) {
    assert(codePoint <= 0x10FFFF);
    const char32_t c = isSurrogate(codePoint) ? kReplacement : codePoint;
    const auto push = [&](char32_t byte) { text.push_back(static_cast<char>(static_cast<unsigned char>(byte))); };
    if (c < 0x80) {
        push(c);
    } else if (c < 0x800) {
        push(0xC0 | (c >> 6));
        push(0x80 | (c & 0x3F));
    } else if (c < 0x10000) {
        push(0xE0 | (c >> 12));
        push(0x80 | ((c >> 6) & 0x3F));
        push(0x80 | (c & 0x3F));
    } else {
        push(0xF0 | (c >> 18));
        push(0x80 | ((c >> 12) & 0x3F));
        push(0x80 | ((c >> 6) & 0x3F));
        push(0x80 | (c & 0x3F));
    }
}

std::string utf8OrLatin1(std::string_view text) {
    if (isUtf8(text)) return std::string(text);
    std::string converted;
    converted.reserve(2 * text.size());
    for (const char c : text) appendUtf8(converted, static_cast<unsigned char>(c));
    return converted;
}

} // namespace ars
