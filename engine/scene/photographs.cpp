#include "engine/scene/photographs.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <map>
#include <system_error>

namespace ars {
namespace fs = std::filesystem;
namespace {

bool isDigit(char c) { return c >= '0' && c <= '9'; }

std::string lowerCaseEnding(const fs::path& path) {
    std::string ending = path.extension().string();
    std::transform(ending.begin(), ending.end(), ending.begin(),
                   [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    return ending;
}

std::vector<fs::path> picturesIn(const fs::path& folder) {
    std::map<std::string, fs::path> byStem;
    std::error_code failure;
    for (fs::directory_iterator i(folder, failure), end; !failure && i != end; i.increment(failure)) {
        const std::string ending = lowerCaseEnding(i->path());
        if (ending != ".jpg" && ending != ".jpeg" && ending != ".png") continue;
        std::error_code ignored;
        if (!i->is_regular_file(ignored)) continue;
        fs::path& known = byStem[i->path().stem().string()];
        if (known.empty() || ending == ".png") known = i->path();
    }
    std::vector<fs::path> paths;
    for (const auto& entry : byStem) paths.push_back(entry.second);
    return paths;
}

} // namespace

std::optional<int> photographNumber(const fs::path& path) {
    const std::string stem = path.stem().string();
    std::size_t end = stem.size();
    while (end > 0 && !isDigit(stem[end - 1])) --end;
    std::size_t begin = end;
    while (begin > 0 && isDigit(stem[begin - 1])) --begin;
    while (begin + 1 < end && stem[begin] == '0') ++begin;
    if (begin == end || end - begin > 9) return std::nullopt;
    return std::stoi(stem.substr(begin, end - begin));
}

std::vector<fs::path> photographsOf(const fs::path& folder, std::string_view camera) {
    if (camera.empty()) return {};
    std::vector<fs::path> paths = picturesIn(folder / camera);
    if (paths.empty()) paths = picturesIn(folder / "images" / camera);
    std::stable_sort(paths.begin(), paths.end(), [](const fs::path& a, const fs::path& b) {
        return photographNumber(a).value_or(-1) < photographNumber(b).value_or(-1);
    });
    return paths;
}

Result<fs::path> findPhotograph(const CaptureAsset& capture, std::string_view camera, int index) {
    const auto found = std::find_if(capture.cameras.begin(), capture.cameras.end(),
                                    [&](const CalibratedCamera& c) { return c.name == camera; });
    if (found == capture.cameras.end()) {
        ARS_TRY(const CalibratedCamera unused, findCamera(capture.cameras, camera)); // its error lists the names
    }
    const std::vector<fs::path>& photographs =
        capture.photographs[static_cast<std::size_t>(found - capture.cameras.begin())];
    const std::string place = fmt::format("camera \"{}\"", camera);
    if (photographs.empty()) {
        return makeError(ErrorCode::NotFound, place, "there are no photographs beside the calibration");
    }
    if (index >= 0 && static_cast<std::size_t>(index) < photographs.size()) {
        return photographs[static_cast<std::size_t>(index)];
    }
    return makeError(ErrorCode::NotFound, place,
                     fmt::format("there is no photograph {}; there are {}, counted from 0", index, photographs.size()));
}

} // namespace ars
