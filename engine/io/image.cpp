#include "engine/io/image.h"

#include "engine/core/parallel.h"

#include <cmath>

namespace ars {

namespace {

/// color = combine(color, alpha) in every pixel.
template <typename Combine>
void combineWithAlpha(Image& image, Combine combine) {
    const int channels = image.channels;
    const std::size_t count = image.pixels.size() / channels;
    float* pixels = image.pixels.data();
    parallelFor(count, [=](std::size_t p) {
        float* pixel = pixels + p * channels;
        for (int c = 0; c + 1 < channels; ++c) pixel[c] = combine(pixel[c], pixel[channels - 1]);
    });
}

template <typename Transfer>
void mapColors(Image& image, Transfer transfer) {
    const int channels = image.channels;
    const int colors = image.hasAlpha() ? channels - 1 : channels;
    const std::size_t count = image.pixels.size() / channels;
    float* pixels = image.pixels.data();
    parallelFor(count, [=](std::size_t p) {
        for (int c = 0; c < colors; ++c) pixels[p * channels + c] = transfer(pixels[p * channels + c]);
    });
}

} // namespace

std::string_view colorSpaceName(ColorSpace space) {
    switch (space) {
    case ColorSpace::Linear:
        return "linear";
    case ColorSpace::Srgb:
        return "srgb";
    case ColorSpace::Data:
        return "data";
    }
    return "data";
}

Result<std::size_t> imageValueCount(std::int64_t width, std::int64_t height, std::int64_t channels,
                                    const ReadLimits& limits) {
    if (width <= 0 || height <= 0 || channels <= 0) {
        return makeError(ErrorCode::BadFile, "",
                         fmt::format("expected a picture of at least 1x1 pixels, found {}x{} with {} channels", width,
                                     height, channels));
    }
    if (width > limits.maxImageSide || height > limits.maxImageSide) {
        return makeError(
            ErrorCode::LimitExceeded, "",
            fmt::format("a picture of {}x{} pixels, the limit is {} a side", width, height, limits.maxImageSide));
    }
    // Both sides are below 2^32 here, so their product fits; the bytes are compared by division.
    const auto pixels = static_cast<std::uint64_t>(width) * static_cast<std::uint64_t>(height);
    if (static_cast<std::uint64_t>(channels) > limits.maxBytes / sizeof(float) / pixels) {
        return makeError(
            ErrorCode::LimitExceeded, "",
            fmt::format("a picture of {}x{} pixels with {} channels needs {:.1f} MB, the limit is {:.1f} MB", width,
                        height, channels, 4e-6 * double(pixels) * double(channels), 1e-6 * double(limits.maxBytes)));
    }
    return static_cast<std::size_t>(pixels) * static_cast<std::size_t>(channels);
}

Status checkImage(const Image& image) {
    if (image.width <= 0 || image.height <= 0 || image.channels < 1 || image.channels > 4) {
        return makeError(ErrorCode::InvalidArgument, "",
                         fmt::format("cannot write a picture of {}x{} pixels with {} channels (1 to 4)", image.width,
                                     image.height, image.channels));
    }
    const std::size_t expected = std::size_t(image.width) * image.height * image.channels;
    if (image.pixels.size() != expected) {
        return makeError(ErrorCode::InvalidArgument, "",
                         fmt::format("a picture of {}x{}x{} has {} values, expected {}", image.height, image.width,
                                     image.channels, image.pixels.size(), expected));
    }
    return {};
}

float linearToSrgb(float linear) {
    const float x = std::abs(linear);
    const float y = x <= 0.0031308f ? 12.92f * x : 1.055f * std::pow(x, 1.0f / 2.4f) - 0.055f;
    return std::copysign(y, linear);
}

float srgbToLinear(float encoded) {
    const float x = std::abs(encoded);
    const float y = x <= 0.04045f ? x / 12.92f : std::pow((x + 0.055f) / 1.055f, 2.4f);
    return std::copysign(y, encoded);
}

Result<Image> convertColorSpace(Image image, ColorSpace space) {
    if (image.space == space) return image;
    if (image.space == ColorSpace::Data || space == ColorSpace::Data) {
        return makeError(ErrorCode::InvalidArgument, "",
                         fmt::format("cannot convert a picture from {} to {}: data is not a colour",
                                     colorSpaceName(image.space), colorSpaceName(space)));
    }
    const bool premultiplied = image.premultiplied && image.hasAlpha();
    if (premultiplied) image = straightAlpha(std::move(image));
    if (space == ColorSpace::Srgb) {
        mapColors(image, linearToSrgb);
    } else {
        mapColors(image, srgbToLinear);
    }
    image.space = space;
    return premultiplied ? premultipliedAlpha(std::move(image)) : std::move(image);
}

Image straightAlpha(Image image) {
    if (!image.premultiplied) return image;
    if (image.hasAlpha())
        combineWithAlpha(image, [](float c, float alpha) { return alpha != 0.0f ? c / alpha : 0.0f; });
    image.premultiplied = false;
    return image;
}

Image premultipliedAlpha(Image image) {
    if (image.premultiplied || !image.hasAlpha()) return image;
    combineWithAlpha(image, [](float c, float alpha) { return c * alpha; });
    image.premultiplied = true;
    return image;
}

} // namespace ars
