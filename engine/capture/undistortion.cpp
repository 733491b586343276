#include "engine/capture/undistortion.h"

#include "engine/core/parallel.h"
#include "engine/io/text_scanner.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace ars {
namespace {

Image plane(int width, int height, int channels) {
    Image image;
    image.width = width;
    image.height = height;
    image.channels = channels;
    image.space = ColorSpace::Data;
    image.pixels.resize(static_cast<std::size_t>(width) * static_cast<std::size_t>(height) *
                        static_cast<std::size_t>(channels));
    return image;
}

/// Two neighbours along one axis and the weight of the second; `whole` when those with weight exist.
struct Tap {
    int first = 0, second = 0;
    float weight = 0.0f;
    bool whole = false;
};

Tap tapAt(float position, int size) {
    const float centred = position - 0.5f;
    const float low = std::floor(centred);
    Tap tap;
    tap.weight = centred - low;
    const float most = static_cast<float>(size - 1);
    tap.whole = low >= 0.0f && (tap.weight > 0.0f ? low + 1.0f <= most : low <= most);
    tap.first = static_cast<int>(std::clamp(low, 0.0f, most));
    tap.second = static_cast<int>(std::clamp(low + 1.0f, 0.0f, most));
    return tap;
}

} // namespace

Result<LensDistortion<double>> lensDistortion(const CalibratedCamera& camera) {
    const std::vector<double>& d = camera.distortion;
    const std::string place = fmt::format("camera {}", quotedFound(camera.name));
    const auto at = [&](std::size_t i) { return i < d.size() ? d[i] : 0.0; };
    constexpr std::size_t kRational = 8;
    if (d.size() != 0 && d.size() != 4 && d.size() != 5 && d.size() != kRational && d.size() != 12 && d.size() != 14) {
        return makeError(
            ErrorCode::BadFile, place,
            fmt::format("distCoeff has {} numbers, expected 4, 5, 8, 12 or 14 (k1 k2 p1 p2 k3 ...)", d.size()));
    }
    for (std::size_t i = kRational; i < d.size(); ++i) {
        if (d[i] == 0.0) continue;
        return makeError(ErrorCode::Unsupported, place,
                         "distCoeff has thin prism or tilt coefficients; only k1 k2 p1 p2 k3 k4 k5 k6 are read");
    }
    return LensDistortion<double>{at(0), at(1), at(2), at(3), at(4), at(5), at(6), at(7)};
}

Image undistortionMap(const Camera& camera, const LensDistortion<double>& lens) {
    Image map = plane(camera.width, camera.height, 2);
    const auto width = static_cast<std::size_t>(camera.width);
    parallelFor(
        static_cast<std::size_t>(camera.height),
        [&](std::size_t row) {
            const double y = (static_cast<double>(row) + 0.5 - camera.cy) / camera.fy;
            for (std::size_t column = 0; column < width; ++column) {
                const double x = (static_cast<double>(column) + 0.5 - camera.cx) / camera.fx;
                float* target = &map.pixels[(row * width + column) * 2];
                if (!(radialSlope(lens, x, y) > 0.0)) {
                    target[0] = target[1] = std::numeric_limits<float>::quiet_NaN();
                    continue;
                }
                const glm::dvec2 seen = distorted(lens, x, y);
                target[0] = static_cast<float>(camera.fx * seen.x + camera.cx);
                target[1] = static_cast<float>(camera.fy * seen.y + camera.cy);
            }
        },
        16);
    return map;
}

Image resampled(const Image& source, const Image& map, Image& inside) {
    Image result = plane(map.width, map.height, source.channels);
    result.space = source.space;
    result.sourceBits = 32;
    inside = plane(map.width, map.height, 1);
    const auto channels = static_cast<std::size_t>(source.channels);
    const auto stride = static_cast<std::size_t>(source.width);
    parallelFor(
        static_cast<std::size_t>(map.width) * static_cast<std::size_t>(map.height),
        [&](std::size_t pixel) {
            const float u = map.pixels[pixel * 2], v = map.pixels[pixel * 2 + 1];
            if (!std::isfinite(u) || !std::isfinite(v)) return;
            const Tap x = tapAt(u, source.width), y = tapAt(v, source.height);
            inside.pixels[pixel] = x.whole && y.whole ? 1.0f : 0.0f;
            const auto index = [&](int row, int column) {
                return (static_cast<std::size_t>(row) * stride + static_cast<std::size_t>(column)) * channels;
            };
            const std::size_t a = index(y.first, x.first), b = index(y.first, x.second);
            const std::size_t c = index(y.second, x.first), d = index(y.second, x.second);
            for (std::size_t channel = 0; channel < channels; ++channel) {
                const float* p = source.pixels.data() + channel;
                const float top = p[a] + x.weight * (p[b] - p[a]);
                const float bottom = p[c] + x.weight * (p[d] - p[c]);
                result.pixels[pixel * channels + channel] = top + y.weight * (bottom - top);
            }
        },
        4096);
    return result;
}

} // namespace ars
