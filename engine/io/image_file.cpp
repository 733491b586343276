#include "engine/io/image_file.h"

#include "engine/core/file.h"
#include "engine/io/exr.h"
#include "engine/io/hdr.h"
#include "engine/io/jpeg.h"
#include "engine/io/png.h"

namespace ars {

namespace {

template <typename File>
Result<Image> imageOf(Result<File> file) {
    if (!file) return std::move(file).error();
    return std::move(file->image);
}

Result<Image> mainLayer(std::span<const std::byte> bytes, const ReadLimits& limits) {
    ARS_TRY(const ExrImage exr, parseExr(bytes, limits));
    const std::vector<std::string> layers = exrLayers(exr);
    return exrLayer(exr, layers.size() == 1 ? layers.front() : "", ExrWindow::Display, limits);
}

} // namespace

std::string_view imageFormatName(ImageFormat format) {
    switch (format) {
    case ImageFormat::Exr:
        return "OpenEXR";
    case ImageFormat::Hdr:
        return "Radiance HDR";
    case ImageFormat::Png:
        return "PNG";
    case ImageFormat::Jpeg:
        return "JPEG";
    }
    return "unknown";
}

std::optional<ImageFormat> recogniseImage(std::span<const std::byte> head) {
    const std::string_view text(reinterpret_cast<const char*>(head.data()), head.size());
    if (text.starts_with("\x76\x2f\x31\x01")) return ImageFormat::Exr;
    if (text.starts_with("#?")) return ImageFormat::Hdr;
    if (text.starts_with("\x89PNG\r\n\x1a\n")) return ImageFormat::Png;
    if (text.starts_with("\xff\xd8\xff")) return ImageFormat::Jpeg;
    return std::nullopt;
}

Result<Image> parseImageFile(std::span<const std::byte> bytes, const ReadLimits& limits) {
    const auto format = recogniseImage(bytes);
    if (!format) {
        return makeError(ErrorCode::Unsupported, "", "expected a picture: OpenEXR, Radiance HDR, PNG or JPEG");
    }
    switch (*format) {
    case ImageFormat::Exr:
        return mainLayer(bytes, limits);
    case ImageFormat::Hdr:
        return parseHdr(bytes, limits);
    case ImageFormat::Png:
        return imageOf(parsePng(bytes, limits));
    case ImageFormat::Jpeg:
        return imageOf(parseJpeg(bytes, {}, limits));
    }
    return makeError(ErrorCode::Internal, "", "a picture format without a reader");
}

Result<Image> readImageFile(const std::filesystem::path& path, const ReadLimits& limits) {
    ARS_TRY(const auto bytes, readFile(path, limits));
    auto image = parseImageFile(bytes, limits);
    if (!image) return atPlace(std::move(image).error(), path.string());
    return image;
}

} // namespace ars
