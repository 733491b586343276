#include "engine/io/jpeg.h"

#include "engine/core/file.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <csetjmp>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>

// jpeglib.h needs size_t and FILE before it; jerror.h needs its switches and so comes after.
// clang-format off
#include <jpeglib.h>
#include <jerror.h>
// clang-format on

namespace ars {

namespace {

constexpr int kMaxScans = 500;
/// A Huffman-coded 8x8 block takes at least one bit, so a byte holds at most 8 blocks.
constexpr std::uint64_t kMaxPixelsPerByte = 512;
constexpr int kTooManyScans = -1; // besides libjpeg's own codes, which are positive

/// What libjpeg's callbacks see. A failed call is left by longjmp, which runs no destructors: whatever owns memory
/// lives in the callers of guarded().
struct Failure {
    jpeg_error_mgr manager;
    std::jmp_buf jump;
    int code = 0;
    std::array<char, JMSG_LENGTH_MAX> message{};
};

static_assert(std::is_standard_layout_v<Failure>, "jpeg_error_mgr* is cast back to Failure*");

Failure& failureOf(j_common_ptr info) { return *reinterpret_cast<Failure*>(info->err); }

[[noreturn]] void onError(j_common_ptr info) {
    Failure& failure = failureOf(info);
    failure.code = info->err->msg_code;
    info->err->format_message(info, failure.message.data());
    std::longjmp(failure.jump, 1);
}

/// Warnings that mean lost pixels. libjpeg would go on and make the missing ones up.
bool losesPixels(int code) {
    return code == JWRN_JPEG_EOF || code == JWRN_HIT_MARKER || code == JWRN_HUFF_BAD_CODE || code == JWRN_MUST_RESYNC ||
           code == JWRN_ARITH_BAD_CODE || code == JWRN_BOGUS_PROGRESSION;
}

void onMessage(j_common_ptr info, int level) {
    if (level < 0 && losesPixels(info->err->msg_code)) onError(info);
}

void onOutput(j_common_ptr) {}

void onProgress(j_common_ptr info) {
    const auto* decoder = reinterpret_cast<j_decompress_ptr>(info);
    if (decoder->input_scan_number <= kMaxScans) return;
    Failure& failure = failureOf(info);
    failure.code = kTooManyScans;
    std::snprintf(failure.message.data(), failure.message.size(), "more than %d scans", kMaxScans);
    std::longjmp(failure.jump, 1);
}

jpeg_error_mgr* prepare(Failure& failure) {
    jpeg_std_error(&failure.manager);
    failure.manager.error_exit = onError;
    failure.manager.emit_message = onMessage;
    failure.manager.output_message = onOutput;
    return &failure.manager;
}

/// Runs calls into libjpeg; false when one of them failed. `body` must hold no object with a destructor.
template <typename Body>
bool guarded(Failure& failure, const Body& body) {
    if (setjmp(failure.jump) != 0) return false;
    body();
    return true;
}

struct Decoder {
    Failure failure;
    jpeg_decompress_struct info{};
    jpeg_progress_mgr progress{};

    Decoder() { info.err = prepare(failure); }
    Decoder(const Decoder&) = delete;
    Decoder& operator=(const Decoder&) = delete;
    ~Decoder() { jpeg_destroy_decompress(&info); }
};

struct Encoder {
    Failure failure;
    jpeg_compress_struct info{};
    unsigned char* bytes = nullptr;
    unsigned long size = 0;

