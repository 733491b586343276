#include "engine/io/png.h"

#include "engine/core/file.h"
#include "engine/io/byte_reader.h"
#include "engine/io/utf8.h"

#include <png.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <csetjmp>
#include <cstdio>

namespace ars {

namespace {

constexpr std::size_t kMaxWarnings = 16;
constexpr std::uint64_t kMaxTextChunks = 64;
constexpr std::uint64_t kMaxTextBytes = 64ull << 20;
constexpr std::size_t kCompressTextAbove = 1024; // bytes
/// deflate cannot shrink more than this (RFC 1951: 258 bytes in 2 bits), so a tiny file cannot hold a large picture.
constexpr std::uint64_t kMaxDeflateRatio = 1032;

/// What libpng's callbacks see. libpng leaves a failed call by longjmp, which runs no destructors: everything that owns
/// memory lives here or in the callers of guarded(), never in a frame that is jumped over.
struct Session {
    std::jmp_buf jump;
    std::array<char, 256> message{};
    std::vector<std::string> warnings;
    std::span<const std::byte> input;
    std::size_t position = 0;
    std::vector<std::byte> output;
};

Session& sessionOf(png_structp png) { return *static_cast<Session*>(png_get_error_ptr(png)); }

[[noreturn]] void onError(png_structp png, png_const_charp message) {
    Session& session = sessionOf(png);
    std::snprintf(session.message.data(), session.message.size(), "%s", message);
    std::longjmp(session.jump, 1);
}

void onWarning(png_structp png, png_const_charp message) {
    Session& session = sessionOf(png);
    if (session.warnings.size() >= kMaxWarnings) return;
    try {
        session.warnings.emplace_back(message);
    } catch (const std::bad_alloc&) {
        // A warning that cannot be kept is not worth more than the picture.
    }
}

void onRead(png_structp png, png_bytep out, png_size_t count) {
    auto& session = *static_cast<Session*>(png_get_io_ptr(png));
    if (count > session.input.size() - session.position) png_error(png, "the file ends too early");
    std::memcpy(out, session.input.data() + session.position, count);
    session.position += count;
}

void onWrite(png_structp png, png_bytep bytes, png_size_t count) {
    auto& session = *static_cast<Session*>(png_get_io_ptr(png));
    bool stored = true;
    try {
        const auto* begin = reinterpret_cast<const std::byte*>(bytes);
        session.output.insert(session.output.end(), begin, begin + count);
    } catch (const std::bad_alloc&) {
        stored = false;
    }
    if (!stored) png_error(png, "out of memory");
}

void onFlush(png_structp) {}

/// Runs calls into libpng; false when one of them failed (Session::message says why). `body` and what it calls must
/// hold no object with a destructor.
template <typename Body>
bool guarded(Session& session, const Body& body) {
    if (setjmp(session.jump) != 0) return false;
    body();
    return true;
}

struct Reader {
    Session session;
    png_structp png = nullptr;
    png_infop info = nullptr;

    Reader() = default;
    Reader(const Reader&) = delete;
    Reader& operator=(const Reader&) = delete;
    ~Reader() { png_destroy_read_struct(&png, &info, nullptr); }
};

struct Writer {
    Session session;
    png_structp png = nullptr;
    png_infop info = nullptr;

