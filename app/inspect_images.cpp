#include "app/inspect.h"
#include "app/text.h"
#include "engine/core/file.h"
#include "engine/io/exr.h"
#include "engine/io/hdr.h"
#include "engine/io/jpeg.h"
#include "engine/io/png.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace ars::app {
namespace {

/// What numbers a channel holds.
struct ValueRange {
    float low = std::numeric_limits<float>::infinity();
    float high = -std::numeric_limits<float>::infinity();
    std::size_t negative = 0;
    std::size_t infinite = 0;
    std::size_t nan = 0;

    void add(float value) {
        if (std::isnan(value)) {
            ++nan;
        } else if (std::isinf(value)) {
            ++infinite;
        } else {
            low = std::min(low, value);
            high = std::max(high, value);
            if (value < 0.0f) ++negative;
        }
    }
    std::string describe() const {
        std::string text = low <= high ? fmt::format("{:.5g} to {:.5g}", low, high) : "no finite value";
        if (negative) text += fmt::format(", {} negative", grouped(negative));
        if (infinite) text += fmt::format(", {} infinite", grouped(infinite));
        if (nan) text += fmt::format(", {} NaN", grouped(nan));
        return text;
    }
    Json json() const {
        return {{"min", low <= high ? Json(low) : Json()},
                {"max", low <= high ? Json(high) : Json()},
                {"negative", negative},
                {"infinite", infinite},
                {"nan", nan}};
    }
};

void addPictureSize(FileReport& report, int width, int height) {
    report.add("width", "", width);
    report.add("height", "", height);
    report.add("pixels", fmt::format("{} x {}", width, height), Json{width, height});
}

void addEnvironmentGuess(FileReport& report, int width, int height) {
    const bool environment = width == 2 * height && height > 0;
    report.add("environment", environment ? "2:1, so probably a lat-long environment" : "", environment);
}

void addRangeWarnings(FileReport& report, const ValueRange& all) {
    if (all.nan) report.warn(fmt::format("{} not a number (NaN)", counted(all.nan, "value is", "values are")));
    if (all.infinite) report.warn(fmt::format("{} infinite", counted(all.infinite, "value is", "values are")));
}

void merge(ValueRange& all, const ValueRange& one) {
    all.low = std::min(all.low, one.low);
    all.high = std::max(all.high, one.high);
    all.negative += one.negative;
    all.infinite += one.infinite;
    all.nan += one.nan;
}

std::string describeBox(const ExrBox& box) {
    return fmt::format("({}, {}) to ({}, {})", box.x0, box.y0, box.x1, box.y1);
}

/// "R G B A half; depth.Z float"
std::string describeChannels(const ExrPartInfo& part) {
    std::string text;
    const ExrChannelInfo* last = nullptr;
    for (const ExrChannelInfo& channel : part.channels) {
        if (last) text += last->type == channel.type ? " " : fmt::format(" {}, ", exrPixelTypeName(last->type));
        text += channel.name;
        last = &channel;
    }
    return last ? text + fmt::format(" {}", exrPixelTypeName(last->type)) : "none";
}

std::string describeLayers(const std::vector<std::string>& layers) {
    std::vector<std::string> shown = layers;
    for (std::string& layer : shown) {
        if (layer.empty()) layer = "(main)";
    }
    return listed(shown, 16);
}

Json boxJson(const ExrBox& box) { return {box.x0, box.y0, box.x1, box.y1}; }

void addExrHeader(FileReport& report, const ExrInfo& info) {
    const ExrPartInfo& part = info.parts.front();
    addPictureSize(report, part.displayWindow.width(), part.displayWindow.height());
    if (!(part.dataWindow == part.displayWindow)) {
        report.add("data_window",
                   fmt::format("{}, display window {}", describeBox(part.dataWindow), describeBox(part.displayWindow)),
                   boxJson(part.dataWindow));
    }
    if (info.parts.size() > 1) report.add("parts", std::to_string(info.parts.size()), info.parts.size());
    report.add("layers", info.layers.size() > 1 || !info.layers.front().empty() ? describeLayers(info.layers) : "",
               info.layers);
    Json channels = Json::array();
    std::string text;
    for (const ExrPartInfo& p : info.parts) {
        text += (text.empty() ? "" : "; ") + describeChannels(p);
        for (const ExrChannelInfo& c : p.channels) {
            channels.push_back({{"name", c.name}, {"type", exrPixelTypeName(c.type)}});
        }
    }
    report.add("channels", text, channels);
    report.add("compression",
               fmt::format("{}, {}", exrCompressionName(part.compression), part.tiled ? "tiles" : "scan lines"),
               exrCompressionName(part.compression));
    if (part.deep) report.add("deep", "yes", true);
}

} // namespace

