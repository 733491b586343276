#include "engine/capture/view_cache.h"

#include <cmath>
#include <cstddef>
#include <cstring>
#include <type_traits>

namespace ars {
namespace {

constexpr std::uint64_t kMagic = 0x3257454956535241ull; // "ARSVIEW2"
constexpr float kLevels16 = 65535.0f;
constexpr float kLevels8 = 255.0f;
constexpr std::uint32_t kRatio = 257; ///< 65535 / 255

/// What stands before the pixels; everything in the machine's own order, as caches stay on one machine.
struct PackedHeader {
    std::uint64_t magic = kMagic;
    std::uint64_t checksum = 0; ///< of all that follows this field
    std::int32_t camera = 0, frame = 0;
    std::int32_t width = 0, height = 0;
    std::uint32_t colorBytes = 1, maskBytes = 1; ///< of one value
    std::uint64_t bitPlanes = 1;                 ///< the band, and what is unknown where anything is
    double intrinsics[4] = {};
    double rotation[9] = {}; ///< columns first
    double translation[3] = {};
};
static_assert(std::is_trivially_copyable_v<PackedHeader>);
constexpr std::size_t kChecked = offsetof(PackedHeader, checksum) + sizeof(std::uint64_t);

std::uint64_t mixed(std::uint64_t h, std::uint64_t word) {
    h = (h ^ word) * 0x9E3779B97F4A7C15ull;
    return h ^ (h >> 29);
}

std::uint64_t checksumOf(std::span<const std::byte> bytes) {
    std::uint64_t h = bytes.size();
    std::size_t i = 0;
    for (; i + sizeof(std::uint64_t) <= bytes.size(); i += sizeof(std::uint64_t)) {
        std::uint64_t word;
        std::memcpy(&word, bytes.data() + i, sizeof word);
        h = mixed(h, word);
    }
    std::uint64_t rest = 0;
    if (i < bytes.size()) std::memcpy(&rest, bytes.data() + i, bytes.size() - i);
    return mixed(h, rest);
}

std::uint32_t level16(float value) { return static_cast<std::uint32_t>(std::lround(value * kLevels16)); }

bool fitsEightBits(const std::vector<float>& values) {
    for (const float value : values) {
        if (level16(value) % kRatio != 0) return false;
    }
    return true;
}

void appendValues(std::vector<std::byte>& bytes, const std::vector<float>& values, std::uint32_t width) {
    std::size_t at = bytes.size();
    bytes.resize(at + values.size() * width);
    for (const float value : values) {
        const std::uint32_t level = level16(value);
        if (width == 1) {
            bytes[at++] = static_cast<std::byte>(level / kRatio);
        } else {
            const auto narrow = static_cast<std::uint16_t>(level);
            std::memcpy(&bytes[at], &narrow, sizeof narrow);
            at += sizeof narrow;
        }
    }
}

Image valuesOf(const std::byte*& bytes, int width, int height, int channels, std::uint32_t bytesEach) {
    Image image;
    image.width = width;
    image.height = height;
    image.channels = channels;
    image.sourceBits = 16;
    image.pixels.resize(static_cast<std::size_t>(width) * static_cast<std::size_t>(height) *
                        static_cast<std::size_t>(channels));
    for (float& value : image.pixels) {
        if (bytesEach == 1) {
            value = static_cast<float>(static_cast<unsigned char>(*bytes)) / kLevels8;
        } else {
            std::uint16_t level;
            std::memcpy(&level, bytes, sizeof level);
            value = static_cast<float>(level) / kLevels16;
        }
        bytes += bytesEach;
    }
    return image;
}

void setCamera(const Camera& camera, PackedHeader& header) {
    const double intrinsics[4] = {camera.fx, camera.fy, camera.cx, camera.cy};
    std::memcpy(header.intrinsics, intrinsics, sizeof intrinsics);
    for (int c = 0; c < 3; ++c) {
        for (int r = 0; r < 3; ++r) header.rotation[3 * c + r] = camera.rotation[c][r];
        header.translation[c] = camera.translation[c];
    }
}

Camera cameraOf(const PackedHeader& header) {
    Camera camera;
    camera.width = header.width;
    camera.height = header.height;
    camera.fx = header.intrinsics[0];
    camera.fy = header.intrinsics[1];
    camera.cx = header.intrinsics[2];
    camera.cy = header.intrinsics[3];
    for (int c = 0; c < 3; ++c) {
        for (int r = 0; r < 3; ++r) camera.rotation[c][r] = header.rotation[3 * c + r];
        camera.translation[c] = header.translation[c];
    }
    return camera;
}

/// One bit a pixel.
std::size_t planeBytes(std::size_t pixels) { return (pixels + 7) / 8; }

std::size_t packedBytes(const PackedHeader& header, std::size_t pixels) {
    return sizeof header + pixels * (3 * header.colorBytes + header.maskBytes) +
           static_cast<std::size_t>(header.bitPlanes) * planeBytes(pixels);
}

void appendBits(std::vector<std::byte>& bytes, const std::vector<float>& values) {
    const std::size_t begin = bytes.size();
    bytes.resize(begin + planeBytes(values.size()), std::byte{0});
    for (std::size_t i = 0; i < values.size(); ++i) {
        if (values[i] > 0.0f) bytes[begin + i / 8] |= std::byte{1} << (i % 8);
    }
}

/// A picture of zeros and ones, of the size of `like`.
Image bitsOf(const std::byte*& bytes, const Image& like) {
    Image image = like;
    image.sourceBits = 8;
    for (std::size_t i = 0; i < image.pixels.size(); ++i) {
        image.pixels[i] = (bytes[i / 8] & std::byte{1} << (i % 8)) != std::byte{0} ? 1.0f : 0.0f;
    }
    bytes += planeBytes(image.pixels.size());
    return image;
}

Error badPacking(const char* what) { return makeError(ErrorCode::BadFile, "", what); }

} // namespace

std::vector<std::byte> packView(const CapturedView& view) {
    PackedHeader header;
    header.camera = view.id.camera;
    header.frame = view.id.frame;
    header.width = view.color.width;
    header.height = view.color.height;
    header.colorBytes = fitsEightBits(view.color.pixels) ? 1 : 2;
    header.maskBytes = fitsEightBits(view.mask.pixels) ? 1 : 2;
    header.bitPlanes = view.unknown.pixels.empty() ? 1 : 2;
    setCamera(view.camera, header);
    std::vector<std::byte> bytes(sizeof header);
    bytes.reserve(packedBytes(header, view.mask.pixels.size()));
    appendValues(bytes, view.color.pixels, header.colorBytes);
    appendValues(bytes, view.mask.pixels, header.maskBytes);
    appendBits(bytes, view.band.pixels);
    appendBits(bytes, view.unknown.pixels);
    std::memcpy(bytes.data(), &header, sizeof header);
    header.checksum = checksumOf(std::span<const std::byte>(bytes).subspan(kChecked));
    std::memcpy(bytes.data(), &header, sizeof header);
    return bytes;
}

Result<CapturedView> unpackView(std::span<const std::byte> bytes) {
    PackedHeader header;
    if (bytes.size() < sizeof header) return badPacking("is too short for a packed view");
    std::memcpy(&header, bytes.data(), sizeof header);
    if (header.magic != kMagic) return badPacking("is no packed view");
    constexpr std::int32_t kMostSide = 32768;
    const bool sound = header.width > 0 && header.width <= kMostSide && header.height > 0 &&
                       header.height <= kMostSide && (header.colorBytes == 1 || header.colorBytes == 2) &&
                       (header.maskBytes == 1 || header.maskBytes == 2) &&
                       (header.bitPlanes == 1 || header.bitPlanes == 2);
    if (!sound) return badPacking("is a packed view of an impossible size");
    const std::size_t count = static_cast<std::size_t>(header.width) * static_cast<std::size_t>(header.height);
    if (bytes.size() != packedBytes(header, count)) return badPacking("is a packed view of another length");
    if (checksumOf(bytes.subspan(kChecked)) != header.checksum) return badPacking("is a damaged packed view");
    CapturedView view;
    view.id = {header.camera, header.frame};
    view.camera = cameraOf(header);
    const std::byte* at = bytes.data() + sizeof header;
    view.color = valuesOf(at, header.width, header.height, 3, header.colorBytes);
    view.color.space = ColorSpace::Srgb;
    view.mask = valuesOf(at, header.width, header.height, 1, header.maskBytes);
    view.mask.space = ColorSpace::Data;
    view.band = bitsOf(at, view.mask);
    if (header.bitPlanes == 2) view.unknown = bitsOf(at, view.mask);
    return view;
}

} // namespace ars
