#pragma once

#include "engine/core/error.h"
#include "engine/core/limits.h"
#include "engine/io/image.h"

#include <array>
#include <cstddef>
#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace ars {

enum class ExrPixelType { UInt, Half, Float };
std::string_view exrPixelTypeName(ExrPixelType type);

/// Lossless: None, Rle, Zips (1 row a block), Zip (16 rows), Piz. Lossy: Pxr24 (Float only), B44, B44a (Half only),
/// Dwaa (32 rows), Dwab (256 rows).
enum class ExrCompression { None, Rle, Zips, Zip, Piz, Pxr24, B44, B44a, Dwaa, Dwab };
std::string_view exrCompressionName(ExrCompression compression);

/// A rectangle of pixels; all four sides belong to it. y grows downwards.
struct ExrBox {
    int x0 = 0;
    int y0 = 0;
    int x1 = -1;
    int y1 = -1;

    int width() const { return x1 - x0 + 1; }
    int height() const { return y1 - y0 + 1; }
    bool operator==(const ExrBox&) const = default;
};

/// One channel under its whole name ("albedo.R"). UInt values are exact up to 2^24; NaN and infinity stay.
struct ExrChannel {
    std::string name;
    ExrPixelType type = ExrPixelType::Half; ///< in the file
    std::vector<float> pixels;              ///< (height, width) of the data window
};

/// A flat OpenEXR picture with all its layers.
///
/// Values are kept as stored: linear light for colours by the format's convention, colours premultiplied by A.
struct ExrImage {
    ExrBox dataWindow;    ///< the pixels that are stored
    ExrBox displayWindow; ///< the picture; stored pixels may be fewer or more
    ExrCompression compression = ExrCompression::Zip;
    float dwaLevel = 45.0f; ///< Dwaa and Dwab when writing: 0 is finest, 45 is the library's default
    std::vector<ExrChannel> channels;
    std::map<std::string, std::string>
        textAttributes; ///< string attributes; the program's pictures carry their document

    const ExrChannel* find(std::string_view name) const;
};

/// Where the result of exrLayer lies.
enum class ExrWindow {
    Display, ///< cropped to the display window, zeros where nothing is stored
    Data,    ///< the stored pixels
};

/// Reads every channel of level 0 of a scan-line or tiled file with one part or many.
///
/// With several parts the data window is the union of theirs (zeros where a part stores nothing) and a channel name
/// that more than one part uses is prefixed with its part's name ("left.R").
/// BadFile: broken, truncated, or any block missing. Unsupported: deep pixels, subsampled channels, unknown
/// compression. LimitExceeded: windows or channels beyond `limits`, found from the header before memory is taken.
Result<ExrImage> parseExr(std::span<const std::byte> bytes, const ReadLimits& limits = defaultReadLimits());
Result<ExrImage> readExr(const std::filesystem::path& path, const ReadLimits& limits = defaultReadLimits());

/// Writes one scan-line part. Channels may come in any order (the file sorts them). Channel names longer than 31 bytes
/// are stored as such. InvalidArgument: no channels, a name twice or empty, pixels not of the data window's size, an
/// empty window, a UInt channel with values that are no integers in [0, 2^32), or a finite value beyond 65,504 in a
/// Half channel (which would silently become infinity).
Result<std::vector<std::byte>> encodeExr(const ExrImage& image);
Status writeExr(const std::filesystem::path& path, const ExrImage& image);

/// What the header says about one channel.
struct ExrChannelInfo {
    std::string name;
    ExrPixelType type = ExrPixelType::Half;
    int xSampling = 1; ///< 1: every pixel is stored
    int ySampling = 1;
};

/// What the header says about one part.
struct ExrPartInfo {
    std::string name; ///< empty in single-part files
    bool tiled = false;
    bool deep = false;
    ExrBox dataWindow;
    ExrBox displayWindow;
    ExrCompression compression = ExrCompression::None;
    std::vector<ExrChannelInfo> channels;
    std::map<std::string, std::string> textAttributes;
    std::optional<std::array<float, 8>> chromaticities; ///< red, green, blue, white as x y; absent means Rec.709
};

struct ExrInfo {
    std::vector<ExrPartInfo> parts;
    std::vector<std::string> layers; ///< of all parts, sorted; "" is the layer of channels without a dot
};

/// Header only: no pixel is read. The bytes may be the beginning of a file as long as they hold the whole header.
/// BadFile as in parseExr; deep and subsampled files are described, not refused.
Result<ExrInfo> parseExrInfo(std::span<const std::byte> bytes);
Result<ExrInfo> listExr(const std::filesystem::path& path, const ReadLimits& limits = defaultReadLimits());

/// The layers of a picture, sorted: "albedo" for "albedo.R"; "" for channels without a dot.
std::vector<std::string> exrLayers(const ExrImage& image);

/// One layer as an image, whatever the order in the file: R G B with A if there is one, else X Y Z, else Y with A if
/// there is one, else the layer's only channel (depth.Z). Names count in lower case too.
///
/// The space is Linear for R G B and for a Y of layer ""; Data for the rest. Whoever knows better (a layer of
/// sRGB-encoded colours) sets it. Images with A are marked premultiplied. sourceBits is that of the first channel.
/// NotFound (naming the layers that exist); Unsupported when the layer's channels form none of the above;
/// LimitExceeded when the display window is beyond `limits`.
Result<Image> exrLayer(const ExrImage& image, std::string_view layer, ExrWindow window = ExrWindow::Display,
                       const ReadLimits& limits = defaultReadLimits());

/// Adds an image as the layer's channels, named by one letter per image channel: "RGB", "RGBA", "XYZ", "Y", "Z", "YA".
/// The first layer sets both windows to (0, 0, width-1, height-1). Values are stored as they are, in whatever space the
/// image is; straight alpha is premultiplied. InvalidArgument: sizes differ from the data window, letters do not match
/// the channels, or the name is taken.
Status addExrLayer(ExrImage& exr, std::string_view layer, const Image& image, std::string_view letters,
                   ExrPixelType type = ExrPixelType::Half);

} // namespace ars
