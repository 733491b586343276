#include "engine/capture/missing_pictures.h"

#include "engine/core/file.h"

#include <algorithm>
#include <map>
#include <system_error>

namespace ars {
namespace {

constexpr std::size_t kMostDigits = 9;

/// The number at the end of a name without extension; -1 without one.
int trailingNumber(std::string_view name) {
    name = name.substr(0, name.rfind('.'));
    std::size_t begin = name.size();
    while (begin > 0 && name[begin - 1] >= '0' && name[begin - 1] <= '9') --begin;
    if (begin == name.size() || name.size() - begin > kMostDigits) return -1;
    int number = 0;
    for (const char c : name.substr(begin)) number = number * 10 + (c - '0');
    return number;
}

} // namespace

MissingPictures parseMissingPictures(std::string_view text, const CaptureLayout& layout) {
    std::map<std::string, int, std::less<>> byName;
    for (std::size_t i = 0; i < layout.cameras.size(); ++i) byName.emplace(layout.cameras[i].name, static_cast<int>(i));
    MissingPictures missing;
    while (!text.empty()) {
        const std::size_t end = text.find('\n');
        std::string line(text.substr(0, end));
        text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
        std::replace(line.begin(), line.end(), '\\', '/');
        line.erase(
            std::find_if_not(line.rbegin(), line.rend(), [](char c) { return c == '\r' || c == ' ' || c == '\t'; })
                .base(),
            line.end());
        if (line.empty()) continue;
        std::size_t slash = line.rfind('/');
        const int number = trailingNumber(line.substr(slash == std::string::npos ? 0 : slash + 1));
        int camera = -1;
        while (camera < 0 && slash != std::string::npos) {
            const std::size_t before = slash == 0 ? std::string::npos : line.rfind('/', slash - 1);
            const std::size_t begin = before == std::string::npos ? 0 : before + 1;
            const auto found = byName.find(std::string_view(line).substr(begin, slash - begin));
            if (found != byName.end()) camera = found->second;
            slash = before;
        }
        if (camera < 0 || number < 0) {
            ++missing.strangers;
            continue;
        }
        missing.views.insert({camera, number});
        missing.cameras.insert(camera);
    }
    return missing;
}

Result<MissingPictures> readMissingPictures(const std::filesystem::path& path, const CaptureLayout& layout,
                                            const ReadLimits& limits) {
    std::error_code failure;
    if (!std::filesystem::exists(path, failure)) return MissingPictures{};
    ARS_TRY(const std::string text, readTextFile(path, limits));
    return parseMissingPictures(text, layout);
}

} // namespace ars
