#include "engine/frame/display.h"

#include "engine/core/parallel.h"
#include "engine/light/cube_map.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace ars {

namespace {

struct DataColors {
    BufferKind kind;
    float minimum, maximum;
    ColorMap map;

    /// sRGB-encoded.
    glm::vec3 operator()(const float* value) const {
        switch (kind) {
        case BufferKind::SrgbColor:
            return {value[0], value[1], value[2]};
        case BufferKind::LinearAlbedo:
            return {linearToSrgb(value[0]), linearToSrgb(value[1]), linearToSrgb(value[2])};
        case BufferKind::Direction:
            return 0.5f + 0.5f * glm::vec3(value[0], -value[1], -value[2]);
        case BufferKind::Place:
            return (glm::vec3(value[0], value[1], value[2]) - minimum) / (maximum - minimum);
        default:
            return mapColor(map, (value[0] - minimum) / (maximum - minimum));
        }
    }
};

Result<Image> displayLight(const Image& picture, const Image& opacity, const ToneParams& tone) {
    std::vector<float> rgba(opacity.pixels.size() * 4);
    const auto channels = static_cast<std::size_t>(picture.channels);
    for (std::size_t p = 0; p < opacity.pixels.size(); ++p) {
        // Diffuse and specular light come without alpha and not premultiplied.
        const float alpha = channels == 4 ? picture.pixels[4 * p + 3] : opacity.pixels[p];
        const float factor = channels == 4 ? 1.0f : alpha;
        for (std::size_t c = 0; c < 3; ++c) rgba[4 * p + c] = picture.pixels[channels * p + c] * factor;
        rgba[4 * p + 3] = alpha;
    }
    Image result;
    result.width = picture.width;
    result.height = picture.height;
    result.channels = 4;
    result.space = ColorSpace::Srgb;
    result.pixels.resize(rgba.size());
    ARS_TRY_STATUS(toneMap({}, tone, {rgba.data(), picture.width, picture.height, 4},
                           ImageView<float>{result.pixels.data(), picture.width, picture.height, 4}));
    return result;
}

Image withoutAlpha(Image image) {
    if (image.channels != 4) return image;
    for (std::size_t p = 0; p < image.pixels.size() / 4; ++p) {
        for (std::size_t c = 0; c < 3; ++c) image.pixels[3 * p + c] = image.pixels[4 * p + c];
    }
    image.pixels.resize(image.pixels.size() / 4 * 3);
    image.channels = 3;
    return image;
}

/// Data over the background; mixed as shown, since these colours are no light.
Image displayData(BufferId id, const Image& picture, const Image& opacity, const DisplaySettings& settings) {
    const BufferInfo& info = bufferInfo(id);
    const auto range = settings.range.value_or(std::pair{info.minimum, info.maximum});
    const DataColors colors{info.kind, range.first, range.second, settings.colorMap.value_or(info.colorMap)};
    const glm::vec3 background(linearToSrgb(settings.tone.backgroundRed), linearToSrgb(settings.tone.backgroundGreen),
                               linearToSrgb(settings.tone.backgroundBlue));
    Image result;
    result.width = picture.width;
    result.height = picture.height;
    result.channels = 4;
    result.space = ColorSpace::Srgb;
    result.pixels.resize(opacity.pixels.size() * 4);
    const bool transparent = settings.tone.transparent;
    parallelFor(opacity.pixels.size(), [&](std::size_t p) {
        // Opacity itself is data everywhere: nothing lies behind it.
        const float covered = id == BufferId::Opacity ? 1.0f : std::clamp(opacity.pixels[p], 0.0f, 1.0f);
        const glm::vec3 shown =
            glm::clamp(colors(&picture.pixels[p * static_cast<std::size_t>(picture.channels)]), 0.0f, 1.0f);
        const glm::vec3 mixed = transparent ? shown : glm::mix(background, shown, covered);
        for (int c = 0; c < 3; ++c) result.pixels[4 * p + static_cast<std::size_t>(c)] = mixed[c];
        result.pixels[4 * p + 3] = transparent ? covered : 1.0f;
    });
    return result;
}

/// Half the sides, each texel the mean of four.
Image halved(const Image& image) {
    Image half;
    half.width = std::max(1, image.width / 2);
    half.height = std::max(1, image.height / 2);
    half.channels = 3;
    half.pixels.resize(static_cast<std::size_t>(half.width) * static_cast<std::size_t>(half.height) * 3);
    parallelFor(
        static_cast<std::size_t>(half.height),
        [&](std::size_t y) {
            const int row = static_cast<int>(y), top = std::min(2 * row, image.height - 1),
                      bottom = std::min(2 * row + 1, image.height - 1);
            for (int column = 0; column < half.width; ++column) {
                const int left = std::min(2 * column, image.width - 1), right = std::min(left + 1, image.width - 1);
                for (int c = 0; c < 3; ++c) {
                    half.at(row, column, c) = 0.25f * (image.at(top, left, c) + image.at(top, right, c) +
                                                       image.at(bottom, left, c) + image.at(bottom, right, c));
                }
            }
        },
        16);
    return half;
}

/// A lat-long picture looked up bilinearly in a halved form of it, or between two.
class BlurredSphere {
public:
    BlurredSphere(const Image& picture, float blur) {
        const float levels = std::log2(static_cast<float>(std::max(picture.width, 1)));
        const float level = std::clamp(blur, 0.0f, 1.0f) * levels;
        share_ = level - std::floor(level);
        fine_ = &picture;
        for (int i = 0; i < static_cast<int>(level); ++i) fine_ = &(halves_[0] = halved(*fine_));
        if (share_ > 0.0f) halves_[1] = halved(*fine_);
    }
    /// @param place  in [0, 1]^2
    glm::vec3 operator()(const glm::dvec2& place) const {
        const glm::vec3 fine = lookUp(*fine_, place);
        return share_ > 0.0f ? glm::mix(fine, lookUp(halves_[1], place), share_) : fine;
    }

private:
    static glm::vec3 texel(const Image& image, int row, int column) {
        column = (column % image.width + image.width) % image.width;
        row = std::clamp(row, 0, image.height - 1);
        return {image.at(row, column, 0), image.at(row, column, 1), image.at(row, column, 2)};
    }
    static glm::vec3 lookUp(const Image& image, const glm::dvec2& place) {
        const double x = place.x * image.width - 0.5, y = place.y * image.height - 0.5;
        const int x0 = static_cast<int>(std::floor(x)), y0 = static_cast<int>(std::floor(y));
        const float fx = static_cast<float>(x - x0), fy = static_cast<float>(y - y0);
        const glm::vec3 top = texel(image, y0, x0) * (1 - fx) + texel(image, y0, x0 + 1) * fx;
        const glm::vec3 bottom = texel(image, y0 + 1, x0) * (1 - fx) + texel(image, y0 + 1, x0 + 1) * fx;
        return top * (1 - fy) + bottom * fy;
    }

