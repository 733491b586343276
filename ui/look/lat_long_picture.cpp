#include "ui/look/lat_long_picture.h"

#include "engine/core/parallel.h"
#include "engine/shade/tone.h"

#include <algorithm>
#include <cmath>

namespace ars::ui {

namespace {

constexpr float kMiddleGrey = 0.22f;

/// Pixels of a side of `from` that pixel `i` of `to` covers, [begin, end), never empty.
std::pair<int, int> covered(int i, int to, int from) {
    const int begin = static_cast<int>(static_cast<std::int64_t>(i) * from / to);
    const int end = static_cast<int>((static_cast<std::int64_t>(i) + 1) * from / to);
    return {begin, std::clamp(end, begin + 1, std::max(from, begin + 1))};
}

} // namespace

Image smallLatLong(const Image& environment, int width) {
    Image small;
    if (environment.width <= 0 || environment.height <= 0 || environment.channels < 3) return small;
    small.width = std::max(width, 2);
    small.height = small.width / 2;
    small.channels = 3;
    small.pixels.resize(static_cast<std::size_t>(small.width) * static_cast<std::size_t>(small.height) * 3);
    parallelFor(
        static_cast<std::size_t>(small.height),
        [&](std::size_t row) {
            const auto [top, bottom] = covered(static_cast<int>(row), small.height, environment.height);
            for (int column = 0; column < small.width; ++column) {
                const auto [left, right] = covered(column, small.width, environment.width);
                double sum[3] = {};
                for (int y = top; y < bottom; ++y) {
                    for (int x = left; x < right; ++x) {
                        for (int c = 0; c < 3; ++c) sum[c] += static_cast<double>(environment.at(y, x, c));
                    }
                }
                const double count = static_cast<double>(bottom - top) * (right - left);
                for (int c = 0; c < 3; ++c) {
                    small.at(static_cast<int>(row), column, c) = static_cast<float>(sum[c] / count);
                }
            }
        },
        8);
    return small;
}

float previewExposure(const Image& environment) {
    std::vector<float> brightness;
    const std::size_t pixels = environment.channels >= 3 ? environment.pixels.size() / environment.channels : 0;
    brightness.reserve(pixels);
    for (std::size_t p = 0; p < pixels; ++p) {
        const float* color = &environment.pixels[p * environment.channels];
        brightness.push_back(0.2126f * color[0] + 0.7152f * color[1] + 0.0722f * color[2]);
    }
    if (brightness.empty()) return 0.0f;
    const auto middle = brightness.begin() + static_cast<std::ptrdiff_t>(brightness.size() / 2);
    std::nth_element(brightness.begin(), middle, brightness.end());
    if (!(*middle > 0.0f)) return 0.0f;
    return std::clamp(std::log2(kMiddleGrey / *middle), -10.0f, 10.0f);
}

Image displayLatLong(const Image& environment, float exposureEv) {
    Image display;
    if (environment.channels != 3 || environment.pixels.empty()) return display;
    display.width = environment.width;
    display.height = environment.height;
    display.channels = 4;
    display.space = ColorSpace::Srgb;
    display.pixels.resize(environment.pixels.size() / 3 * 4);
    ToneParams tone;
    tone.curve = ToneCurve::Agx;
    tone.exposureEv = std::clamp(exposureEv, -16.0f, 16.0f);
    const ImageView<const float> linear{environment.pixels.data(), environment.width, environment.height, 3};
    const ImageView<float> shown{display.pixels.data(), display.width, display.height, 4};
    if (auto status = toneMap(Device{}, tone, linear, shown); !status) return {};
    return display;
}

} // namespace ars::ui
