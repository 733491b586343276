#include "engine/io/exr.h"

#include <algorithm>
#include <set>

namespace ars {

namespace {

/// The image channels of one way to read a layer; a trailing letter in brackets in the comments is optional.
struct Reading {
    std::vector<const ExrChannel*> channels;
    ColorSpace space = ColorSpace::Data;
    bool alpha = false;
};

std::string_view layerOf(std::string_view channel) {
    const std::size_t dot = channel.rfind('.');
    return dot == std::string_view::npos ? std::string_view() : channel.substr(0, dot);
}

const ExrChannel* findLetter(const ExrImage& image, std::string_view layer, char letter) {
    const std::string prefix = layer.empty() ? "" : std::string(layer) + '.';
    const ExrChannel* found = image.find(prefix + letter);
    return found ? found : image.find(prefix + static_cast<char>(letter - 'A' + 'a'));
}

std::optional<Reading> readLetters(const ExrImage& image, std::string_view layer, std::string_view letters) {
    Reading reading;
    for (const char letter : letters) {
        const ExrChannel* channel = findLetter(image, layer, letter);
        if (!channel) return std::nullopt;
        reading.channels.push_back(channel);
    }
    return reading;
}

void addAlpha(const ExrImage& image, std::string_view layer, Reading& reading) {
    const ExrChannel* alpha = findLetter(image, layer, 'A');
    if (!alpha) return;
    reading.channels.push_back(alpha);
    reading.alpha = true;
}

Result<Reading> chooseChannels(const ExrImage& image, std::string_view layer) {
    std::vector<const ExrChannel*> all;
    std::string names;
    for (const ExrChannel& channel : image.channels) {
        if (layerOf(channel.name) != layer) continue;
        all.push_back(&channel);
        names += (names.empty() ? "" : ", ") + channel.name;
    }
    if (all.empty()) {
        std::string known;
        for (const std::string& name : exrLayers(image))
            known += fmt::format("{}\"{}\"", known.empty() ? "" : ", ", name);
        return makeError(ErrorCode::NotFound, fmt::format("layer \"{}\"", layer),
                         fmt::format("no such layer; the picture has {}", known));
    }
    if (auto rgb = readLetters(image, layer, "RGB")) {
        rgb->space = ColorSpace::Linear;
        addAlpha(image, layer, *rgb);
        return *rgb;
    }
    if (auto xyz = readLetters(image, layer, "XYZ")) return *xyz;
    const std::string prefix = layer.empty() ? "" : std::string(layer) + '.';
    const bool chroma = image.find(prefix + "RY") || image.find(prefix + "BY");
    if (auto y = readLetters(image, layer, "Y"); y && !chroma) {
        if (layer.empty()) y->space = ColorSpace::Linear;
        addAlpha(image, layer, *y);
        return *y;
    }
    if (all.size() == 1) return Reading{all, ColorSpace::Data, false};
    return makeError(ErrorCode::Unsupported, fmt::format("layer \"{}\"", layer),
                     fmt::format("expected channels R G B, X Y Z, Y or a single one, found {}", names));
}

/// Copies the part of the data window that lies in `window`; the rest stays zero.
void copyChannel(const ExrImage& exr, const ExrChannel& channel, const ExrBox& window, int index, Image& out) {
    const ExrBox& data = exr.dataWindow;
    const std::size_t stride = static_cast<std::size_t>(data.width());
    for (int y = std::max(window.y0, data.y0); y <= std::min(window.y1, data.y1); ++y) {
        for (int x = std::max(window.x0, data.x0); x <= std::min(window.x1, data.x1); ++x) {
            out.at(y - window.y0, x - window.x0, index) = channel.pixels[(y - data.y0) * stride + (x - data.x0)];
        }
    }
}

} // namespace

std::string_view exrPixelTypeName(ExrPixelType type) {
    switch (type) {
    case ExrPixelType::UInt:
        return "uint";
    case ExrPixelType::Half:
        return "half";
    case ExrPixelType::Float:
        return "float";
    }
    return "float";
}

std::string_view exrCompressionName(ExrCompression compression) {
    constexpr std::array<std::string_view, 10> kNames = {"none",  "rle", "zips", "zip",  "piz",
                                                         "pxr24", "b44", "b44a", "dwaa", "dwab"};
    const auto index = static_cast<std::size_t>(compression);
    return index < kNames.size() ? kNames[index] : "unknown";
}

const ExrChannel* ExrImage::find(std::string_view name) const {
    const auto at = std::find_if(channels.begin(), channels.end(), [&](const ExrChannel& c) { return c.name == name; });
    return at == channels.end() ? nullptr : &*at;
}

std::vector<std::string> exrLayers(const ExrImage& image) {
    std::set<std::string> layers;
    for (const ExrChannel& channel : image.channels) layers.emplace(layerOf(channel.name));
    return {layers.begin(), layers.end()};
}

Result<Image> exrLayer(const ExrImage& image, std::string_view layer, ExrWindow window, const ReadLimits& limits) {
    ARS_TRY(const Reading reading, chooseChannels(image, layer));
    const ExrBox& box = window == ExrWindow::Display ? image.displayWindow : image.dataWindow;
    const std::int64_t width = std::int64_t(box.x1) - box.x0 + 1;
    const std::int64_t height = std::int64_t(box.y1) - box.y0 + 1;
    auto count = imageValueCount(width, height, static_cast<std::int64_t>(reading.channels.size()), limits);
    if (!count) return atPlace(std::move(count).error(), window == ExrWindow::Display ? "displayWindow" : "dataWindow");
    Image out;
    out.width = static_cast<int>(width);
    out.height = static_cast<int>(height);
    out.channels = static_cast<int>(reading.channels.size());
    out.space = reading.space;
    out.premultiplied = reading.alpha;
    out.sourceBits = reading.channels.front()->type == ExrPixelType::Half ? 16 : 32;
    out.pixels.assign(*count, 0.0f);
    for (int c = 0; c < out.channels; ++c) copyChannel(image, *reading.channels[c], box, c, out);
    return out;
}

Status addExrLayer(ExrImage& exr, std::string_view layer, const Image& image, std::string_view letters,
                   ExrPixelType type) {
    const std::string place = fmt::format("layer \"{}\"", layer);
    if (auto status = checkImage(image); !status) return atPlace(std::move(status).error(), place);
    if (letters.size() != static_cast<std::size_t>(image.channels)) {
        return makeError(ErrorCode::InvalidArgument, place,
                         fmt::format("the letters \"{}\" name {} channels, the image has {}", letters, letters.size(),
                                     image.channels));
    }
    if (letters.ends_with('A') && image.hasAlpha() && !image.premultiplied) {
        return addExrLayer(exr, layer, premultipliedAlpha(image), letters, type);
    }
    if (exr.channels.empty()) {
        exr.dataWindow = {0, 0, image.width - 1, image.height - 1};
        exr.displayWindow = exr.dataWindow;
    }
    if (image.width != exr.dataWindow.width() || image.height != exr.dataWindow.height()) {
        return makeError(ErrorCode::InvalidArgument, place,
                         fmt::format("{}x{} pixels, the picture's other layers have {}x{}", image.width, image.height,
                                     exr.dataWindow.width(), exr.dataWindow.height()));
    }
    const std::string prefix = layer.empty() ? "" : std::string(layer) + '.';
    for (const char letter : letters) {
        if (!exr.find(prefix + letter) && std::count(letters.begin(), letters.end(), letter) == 1) continue;
        return makeError(ErrorCode::InvalidArgument, place,
                         fmt::format("channel \"{}{}\" stands twice", prefix, letter));
    }
    for (std::size_t c = 0; c < letters.size(); ++c) {
        ExrChannel channel{prefix + letters[c], type, {}};
        channel.pixels.resize(image.pixels.size() / letters.size());
        for (std::size_t p = 0; p < channel.pixels.size(); ++p) {
            channel.pixels[p] = image.pixels[p * letters.size() + c];
        }
        exr.channels.push_back(std::move(channel));
    }
    return {};
}

} // namespace ars
