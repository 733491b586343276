#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace ars::app {

/// Text from a file or a command line as it may be shown on a terminal: UTF-8 on one line, without control characters.
std::string printable(std::string_view text);

/// "1,234,567"
std::string grouped(std::uint64_t number);

/// "1 mesh", "3 meshes"; the plural adds "s" unless it is given.
std::string counted(std::uint64_t number, std::string_view singular, std::string_view plural = "");

/// "a, b, c and 12 more": at most `most` of them.
std::string listed(std::span<const std::string> names, std::size_t most = 8);

/// The candidate that `typed` was probably meant to be (at most two edits, or a prefix), or empty.
std::string nearest(std::string_view typed, std::span<const std::string> candidates);

} // namespace ars::app