    const Image* fine_ = nullptr;
    std::array<Image, 2> halves_;
    float share_ = 0.0f; ///< of the coarser one
};

} // namespace

Result<Image> displayPicture(BufferId id, const Image& picture, const Image& opacity, const DisplaySettings& settings) {
    const BufferInfo& info = bufferInfo(id);
    if (picture.width != opacity.width || picture.height != opacity.height || picture.channels != info.channels() ||
        opacity.channels != 1) {
        return makeError(ErrorCode::InvalidArgument, std::string(info.name),
                         fmt::format("a picture of {}x{}x{}, opacity of {}x{}x{}; expected one size, {} and 1 channels",
                                     picture.width, picture.height, picture.channels, opacity.width, opacity.height,
                                     opacity.channels, info.channels()));
    }
    if (settings.range && !(settings.range->first < settings.range->second)) {
        return makeError(ErrorCode::InvalidArgument, std::string(info.name),
                         fmt::format("a range from {} to {}; the second must be larger", settings.range->first,
                                     settings.range->second));
    }
    if (info.kind != BufferKind::LinearColor) {
        Image result = displayData(id, picture, opacity, settings);
        return settings.tone.transparent ? result : withoutAlpha(std::move(result));
    }
    ARS_TRY(Image result, displayLight(picture, opacity, settings.tone));
    return settings.tone.transparent ? std::move(result) : withoutAlpha(std::move(result));
}

Status addBackdrop(Image& beauty, const Camera& camera, const Environment& environment,
                   const EnvironmentPlacement& placement, float blur) {
    if (beauty.channels != 4 || beauty.width != camera.width || beauty.height != camera.height) {
        return makeError(ErrorCode::InvalidArgument, "backdrop",
                         fmt::format("a picture of {}x{}x{}; expected RGBA of the camera's {}x{}", beauty.width,
                                     beauty.height, beauty.channels, camera.width, camera.height));
    }
    const BlurredSphere light(environment.picture, blur);
    const glm::dmat3 turned =
        worldToEnvironment(static_cast<double>(placement.rotationDeg)) * glm::transpose(camera.rotation);
    parallelFor(
        static_cast<std::size_t>(beauty.height),
        [&](std::size_t row) {
            for (int column = 0; column < beauty.width; ++column) {
                float* pixel =
                    &beauty
                         .pixels[(row * static_cast<std::size_t>(beauty.width) + static_cast<std::size_t>(column)) * 4];
                if (pixel[3] >= 1.0f) continue;
                const glm::vec3 behind = light(
                    latLongPlace(glm::normalize(turned * camera.ray(column + 0.5, static_cast<double>(row) + 0.5))));
                for (int channel = 0; channel < 3; ++channel)
                    pixel[channel] += (1.0f - pixel[3]) * placement.scale * behind[channel];
                pixel[3] = 1.0f;
            }
        },
        4);
    return {};
}

std::vector<std::uint8_t> displayBytes(const Image& image) {
    const auto channels = static_cast<std::size_t>(image.channels);
    const std::size_t pixels = image.pixels.size() / channels;
    std::vector<std::uint8_t> bytes(3 * pixels);
    parallelFor(
        pixels,
        [&](std::size_t p) {
            for (std::size_t c = 0; c < 3; ++c) {
                const float value = image.pixels[channels * p + std::min(c, channels - 1)];
                bytes[3 * p + c] = static_cast<std::uint8_t>(std::clamp(value, 0.0f, 1.0f) * 255.0f + 0.5f);
            }
        },
        4096);
    return bytes;
}

Status addBufferLayer(ExrImage& exr, BufferId id, const Image& picture) {
    const BufferInfo& info = bufferInfo(id);
    // Half floats resolve 1 mm at 2 m only; a shaded pixel may be brighter than they reach.
    const bool wide = id == BufferId::Depth || id == BufferId::Position;
    Image bounded = picture;
    if (!wide) {
        for (float& value : bounded.pixels) value = std::clamp(value, -65504.0f, 65504.0f);
    }
    return addExrLayer(exr, id == BufferId::Beauty ? "" : info.name, bounded, info.letters,
                       wide ? ExrPixelType::Float : ExrPixelType::Half);
}

} // namespace ars
