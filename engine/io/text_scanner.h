#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace ars {

/// A cursor over the bytes of a text file that knows its line: the readers of PLY, OBJ and BVH stand on it. White space
/// is blank, tab, carriage return, vertical tab and form feed; lines end with '\n'. Nothing depends on the locale.
class TextScanner {
public:
    explicit TextScanner(std::string_view text) : text_(text) {}
    explicit TextScanner(std::span<const std::byte> bytes)
        : text_(reinterpret_cast<const char*>(bytes.data()), bytes.size()) {}

    /// Number of the line at the cursor, from 1.
    std::size_t line() const { return line_; }
    /// "line 12"
    std::string place() const;
    std::size_t position() const { return position_; }
    std::size_t remaining() const { return text_.size() - position_; }
    bool atEnd() const { return position_ == text_.size(); }

    /// Moves past white space and, unless `sameLine`, past line ends.
    void skipSpace(bool sameLine = false);
    /// The next word; empty at the end of the file, or of the line with `sameLine`.
    std::string_view word(bool sameLine = false);
    /// The rest of the line without white space at either end; the cursor goes to the next line.
    std::string_view restOfLine();

private:
    std::string_view text_;
    std::size_t position_ = 0;
    std::size_t line_ = 1;
};

/// A whole word as a number; nothing when it is not one. Numbers too small for the type become 0, too large ones
/// infinite; a leading '+' is allowed.
std::optional<float> parseFloat(std::string_view word);
std::optional<double> parseDouble(std::string_view word);
/// Nothing as well when the number does not fit.
std::optional<std::int64_t> parseInt(std::string_view word);
std::optional<std::uint64_t> parseUnsigned(std::string_view word);

bool equalIgnoringCase(std::string_view a, std::string_view b);

/// Text from a file as it may stand in a message: in quotes, at most 40 characters, odd bytes as \x..; "the end of the
/// file" when empty.
std::string quotedFound(std::string_view text);

} // namespace ars
