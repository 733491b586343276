#include "engine/io/hdr.h"

#include "engine/core/file.h"
#include "engine/io/byte_reader.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>

namespace ars {

namespace {

using Rgbe = std::array<std::uint8_t, 4>;

constexpr float kLargest = 0x1.fep126f; // mantissa 255, exponent 255

/// The resolution line: the first axis is that of the scanlines.
struct Layout {
    std::int64_t scanlines = 0;
    std::int64_t length = 0;    ///< pixels of a scanline
    bool transposed = false;    ///< a scanline is a column
    bool scanlinesFlip = false; ///< the first scanline is the bottom row or the right column
    bool pixelsFlip = false;    ///< the first pixel of a scanline is at the right or the bottom
};

struct Header {
    Layout layout;
    std::array<double, 3> multiplier = {1.0, 1.0, 1.0}; ///< product of EXPOSURE and COLORCORR
};

Error badHdr(std::string place, std::string message) {
    return makeError(ErrorCode::BadFile, std::move(place), std::move(message));
}

std::string_view nextWord(std::string_view& text) {
    text.remove_prefix(std::min(text.find_first_not_of(" \t"), text.size()));
    const std::string_view word = text.substr(0, text.find_first_of(" \t"));
    text.remove_prefix(word.size());
    return word;
}

Result<double> positiveNumber(std::string_view name, std::string_view& text) {
    std::string_view word = nextWord(text);
    if (!word.empty() && word.front() == '+') word.remove_prefix(1);
    double value = 0.0;
    const auto [end, code] = std::from_chars(word.data(), word.data() + word.size(), value);
    if (code != std::errc() || end != word.data() + word.size() || !std::isfinite(value) || value <= 0.0) {
        return badHdr("header",
                      fmt::format("{} must be a positive finite number, found \"{}\"", name, word.substr(0, 40)));
    }
    return value;
}

Status readVariable(std::string_view line, Header& header) {
    const std::size_t equals = line.find('=');
    if (equals == std::string_view::npos) return {};
    const std::string_view name = line.substr(0, equals);
    std::string_view value = line.substr(equals + 1);
    if (name == "EXPOSURE") {
        ARS_TRY(const double exposure, positiveNumber("EXPOSURE", value));
        for (double& m : header.multiplier) m *= exposure;
    } else if (name == "COLORCORR") {
        for (double& m : header.multiplier) {
            ARS_TRY(const double correction, positiveNumber("COLORCORR", value));
            m *= correction;
        }
    } else if (name == "FORMAT") {
        const std::string_view format = nextWord(value);
        if (format == "32-bit_rle_xyze") {
            return makeError(ErrorCode::Unsupported, "header",
                             "the pixels are XYZE; convert the picture to RGB with `ra_xyze -r`");
        }
        if (format != "32-bit_rle_rgbe") {
            return badHdr("header", fmt::format("expected FORMAT=32-bit_rle_rgbe, found \"{}\"", format.substr(0, 40)));
        }
    }
    return {};
}

Result<Layout> readLayout(std::string_view line) {
    Layout layout;
    std::string_view rest = line;
    std::array<char, 2> axes{};
    for (int i = 0; i < 2; ++i) {
        const std::string_view axis = nextWord(rest);
        const std::string_view number = nextWord(rest);
        std::int64_t count = 0;
        const auto [end, code] = std::from_chars(number.data(), number.data() + number.size(), count);
        const bool sound = axis.size() == 2 && (axis[0] == '+' || axis[0] == '-') && (axis[1] == 'X' || axis[1] == 'Y');
        if (!sound || code != std::errc() || end != number.data() + number.size()) {
            return badHdr("resolution",
                          fmt::format("expected a line like \"-Y 512 +X 1024\", found \"{}\"", line.substr(0, 60)));
        }
        axes[i] = axis[1];
        // Rows count downwards and columns to the right: -Y and +X are the order of an upright picture.
        const bool flip = axis[1] == 'Y' ? axis[0] == '+' : axis[0] == '-';
        (i == 0 ? layout.scanlinesFlip : layout.pixelsFlip) = flip;
        (i == 0 ? layout.scanlines : layout.length) = count;
    }
    if (axes[0] == axes[1] || !nextWord(rest).empty()) {
        return badHdr("resolution", fmt::format("expected one X and one Y, found \"{}\"", line.substr(0, 60)));
    }
    layout.transposed = axes[0] == 'X';
    return layout;
}

Result<Header> readHeader(ByteReader& reader) {
    ARS_TRY(const std::string_view magic, reader.readLine("a Radiance header"));
    if (!magic.starts_with("#?")) {
        return badHdr("header", "expected a Radiance picture, which begins with \"#?RADIANCE\"");
    }
    Header header;
    while (true) {
        ARS_TRY(const std::string_view line, reader.readLine("a Radiance header"));
        if (line.empty()) break;
        ARS_TRY_STATUS(readVariable(line, header));
    }
    for (const double m : header.multiplier) {
        if (!std::isfinite(m) || m < 1e-30 || m > 1e30) {
            return badHdr("header", fmt::format("the EXPOSURE lines multiply to {}, expected 1e-30 to 1e30", m));
        }
    }
    ARS_TRY(const std::string_view line, reader.readLine("the resolution line"));
    ARS_TRY(header.layout, readLayout(line));
    return header;
}

/// New run-length encoding: the four components one after the other, runs above 128.
Status readNewScanline(ByteReader& reader, std::span<Rgbe> scanline) {
    for (int component = 0; component < 4; ++component) {
        for (std::size_t i = 0; i < scanline.size();) {
            ARS_TRY(const auto code, reader.read<std::uint8_t>("pixels"));
            const bool run = code > 128;
            const std::size_t count = run ? code - 128u : code;
            if (count == 0 || count > scanline.size() - i) {
                return badHdr(
                    fmt::format("byte {}", reader.position() - 1),
                    fmt::format("a run of {} pixels where the scanline has {} left", count, scanline.size() - i));
            }
            ARS_TRY(const auto values, reader.readBytes(run ? 1 : count, "pixels"));
            for (std::size_t k = 0; k < count; ++k) {
                scanline[i + k][component] = std::to_integer<std::uint8_t>(values[run ? 0 : k]);
            }
            i += count;
        }
    }
    return {};
}

/// Flat pixels and old run-length encoding: (1,1,1,n) repeats the pixel before, further such codes shift n by 8 bits.
Status readOldScanline(ByteReader& reader, std::span<Rgbe> scanline) {
    unsigned shift = 0;
    for (std::size_t i = 0; i < scanline.size();) {
        ARS_TRY(const Rgbe pixel, reader.read<Rgbe>("pixels"));
        if (pixel[0] != 1 || pixel[1] != 1 || pixel[2] != 1) {
            scanline[i++] = pixel;
            shift = 0;
            continue;
        }
        const std::uint64_t count = shift < 32 ? std::uint64_t(pixel[3]) << shift : ~0ull;
        if (i == 0 || count > scanline.size() - i) {
            return badHdr(fmt::format("byte {}", reader.position() - 4),
                          fmt::format("a run of {} pixels where the scanline has {} left and {} before", count,
                                      scanline.size() - i, i));
        }
        std::fill_n(scanline.begin() + std::ptrdiff_t(i), count, scanline[i - 1]);
        i += static_cast<std::size_t>(count);
        shift += 8;
    }
    return {};
}

Status readScanline(ByteReader& reader, std::span<Rgbe> scanline) {
    if (scanline.size() >= 8 && scanline.size() < 32768) {
        ByteReader ahead = reader;
        ARS_TRY(const Rgbe mark, ahead.read<Rgbe>("pixels"));
        if (mark[0] == 2 && mark[1] == 2 && mark[2] < 128) {
            const std::size_t length = std::size_t(mark[2]) << 8 | mark[3];
            if (length != scanline.size()) {
                return badHdr(fmt::format("byte {}", reader.position()),
                              fmt::format("a scanline of {} pixels, expected {}", length, scanline.size()));
            }
            reader = ahead;
            return readNewScanline(reader, scanline);
        }
    }
    return readOldScanline(reader, scanline);
}

/// The fewest bytes that could hold the picture, so that a tiny file cannot ask for a large one.
std::uint64_t fewestBytes(const Layout& layout) {
    const auto lines = static_cast<std::uint64_t>(layout.scanlines);
    const auto length = static_cast<std::uint64_t>(layout.length);
    const std::uint64_t newRuns = 4 + 8 * ((length + 126) / 127);
    // Old encoding: one pixel, then runs of at most 255, 65280, 16711680... pixels: a handful of codes a line.
    const std::uint64_t oldRuns = length == 1 ? 4 : 8;
    return lines * std::min(newRuns, oldRuns);
}

void decodePixel(const Rgbe& rgbe, const std::array<double, 3>& scale, float* out) {
    // Exponent 0 is black by definition. No half is added to the mantissa: 0 stays 0 and 128 * 2^-7 stays 1.
    const double unit = rgbe[3] == 0 ? 0.0 : std::ldexp(1.0, rgbe[3] - 136);
    for (int c = 0; c < 3; ++c) out[c] = static_cast<float>(rgbe[c] * unit * scale[c]);
}

void storeScanline(const Header& header, std::int64_t line, std::span<const Rgbe> scanline, Image& image) {
    const Layout& layout = header.layout;
    const std::array<double, 3> scale = {1.0 / header.multiplier[0], 1.0 / header.multiplier[1],
                                         1.0 / header.multiplier[2]};
    const std::int64_t major = layout.scanlinesFlip ? layout.scanlines - 1 - line : line;
    for (std::int64_t i = 0; i < layout.length; ++i) {
        const std::int64_t minor = layout.pixelsFlip ? layout.length - 1 - i : i;
        const std::int64_t row = layout.transposed ? minor : major;
        const std::int64_t column = layout.transposed ? major : minor;
        decodePixel(scanline[static_cast<std::size_t>(i)], scale,
                    &image.pixels[static_cast<std::size_t>((row * image.width + column) * 3)]);
    }
}

Result<Rgbe> encodePixel(const float* rgb, int step, std::size_t index, int width) {
    std::array<float, 3> value{};
    float largest = 0.0f;
    for (int c = 0; c < 3; ++c) {
        const float v = rgb[c * step];
        if (!std::isfinite(v) || v > kLargest) {
            return makeError(ErrorCode::InvalidArgument, fmt::format("row {}, column {}", index / width, index % width),
                             fmt::format("a Radiance picture cannot hold {}", v));
        }
        value[c] = std::max(v, 0.0f);
        largest = std::max(largest, value[c]);
    }
    if (largest < 1e-38f) return Rgbe{};
    int exponent = 0;
    std::frexp(largest, &exponent); // largest = f * 2^exponent, f in [0.5, 1)
    if (std::round(std::ldexp(largest, 8 - exponent)) > 255.0f) ++exponent;
    Rgbe out{};
    for (int c = 0; c < 3; ++c) {
        out[c] = static_cast<std::uint8_t>(std::round(std::ldexp(value[c], 8 - exponent)));
    }
    out[3] = static_cast<std::uint8_t>(exponent + 128);
    return out;
}

void appendByte(std::vector<std::byte>& out, std::size_t value) { out.push_back(static_cast<std::byte>(value)); }

void appendComponent(std::span<const Rgbe> scanline, int component, std::vector<std::byte>& out) {
    const auto at = [&](std::size_t i) { return scanline[i][component]; };
    const auto runAt = [&](std::size_t i) {
        std::size_t count = 1;
        while (count < 127 && i + count < scanline.size() && at(i + count) == at(i)) ++count;
        return count;
    };
    for (std::size_t i = 0; i < scanline.size();) {
        std::size_t run = runAt(i);
        if (run >= 4) {
            appendByte(out, 128 + run);
            appendByte(out, at(i));
            i += run;
            continue;
        }
        const std::size_t begin = i;
        do {
            i += run;
            run = i < scanline.size() ? runAt(i) : 0;
        } while (run > 0 && run < 4 && i + run - begin <= 128);
        appendByte(out, i - begin);
        for (std::size_t k = begin; k < i; ++k) appendByte(out, at(k));
    }
}

void appendScanline(std::span<const Rgbe> scanline, std::vector<std::byte>& out) {
    // The format has no run-length encoding for these widths.
    if (scanline.size() < 8 || scanline.size() >= 32768) {
        for (const Rgbe& pixel : scanline) {
            for (const std::uint8_t component : pixel) appendByte(out, component);
        }
        return;
    }
    appendByte(out, 2);
    appendByte(out, 2);
    appendByte(out, scanline.size() >> 8);
    appendByte(out, scanline.size() & 255);
    for (int component = 0; component < 4; ++component) appendComponent(scanline, component, out);
}

} // namespace

Result<Image> parseHdr(std::span<const std::byte> bytes, const ReadLimits& limits) {
    ByteReader reader(bytes);
    ARS_TRY(const Header header, readHeader(reader));
    const Layout& layout = header.layout;
    Image image;
    const std::int64_t width = layout.transposed ? layout.scanlines : layout.length;
    const std::int64_t height = layout.transposed ? layout.length : layout.scanlines;
    ARS_TRY(const std::size_t values, imageValueCount(width, height, 3, limits));
    if (fewestBytes(layout) > reader.remaining()) {
        return badHdr("pixels", fmt::format("{}x{} pixels need at least {} bytes, the file has {} after its header",
                                            width, height, fewestBytes(layout), reader.remaining()));
    }
    image.width = static_cast<int>(width);
    image.height = static_cast<int>(height);
    image.channels = 3;
    image.space = ColorSpace::Linear;
    image.sourceBits = 32;
    image.pixels.resize(values);
    std::vector<Rgbe> scanline(static_cast<std::size_t>(layout.length));
    for (std::int64_t line = 0; line < layout.scanlines; ++line) {
        if (auto status = readScanline(reader, scanline); !status) {
            return atPlace(std::move(status).error(), fmt::format("scanline {}", line));
        }
        storeScanline(header, line, scanline, image);
    }
    const auto bad = std::find_if(image.pixels.begin(), image.pixels.end(), [](float v) { return !std::isfinite(v); });
    if (bad != image.pixels.end()) {
        return badHdr("pixels", "a value divided by the header's EXPOSURE is beyond the range of a float");
    }
    return image;
}

Result<Image> readHdr(const std::filesystem::path& path, const ReadLimits& limits) {
    ARS_TRY(const auto bytes, readFile(path, limits));
    auto image = parseHdr(bytes, limits);
    if (!image) return atPlace(std::move(image).error(), path.string());
    return image;
}

Result<std::vector<std::byte>> encodeHdr(const Image& image) {
    ARS_TRY_STATUS(checkImage(image));
    if (image.space == ColorSpace::Srgb) {
        ARS_TRY(const Image linear, convertColorSpace(image, ColorSpace::Linear));
        return encodeHdr(linear);
    }
    const std::string header =
        fmt::format("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {} +X {}\n", image.height, image.width);
    std::vector<std::byte> out(header.size());
    std::memcpy(out.data(), header.data(), header.size());
    // A gray pixel is read three times.
    const int step = image.channels >= 3 ? 1 : 0;
    std::vector<Rgbe> scanline(static_cast<std::size_t>(image.width));
    for (int row = 0; row < image.height; ++row) {
        for (int column = 0; column < image.width; ++column) {
            const std::size_t index = std::size_t(row) * image.width + column;
            ARS_TRY(scanline[column], encodePixel(&image.pixels[index * image.channels], step, index, image.width));
        }
        appendScanline(scanline, out);
    }
    return out;
}

Status writeHdr(const std::filesystem::path& path, const Image& image) {
    auto bytes = encodeHdr(image);
    if (!bytes) return atPlace(std::move(bytes).error(), path.string());
    return writeFileAtomic(path, *bytes);
}

} // namespace ars
