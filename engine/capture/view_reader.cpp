#include "engine/capture/capture.h"

#include "engine/capture/view_preparation.h"
#include "engine/core/file.h"
#include "engine/io/image_file.h"
#include "engine/io/jpeg.h"
#include "engine/io/png.h"

#include <algorithm>
#include <cmath>

namespace ars {
namespace fs = std::filesystem;
namespace {

/// A JPEG or PNG as its pixels are stored: whoever calibrated the cameras did not turn pictures by EXIF.
Result<Image> readPicture(const fs::path& path, const ReadLimits& limits) {
    ARS_TRY(const std::vector<std::byte> bytes, readFile(path, limits));
    const auto format = recogniseImage(bytes);
    if (format == ImageFormat::Jpeg) {
        auto file = parseJpeg(bytes, {.applyOrientation = false}, limits);
        if (!file) return atPlace(std::move(file).error(), path.string());
        return std::move(file->image);
    }
    if (format == ImageFormat::Png) {
        auto file = parsePng(bytes, limits);
        if (!file) return atPlace(std::move(file).error(), path.string());
        return std::move(file->image);
    }
    return makeError(ErrorCode::BadFile, path.string(), "is no JPEG or PNG picture");
}

/// One channel of a picture.
Image channelOf(const Image& image, int channel) {
    Image result;
    result.width = image.width;
    result.height = image.height;
    result.channels = 1;
    result.space = ColorSpace::Data;
    result.sourceBits = image.sourceBits;
    const auto stride = static_cast<std::size_t>(image.channels);
    result.pixels.resize(image.pixels.size() / stride);
    for (std::size_t i = 0; i < result.pixels.size(); ++i) {
        result.pixels[i] = image.pixels[i * stride + static_cast<std::size_t>(channel)];
    }
    return result;
}

/// Three channels without alpha, sRGB-encoded.
Result<Image> colorsOf(Image image) {
    if (image.space == ColorSpace::Linear) {
        ARS_TRY(image, convertColorSpace(std::move(image), ColorSpace::Srgb));
    }
    if (image.channels == 3) return image;
    Image result = image;
    result.channels = 3;
    const auto stride = static_cast<std::size_t>(image.channels);
    const std::size_t count = image.pixels.size() / stride;
    const bool gray = image.channels < 3;
    result.pixels.resize(count * 3);
    for (std::size_t i = 0; i < count; ++i) {
        for (std::size_t c = 0; c < 3; ++c) result.pixels[i * 3 + c] = image.pixels[i * stride + (gray ? 0 : c)];
    }
    return result;
}

/// Masks are gray, gray in three channels, or 0 and 1 in eight bits where 255 was meant.
Image maskOf(const Image& image, ImageFormat format) {
    Image mask = channelOf(image, 0);
    if (format != ImageFormat::Png || mask.sourceBits != 8) return mask;
    const bool ones = std::all_of(mask.pixels.begin(), mask.pixels.end(), [](float v) { return v * 255.0f < 1.5f; });
    if (ones) {
        for (float& value : mask.pixels) value = value > 0.0f ? 1.0f : 0.0f;
    }
    return mask;
}

Result<Image> readMask(const fs::path& path, const Image& picture, const ReadLimits& limits) {
    ARS_TRY(const Image image, readPicture(path, limits));
    if (image.width != picture.width || image.height != picture.height) {
        return makeError(ErrorCode::InvalidArgument, path.string(),
                         fmt::format("the mask has {} x {} pixels, its picture {} x {}", image.width, image.height,
                                     picture.width, picture.height));
    }
    return maskOf(image, path.extension() == ".png" ? ImageFormat::Png : ImageFormat::Jpeg);
}

Status checkView(const Capture& capture, ViewId view) {
    const bool exists = view.camera >= 0 && view.camera < static_cast<int>(capture.cameras.size()) && view.frame >= 0 &&
                        view.frame < static_cast<int>(capture.frames.size());
    if (!exists) {
        return makeError(ErrorCode::InvalidArgument, capture.folder.string(),
                         fmt::format("there is no view of camera {} and frame {}; there are {} cameras and {} frames",
                                     view.camera, view.frame, capture.cameras.size(), capture.frames.size()));
    }
    if (capture.has(view)) return {};
    return makeError(ErrorCode::InvalidArgument, capture.imagePath(view).string(), "is missing in this capture");
}

} // namespace

Status validateViewOptions(const ViewOptions& options) {
    const auto check = [](const char* name, int value, int least, int most) -> Status {
        if (value >= least && value <= most) return {};
        return makeError(ErrorCode::InvalidArgument, name,
                         fmt::format("must lie in [{}, {}], found {}", least, most, value));
    };
    constexpr int kMostPixels = 32768;
    ARS_TRY_STATUS(check("picture scale", options.scale, 1, 8));
    ARS_TRY_STATUS(check("crop margin", options.cropMargin, -kMostPixels, kMostPixels));
    ARS_TRY_STATUS(check("mask threshold", options.maskThreshold, 0, 254));
    return check("boundary band", options.bandPixels, 0, 256);
}

Result<CapturedView> readView(const Capture& capture, ViewId view, const ViewOptions& options,
                              const ReadLimits& limits) {
    ARS_TRY_STATUS(validateViewOptions(options));
    ARS_TRY_STATUS(checkView(capture, view));
    const CalibratedCamera& camera = capture.cameras[static_cast<std::size_t>(view.camera)];
    const fs::path path = capture.imagePath(view);
    ARS_TRY(Image picture, readPicture(path, limits));
    if (picture.width != camera.camera.width || picture.height != camera.camera.height) {
        return makeError(ErrorCode::BadFile, path.string(),
                         fmt::format("has {} x {} pixels, the calibration says {} x {}", picture.width, picture.height,
                                     camera.camera.width, camera.camera.height));
    }
    const fs::path maskPath = capture.maskPath(view);
    if (maskPath.empty() && !picture.hasAlpha()) {
        return makeError(ErrorCode::BadFile, path.string(), "has no mask: neither a file of its own nor alpha");
    }
    Image mask;
    if (maskPath.empty()) {
        mask = channelOf(picture, picture.channels - 1);
    } else {
        ARS_TRY(mask, readMask(maskPath, picture, limits));
    }
    ARS_TRY(Image color, colorsOf(std::move(picture)));
    return prepareView(view, camera, std::move(color), std::move(mask), options);
}

} // namespace ars
