#include "engine/capture/capture.h"

#include "engine/capture/published_settings.h"
#include "engine/core/file.h"
#include "engine/io/text_scanner.h"

#include <algorithm>
#include <numeric>
#include <optional>

namespace ars {
namespace {

constexpr std::string_view kTrain = "train";
constexpr std::string_view kAll = "all";

Error badSplit(std::string message) { return makeError(ErrorCode::InvalidArgument, "", std::move(message)); }

std::string_view trimmed(std::string_view text) {
    while (!text.empty() && text.front() == ' ') text.remove_prefix(1);
    while (!text.empty() && text.back() == ' ') text.remove_suffix(1);
    return text;
}

std::vector<std::string_view> commaWords(std::string_view text) {
    std::vector<std::string_view> words;
    while (true) {
        const std::size_t comma = text.find(',');
        words.push_back(trimmed(text.substr(0, comma)));
        if (comma == std::string_view::npos) return words;
        text.remove_prefix(comma + 1);
    }
}

/// Index of a camera given by name, or by index where none has that name.
std::optional<int> cameraIndex(const Capture& capture, std::string_view word) {
    for (std::size_t i = 0; i < capture.cameras.size(); ++i) {
        if (capture.cameras[i].name == word) return static_cast<int>(i);
    }
    const auto number = parseUnsigned(word);
    if (!number || *number >= capture.cameras.size()) return std::nullopt;
    return static_cast<int>(*number);
}

/// One name or index, or two of them with a dash between; a name may itself have dashes.
std::optional<std::pair<int, int>> cameraRange(const Capture& capture, std::string_view word) {
    if (const auto one = cameraIndex(capture, word)) return std::pair{*one, *one};
    for (std::size_t dash = word.find('-'); dash != std::string_view::npos; dash = word.find('-', dash + 1)) {
        const auto first = cameraIndex(capture, word.substr(0, dash));
        const auto last = cameraIndex(capture, word.substr(dash + 1));
        if (first && last && *first <= *last) return std::pair{*first, *last};
    }
    return std::nullopt;
}

Result<std::vector<int>> parseCameras(const Capture& capture, std::string_view text) {
    std::set<int> chosen;
    for (const std::string_view word : commaWords(text)) {
        const auto range = cameraRange(capture, word);
        if (!range) {
            return badSplit(fmt::format("{} names no camera; there are {} with indices 0 to {}, named {} to {}",
                                        word.empty() ? "an empty word" : quotedFound(word), capture.cameras.size(),
                                        capture.cameras.size() - 1, quotedFound(capture.cameras.front().name),
                                        quotedFound(capture.cameras.back().name)));
        }
        for (int i = range->first; i <= range->second; ++i) chosen.insert(i);
    }
    return std::vector<int>(chosen.begin(), chosen.end());
}

/// a, a:b or a:b:step, each number optional around the colons.
struct FrameNumbers {
    std::uint64_t first = 0, end = ~0ull, step = 1;
    bool contains(int number) const {
        const auto n = static_cast<std::uint64_t>(number);
        return n >= first && n < end && (n - first) % step == 0;
    }
};

std::optional<FrameNumbers> parseFrameNumbers(std::string_view word) {
    FrameNumbers numbers;
    std::vector<std::string_view> parts;
    for (std::size_t colon = word.find(':'); colon != std::string_view::npos; colon = word.find(':')) {
        parts.push_back(word.substr(0, colon));
        word.remove_prefix(colon + 1);
    }
    parts.push_back(word);
    if (parts.size() > 3) return std::nullopt;
    std::uint64_t* const targets[3] = {&numbers.first, &numbers.end, &numbers.step};
    for (std::size_t i = 0; i < parts.size(); ++i) {
        if (parts[i].empty() && parts.size() > 1) continue;
        const auto value = parseUnsigned(parts[i]);
        if (!value || *value > 1'000'000'000) return std::nullopt;
        *targets[i] = *value;
    }
    if (parts.size() == 1) numbers.end = numbers.first + 1;
    if (numbers.step == 0 || numbers.end <= numbers.first) return std::nullopt;
    return numbers;
}

Result<std::vector<int>> parseFrames(const Capture& capture, std::string_view text) {
    std::vector<FrameNumbers> ranges;
    for (const std::string_view word : commaWords(text)) {
        const auto range = parseFrameNumbers(word);
        if (!range) {
            return badSplit(fmt::format("expected frames as a:b (a to b-1), a:b:step or one number, found {}",
                                        word.empty() ? "an empty word" : quotedFound(word)));
        }
        ranges.push_back(*range);
    }
    std::vector<int> chosen;
    for (std::size_t i = 0; i < capture.frames.size(); ++i) {
        const int number = capture.frames[i];
        const bool wanted = std::any_of(ranges.begin(), ranges.end(),
                                        [&](const FrameNumbers& range) { return range.contains(number); });
        if (wanted) chosen.push_back(static_cast<int>(i));
    }
    if (chosen.empty()) {
        return badSplit(fmt::format("no frame is in {}; there are {}, numbered {} to {}", quotedFound(text),
                                    capture.frames.size(), capture.frames.front(), capture.frames.back()));
    }
    return chosen;
}

/// The numbers in frame_ids.txt, which the publishers of one subject put beside the poses; every frame without it.
Result<std::vector<int>> listedFrames(const Capture& capture) {
    std::vector<int> all(capture.frames.size());
    std::iota(all.begin(), all.end(), 0);
    std::error_code failure;
    std::filesystem::path file = capture.folder / std::string(kFrameList);
    if (!std::filesystem::exists(file, failure)) file = capture.folder.parent_path() / std::string(kFrameList);
    if (!std::filesystem::exists(file, failure)) return all;
    ARS_TRY(const std::string text, readTextFile(file));
    std::set<std::int64_t> wanted;
    TextScanner scanner{std::string_view(text)};
    for (scanner.skipSpace(); !scanner.atEnd(); scanner.skipSpace()) {
        const std::string place = scanner.place();
        const std::string_view word = scanner.word();
        const auto number = parseInt(word);
        if (!number) {
            return makeError(ErrorCode::BadFile, fmt::format("{}: {}", file.string(), place),
                             fmt::format("expected a frame number, found {}", quotedFound(word)));
        }
        wanted.insert(*number);
    }
    std::vector<int> chosen;
    for (const int i : all) {
        if (wanted.contains(capture.frames[static_cast<std::size_t>(i)])) chosen.push_back(i);
    }
    if (chosen.empty()) return makeError(ErrorCode::BadFile, file.string(), "names no frame of this capture");
    return chosen;
}

bool hasPicture(const Capture& capture, int camera) {
    for (int frame = 0; frame < static_cast<int>(capture.frames.size()); ++frame) {
        if (capture.has({camera, frame})) return true;
    }
    return false;
}

/// Cameras that were asked for must have pictures; of all cameras those without are simply not used.
Result<std::vector<int>> usableCameras(const Capture& capture, std::vector<int> cameras, bool askedFor) {
    std::vector<int> usable;
    for (const int camera : cameras) {
        if (hasPicture(capture, camera)) {
            usable.push_back(camera);
        } else if (askedFor) {
            const auto index = static_cast<std::size_t>(camera);
            return badSplit(fmt::format("camera {} (index {}) has no pictures in {}",
                                        quotedFound(capture.cameras[index].name), camera,
                                        capture.files[index].pictures.folder.string()));
        }
    }
    return usable;
}

Result<CaptureSplit> makeSplit(const Capture& capture, std::string_view name, std::string_view cameras,
                               std::string_view frames) {
    CaptureSplit split;
    split.name = std::string(name);
    if (cameras.empty()) {
        split.cameras.resize(capture.cameras.size());
        std::iota(split.cameras.begin(), split.cameras.end(), 0);
    } else {
        ARS_TRY(split.cameras, parseCameras(capture, cameras));
    }
    ARS_TRY(split.cameras, usableCameras(capture, std::move(split.cameras), !cameras.empty()));
    if (frames == kFrameList) {
        ARS_TRY(split.frames, listedFrames(capture));
    } else if (frames.empty()) {
        split.frames.resize(capture.frames.size());
        std::iota(split.frames.begin(), split.frames.end(), 0);
    } else {
        ARS_TRY(split.frames, parseFrames(capture, frames));
    }
    for (const int camera : split.cameras) {
        for (const int frame : split.frames) {
            if (capture.has({camera, frame})) return split;
        }
    }
    return badSplit("these cameras have no picture of these frames");
}

} // namespace

std::vector<std::string> splitNames(const Capture& capture) {
    std::vector<std::string> names = {std::string(kTrain), std::string(kAll)};
    if (const PublishedSubject* subject = publishedSubject(capture.subject)) {
        for (const PublishedSplit& split : subject->splits) {
            if (split.name != kTrain) names.emplace_back(split.name);
        }
    }
    return names;
}

Result<CaptureSplit> trainingSplit(const Capture& capture, const std::string& cameras, const std::string& frames) {
    return namedSplit(capture, std::string(kTrain), cameras, frames);
}

Result<CaptureSplit> namedSplit(const Capture& capture, const std::string& name, const std::string& cameras,
                                const std::string& frames) {
    PublishedSplit split{name, "", ""};
    bool known = name == kAll || name == kTrain;
    if (const PublishedSubject* subject = publishedSubject(capture.subject)) {
        for (const PublishedSplit& published : subject->splits) {
            if (published.name != name) continue;
            split = published;
            known = true;
        }
    }
    if (!known) {
        return badSplit(fmt::format("the capture \"{}\" has no split {}; there are {}", capture.subject,
                                    quotedFound(name), fmt::join(splitNames(capture), ", ")));
    }
    return makeSplit(capture, name, cameras.empty() ? split.cameras : std::string_view(cameras),
                     frames.empty() ? split.frames : std::string_view(frames));
}

} // namespace ars