    Writer() = default;
    Writer(const Writer&) = delete;
    Writer& operator=(const Writer&) = delete;
    ~Writer() { png_destroy_write_struct(&png, &info); }
};

Error badPng(const Session& session) {
    return makeError(ErrorCode::BadFile, fmt::format("byte {}", session.position),
                     fmt::format("broken PNG: {}", session.message.data()));
}

std::uint32_t bigEndian32(std::span<const std::byte> bytes, std::size_t at) {
    std::uint32_t value = 0;
    for (std::size_t i = 0; i < 4; ++i) value = value << 8 | std::to_integer<std::uint32_t>(bytes[at + i]);
    return value;
}

struct Declared {
    std::uint32_t width = 0;
    std::uint32_t height = 0;
    int bitDepth = 0;
    int samples = 0; ///< per stored pixel
};

/// The first chunk, so that sizes are judged before the library sees the file.
Result<Declared> readDeclared(std::span<const std::byte> bytes) {
    ByteReader reader(bytes);
    ARS_TRY(const auto signature, reader.readBytes(8, "the PNG signature"));
    if (png_sig_cmp(reinterpret_cast<png_const_bytep>(signature.data()), 0, 8) != 0) {
        return makeError(ErrorCode::BadFile, "byte 0", "expected the PNG signature");
    }
    ARS_TRY(const auto header, reader.readBytes(25, "the IHDR chunk"));
    Declared declared;
    declared.width = bigEndian32(header, 8);
    declared.height = bigEndian32(header, 12);
    declared.bitDepth = std::to_integer<int>(header[16]);
    constexpr std::array<int, 7> kSamples = {1, 0, 3, 1, 2, 0, 4};
    const auto colorType = std::to_integer<std::size_t>(header[17]);
    declared.samples = colorType < kSamples.size() ? kSamples[colorType] : 0;
    const bool sound = bigEndian32(header, 0) == 13 && std::memcmp(header.data() + 4, "IHDR", 4) == 0 &&
                       declared.samples > 0 && declared.bitDepth > 0 && declared.bitDepth <= 16;
    if (!sound) return makeError(ErrorCode::BadFile, "byte 8", "expected a sound IHDR chunk");
    return declared;
}

Status checkDeclared(const Declared& declared, std::size_t fileBytes, const ReadLimits& limits) {
    ARS_TRY_STATUS([&]() -> Status {
        // Palettes and transparent colours may expand to four channels.
        auto count = imageValueCount(declared.width, declared.height, 4, limits);
        return count ? Status() : Status(std::move(count).error());
    }());
    const std::uint64_t bits = std::uint64_t(declared.width) * declared.samples * declared.bitDepth;
    const std::uint64_t raw = ((bits + 7) / 8 + 1) * declared.height;
    if (raw / kMaxDeflateRatio > fileBytes) {
        return makeError(ErrorCode::BadFile, "",
                         fmt::format("{}x{} pixels need at least {} bytes however well they compress, the file has {}",
                                     declared.width, declared.height, raw / kMaxDeflateRatio, fileBytes));
    }
    return {};
}

/// Every chunk up to the end chunk lies within the file. libpng takes memory for a chunk's length before it reads it.
Status checkChunks(std::span<const std::byte> bytes) {
    ByteReader reader(bytes);
    ARS_TRY_STATUS(reader.skip(8, "the PNG signature"));
    while (true) {
        ARS_TRY(const auto head, reader.readBytes(8, "a chunk"));
        const std::string_view type(reinterpret_cast<const char*>(head.data()) + 4, 4);
        ARS_TRY_STATUS(reader.skip(std::uint64_t(bigEndian32(head, 0)) + 4, fmt::format("chunk {}", type)));
        if (type == "IEND") return {};
    }
}

bool openReader(Reader& reader, std::span<const std::byte> bytes, const ReadLimits& limits) {
    Session& session = reader.session;
    session.input = bytes;
    // Creation reports by its return value, but may call onError on the way.
    return guarded(session, [&] {
        reader.png = png_create_read_struct(PNG_LIBPNG_VER_STRING, &session, onError, onWarning);
        if (!reader.png) return;
        reader.info = png_create_info_struct(reader.png);
        if (!reader.info) return;
        png_set_user_limits(reader.png, limits.maxImageSide, limits.maxImageSide);
        png_set_chunk_cache_max(reader.png, kMaxTextChunks);
        png_set_chunk_malloc_max(reader.png, std::min(kMaxTextBytes, limits.maxBytes / kMaxTextChunks));
        png_set_read_fn(reader.png, &session, onRead);
        png_read_info(reader.png, reader.info);
        png_set_expand(reader.png);
        png_set_swap(reader.png);
        png_set_interlace_handling(reader.png);
        png_read_update_info(reader.png, reader.info);
    });
}

void rowToFloats(const std::byte* row, std::size_t values, bool wide, float* out) {
    for (std::size_t i = 0; i < values; ++i) {
        if (wide) {
            std::uint16_t value = 0;
            std::memcpy(&value, row + 2 * i, 2);
            out[i] = float(value) / 65535.0f;
        } else {
            out[i] = float(std::to_integer<std::uint8_t>(row[i])) / 255.0f;
        }
    }
}

Status readPixels(Reader& reader, const ReadLimits& limits, PngFile& file) {
    Image& image = file.image;
    image.width = static_cast<int>(png_get_image_width(reader.png, reader.info));
    image.height = static_cast<int>(png_get_image_height(reader.png, reader.info));
    image.channels = png_get_channels(reader.png, reader.info);
    const bool wide = png_get_bit_depth(reader.png, reader.info) == 16;
    image.sourceBits = wide ? 16 : 8;
    ARS_TRY(const std::size_t count, imageValueCount(image.width, image.height, image.channels, limits));
    const std::size_t rowValues = std::size_t(image.width) * image.channels;
    const std::size_t rowBytes = rowValues * (wide ? 2 : 1);
    if (png_get_rowbytes(reader.png, reader.info) != rowBytes) {
        return makeError(ErrorCode::Internal, "", "the PNG decoder expands rows to an unexpected size");
    }
    image.pixels.resize(count);
    // Interlaced rows are completed over seven passes and must stay in between.
    std::vector<std::byte> raw(rowBytes * (file.interlaced ? image.height : 1));
    const int passes = file.interlaced ? PNG_INTERLACE_ADAM7_PASSES : 1;
    const bool done = guarded(reader.session, [&] {
        for (int pass = 0; pass < passes; ++pass) {
            for (int r = 0; r < image.height; ++r) {
                std::byte* row = raw.data() + (file.interlaced ? r * rowBytes : 0);
                png_read_row(reader.png, reinterpret_cast<png_bytep>(row), nullptr);
                if (pass + 1 == passes) rowToFloats(row, rowValues, wide, image.pixels.data() + r * rowValues);
            }
        }
        png_read_end(reader.png, reader.info);
    });
    return done ? Status() : Status(badPng(reader.session));
}

std::string latin1ToUtf8(std::string_view text) {
    std::string out;
    out.reserve(text.size());
    for (const char c : text) appendUtf8(out, static_cast<unsigned char>(c));
    return out;
}

std::map<std::string, std::string> readText(const Reader& reader) {
    std::map<std::string, std::string> text;
    png_textp entries = nullptr;
    int count = 0;
    png_get_text(reader.png, reader.info, &entries, &count);
    for (int i = 0; i < count; ++i) {
        const png_text& entry = entries[i];
        const bool international = entry.compression >= PNG_ITXT_COMPRESSION_NONE;
        const std::size_t length = international ? entry.itxt_length : entry.text_length;
        const std::string_view value(entry.text ? entry.text : "", entry.text ? length : 0);
        // Some writers put Latin-1 into iTXt; what is no UTF-8 cannot be anything else.
        text.try_emplace(latin1ToUtf8(entry.key), international ? utf8OrLatin1(value) : latin1ToUtf8(value));
    }
    return text;
}

void readColorInfo(const Reader& reader, PngFile& file) {
    int intent = 0;
    file.declaresSrgb = png_get_sRGB(reader.png, reader.info, &intent) != 0;
    double gamma = 0.0;
    if (png_get_gAMA(reader.png, reader.info, &gamma) != 0) file.gamma = gamma;
    png_charp name = nullptr;
    png_bytep profile = nullptr;
    png_uint_32 length = 0;
    int compression = 0;
    if (png_get_iCCP(reader.png, reader.info, &name, &compression, &profile, &length) != 0) {
        file.profileName = latin1ToUtf8(name);
    }
    const bool linear = file.gamma && std::abs(*file.gamma - 1.0) < 0.005;
    const bool otherwiseDefined = file.declaresSrgb || !file.profileName.empty();
    file.image.space = linear && !otherwiseDefined ? ColorSpace::Linear : ColorSpace::Srgb;
}

Status checkOptions(const Image& image, const PngWriteOptions& options) {
    ARS_TRY_STATUS(checkImage(image));
    if (options.bits != 8 && options.bits != 16) {
        return makeError(ErrorCode::InvalidArgument, "",
                         fmt::format("a PNG is written with 8 or 16 bits, not {}", options.bits));
    }
    if (options.compressionLevel < 0 || options.compressionLevel > 9) {
        return makeError(ErrorCode::InvalidArgument, "",
                         fmt::format("PNG compression levels are 0 to 9, not {}", options.compressionLevel));
    }
    if (image.width > 1000000 || image.height > 1000000) {
        return makeError(
            ErrorCode::InvalidArgument, "",
            fmt::format("{}x{} pixels, a PNG is written with at most 1000000 a side", image.width, image.height));
    }
    for (const auto& [keyword, value] : options.text) {
        const bool printable = std::all_of(keyword.begin(), keyword.end(), [](char c) { return c >= 32 && c < 127; });
        const bool spaces = keyword.starts_with(' ') || keyword.ends_with(' ') || keyword.find("  ") != keyword.npos;
        if (keyword.empty() || keyword.size() > 79 || !printable || spaces) {
            return makeError(ErrorCode::InvalidArgument, fmt::format("text \"{}\"", keyword.substr(0, 90)),
                             "a PNG keyword has 1 to 79 printable ASCII characters and single spaces inside only");
        }
        if (value.find('\0') != value.npos || !isUtf8(value) || value.size() > kMaxTextBytes) {
            return makeError(ErrorCode::InvalidArgument, fmt::format("text \"{}\"", keyword),
                             "a PNG text is UTF-8 without zero bytes, at most 64 MB");
        }
    }
    return {};
}

Status quantise(const Image& image, int bits, std::vector<std::byte>& raw) {
    raw.resize(image.pixels.size() * (bits / 8));
    const float scale = bits == 16 ? 65535.0f : 255.0f;
    for (std::size_t i = 0; i < image.pixels.size(); ++i) {
        const float value = image.pixels[i];
        if (std::isnan(value)) {
            const std::size_t pixel = i / image.channels;
            return makeError(ErrorCode::InvalidArgument,
                             fmt::format("row {}, column {}", pixel / image.width, pixel % image.width),
                             "a PNG cannot hold NaN");
        }
        const auto level = static_cast<std::uint16_t>(std::clamp(value, 0.0f, 1.0f) * scale + 0.5f);
        if (bits == 16) {
            std::memcpy(raw.data() + 2 * i, &level, 2);
        } else {
            raw[i] = static_cast<std::byte>(level);
        }
    }
    return {};
}

std::vector<png_text> textEntries(const std::map<std::string, std::string>& text) {
    std::vector<png_text> entries;
    static char empty[] = "";
    for (const auto& [keyword, value] : text) {
        png_text entry{};
        const bool compress = value.size() > kCompressTextAbove;
        entry.compression = compress ? PNG_ITXT_COMPRESSION_zTXt : PNG_ITXT_COMPRESSION_NONE;
        // libpng's structure serves reading too and so is not const; it copies what it is given.
        entry.key = const_cast<char*>(keyword.c_str());
        entry.text = const_cast<char*>(value.c_str());
        entry.itxt_length = value.size();
        entry.lang = empty;
        entry.lang_key = empty;
        entries.push_back(entry);
    }
    return entries;
}

bool writeAll(Writer& writer, const Image& image, const PngWriteOptions& options, const std::vector<std::byte>& raw,
              const std::vector<png_text>& entries) {
    Session& session = writer.session;
    const std::size_t rowBytes = raw.size() / image.height;
    return guarded(session, [&] {
        writer.png = png_create_write_struct(PNG_LIBPNG_VER_STRING, &session, onError, onWarning);
        if (!writer.png) return;
        writer.info = png_create_info_struct(writer.png);
        if (!writer.info) return;
        png_set_write_fn(writer.png, &session, onWrite, onFlush);
        png_set_compression_level(writer.png, options.compressionLevel);
        constexpr std::array<int, 4> kColorTypes = {PNG_COLOR_TYPE_GRAY, PNG_COLOR_TYPE_GRAY_ALPHA, PNG_COLOR_TYPE_RGB,
                                                    PNG_COLOR_TYPE_RGB_ALPHA};
        png_set_IHDR(writer.png, writer.info, image.width, image.height, options.bits,
                     kColorTypes[static_cast<std::size_t>(image.channels - 1)], PNG_INTERLACE_NONE,
                     PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
        if (image.space == ColorSpace::Srgb) {
            png_set_sRGB_gAMA_and_cHRM(writer.png, writer.info, PNG_sRGB_INTENT_PERCEPTUAL);
        } else if (image.space == ColorSpace::Linear) {
            png_set_gAMA(writer.png, writer.info, 1.0);
        }
        if (!entries.empty()) png_set_text(writer.png, writer.info, entries.data(), static_cast<int>(entries.size()));
        png_write_info(writer.png, writer.info);
        if (options.bits == 16) png_set_swap(writer.png);
        for (int r = 0; r < image.height; ++r) {
            png_write_row(writer.png, reinterpret_cast<png_const_bytep>(raw.data() + r * rowBytes));
        }
        png_write_end(writer.png, writer.info);
    });
}

} // namespace

Result<PngFile> parsePng(std::span<const std::byte> bytes, const ReadLimits& limits) {
    ARS_TRY(const Declared declared, readDeclared(bytes));
    ARS_TRY_STATUS(checkDeclared(declared, bytes.size(), limits));
    ARS_TRY_STATUS(checkChunks(bytes));
    Reader reader;
    if (!openReader(reader, bytes, limits)) return badPng(reader.session);
    if (!reader.info) return makeError(ErrorCode::OutOfMemory, "", "no memory for the PNG decoder");
    PngFile file;
    file.bitDepth = declared.bitDepth;
    file.palette = bytes[25] == std::byte{PNG_COLOR_TYPE_PALETTE};
    file.interlaced = png_get_interlace_type(reader.png, reader.info) == PNG_INTERLACE_ADAM7;
    ARS_TRY_STATUS(readPixels(reader, limits, file));
    file.text = readText(reader);
    readColorInfo(reader, file);
    file.warnings = std::move(reader.session.warnings);
    return file;
}

Result<PngFile> readPng(const std::filesystem::path& path, const ReadLimits& limits) {
    ARS_TRY(const auto bytes, readFile(path, limits));
    auto file = parsePng(bytes, limits);
    if (!file) return atPlace(std::move(file).error(), path.string());
    return file;
}

Result<std::vector<std::byte>> encodePng(const Image& image, const PngWriteOptions& options) {
    ARS_TRY_STATUS(checkOptions(image, options));
    if (image.premultiplied && image.hasAlpha()) return encodePng(straightAlpha(image), options);
    if (image.space != ColorSpace::Data && image.space != options.space) {
        ARS_TRY(const Image converted, convertColorSpace(image, options.space));
        return encodePng(converted, options);
    }
    std::vector<std::byte> raw;
    ARS_TRY_STATUS(quantise(image, options.bits, raw));
    const std::vector<png_text> entries = textEntries(options.text);
    Writer writer;
    if (!writeAll(writer, image, options, raw, entries)) {
        return makeError(ErrorCode::Internal, "",
                         fmt::format("cannot write the PNG: {}", writer.session.message.data()));
    }
    if (!writer.info) return makeError(ErrorCode::OutOfMemory, "", "no memory for the PNG encoder");
    return std::move(writer.session.output);
}

Status writePng(const std::filesystem::path& path, const Image& image, const PngWriteOptions& options) {
    auto bytes = encodePng(image, options);
    if (!bytes) return atPlace(std::move(bytes).error(), path.string());
    return writeFileAtomic(path, *bytes);
}

} // namespace ars