void inspectExr(FileReport& report, const InspectOptions& options) {
    report.kind = "picture";
    const auto info = listExr(report.path, options.limits);
    if (!info) return report.fail(info.error());
    if (info->parts.empty() || info->layers.empty()) {
        return report.fail(makeError(ErrorCode::BadFile, "", "the file has no channels"));
    }
    addExrHeader(report, *info);
    const ExrBox& display = info->parts.front().displayWindow;
    const bool colour = std::any_of(info->parts.front().channels.begin(), info->parts.front().channels.end(),
                                    [](const ExrChannelInfo& c) { return c.name == "R" || c.name == "Y"; });
    addEnvironmentGuess(report, colour ? display.width() : 0, display.height());
    if (options.fast) return;
    const auto image = readExr(report.path, options.limits);
    if (!image) return report.fail(image.error());
    ValueRange all;
    Json ranges = Json::object();
    for (const ExrChannel& channel : image->channels) {
        ValueRange range;
        for (const float value : channel.pixels) range.add(value);
        ranges[channel.name] = range.json();
        merge(all, range);
    }
    report.add("values", all.describe(), all.json());
    report.add("channel_values", "", ranges);
    addRangeWarnings(report, all);
}

void inspectHdr(FileReport& report, const InspectOptions& options) {
    report.kind = "picture";
    if (options.fast) return;
    const auto image = readHdr(report.path, options.limits);
    if (!image) return report.fail(image.error());
    addPictureSize(report, image->width, image->height);
    report.add("channels", "R G B, shared exponent", Json{"R", "G", "B"});
    addEnvironmentGuess(report, image->width, image->height);
    ValueRange all;
    for (const float value : image->pixels) all.add(value);
    report.add("values", all.describe(), all.json());
}

void inspectPng(FileReport& report, const InspectOptions& options) {
    report.kind = "picture";
    if (options.fast) return;
    const auto file = readPng(report.path, options.limits);
    if (!file) return report.fail(file.error());
    static constexpr const char* kChannels[] = {"", "gray", "gray and alpha", "RGB", "RGBA"};
    addPictureSize(report, file->image.width, file->image.height);
    report.add(
        "channels",
        fmt::format("{}, {} bits{}", kChannels[file->image.channels], file->bitDepth, file->palette ? ", palette" : ""),
        file->image.channels);
    report.add("bits", "", file->bitDepth);
    report.add("color_space", std::string(colorSpaceName(file->image.space)));
    if (!file->profileName.empty())
        report.add("profile", fmt::format("{} (not applied)", file->profileName), file->profileName);
    if (!file->text.empty()) {
        Json keys = Json::array();
        std::vector<std::string> names;
        for (const auto& [key, value] : file->text) {
            names.push_back(key);
            keys.push_back(key);
        }
        report.add("text", listed(names), keys);
    }
    for (const std::string& warning : file->warnings) report.warn(warning);
}

void inspectJpeg(FileReport& report, const InspectOptions& options) {
    report.kind = "picture";
    if (options.fast) return;
    const auto file = readJpeg(report.path, {}, options.limits);
    if (!file) return report.fail(file.error());
    addPictureSize(report, file->image.width, file->image.height);
    const std::string_view components = file->fileComponents == 1 ? "gray" : file->fileComponents == 3 ? "RGB" : "CMYK";
    report.add("channels", fmt::format("{}, {}", components, file->progressive ? "progressive" : "baseline"),
               file->image.channels);
    report.add("color_space", std::string(colorSpaceName(file->image.space)));
    if (file->exifOrientation != 1) {
        report.add("orientation", fmt::format("EXIF {}, turned upright", file->exifOrientation), file->exifOrientation);
    }
}

} // namespace ars::app
