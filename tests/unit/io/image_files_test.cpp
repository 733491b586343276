#include "engine/core/file.h"
#include "engine/io/hdr.h"
#include "engine/io/image.h"
#include "engine/io/image_file.h"
#include "engine/io/jpeg.h"
#include "engine/io/png.h"
#include "tests/support/test_data.h"

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>

namespace ars {
namespace {

using Bytes = std::vector<std::byte>;

std::filesystem::path fixturePath(const std::string& name) {
    return test::sourceFolder() / "tests/unit/io/fixtures/image" / name;
}

Bytes fixture(const std::string& name) {
    auto bytes = readFile(fixturePath(name));
    EXPECT_TRUE(bytes.ok()) << name;
    return bytes.ok() ? std::move(bytes).value() : Bytes();
}

Bytes toBytes(std::string_view text) {
    const auto* begin = reinterpret_cast<const std::byte*>(text.data());
    return {begin, begin + text.size()};
}

/// pattern() of make_image_fixtures.py.
int pattern(int row, int column, int channel, int modulus) {
    return static_cast<int>((row * 7919LL + column * 104729LL + channel * 1299709LL) % modulus);
}

Image makeImage(int height, int width, int channels, int levels, ColorSpace space) {
    Image image;
    image.width = width;
    image.height = height;
    image.channels = channels;
    image.space = space;
    for (int row = 0; row < height; ++row) {
        for (int column = 0; column < width; ++column) {
            for (int c = 0; c < channels; ++c) {
                image.pixels.push_back(float(pattern(row, column, c, levels)) / float(levels - 1));
            }
        }
    }
    return image;
}

float largestDifference(const Image& a, const Image& b) {
    EXPECT_EQ(a.pixels.size(), b.pixels.size());
    float worst = 0.0f;
    for (std::size_t i = 0; i < std::min(a.pixels.size(), b.pixels.size()); ++i) {
        worst = std::max(worst, std::abs(a.pixels[i] - b.pixels[i]));
    }
    return worst;
}

/// All pixels of a 9x13 fixture follow pattern(), exactly.
void expectPattern(const Image& image, int channels, int levels, int bits) {
    ASSERT_EQ(image.width, 13);
    ASSERT_EQ(image.height, 9);
    ASSERT_EQ(image.channels, channels);
    EXPECT_EQ(image.sourceBits, bits);
    EXPECT_EQ(largestDifference(image, makeImage(9, 13, channels, levels, ColorSpace::Srgb)), 0.0f);
}

long peakKilobytes() {
    rusage usage{};
    getrusage(RUSAGE_SELF, &usage);
    return usage.ru_maxrss;
}

template <typename T>
void expectError(const Result<T>& result, ErrorCode code, const std::string& text) {
    ASSERT_FALSE(result.ok()) << "expected: " << text;
    EXPECT_EQ(errorCodeName(result.error().code), errorCodeName(code)) << result.error().describe();
    EXPECT_NE(result.error().describe().find(text), std::string::npos) << result.error().describe();
}

template <typename Parse>
void expectEveryTruncationRefused(const Bytes& bytes, const Parse& parse, const std::string& name) {
    ASSERT_TRUE(parse(std::span<const std::byte>(bytes)).ok()) << name;
    for (std::size_t size = 0; size < bytes.size(); ++size) {
        const auto result = parse(std::span<const std::byte>(bytes).first(size));
        ASSERT_FALSE(result.ok()) << name << " cut after " << size << " of " << bytes.size() << " bytes";
        ASSERT_EQ(result.error().code, ErrorCode::BadFile) << result.error().describe();
    }
}

// ---- colour -------------------------------------------------------------------------------------------------------

// IEC 61966-2-1 in double precision, by Python.
TEST(ImageColor, TransferFunctionHasTheStandardsNumbers) {
    const std::vector<std::pair<float, double>> encoded = {{0.001f, 0.012920000000000001},
                                                           {0.18f, 0.46135612950044164},
                                                           {0.5f, 0.7353569830524495},
                                                           {0.8f, 0.9063317533440594},
                                                           {1.0f, 1.0},
                                                           {2.5f, 1.4904707737671792}};
    for (const auto& [linear, value] : encoded) {
        EXPECT_NEAR(linearToSrgb(linear), value, 3e-7);
        EXPECT_NEAR(linearToSrgb(-linear), -value, 3e-7) << "odd-symmetric";
    }
    const std::vector<std::pair<float, double>> linear = {{0.02f, 0.0015479876160990713},
                                                          {0.18f, 0.027211780951381357},
                                                          {0.5f, 0.21404114048223255},
                                                          {0.8f, 0.6038273388553378},
                                                          {1.0f, 1.0},
                                                          {1.5f, 2.537155239391517}};
    for (const auto& [code, value] : linear) {
        EXPECT_NEAR(srgbToLinear(code), value, 5e-7);
        EXPECT_NEAR(srgbToLinear(-code), -value, 5e-7);
    }
}

TEST(ImageColor, ConversionLeavesAlphaAloneAndRespectsPremultiplication) {
    Image image;
    image.width = image.height = 1;
    image.channels = 4;
    image.pixels = {0.25f, 0.1f, 0.0f, 0.5f};
    image.premultiplied = true;
    const auto encoded = convertColorSpace(image, ColorSpace::Srgb);
    ASSERT_TRUE(encoded.ok());
    // The colour is 0.5, encoded 0.73536, times alpha again.
    EXPECT_NEAR(encoded->pixels[0], 0.7353569830524495 * 0.5, 3e-7);
    EXPECT_EQ(encoded->pixels[3], 0.5f);
    EXPECT_TRUE(encoded->premultiplied);
    const Image straight = straightAlpha(image);
    EXPECT_EQ(straight.pixels, (std::vector<float>{0.5f, 0.2f, 0.0f, 0.5f}));
    EXPECT_EQ(premultipliedAlpha(straight).pixels, image.pixels);
    image.space = ColorSpace::Data;
    expectError(convertColorSpace(image, ColorSpace::Srgb), ErrorCode::InvalidArgument, "data is not a colour");
}

// ---- PNG ----------------------------------------------------------------------------------------------------------

TEST(Png, RoundTripIsExactAtBothDepthsForAllChannels) {
    for (const int bits : {8, 16}) {
        for (int channels = 1; channels <= 4; ++channels) {
            for (const auto space : {ColorSpace::Srgb, ColorSpace::Data}) {
                const Image image = makeImage(17, 23, channels, 1 << bits, space);
                const auto bytes = encodePng(image, {.bits = bits});
                ASSERT_TRUE(bytes.ok()) << bytes.error().describe();
                const auto back = parsePng(*bytes);
                ASSERT_TRUE(back.ok()) << back.error().describe();
                EXPECT_EQ(back->bitDepth, bits);
                EXPECT_EQ(back->image.sourceBits, bits);
                EXPECT_EQ(back->image.channels, channels);
                EXPECT_EQ(back->declaresSrgb, space == ColorSpace::Srgb);
                EXPECT_EQ(largestDifference(back->image, image), 0.0f);
            }
        }
    }
}

TEST(Png, LinearImagesAreEncodedUnlessLinearIsAsked) {
    Image image = makeImage(1, 1, 3, 2, ColorSpace::Linear);
    image.pixels = {0.5f, 0.18f, 2.0f};
    const auto encoded = encodePng(image, {.bits = 16});
    ASSERT_TRUE(encoded.ok());
    const auto srgb = parsePng(*encoded);
    ASSERT_TRUE(srgb.ok());
    EXPECT_EQ(srgb->image.space, ColorSpace::Srgb);
    EXPECT_NEAR(srgb->image.pixels[0], 0.7353569830524495, 0.5 / 65535 + 1e-6);
    EXPECT_NEAR(srgb->image.pixels[1], 0.46135612950044164, 0.5 / 65535 + 1e-6);
    EXPECT_EQ(srgb->image.pixels[2], 1.0f);
    const auto stored = encodePng(image, {.bits = 16, .space = ColorSpace::Linear});
    ASSERT_TRUE(stored.ok());
    const auto linear = parsePng(*stored);
    ASSERT_TRUE(linear.ok());
    EXPECT_EQ(linear->image.space, ColorSpace::Linear);
    EXPECT_NEAR(linear->image.pixels[1], 0.18, 0.5 / 65535 + 1e-7);
}

TEST(Png, PremultipliedColoursAreMadeStraight) {
    Image image = makeImage(1, 1, 4, 2, ColorSpace::Srgb);
    image.pixels = {0.25f, 0.5f, 0.0f, 0.5f};
    image.premultiplied = true;
    const auto bytes = encodePng(image, {.bits = 16});
    ASSERT_TRUE(bytes.ok());
    const auto back = parsePng(*bytes);
    ASSERT_TRUE(back.ok());
    EXPECT_FALSE(back->image.premultiplied);
    EXPECT_NEAR(back->image.pixels[0], 0.5f, 1e-5f);
    EXPECT_NEAR(back->image.pixels[1], 1.0f, 1e-5f);
}

TEST(Png, IndependentFilesOfEveryKindRead) {
    const struct {
        const char* name;
        int channels, levels, bits, depth;
        bool interlaced;
    } cases[] = {{"gray1.png", 1, 2, 8, 1, false},         {"gray2_interlaced.png", 1, 4, 8, 2, true},
                 {"gray4.png", 1, 16, 8, 4, false},        {"gray16.png", 1, 65536, 16, 16, false},
                 {"gray_alpha8.png", 2, 256, 8, 8, false}, {"rgba16_interlaced.png", 4, 65536, 16, 16, true},
                 {"rgb8_gamma1.png", 3, 256, 8, 8, false}, {"rgb16.png", 3, 65536, 16, 16, false},
                 {"text.png", 3, 256, 8, 8, false}};
    for (const auto& c : cases) {
        SCOPED_TRACE(c.name);
        const auto file = readPng(fixturePath(c.name));
        ASSERT_TRUE(file.ok()) << file.error().describe();
        expectPattern(file->image, c.channels, c.levels, c.bits);
        EXPECT_EQ(file->bitDepth, c.depth);
        EXPECT_EQ(file->interlaced, c.interlaced);
        EXPECT_FALSE(file->palette);
        EXPECT_EQ(file->image.space, std::string(c.name) == "rgb8_gamma1.png" ? ColorSpace::Linear : ColorSpace::Srgb);
    }
}

TEST(Png, PalettesAndTransparentColoursExpand) {
    const int alphas[] = {0, 64, 128, 192, 255};
    for (const bool transparent : {false, true}) {
        const auto file = readPng(fixturePath(transparent ? "palette_transparent.png" : "palette.png"));
        ASSERT_TRUE(file.ok()) << file.error().describe();
        EXPECT_TRUE(file->palette);
        EXPECT_EQ(file->bitDepth, 4);
        ASSERT_EQ(file->image.channels, transparent ? 4 : 3);
        for (int row = 0; row < 9; ++row) {
            for (int column = 0; column < 13; ++column) {
                const int index = pattern(row, column, 0, 5);
                for (int c = 0; c < 3; ++c) {
                    EXPECT_EQ(file->image.at(row, column, c), float(pattern(index, 0, c, 256)) / 255.0f);
                }
                const float alpha = transparent ? file->image.at(row, column, 3) : 1.0f;
                EXPECT_EQ(alpha, transparent ? float(alphas[index]) / 255.0f : 1.0f);
            }
        }
    }
    const auto keyed = readPng(fixturePath("rgb8_transparent.png"));
    ASSERT_TRUE(keyed.ok()) << keyed.error().describe();
    ASSERT_EQ(keyed->image.channels, 4);
    int holes = 0;
    for (int row = 0; row < 9; ++row) {
        for (int column = 0; column < 13; ++column) {
            const bool hole = pattern(row, column, 0, 256) == pattern(4, 5, 0, 256);
            EXPECT_EQ(keyed->image.at(row, column, 3), hole ? 0.0f : 1.0f);
            holes += hole;
        }
    }
    EXPECT_GE(holes, 1);
}

TEST(Png, TextOfEveryKindReadsAsUtf8) {
    const auto file = readPng(fixturePath("text.png"));
    ASSERT_TRUE(file.ok()) << file.error().describe();
    EXPECT_EQ(file->text.at("Latin"), "caf\xc3\xa9");
    EXPECT_EQ(file->text.at("World"), "\xcf\x80 \xe2\x89\x88 3.14159");
    std::string packed;
    for (int i = 0; i < 500; ++i) packed += "long ";
    EXPECT_EQ(file->text.at("Packed"), packed);
    EXPECT_EQ(file->text.at("PackedWorld").size(), 9000u);
    EXPECT_TRUE(file->text.at("PackedWorld").starts_with("\xe2\x88\x82\xe2\x88\x82"));
}

TEST(Png, DocumentOfMegabytesSurvives) {
    std::string document;
    for (int i = 0; i < 300000; ++i) document += fmt::format("{} \xc3\xa9, ", i);
    const Image image = makeImage(4, 4, 3, 256, ColorSpace::Srgb);
    const auto bytes = encodePng(image, {.text = {{"ars document", document}, {"short", "one"}}});
    ASSERT_TRUE(bytes.ok()) << bytes.error().describe();
    const auto back = parsePng(*bytes);
    ASSERT_TRUE(back.ok()) << back.error().describe();
    EXPECT_EQ(back->text.at("ars document"), document);
    EXPECT_EQ(back->text.at("short"), "one");
    EXPECT_TRUE(back->warnings.empty());
    // A text beyond the memory limit is passed over, and said.
    ReadLimits small;
    small.maxBytes = 1 << 20;
    const auto without = parsePng(*bytes, small);
    ASSERT_TRUE(without.ok()) << without.error().describe();
    EXPECT_FALSE(without->text.contains("ars document"));
    EXPECT_FALSE(without->warnings.empty());
}

TEST(Png, ImpossiblePicturesAreNotWritten) {
    const Image image = makeImage(4, 4, 3, 256, ColorSpace::Srgb);
    Image nan = image;
    nan.pixels[20] = std::nanf("");
    Image shapeless = image;
    shapeless.pixels.pop_back();
    expectError(encodePng(nan), ErrorCode::InvalidArgument, "row 1, column 2: a PNG cannot hold NaN");
    expectError(encodePng(shapeless), ErrorCode::InvalidArgument, "has 47 values, expected 48");
    expectError(encodePng(image, {.bits = 12}), ErrorCode::InvalidArgument, "8 or 16 bits, not 12");
    expectError(encodePng(image, {.compressionLevel = 10}), ErrorCode::InvalidArgument, "0 to 9");
    for (const char* keyword : {"", " a", "a  b", "caf\xc3\xa9"}) {
        expectError(encodePng(image, {.text = {{keyword, "x"}}}), ErrorCode::InvalidArgument, "a PNG keyword has");
    }
    expectError(encodePng(image, {.text = {{"a", "\xff"}}}), ErrorCode::InvalidArgument, "is UTF-8");
    EXPECT_FALSE(writePng("/dev/null/a.png", image).ok());
}

TEST(Png, EveryTruncationIsRefused) {
    for (const char* name :
         {"gray16.png", "gray1.png", "rgba16_interlaced.png", "palette_transparent.png", "text.png"}) {
        expectEveryTruncationRefused(fixture(name), [](auto bytes) { return parsePng(bytes); }, name);
    }
}

/// CRC-32 as in the PNG specification, so that a patched header is sound to the decoder.
std::uint32_t crc32Of(std::span<const std::byte> bytes) {
    std::uint32_t crc = ~0u;
    for (const std::byte b : bytes) {
        crc ^= std::to_integer<std::uint32_t>(b);
        for (int k = 0; k < 8; ++k) crc = (crc >> 1) ^ (crc & 1 ? 0xedb88320u : 0u);
    }
    return ~crc;
}

void putBig32(Bytes& bytes, std::size_t at, std::uint32_t value) {
    for (std::size_t i = 0; i < 4; ++i) bytes[at + i] = static_cast<std::byte>(value >> (24 - 8 * i));
}

/// A PNG that declares another size, depth and colour type.
Bytes patchHeader(Bytes bytes, std::uint32_t width, std::uint32_t height, int depth = 8, int colorType = 2) {
    putBig32(bytes, 16, width);
    putBig32(bytes, 20, height);
    bytes[24] = static_cast<std::byte>(depth);
    bytes[25] = static_cast<std::byte>(colorType);
    putBig32(bytes, 29, crc32Of(std::span(bytes).subspan(12, 17)));
    return bytes;
}

TEST(Png, TextBehindThePixelsIsRead) {
    Bytes bytes = fixture("rgb8_gamma1.png");
    Bytes chunk = toBytes(std::string("\0\0\0\7tEXtLate\0hi....", 19));
    putBig32(chunk, 15, crc32Of(std::span(chunk).subspan(4, 11)));
    bytes.insert(bytes.end() - 12, chunk.begin(), chunk.end());
    const auto file = parsePng(bytes);
    ASSERT_TRUE(file.ok()) << file.error().describe();
    EXPECT_EQ(file->text.at("Late"), "hi");
}

TEST(Png, BrokenFilesGetOneClearSentence) {
    const Bytes sound = fixture("rgb8_gamma1.png");
    ASSERT_TRUE(parsePng(patchHeader(sound, 13, 9)).ok()) << "the patch itself";
    Bytes magic = sound;
    magic[1] = std::byte{'p'};
    Bytes checksum = sound;
    checksum[checksum.size() - 20] ^= std::byte{1};
    Bytes header = sound;
    header[12] = std::byte{'i'};
    Bytes nothing = patchHeader(sound, 13, 9);
    nothing.resize(33);
    Bytes longChunk = sound;
    putBig32(longChunk, 33, 0x7fffff00);
    const struct {
        const char* text;
        ErrorCode code;
        Bytes bytes;
    } cases[] = {{"the PNG signature", ErrorCode::BadFile, Bytes()},
                 {"expected the PNG signature", ErrorCode::BadFile, magic},
                 {"expected the PNG signature", ErrorCode::BadFile, Bytes(100)},
                 {"sound IHDR", ErrorCode::BadFile, header},
                 {"broken PNG", ErrorCode::BadFile, checksum},
                 {"bytes of a chunk, the file ends after 0", ErrorCode::BadFile, nothing},
                 {"bytes of chunk", ErrorCode::BadFile, longChunk},
                 {"at least 1x1", ErrorCode::BadFile, patchHeader(sound, 0, 9)},
                 {"at least 1x1", ErrorCode::BadFile, patchHeader(sound, 13, 0)},
                 {"limit is 32768", ErrorCode::LimitExceeded, patchHeader(sound, 1u << 31, 9)},
                 {"limit is 32768", ErrorCode::LimitExceeded, patchHeader(sound, 13, 1u << 31)},
                 {"broken PNG", ErrorCode::BadFile, patchHeader(sound, 13, 10)},
                 {"broken PNG", ErrorCode::BadFile, patchHeader(sound, 13, 9, 7)},
                 {"sound IHDR", ErrorCode::BadFile, patchHeader(sound, 13, 9, 32)},
                 {"sound IHDR", ErrorCode::BadFile, patchHeader(sound, 13, 9, 8, 5)},
                 {"broken PNG", ErrorCode::BadFile, patchHeader(sound, 13, 9, 8, 3)}};
    int index = 0;
    for (const auto& [text, code, bytes] : cases) {
        SCOPED_TRACE(fmt::format("case {}", index++));
        expectError(parsePng(bytes), code, text);
    }
}

TEST(Png, TinyFileThatDeclaresAHugePictureTakesNoMemory) {
    ReadLimits roomy;
    roomy.maxBytes = 1ull << 40;
    ReadLimits small;
    small.maxBytes = 1 << 20;
    const Bytes bytes = patchHeader(fixture("rgb8_gamma1.png"), 30000, 30000);
    Bytes longText = fixture("text.png");
    putBig32(longText, 33, 0x30000000);
    const long before = peakKilobytes();
    expectError(parsePng(longText, roomy), ErrorCode::BadFile, "expected 805306372 bytes of chunk tEXt");
    expectError(parsePng(bytes, roomy), ErrorCode::BadFile, "need at least");
    expectError(parsePng(bytes, small), ErrorCode::LimitExceeded, "the limit is 1.0 MB");
    expectError(parsePng(bytes), ErrorCode::LimitExceeded, "30000x30000");
    EXPECT_LT(peakKilobytes() - before, 32 * 1024);
}

// Means by numpy of Pillow's pixels.
TEST(Png, PerceptualTestPictureReads) {
    ARS_TEST_DATA_FILE(path, "lpips/ex_ref.png");
    const auto file = readPng(path);
    ASSERT_TRUE(file.ok()) << file.error().describe();
    ASSERT_EQ(file->image.width, 64);
    ASSERT_EQ(file->image.channels, 3);
    const double expected[] = {198.09082031, 159.98071289, 93.57324219};
    for (int c = 0; c < 3; ++c) {
        double sum = 0.0;
        for (std::size_t i = c; i < file->image.pixels.size(); i += 3) sum += file->image.pixels[i];
        EXPECT_NEAR(sum * 255 / 4096, expected[c], 1e-4);
    }
    EXPECT_NEAR(file->image.at(32, 32, 1) * 255, 119.0f, 1e-4f);
}

// ---- JPEG ---------------------------------------------------------------------------------------------------------

Image smoothImage(int height, int width) {
    Image image;
    image.width = width;
    image.height = height;
    image.channels = 3;
    image.space = ColorSpace::Srgb;
    for (int r = 0; r < height; ++r) {
        for (int c = 0; c < width; ++c) {
            image.pixels.insert(image.pixels.end(), {float(c) / float(width), float(r) / float(height),
                                                     1.0f - float(c + r) / float(width + height)});
        }
    }
    return image;
}

// At quality 95 the steps of the tables are 2 levels for the lowest frequencies, which is all that a ramp has; the
// colour matrix doubles the error of blue and rounding to 8 bits adds half a level on either side: 4 levels.
TEST(Jpeg, RoundTripOfASmoothPictureStaysWithinFourLevels) {
    const Image image = smoothImage(61, 83);
    const auto bytes = encodeJpeg(image);
    ASSERT_TRUE(bytes.ok()) << bytes.error().describe();
    const auto back = parseJpeg(*bytes);
    ASSERT_TRUE(back.ok()) << back.error().describe();
    EXPECT_EQ(back->image.space, ColorSpace::Srgb);
    EXPECT_EQ(back->image.sourceBits, 8);
    EXPECT_LT(largestDifference(back->image, image), 4.0f / 255.0f);
    const auto coarse = encodeJpeg(image, 10);
    ASSERT_TRUE(coarse.ok());
    EXPECT_LT(coarse->size(), bytes->size()) << "quality does something";
}

TEST(Jpeg, LinearImagesAreEncoded) {
    Image image = smoothImage(16, 16);
    image.space = ColorSpace::Linear;
    std::fill(image.pixels.begin(), image.pixels.end(), 0.5f);
    const auto bytes = encodeJpeg(image);
    ASSERT_TRUE(bytes.ok());
    const auto back = parseJpeg(*bytes);
    ASSERT_TRUE(back.ok());
    EXPECT_NEAR(back->image.at(8, 8, 1), 0.7353569830524495, 1.0 / 255);
}

// Colours are what Pillow decodes; for inks, light = what one ink leaves times what black leaves.
TEST(Jpeg, IndependentFilesReadAsTheIndependentDecoderDoes) {
    const struct {
        const char* name;
        int components;
        bool progressive;
        std::array<std::array<double, 3>, 3> values; ///< at (0,0), (5,20), (23,31), 0..255
    } cases[] = {
        {"baseline420.jpg", 3, false, {{{0, 2, 245}, {161, 40, 156}, {249, 182, 49}}}},
        {"progressive444.jpg", 3, true, {{{1, 0, 254}, {161, 40, 156}, {249, 184, 40}}}},
        {"gray.jpg", 1, false, {{{29, 29, 29}, {89, 89, 89}, {187, 187, 187}}}},
        {"cmyk.jpg", 4, false, {{{0, 0, 255}, {150.588, 37.647, 145.882}, {180.894, 134.212, 28.447}}}},
        {"ycck.jpg", 4, false, {{{1, 1, 249}, {151.529, 37.647, 145.882}, {181.624, 132.753, 35.741}}}},
    };
    constexpr int kRows[] = {0, 5, 23};
    constexpr int kColumns[] = {0, 20, 31};
    for (const auto& c : cases) {
        SCOPED_TRACE(c.name);
        const auto file = readJpeg(fixturePath(c.name));
        ASSERT_TRUE(file.ok()) << file.error().describe();
        EXPECT_EQ(file->fileComponents, c.components);
        EXPECT_EQ(file->progressive, c.progressive);
        ASSERT_EQ(file->image.width, 32);
        ASSERT_EQ(file->image.height, 24);
        ASSERT_EQ(file->image.channels, c.components == 1 ? 1 : 3);
        for (int p = 0; p < 3; ++p) {
            for (int k = 0; k < file->image.channels; ++k) {
                // One level, in case the decoders' inverse transforms round differently.
                EXPECT_NEAR(file->image.at(kRows[p], kColumns[p], k) * 255, c.values[p][k], 1.01) << p << ' ' << k;
            }
        }
    }
}

// Corners as Pillow's exif_transpose gives them: (first row, first column), (first, last), (last, first).
TEST(Jpeg, ExifOrientationIsApplied) {
    using Color = std::array<int, 3>;
    const Color a = {0, 0, 254}, b = {120, 0, 196}, c = {0, 56, 227}, d = {120, 56, 168};
    const std::array<Color, 3> corners[] = {{a, b, c}, {b, a, d}, {d, c, b}, {c, d, a},
                                            {a, c, b}, {c, a, d}, {d, b, c}, {b, d, a}};
    for (int orientation = 1; orientation <= 8; ++orientation) {
        const auto path = fixturePath(fmt::format("orientation{}.jpg", orientation));
        const auto file = readJpeg(path);
        ASSERT_TRUE(file.ok()) << file.error().describe();
        EXPECT_EQ(file->exifOrientation, orientation);
        const Image& image = file->image;
        ASSERT_EQ(image.width, orientation < 5 ? 16 : 8);
        ASSERT_EQ(image.height, orientation < 5 ? 8 : 16);
        const std::array<Color, 3>& expected = corners[orientation - 1];
        for (int k = 0; k < 3; ++k) {
            EXPECT_NEAR(image.at(0, 0, k) * 255, expected[0][k], 1.01) << orientation;
            EXPECT_NEAR(image.at(0, image.width - 1, k) * 255, expected[1][k], 1.01) << orientation;
            EXPECT_NEAR(image.at(image.height - 1, 0, k) * 255, expected[2][k], 1.01) << orientation;
        }
        const auto stored = readJpeg(path, {.applyOrientation = false});
        ASSERT_TRUE(stored.ok());
        EXPECT_EQ(stored->image.width, 16);
        EXPECT_NEAR(stored->image.at(0, 15, 0) * 255, 120, 1.01);
    }
}

TEST(Jpeg, EveryTruncationIsRefused) {
    for (const char* name : {"baseline420.jpg", "progressive444.jpg", "gray.jpg", "cmyk.jpg"}) {
        expectEveryTruncationRefused(fixture(name), [](auto bytes) { return parseJpeg(bytes); }, name);
    }
}

/// Where the frame header (SOF0 or SOF2) stands.
std::size_t findFrame(const Bytes& bytes) {
    for (std::size_t i = 2; i + 1 < bytes.size(); ++i) {
        if (bytes[i] == std::byte{0xff} && (bytes[i + 1] == std::byte{0xc0} || bytes[i + 1] == std::byte{0xc2}))
            return i;
    }
    ADD_FAILURE() << "no frame";
    return 0;
}

Bytes patchFrame(Bytes bytes, std::size_t at, std::initializer_list<int> values) {
    const std::size_t frame = findFrame(bytes);
    for (const int value : values) bytes[frame + at++] = static_cast<std::byte>(value);
    return bytes;
}

TEST(Jpeg, BrokenFilesGetOneClearSentence) {
    const Bytes sound = fixture("baseline420.jpg");
    Bytes garbled = sound;
    for (std::size_t i = sound.size() - 60; i + 2 < sound.size(); ++i) garbled[i] = std::byte{0xff};
    Bytes noFrame = sound;
    noFrame.erase(noFrame.begin() + 2, noFrame.end() - 2);
    const struct {
        const char* text;
        ErrorCode code;
        Bytes bytes;
    } cases[] = {{"begins with FF D8", ErrorCode::BadFile, Bytes()},
                 {"begins with FF D8", ErrorCode::BadFile, Bytes(64)},
                 {"broken JPEG", ErrorCode::BadFile, noFrame},
                 {"broken JPEG", ErrorCode::BadFile, garbled},
                 {"broken JPEG", ErrorCode::BadFile, patchFrame(sound, 5, {0, 0})}, // height
                 {"broken JPEG", ErrorCode::BadFile, patchFrame(sound, 7, {0, 0})}, // width
                 {"broken JPEG", ErrorCode::BadFile, patchFrame(sound, 11, {0})},   // sampling
                 {"JPEG", ErrorCode::Unsupported, patchFrame(sound, 4, {12})},      // bits
                 {"JPEG", ErrorCode::Unsupported, patchFrame(sound, 1, {0xc3})},    // lossless
                 {"limit is 32768", ErrorCode::LimitExceeded, patchFrame(sound, 5, {0xff, 0xdc})}};
    int index = 0;
    for (const auto& [text, code, bytes] : cases) {
        SCOPED_TRACE(fmt::format("case {}", index++));
        expectError(parseJpeg(bytes), code, text);
    }
}

TEST(Jpeg, TinyFileThatDeclaresAHugePictureTakesNoMemory) {
    ReadLimits roomy;
    roomy.maxBytes = 1ull << 40;
    ReadLimits small;
    small.maxBytes = 1 << 20;
    const long before = peakKilobytes();
    for (const char* name : {"baseline420.jpg", "progressive444.jpg"}) {
        const Bytes bytes = patchFrame(fixture(name), 5, {30000 >> 8, 30000 & 255, 30000 >> 8, 30000 & 255});
        expectError(parseJpeg(bytes, {}, roomy), ErrorCode::BadFile, "need at least");
        expectError(parseJpeg(bytes, {}, small), ErrorCode::LimitExceeded, "the limit is 1.0 MB");
    }
    EXPECT_LT(peakKilobytes() - before, 32 * 1024);
}

TEST(Jpeg, ThousandsOfScansAreRefused) {
    Bytes bytes = fixture("progressive444.jpg");
    // The last scan once more, again and again.
    std::size_t scan = 0;
    for (std::size_t i = 2; i + 1 < bytes.size(); ++i) {
        if (bytes[i] == std::byte{0xff} && bytes[i + 1] == std::byte{0xda}) scan = i;
    }
    const Bytes last(bytes.begin() + std::ptrdiff_t(scan), bytes.end() - 2);
    Bytes many(bytes.begin(), bytes.end() - 2);
    for (int i = 0; i < 2000; ++i) many.insert(many.end(), last.begin(), last.end());
    many.insert(many.end(), bytes.end() - 2, bytes.end());
    const auto file = parseJpeg(many);
    ASSERT_FALSE(file.ok());
    // Either guard will do: the repeated refinement is no sound progression, and there are too many scans.
    EXPECT_TRUE(file.error().code == ErrorCode::LimitExceeded || file.error().code == ErrorCode::BadFile);
}

TEST(Jpeg, ImpossiblePicturesAreNotWritten) {
    Image image = smoothImage(4, 4);
    expectError(encodeJpeg(image, 0), ErrorCode::InvalidArgument, "quality is 1 to 100");
    expectError(encodeJpeg(image, 101), ErrorCode::InvalidArgument, "quality is 1 to 100");
    image.pixels[5] = std::nanf("");
    expectError(encodeJpeg(image), ErrorCode::InvalidArgument, "row 0, column 1: a JPEG cannot hold NaN");
}

// Means by numpy of Pillow's pixels.
TEST(Jpeg, CaptureFramesAndMasksRead) {
    ARS_TEST_DATA_FILE(path, "capture/casual/24110001/00000000.jpg");
    const auto image = readImageFile(path);
    ASSERT_TRUE(image.ok()) << image.error().describe();
    ASSERT_EQ(image->width, 384);
    ASSERT_EQ(image->height, 512);
    const double expected[] = {124.65926107, 124.6493988, 124.34358724};
    for (int c = 0; c < 3; ++c) {
        double sum = 0.0;
        for (std::size_t i = c; i < image->pixels.size(); i += 3) sum += image->pixels[i];
        EXPECT_NEAR(sum * 255 / (384 * 512), expected[c], 0.05);
    }
    EXPECT_NEAR(image->at(256, 192, 1) * 255, 98, 1.01);
    ARS_TEST_DATA_FILE(maskPath, "capture/casual/24110001/mask/pha/00000000.jpg");
    const auto mask = readImageFile(maskPath);
    ASSERT_TRUE(mask.ok()) << mask.error().describe();
    EXPECT_EQ(mask->channels, 1);
    EXPECT_EQ(mask->at(256, 192, 0), 1.0f);
}

// ---- Radiance -----------------------------------------------------------------------------------------------------

std::string flatHdr(const std::string& variables, const std::string& resolution, int pixels) {
    std::string text = "#?RADIANCE\n" + variables + "FORMAT=32-bit_rle_rgbe\n\n" + resolution + "\n";
    // Pixel k is (128 + k, k, 0) at exponent 129: (2 + k/64, k/64, 0) / 2.
    for (int k = 0; k < pixels; ++k) text += {char(128 + k), char(k), char(0), char(129)};
    return text;
}

float flatRed(int k) { return float(128 + k) / 128.0f; }

// A component is rounded to half of 1/128 to 1/256 of the pixel's largest value: 1/256 at worst.
TEST(Hdr, RoundTripStaysWithinTheFormatsError) {
    for (const int width : {1, 7, 8, 200, 300}) {
        Image image = makeImage(5, width, 3, 4096, ColorSpace::Linear);
        for (std::size_t i = 0; i < image.pixels.size(); ++i) image.pixels[i] *= std::ldexp(1.0f, int(i / 3 % 60) - 30);
        for (int c = 0; c < 3 * width; ++c) image.pixels[c] = c < 2 * width ? 0.75f : 0.0f; // runs
        const auto bytes = encodeHdr(image);
        ASSERT_TRUE(bytes.ok()) << bytes.error().describe();
        const auto back = parseHdr(*bytes);
        ASSERT_TRUE(back.ok()) << back.error().describe();
        EXPECT_EQ(back->space, ColorSpace::Linear);
        for (std::size_t p = 0; p < image.pixels.size(); p += 3) {
            const float largest = std::max({image.pixels[p], image.pixels[p + 1], image.pixels[p + 2]});
            for (std::size_t c = p; c < p + 3; ++c) {
                ASSERT_LE(std::abs(back->pixels[c] - image.pixels[c]), largest / 256.0f) << width << ' ' << c;
            }
        }
        // What has been rounded once stays.
        const auto again = encodeHdr(*back);
        ASSERT_TRUE(again.ok());
        EXPECT_EQ(*again, *bytes);
    }
}

TEST(Hdr, PowersOfTwoAndTheLargestMantissaAreExact) {
    Image image = makeImage(1, 4, 3, 2, ColorSpace::Linear);
    image.pixels = {1.0f, 0.5f, 0.0f, 255.0f, 1.0f, 0.0f, 0x1p-100f, 0.0f, 0.0f, 0x1.fep126f, 0x1p119f, -3.0f};
    const auto bytes = encodeHdr(image);
    ASSERT_TRUE(bytes.ok()) << bytes.error().describe();
    const auto back = parseHdr(*bytes);
    ASSERT_TRUE(back.ok()) << back.error().describe();
    image.pixels.back() = 0.0f; // the format has no negative numbers
    EXPECT_EQ(back->pixels, image.pixels);
}

// Values as OpenCV reads its own file.
TEST(Hdr, IndependentFileReads) {
    const auto image = readHdr(fixturePath("opencv.hdr"));
    ASSERT_TRUE(image.ok()) << image.error().describe();
    ASSERT_EQ(image->width, 13);
    ASSERT_EQ(image->height, 9);
    const struct {
        int row, column;
        std::array<float, 3> rgb;
    } cases[] = {{0, 0, {0, 79, 159}}, {4, 5, {147, 227, 51}}, {8, 12, {74, 154, 233}}, {2, 7, {216, 40, 120}}};
    for (const auto& [row, column, rgb] : cases) {
        for (int c = 0; c < 3; ++c) EXPECT_EQ(image->at(row, column, c), rgb[c]);
    }
    for (int row = 0; row < 9; ++row) {
        for (int column = 0; column < 13; ++column) {
            for (int c = 0; c < 3; ++c) {
                // OpenCV cuts the mantissa off instead of rounding it: below 1/128 of the largest, 256 here.
                EXPECT_NEAR(image->at(row, column, c), float(pattern(row, column, c, 4096)) / 16.0f, 2.0f);
            }
        }
    }
}

TEST(Hdr, AllEightOrientationsComeUpright) {
    // A picture of 2 rows and 3 columns, numbered in the order of the file.
    const struct {
        const char* resolution;
        std::array<int, 6> upright;
    } cases[] = {{"-Y 2 +X 3", {0, 1, 2, 3, 4, 5}}, {"-Y 2 -X 3", {2, 1, 0, 5, 4, 3}},
                 {"+Y 2 +X 3", {3, 4, 5, 0, 1, 2}}, {"+Y 2 -X 3", {5, 4, 3, 2, 1, 0}},
                 {"+X 3 -Y 2", {0, 2, 4, 1, 3, 5}}, {"-X 3 -Y 2", {4, 2, 0, 5, 3, 1}},
                 {"+X 3 +Y 2", {1, 3, 5, 0, 2, 4}}, {"-X 3 +Y 2", {5, 3, 1, 4, 2, 0}}};
    for (const auto& [resolution, upright] : cases) {
        SCOPED_TRACE(resolution);
        const auto image = parseHdr(toBytes(flatHdr("", resolution, 6)));
        ASSERT_TRUE(image.ok()) << image.error().describe();
        ASSERT_EQ(image->width, 3);
        ASSERT_EQ(image->height, 2);
        for (int i = 0; i < 6; ++i) EXPECT_EQ(image->pixels[3 * i], flatRed(upright[i]));
    }
}

TEST(Hdr, ExposureAndColourCorrectionAreTakenOut) {
    const auto image = parseHdr(toBytes(flatHdr("EXPOSURE=2\nCOLORCORR= 1 4 1\nEXPOSURE= 4.0\n", "-Y 1 +X 2", 2)));
    ASSERT_TRUE(image.ok()) << image.error().describe();
    EXPECT_EQ(image->pixels, (std::vector<float>{1.0f / 8, 0, 0, flatRed(1) / 8, 1.0f / 128 / 32, 0}));
}

TEST(Hdr, OldRunLengthsRepeatThePixelBefore) {
    std::string text = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 262\n";
    const std::string pixel = {char(200), char(100), char(50), char(136)};
    text += pixel + std::string("\1\1\1\4", 4) + std::string("\1\1\1\1", 4); // 1 + 4 + (1 << 8) = 261
    text += std::string("\10\20\30\210", 4);
    const auto image = parseHdr(toBytes(text));
    ASSERT_TRUE(image.ok()) << image.error().describe();
    for (int i = 0; i < 261; ++i) ASSERT_EQ(image->at(0, i, 1), 100.0f) << i;
    EXPECT_EQ(image->at(0, 261, 2), 24.0f);
}

TEST(Hdr, EveryTruncationIsRefused) {
    const Bytes flat = toBytes(flatHdr("EXPOSURE=2\n", "-Y 4 +X 20", 80));
    const auto parse = [](auto bytes) { return parseHdr(bytes); };
    expectEveryTruncationRefused(fixture("opencv.hdr"), parse, "opencv.hdr");
    expectEveryTruncationRefused(flat, parse, "flat");
    const auto runs = encodeHdr(makeImage(6, 90, 3, 4, ColorSpace::Linear));
    ASSERT_TRUE(runs.ok());
    expectEveryTruncationRefused(*runs, parse, "runs");
}

TEST(Hdr, BrokenFilesGetOneClearSentence) {
    const std::string head = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n";
    const std::string noise(4096, '\x05');
    const struct {
        const char* text;
        ErrorCode code;
        std::string bytes;
    } cases[] = {
        {"a Radiance header", ErrorCode::BadFile, ""},
        {"begins with \"#?RADIANCE\"", ErrorCode::BadFile, "P6\n3 3\n255\n" + noise},
        {"XYZE", ErrorCode::Unsupported, "#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 1\n" + noise},
        {"expected FORMAT=32-bit_rle_rgbe", ErrorCode::BadFile, "#?RADIANCE\nFORMAT=8-bit\n\n-Y 1 +X 1\n" + noise},
        {"EXPOSURE must be a positive finite", ErrorCode::BadFile, flatHdr("EXPOSURE=nan\n", "-Y 1 +X 1", 1)},
        {"EXPOSURE must be a positive finite", ErrorCode::BadFile, flatHdr("EXPOSURE=0\n", "-Y 1 +X 1", 1)},
        {"EXPOSURE must be a positive finite", ErrorCode::BadFile, flatHdr("EXPOSURE=-1\n", "-Y 1 +X 1", 1)},
        {"EXPOSURE must be a positive finite", ErrorCode::BadFile, flatHdr("EXPOSURE=1e999\n", "-Y 1 +X 1", 1)},
        {"COLORCORR must be", ErrorCode::BadFile, flatHdr("COLORCORR=1 1\n", "-Y 1 +X 1", 1)},
        {"lines multiply to", ErrorCode::BadFile, flatHdr("EXPOSURE=1e-20\nEXPOSURE=1e-20\n", "-Y 1 +X 1", 1)},
        {"beyond the range of a float", ErrorCode::BadFile,
         "#?RADIANCE\nEXPOSURE=1e-5\n\n-Y 1 +X 1\n" + std::string("\xff\xff\xff\xff", 4)},
        {"at least 1x1", ErrorCode::BadFile, head + "-Y 0 +X 4\n" + noise},
        {"at least 1x1", ErrorCode::BadFile, head + "-Y 4 +X -4\n" + noise},
        {"limit is 32768", ErrorCode::LimitExceeded, head + "-Y 2147483648 +X 4\n" + noise},
        {"a line like", ErrorCode::BadFile, head + "-Y 99999999999999999999 +X 4\n" + noise},
        {"a line like", ErrorCode::BadFile, head + "-Y nan +X nan\n" + noise},
        {"a line like", ErrorCode::BadFile, head + "Y 4 X 4\n" + noise},
        {"one X and one Y", ErrorCode::BadFile, head + "-Y 4 +Y 4\n" + noise},
        {"a scanline of 9 pixels, expected 8", ErrorCode::BadFile,
         head + "-Y 1 +X 8\n" + std::string("\2\2\0\11", 4) + noise},
        {"a run of 127 pixels where", ErrorCode::BadFile,
         head + "-Y 1 +X 8\n" + std::string("\2\2\0\10\xff", 5) + noise},
        {"a run of 0 pixels", ErrorCode::BadFile, head + "-Y 1 +X 8\n" + std::string("\2\2\0\10\0", 5) + noise},
        {"0 before", ErrorCode::BadFile, head + "-Y 1 +X 4\n" + std::string("\1\1\1\3", 4) + noise},
        {"a run of 9 pixels", ErrorCode::BadFile, head + "-Y 1 +X 4\n" + std::string("\3\3\3\3\1\1\1\11", 8) + noise}};
    int index = 0;
    for (const auto& [text, code, bytes] : cases) {
        SCOPED_TRACE(fmt::format("case {}", index++));
        expectError(parseHdr(toBytes(bytes)), code, text);
    }
}

TEST(Hdr, TinyFileThatDeclaresAHugePictureTakesNoMemory) {
    ReadLimits roomy;
    roomy.maxBytes = 1ull << 40;
    ReadLimits small;
    small.maxBytes = 1 << 20;
    const Bytes bytes = toBytes(flatHdr("", "-Y 30000 +X 30000", 80));
    const long before = peakKilobytes();
    expectError(parseHdr(bytes, roomy), ErrorCode::BadFile, "need at least");
    expectError(parseHdr(bytes, small), ErrorCode::LimitExceeded, "the limit is 1.0 MB");
    EXPECT_LT(peakKilobytes() - before, 32 * 1024);
}

TEST(Hdr, ImpossiblePicturesAreNotWritten) {
    for (const float bad : {std::nanf(""), std::numeric_limits<float>::infinity(), 3e38f}) {
        Image image = makeImage(2, 2, 3, 4, ColorSpace::Linear);
        image.pixels[10] = bad;
        expectError(encodeHdr(image), ErrorCode::InvalidArgument, "row 1, column 1: a Radiance picture cannot hold");
    }
}

// ---- any picture --------------------------------------------------------------------------------------------------

TEST(ImageFile, ContentDecidesNotTheName) {
    test::TemporaryFolder folder;
    const struct {
        const char* fixture;
        ImageFormat format;
        int channels;
    } cases[] = {{"opencv.hdr", ImageFormat::Hdr, 3},
                 {"gray_alpha8.png", ImageFormat::Png, 2},
                 {"progressive444.jpg", ImageFormat::Jpeg, 3},
                 {"layers_windows.exr", ImageFormat::Exr, 4}};
    for (const auto& c : cases) {
        const Bytes bytes = fixture(c.fixture);
        EXPECT_EQ(recogniseImage(std::span(bytes).first(16)), c.format);
        ASSERT_TRUE(writeFileAtomic(folder / "picture.txt", bytes).ok());
        const auto image = readImageFile(folder / "picture.txt");
        ASSERT_TRUE(image.ok()) << image.error().describe();
        EXPECT_EQ(image->channels, c.channels) << c.fixture;
    }
}

TEST(ImageFile, OtherFilesAreRefusedByName) {
    test::TemporaryFolder folder;
    ASSERT_TRUE(writeFileAtomic(folder / "a.png", std::string_view("GIF89a")).ok());
    const auto image = readImageFile(folder / "a.png");
    expectError(image, ErrorCode::Unsupported, "OpenEXR, Radiance HDR, PNG or JPEG");
    EXPECT_NE(image.error().describe().find("a.png"), std::string::npos);
    expectError(readImageFile(folder / "missing.png"), ErrorCode::NotFound, "missing.png");
    expectError(parseImageFile(Bytes()), ErrorCode::Unsupported, "expected a picture");
}

} // namespace
} // namespace ars
