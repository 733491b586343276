#include "engine/capture/view_preparation.h"

#include "engine/capture/undistortion.h"
#include "engine/core/parallel.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

namespace ars {
namespace {

constexpr float kSoftAbove = 5.0f / 255.0f;
constexpr float kSoftBelow = 250.0f / 255.0f;
constexpr float kRounding = 65535.0f;

Image imageLike(const Image& image, int width, int height) {
    Image result;
    result.width = width;
    result.height = height;
    result.channels = image.channels;
    result.space = image.space;
    result.sourceBits = image.sourceBits;
    result.pixels.resize(static_cast<std::size_t>(width) * static_cast<std::size_t>(height) *
                         static_cast<std::size_t>(image.channels));
    return result;
}

/// Encoded 8-bit values to light by table: the power function costs more than decoding the file.
void toLinear(Image& image) {
    if (image.sourceBits == 8) {
        std::array<float, 256> table;
        for (std::size_t i = 0; i < table.size(); ++i) table[i] = srgbToLinear(static_cast<float>(i) / 255.0f);
        parallelFor(
            image.pixels.size(),
            [&](std::size_t i) {
                const float level = std::clamp(image.pixels[i] * 255.0f + 0.5f, 0.0f, 255.0f);
                image.pixels[i] = table[static_cast<std::size_t>(level)];
            },
            1 << 16);
    } else {
        parallelFor(
            image.pixels.size(), [&](std::size_t i) { image.pixels[i] = srgbToLinear(image.pixels[i]); }, 1 << 14);
    }
    image.space = ColorSpace::Linear;
}

void toEncoded(Image& image) {
    parallelFor(image.pixels.size(), [&](std::size_t i) { image.pixels[i] = linearToSrgb(image.pixels[i]); }, 1 << 14);
    image.space = ColorSpace::Srgb;
}

void roundValues(Image& image) {
    for (float& value : image.pixels) {
        value = std::floor(std::clamp(value, 0.0f, 1.0f) * kRounding + 0.5f) / kRounding;
    }
}

/// Undistorts both; `unknown` becomes 1 where the distorted picture says nothing.
Status undistortView(const CalibratedCamera& camera, Image& color, Image& mask, Image& unknown) {
    ARS_TRY(const LensDistortion<double> lens, lensDistortion(camera));
    const Image map = undistortionMap(camera.camera, lens);
    Image inside;
    color = resampled(color, map, inside);
    mask = resampled(mask, map, inside);
    unknown = std::move(inside);
    for (float& value : unknown.pixels) value = 1.0f - value;
    for (std::size_t i = 0; i < mask.pixels.size(); ++i) mask.pixels[i] *= 1.0f - unknown.pixels[i];
    return {};
}

/// Marks the incomplete last column and row that areaAveraged makes of a picture of this size.
void markIncomplete(Image& unknown, int width, int height, int scale) {
    if (width % scale != 0) {
        for (int row = 0; row < unknown.height; ++row) unknown.at(row, unknown.width - 1, 0) = 1.0f;
    }
    if (height % scale != 0) {
        for (int column = 0; column < unknown.width; ++column) unknown.at(unknown.height - 1, column, 0) = 1.0f;
    }
}

/// The box's part as zeros and ones; empty where all of it is known.
Image unknownPart(const Image& unknown, const PixelBox& box) {
    if (unknown.pixels.empty()) return {};
    Image part = cropped(unknown, box);
    bool any = false;
    for (float& value : part.pixels) {
        value = value > 0.0f ? 1.0f : 0.0f;
        any = any || value > 0.0f;
    }
    if (!any) return {};
    part.space = ColorSpace::Data;
    part.sourceBits = 8;
    return part;
}

} // namespace

PixelBox maskBounds(const Image& mask, int threshold) {
    const float above = static_cast<float>(threshold) / 255.0f;
    int left = mask.width, right = -1, top = mask.height, bottom = -1;
    for (int row = 0; row < mask.height; ++row) {
        const float* line = &mask.pixels[static_cast<std::size_t>(row) * static_cast<std::size_t>(mask.width)];
        int first = 0;
        while (first < mask.width && !(line[first] > above)) ++first;
        if (first == mask.width) continue;
        int last = mask.width - 1;
        while (!(line[last] > above)) --last;
        left = std::min(left, first);
        right = std::max(right, last);
        top = std::min(top, row);
        bottom = row;
    }
    if (right < 0) return {};
    return {left, top, right - left + 1, bottom - top + 1};
}

PixelBox cropBox(const PixelBox& box, int width, int height, int scale, int margin) {
    if (box.width <= 0 || margin < 0) return {0, 0, width, height};
    // Whole pixels of the smaller picture that touch the box.
    const int left = std::max(box.x / scale - margin, 0);
    const int top = std::max(box.y / scale - margin, 0);
    const int right = std::min((box.x + box.width - 1) / scale + 1 + margin, width);
    const int bottom = std::min((box.y + box.height - 1) / scale + 1 + margin, height);
    return {left, top, right - left, bottom - top};
}

Image areaAveraged(const Image& image, int scale) {
    Image result = imageLike(image, (image.width + scale - 1) / scale, (image.height + scale - 1) / scale);
    result.sourceBits = 32;
    const int channels = image.channels;
    parallelFor(
        static_cast<std::size_t>(result.height),
        [&](std::size_t line) {
            const int row = static_cast<int>(line);
            const int rows = std::min(scale, image.height - row * scale);
            for (int column = 0; column < result.width; ++column) {
                const int columns = std::min(scale, image.width - column * scale);
                for (int channel = 0; channel < channels; ++channel) {
                    float sum = 0.0f;
                    for (int y = 0; y < rows; ++y) {
                        for (int x = 0; x < columns; ++x) sum += image.at(row * scale + y, column * scale + x, channel);
                    }
                    result.at(row, column, channel) = sum / static_cast<float>(rows * columns);
                }
            }
        },
        8);
    return result;
}

Camera scaledCamera(const Camera& camera, int scale) {
    Camera result = camera;
    result.width = (camera.width + scale - 1) / scale;
    result.height = (camera.height + scale - 1) / scale;
    result.fx /= scale;
    result.fy /= scale;
    result.cx /= scale;
    result.cy /= scale;
    return result;
}

Image cropped(const Image& image, const PixelBox& box) {
    Image result = imageLike(image, box.width, box.height);
    const auto channels = static_cast<std::size_t>(image.channels);
    const auto length = static_cast<std::size_t>(box.width) * channels;
    for (int row = 0; row < box.height; ++row) {
        const std::size_t from = (static_cast<std::size_t>(box.y + row) * static_cast<std::size_t>(image.width) +
                                  static_cast<std::size_t>(box.x)) *
                                 channels;
        std::copy_n(image.pixels.begin() + static_cast<std::ptrdiff_t>(from), length,
                    result.pixels.begin() + static_cast<std::ptrdiff_t>(static_cast<std::size_t>(row) * length));
    }
    return result;
}

Camera croppedCamera(const Camera& camera, const PixelBox& box) {
    Camera result = camera;
    result.width = box.width;
    result.height = box.height;
    result.cx -= box.x;
    result.cy -= box.y;
    return result;
}

Image boundaryBand(const Image& mask, const PixelBox& box, int threshold, int halfWidth) {
    const float above = static_cast<float>(threshold) / 255.0f;
    Image band = imageLike(mask, box.width, box.height);
    band.space = ColorSpace::Data;
    // Number of person pixels above and to the left, over the box and what its squares reach.
    const int x0 = std::max(box.x - halfWidth, 0), x1 = std::min(box.x + box.width + halfWidth, mask.width);
    const int y0 = std::max(box.y - halfWidth, 0), y1 = std::min(box.y + box.height + halfWidth, mask.height);
    const auto stride = static_cast<std::size_t>(x1 - x0 + 1);
    std::vector<std::int32_t> sums(stride * static_cast<std::size_t>(y1 - y0 + 1), 0);
    const auto sumAt = [&](int row, int column) -> std::int32_t& {
        return sums[static_cast<std::size_t>(row - y0) * stride + static_cast<std::size_t>(column - x0)];
    };
    for (int row = y0; row < y1; ++row) {
        std::int32_t line = 0;
        for (int column = x0; column < x1; ++column) {
            line += mask.at(row, column, 0) > above ? 1 : 0;
            sumAt(row + 1, column + 1) = sumAt(row, column + 1) + line;
        }
    }
    for (int row = 0; row < box.height; ++row) {
        const int top = std::max(box.y + row - halfWidth, y0), bottom = std::min(box.y + row + halfWidth + 1, y1);
        for (int column = 0; column < box.width; ++column) {
            const int left = std::max(box.x + column - halfWidth, x0);
            const int right = std::min(box.x + column + halfWidth + 1, x1);
            const std::int32_t count =
                sumAt(bottom, right) - sumAt(top, right) - sumAt(bottom, left) + sumAt(top, left);
            const bool mixed = count > 0 && count < (bottom - top) * (right - left);
            const float alpha = mask.at(box.y + row, box.x + column, 0);
            const bool soft = alpha > kSoftAbove && alpha < kSoftBelow;
            band.at(row, column, 0) = mixed || soft ? 1.0f : 0.0f;
        }
    }
    return band;
}

Result<CapturedView> prepareView(ViewId id, const CalibratedCamera& calibrated, Image color, Image mask,
                                 const ViewOptions& options) {
    CapturedView view;
    view.id = id;
    view.camera = calibrated.camera;
    const bool resample = calibrated.distorted() || options.scale > 1;
    if (resample) toLinear(color);
    Image unknown;      // empty: every pixel is known
    Image incomparable; // unknown, and what else the colours of a smaller picture are wrong in
    if (calibrated.distorted()) ARS_TRY_STATUS(undistortView(calibrated, color, mask, unknown));
    const PixelBox person = maskBounds(mask, options.maskThreshold);
    if (options.scale > 1) {
        const int width = color.width, height = color.height;
        color = areaAveraged(color, options.scale);
        mask = areaAveraged(mask, options.scale);
        if (!unknown.pixels.empty()) unknown = areaAveraged(unknown, options.scale);
        incomparable = unknown.pixels.empty() ? imageLike(mask, mask.width, mask.height) : unknown;
        markIncomplete(incomparable, width, height, options.scale);
        view.camera = scaledCamera(view.camera, options.scale);
    }
    const PixelBox box = cropBox(person, mask.width, mask.height, options.scale, options.cropMargin);
    view.camera = croppedCamera(view.camera, box);
    view.band = boundaryBand(mask, box, options.maskThreshold, options.bandPixels);
    view.color = cropped(color, box);
    if (resample) toEncoded(view.color);
    view.mask = cropped(mask, box);
    view.mask.space = ColorSpace::Data;
    for (const Image* left : {&unknown, &incomparable}) {
        if (left->pixels.empty()) continue;
        const Image part = cropped(*left, box);
        for (std::size_t i = 0; i < part.pixels.size(); ++i) {
            if (part.pixels[i] > 0.0f) view.band.pixels[i] = 1.0f;
        }
    }
    view.unknown = unknownPart(unknown, box);
    for (float& alpha : view.mask.pixels) {
        // Noise of the matting and of JPEG: what the band does not count as soft is no person or wholly one.
        if (alpha <= kSoftAbove) alpha = 0.0f;
        if (alpha >= kSoftBelow) alpha = 1.0f;
    }
    roundValues(view.color);
    roundValues(view.mask);
    view.color.sourceBits = view.mask.sourceBits = 16;
    view.band.sourceBits = 8;
    return view;
}

} // namespace ars