    Encoder() { info.err = prepare(failure); }
    Encoder(const Encoder&) = delete;
    Encoder& operator=(const Encoder&) = delete;
    ~Encoder() {
        jpeg_destroy_compress(&info);
        std::free(bytes);
    }
};

Error jpegError(const Failure& failure) {
    ErrorCode code = ErrorCode::BadFile;
    switch (failure.code) {
    case JERR_BAD_PRECISION:
    case JERR_SOF_UNSUPPORTED:
    case JERR_ARITH_NOTIMPL:
    case JERR_CONVERSION_NOTIMPL:
    case JERR_NOTIMPL:
    case JERR_COMPONENT_COUNT:
        code = ErrorCode::Unsupported;
        break;
    case JERR_NO_BACKING_STORE:
    case kTooManyScans:
        code = ErrorCode::LimitExceeded;
        break;
    case JERR_OUT_OF_MEMORY:
        code = ErrorCode::OutOfMemory;
        break;
    default:
        break;
    }
    const char* kind = code == ErrorCode::BadFile ? "broken JPEG" : "JPEG";
    return makeError(code, "", fmt::format("{}: {}", kind, failure.message.data()));
}

/// Orientation from an EXIF block (TIFF inside APP1), 1 where there is none or it makes no sense.
int exifOrientation(std::span<const std::uint8_t> block) {
    constexpr std::array<std::uint8_t, 6> kSignature = {'E', 'x', 'i', 'f', 0, 0};
    if (block.size() < 14 || !std::equal(kSignature.begin(), kSignature.end(), block.begin())) return 1;
    const auto tiff = block.subspan(6);
    const bool little = tiff[0] == 'I';
    const auto number = [&](std::size_t at, std::size_t bytes) {
        std::uint32_t value = 0;
        if (at > tiff.size() || bytes > tiff.size() - at) return value;
        for (std::size_t i = 0; i < bytes; ++i) value = value << 8 | tiff[at + (little ? bytes - 1 - i : i)];
        return value;
    };
    const std::size_t directory = number(4, 4);
    const std::size_t entries = number(directory, 2);
    for (std::size_t i = 0; i < entries; ++i) {
        const std::size_t entry = directory + 2 + 12 * i;
        if (number(entry, 2) != 0x0112) continue;
        const std::uint32_t value = number(entry + 8, 2);
        return value >= 1 && value <= 8 ? static_cast<int>(value) : 1;
    }
    return 1;
}

/// Turns a stored picture upright (EXIF 2.3, tag 0x0112: where row 0 and column 0 of the file belong).
Image upright(Image stored, int orientation) {
    if (orientation <= 1) return stored;
    const bool transposed = orientation >= 5;
    const bool flipRows = orientation == 3 || orientation == 4 || orientation == 7 || orientation == 8;
    const bool flipColumns = orientation == 2 || orientation == 3 || orientation == 6 || orientation == 7;
    Image image = stored;
    if (transposed) std::swap(image.width, image.height);
    const auto pixelBytes = sizeof(float) * static_cast<std::size_t>(image.channels);
    for (int row = 0; row < image.height; ++row) {
        for (int column = 0; column < image.width; ++column) {
            const int r = flipRows ? image.height - 1 - row : row;
            const int c = flipColumns ? image.width - 1 - column : column;
            const float* source =
                &stored
                     .pixels[(std::size_t(transposed ? c : r) * stored.width + (transposed ? r : c)) * stored.channels];
            std::memcpy(&image.at(row, column, 0), source, pixelBytes);
        }
    }
    return image;
}

void rowToFloats(const std::uint8_t* row, std::size_t count, float* out) {
    for (std::size_t i = 0; i < count; ++i) out[i] = float(row[i]) / 255.0f;
}

/// Ink to light without a profile: R = (1-C)(1-K). Adobe's files hold the inks inverted, so R = C'K'.
void cmykRowToFloats(const std::uint8_t* row, std::size_t pixels, bool inverted, float* out) {
    for (std::size_t i = 0; i < pixels; ++i) {
        const auto light = [&](int c) { return float(inverted ? row[4 * i + c] : 255 - row[4 * i + c]) / 255.0f; };
        for (int c = 0; c < 3; ++c) out[3 * i + c] = light(c) * light(3);
    }
}

bool readHeader(Decoder& decoder, std::span<const std::byte> bytes, const ReadLimits& limits) {
    jpeg_decompress_struct* info = &decoder.info;
    return guarded(decoder.failure, [&] {
        jpeg_create_decompress(info);
        info->mem->max_memory_to_use = static_cast<long>(std::min<std::uint64_t>(limits.maxBytes, 1ull << 62));
        decoder.progress.progress_monitor = onProgress;
        info->progress = &decoder.progress;
        jpeg_save_markers(info, JPEG_APP0 + 1, 0xffff);
        jpeg_mem_src(info, reinterpret_cast<const unsigned char*>(bytes.data()), bytes.size());
        jpeg_read_header(info, TRUE);
    });
}

/// Sizes against the limits and against what the file could possibly hold.
Status checkHeader(Decoder& decoder, std::size_t fileBytes, const ReadLimits& limits) {
    const jpeg_decompress_struct& info = decoder.info;
    // Several scans keep all coefficients, 2 bytes each, beside the picture.
    const bool several = jpeg_has_multiple_scans(&decoder.info) != FALSE;
    const int floatsWorth = 3 + (several ? (info.num_components + 1) / 2 : 0);
    auto count = imageValueCount(info.image_width, info.image_height, floatsWorth, limits);
    if (!count) return std::move(count).error();
    const std::uint64_t pixels = std::uint64_t(info.image_width) * info.image_height;
    if (!info.arith_code && pixels / kMaxPixelsPerByte > fileBytes) {
        return makeError(ErrorCode::BadFile, "",
                         fmt::format("{}x{} pixels need at least {} bytes however well they compress, the file has {}",
                                     info.image_width, info.image_height, pixels / kMaxPixelsPerByte, fileBytes));
    }
    return {};
}

Status chooseOutput(jpeg_decompress_struct& info) {
    switch (info.jpeg_color_space) {
    case JCS_GRAYSCALE:
        info.out_color_space = JCS_GRAYSCALE;
        return {};
    case JCS_YCbCr:
    case JCS_RGB:
        info.out_color_space = JCS_RGB;
        return {};
    case JCS_CMYK:
    case JCS_YCCK:
        info.out_color_space = JCS_CMYK;
        return {};
    default:
        return makeError(
            ErrorCode::Unsupported, "",
            fmt::format("a JPEG of {} components, expected gray, RGB, YCbCr, CMYK or YCCK", info.num_components));
    }
}

Status readPixels(Decoder& decoder, Image& image) {
    jpeg_decompress_struct* info = &decoder.info;
    const bool inks = info->out_color_space == JCS_CMYK;
    const bool inverted = info->saw_Adobe_marker != FALSE;
    const auto width = static_cast<std::size_t>(image.width);
    const std::size_t rowValues = width * image.channels;
    std::vector<std::uint8_t> row(width * 4);
    const bool done = guarded(decoder.failure, [&] {
        jpeg_start_decompress(info);
        while (info->output_scanline < info->output_height) {
            float* out = image.pixels.data() + info->output_scanline * rowValues;
            JSAMPROW rows[1] = {row.data()};
            jpeg_read_scanlines(info, rows, 1);
            if (inks) {
                cmykRowToFloats(row.data(), width, inverted, out);
            } else {
                rowToFloats(row.data(), rowValues, out);
            }
        }
        jpeg_finish_decompress(info);
    });
    return done ? Status() : Status(jpegError(decoder.failure));
}

Result<std::vector<std::uint8_t>> quantise(const Image& image, int channels) {
    std::vector<std::uint8_t> raw(std::size_t(image.width) * image.height * channels);
    for (std::size_t i = 0; i < raw.size(); ++i) {
        const std::size_t pixel = i / channels;
        const float value = image.pixels[pixel * image.channels + i % channels];
        if (std::isnan(value)) {
            return makeError(ErrorCode::InvalidArgument,
                             fmt::format("row {}, column {}", pixel / image.width, pixel % image.width),
                             "a JPEG cannot hold NaN");
        }
        raw[i] = static_cast<std::uint8_t>(std::clamp(value, 0.0f, 1.0f) * 255.0f + 0.5f);
    }
    return raw;
}

bool writeAll(Encoder& encoder, const Image& image, const std::vector<std::uint8_t>& raw, int channels, int quality) {
    jpeg_compress_struct* info = &encoder.info;
    return guarded(encoder.failure, [&] {
        jpeg_create_compress(info);
        jpeg_mem_dest(info, &encoder.bytes, &encoder.size);
        info->image_width = static_cast<JDIMENSION>(image.width);
        info->image_height = static_cast<JDIMENSION>(image.height);
        info->input_components = channels;
        info->in_color_space = channels == 1 ? JCS_GRAYSCALE : JCS_RGB;
        jpeg_set_defaults(info);
        jpeg_set_quality(info, quality, TRUE);
        info->optimize_coding = TRUE;
        for (int c = 0; c < info->num_components; ++c) {
            info->comp_info[c].h_samp_factor = 1;
            info->comp_info[c].v_samp_factor = 1;
        }
        jpeg_start_compress(info, TRUE);
        const std::size_t rowBytes = std::size_t(image.width) * channels;
        while (info->next_scanline < info->image_height) {
            JSAMPROW rows[1] = {const_cast<JSAMPROW>(raw.data() + info->next_scanline * rowBytes)};
            jpeg_write_scanlines(info, rows, 1);
        }
        jpeg_finish_compress(info);
    });
}

} // namespace

Result<JpegFile> parseJpeg(std::span<const std::byte> bytes, const JpegReadOptions& options, const ReadLimits& limits) {
    if (bytes.size() < 2 || bytes[0] != std::byte{0xff} || bytes[1] != std::byte{0xd8}) {
        return makeError(ErrorCode::BadFile, "byte 0", "expected a JPEG, which begins with FF D8");
    }
    Decoder decoder;
    if (!readHeader(decoder, bytes, limits)) return jpegError(decoder.failure);
    ARS_TRY_STATUS(checkHeader(decoder, bytes.size(), limits));
    ARS_TRY_STATUS(chooseOutput(decoder.info));
    JpegFile file;
    file.fileComponents = decoder.info.num_components;
    file.progressive = decoder.info.progressive_mode != FALSE;
    for (auto* marker = decoder.info.marker_list; marker && file.exifOrientation == 1; marker = marker->next) {
        file.exifOrientation = exifOrientation({marker->data, marker->data_length});
    }
    Image& image = file.image;
    image.width = static_cast<int>(decoder.info.image_width);
    image.height = static_cast<int>(decoder.info.image_height);
    image.channels = decoder.info.out_color_space == JCS_GRAYSCALE ? 1 : 3;
    image.space = ColorSpace::Srgb;
    image.sourceBits = 8;
    image.pixels.resize(std::size_t(image.width) * image.height * image.channels);
    ARS_TRY_STATUS(readPixels(decoder, image));
    if (options.applyOrientation) image = upright(std::move(image), file.exifOrientation);
    return file;
}

Result<JpegFile> readJpeg(const std::filesystem::path& path, const JpegReadOptions& options, const ReadLimits& limits) {
    ARS_TRY(const auto bytes, readFile(path, limits));
    auto file = parseJpeg(bytes, options, limits);
    if (!file) return atPlace(std::move(file).error(), path.string());
    return file;
}

Result<std::vector<std::byte>> encodeJpeg(const Image& image, int quality) {
    ARS_TRY_STATUS(checkImage(image));
    if (quality < 1 || quality > 100) {
        return makeError(ErrorCode::InvalidArgument, "", fmt::format("JPEG quality is 1 to 100, not {}", quality));
    }
    if (image.width > JPEG_MAX_DIMENSION || image.height > JPEG_MAX_DIMENSION) {
        return makeError(
            ErrorCode::InvalidArgument, "",
            fmt::format("{}x{} pixels, a JPEG has at most {} a side", image.width, image.height, JPEG_MAX_DIMENSION));
    }
    if (image.space == ColorSpace::Linear) {
        ARS_TRY(const Image encoded, convertColorSpace(image, ColorSpace::Srgb));
        return encodeJpeg(encoded, quality);
    }
    const int channels = image.channels >= 3 ? 3 : 1;
    ARS_TRY(const auto raw, quantise(image, channels));
    Encoder encoder;
    if (!writeAll(encoder, image, raw, channels, quality)) {
        return makeError(ErrorCode::Internal, "",
                         fmt::format("cannot write the JPEG: {}", encoder.failure.message.data()));
    }
    const auto* begin = reinterpret_cast<const std::byte*>(encoder.bytes);
    return std::vector<std::byte>(begin, begin + encoder.size);
}

Status writeJpeg(const std::filesystem::path& path, const Image& image, int quality) {
    auto bytes = encodeJpeg(image, quality);
    if (!bytes) return atPlace(std::move(bytes).error(), path.string());
    return writeFileAtomic(path, *bytes);
}

} // namespace ars
