#include "app/text.h"

#include "engine/io/utf8.h"

#include <fmt/format.h>

#include <algorithm>
#include <numeric>

namespace ars::app {
namespace {

/// Edits (insert, delete, replace, swap of neighbours) between two short words.
std::size_t editDistance(std::string_view a, std::string_view b) {
    std::vector<std::size_t> beforeLast(b.size() + 1), last(b.size() + 1), now(b.size() + 1);
    std::iota(last.begin(), last.end(), std::size_t{0});
    for (std::size_t i = 1; i <= a.size(); ++i) {
        now[0] = i;
        for (std::size_t j = 1; j <= b.size(); ++j) {
            const std::size_t replaced = last[j - 1] + (a[i - 1] == b[j - 1] ? 0 : 1);
            now[j] = std::min({replaced, last[j] + 1, now[j - 1] + 1});
            const bool swapped = i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1];
            if (swapped) now[j] = std::min(now[j], beforeLast[j - 2] + 1);
        }
        beforeLast.swap(last);
        last.swap(now);
    }
    return last[b.size()];
}

} // namespace

std::string printable(std::string_view text) {
    std::string result = utf8OrLatin1(text);
    for (char& c : result) {
        if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = ' ';
    }
    // The C1 controls (U+0080 to U+009F) steer some terminals too; in UTF-8 they are C2 80 to C2 9F.
    for (std::size_t i = 0; i + 1 < result.size(); ++i) {
        if (result[i] == '\xc2' && static_cast<unsigned char>(result[i + 1]) < 0xa0) result.replace(i, 2, " ");
    }
    return result;
}

std::string grouped(std::uint64_t number) {
    std::string digits = std::to_string(number);
    for (std::size_t i = digits.size(); i > 3; i -= 3) digits.insert(i - 3, ",");
    return digits;
}

std::string counted(std::uint64_t number, std::string_view singular, std::string_view plural) {
    if (number == 1) return fmt::format("1 {}", singular);
    if (!plural.empty()) return fmt::format("{} {}", grouped(number), plural);
    return fmt::format("{} {}s", grouped(number), singular);
}

std::string listed(std::span<const std::string> names, std::size_t most) {
    std::string text;
    const std::size_t shown = names.size() <= most + 1 ? names.size() : most;
    for (std::size_t i = 0; i < shown; ++i) text += (i ? ", " : "") + names[i];
    if (shown < names.size()) text += fmt::format(" and {} more", names.size() - shown);
    return text;
}

std::string nearest(std::string_view typed, std::span<const std::string> candidates) {
    std::string best;
    std::size_t bestDistance = typed.size() <= 3 ? 2 : 3; // below this counts
    for (const std::string& candidate : candidates) {
        if (typed.size() >= 2 && candidate.starts_with(typed)) return candidate;
        const std::size_t distance = editDistance(typed, candidate);
        if (distance < bestDistance) {
            bestDistance = distance;
            best = candidate;
        }
    }
    return best;
}

} // namespace ars::app
