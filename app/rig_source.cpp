#include "app/rig_source.h"

#include "app/text.h"
#include "engine/io/text_scanner.h"

#include <algorithm>
#include <cmath>

namespace ars::app {
namespace {

Error badRange(std::string_view text) {
    return makeError(
        ErrorCode::InvalidArgument, "--frames",
        fmt::format("expected a:b (frames a to b-1), a: or :b or one number, found \"{}\"", printable(text)));
}

} // namespace

Result<BodyModel> loadBody(const std::string& name) { return name == "open" ? readOpenBody() : readBodyModel(name); }

Result<FrameRange> parseFrameRange(std::string_view text) {
    FrameRange range;
    const std::size_t colon = text.find(':');
    const std::string_view first = text.substr(0, colon);
    if (!first.empty()) {
        const auto number = parseUnsigned(first);
        if (!number) return badRange(text);
        range.first = static_cast<std::size_t>(*number);
    }
    if (colon == std::string_view::npos) {
        if (first.empty()) return badRange(text);
        range.end = range.first + 1;
        return range;
    }
    if (const std::string_view end = text.substr(colon + 1); !end.empty()) {
        const auto number = parseUnsigned(end);
        if (!number || *number <= range.first) return badRange(text);
        range.end = static_cast<std::size_t>(*number);
    }
    return range;
}

Status cutFrames(Motion& motion, const FrameRange& range) {
    const std::size_t count = motion.frames.size();
    const std::size_t end = range.end.value_or(count);
    if (range.first >= count || end > count) {
        return makeError(ErrorCode::InvalidArgument, "",
                         fmt::format("the motion has {} (0 to {}), frame {} was asked for", counted(count, "frame"),
                                     count - 1, range.first >= count ? range.first : end - 1));
    }
    motion.frames.erase(motion.frames.begin() + static_cast<std::ptrdiff_t>(end), motion.frames.end());
    motion.frames.erase(motion.frames.begin(), motion.frames.begin() + static_cast<std::ptrdiff_t>(range.first));
    return {};
}

float soleHeightM(std::span<const glm::vec3> vertices) {
    float lowest = vertices.empty() ? 0.0f : vertices[0].y;
    for (const glm::vec3& v : vertices) lowest = std::min(lowest, v.y);
    return lowest;
}

Result<std::vector<float>> parseNumbers(std::string_view text, std::string_view option) {
    std::vector<float> numbers;
    while (!text.empty()) {
        const std::size_t comma = std::min(text.find(','), text.size());
        const std::string_view word = text.substr(0, comma);
        const auto number = parseFloat(word);
        if (!number || !std::isfinite(*number)) {
            return makeError(ErrorCode::InvalidArgument, std::string(option),
                             fmt::format("expected numbers with commas between them, found \"{}\"", printable(word)));
        }
        numbers.push_back(*number);
        text.remove_prefix(std::min(comma + 1, text.size()));
    }
    return numbers;
}

} // namespace ars::app
