#include "engine/io/exr.h"

#include "engine/core/file.h"
#include "engine/io/image_file.h"
#include "tests/support/test_data.h"

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <algorithm>
#include <bit>
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

/// pattern() of make_image_fixtures.py.
int pattern(int row, int column, int channel, int modulus) {
    return static_cast<int>((row * 7919LL + column * 104729LL + channel * 1299709LL) % modulus);
}

/// half() of make_image_fixtures.py: multiples of 1/64 below 16, exact in half.
float halfPattern(int row, int column, int channel) {
    return float(pattern(row, column, channel, 1024)) / 64.0f - 3.0f;
}

float smooth(int row, int column, int channel) {
    const int value = channel == 0 ? 8 * column : channel == 1 ? 8 * row : 255 - 4 * column - 4 * row;
    return float(std::clamp(value, 0, 255)) / 255.0f;
}

ExrChannel makeChannel(const std::string& name, ExrPixelType type, int width, int height) {
    ExrChannel channel{name, type, {}};
    for (int row = 0; row < height; ++row) {
        for (int column = 0; column < width; ++column) {
            const int k = pattern(row, column, static_cast<int>(name.size()), 1 << 20);
            channel.pixels.push_back(type == ExrPixelType::Half   ? float(k % 2048) / 64.0f - 16.0f
                                     : type == ExrPixelType::UInt ? float(k * 16)
                                                                  : std::sqrt(float(k)) - 300.0f);
        }
    }
    return channel;
}

ExrImage makePicture() {
    ExrImage image;
    image.dataWindow = {-5, 7, 31, 49};
    image.displayWindow = {0, 0, 63, 39};
    for (const auto& [name, type] : std::vector<std::pair<std::string, ExrPixelType>>{
             {"R", ExrPixelType::Half}, {"depth.Z", ExrPixelType::Float}, {"id", ExrPixelType::UInt}}) {
        image.channels.push_back(makeChannel(name, type, image.dataWindow.width(), image.dataWindow.height()));
    }
    image.textAttributes["document"] = "{\"radius\": 0.25}";
    return image;
}

bool sameBits(const std::vector<float>& a, const std::vector<float>& b) {
    return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0;
}

std::size_t findText(const Bytes& bytes, const std::string& text) {
    const auto at = std::search(bytes.begin(), bytes.end(), text.begin(), text.end(),
                                [](std::byte b, char c) { return std::to_integer<char>(b) == c; });
    EXPECT_NE(at, bytes.end()) << text;
    return static_cast<std::size_t>(at - bytes.begin());
}

/// Where the table of blocks begins in a file of one block: its entry points right behind itself.
std::size_t findTable(const Bytes& bytes) {
    for (std::size_t at = 8; at + 8 <= bytes.size(); ++at) {
        std::uint64_t offset = 0;
        std::memcpy(&offset, bytes.data() + at, 8);
        if (offset == at + 8) return at;
    }
    ADD_FAILURE() << "no table of one block";
    return 0;
}

/// Overwrites the value of an attribute in place.
template <typename T>
Bytes patchAttribute(Bytes bytes, const std::string& name, const std::string& type, const T& value,
                     std::size_t at = 0) {
    const std::string key = name + '\0' + type + '\0';
    std::memcpy(bytes.data() + findText(bytes, key) + key.size() + 4 + at, &value, sizeof(T));
    return bytes;
}

long peakKilobytes() {
    rusage usage{};
    getrusage(RUSAGE_SELF, &usage);
    return usage.ru_maxrss;
}

void expectError(const Result<ExrImage>& result, ErrorCode code, const std::string& text) {
    ASSERT_FALSE(result.ok()) << "expected: " << text;
    EXPECT_EQ(errorCodeName(result.error().code), errorCodeName(code)) << result.error().describe();
    EXPECT_NE(result.error().describe().find(text), std::string::npos) << result.error().describe();
}

TEST(Exr, LosslessRoundTripIsBitExactWithBothWindows) {
    ExrImage image = makePicture();
    for (const auto compression :
         {ExrCompression::None, ExrCompression::Rle, ExrCompression::Zips, ExrCompression::Zip, ExrCompression::Piz}) {
        SCOPED_TRACE(exrCompressionName(compression));
        image.compression = compression;
        const auto bytes = encodeExr(image);
        ASSERT_TRUE(bytes.ok()) << bytes.error().describe();
        const auto back = parseExr(*bytes);
        ASSERT_TRUE(back.ok()) << back.error().describe();
        EXPECT_EQ(back->dataWindow, image.dataWindow);
        EXPECT_EQ(back->displayWindow, image.displayWindow);
        EXPECT_EQ(back->compression, compression);
        EXPECT_EQ(back->textAttributes, image.textAttributes);
        ASSERT_EQ(back->channels.size(), image.channels.size());
        for (const ExrChannel& channel : image.channels) {
            const ExrChannel* found = back->find(channel.name);
            ASSERT_NE(found, nullptr) << channel.name;
            EXPECT_EQ(found->type, channel.type);
            EXPECT_TRUE(sameBits(found->pixels, channel.pixels)) << channel.name;
        }
    }
}

TEST(Exr, SpecialNumbersSurvive) {
    ExrImage image;
    image.dataWindow = image.displayWindow = {0, 0, 5, 0};
    const float infinity = std::numeric_limits<float>::infinity();
    const std::vector<float> values = {65504.0f, 0x1p-24f,  -0.0f,
                                       infinity, -infinity, std::numeric_limits<float>::quiet_NaN()};
    image.channels.push_back({"half", ExrPixelType::Half, values});
    image.channels.push_back({"float", ExrPixelType::Float, values});
    const auto bytes = encodeExr(image);
    ASSERT_TRUE(bytes.ok()) << bytes.error().describe();
    const auto back = parseExr(*bytes);
    ASSERT_TRUE(back.ok()) << back.error().describe();
    for (const ExrChannel& channel : back->channels) {
        for (std::size_t i = 0; i + 1 < values.size(); ++i) {
            EXPECT_EQ(std::bit_cast<std::uint32_t>(channel.pixels[i]), std::bit_cast<std::uint32_t>(values[i])) << i;
        }
        EXPECT_TRUE(std::isnan(channel.pixels.back()));
    }
}

// The lossy codecs' own promises: PXR24 keeps 15 of 23 mantissa bits; B44 keeps 6 bits of the largest difference in 4x4
// pixels (0.25 between neighbours here); DWA at level 45 quantises to what is not seen, below 0.01 at white.
TEST(Exr, LossyCompressionStaysWithinItsError) {
    const struct {
        ExrCompression compression;
        ExrPixelType type;
        float tolerance;
    } cases[] = {
        {ExrCompression::Pxr24, ExrPixelType::Float, 0x1p-15f}, {ExrCompression::B44, ExrPixelType::Half, 0.02f},
        {ExrCompression::B44a, ExrPixelType::Half, 0.02f},      {ExrCompression::Dwaa, ExrPixelType::Half, 0.02f},
        {ExrCompression::Dwab, ExrPixelType::Half, 0.02f},      {ExrCompression::Dwab, ExrPixelType::Float, 0.02f}};
    for (const auto& [compression, type, tolerance] : cases) {
        SCOPED_TRACE(exrCompressionName(compression));
        Image image;
        image.width = 70;
        image.height = 61;
        image.channels = 3;
        for (int i = 0; i < 61 * 70 * 3; ++i) image.pixels.push_back(smooth(i / 210 / 2, i / 3 % 70 / 3, i % 3));
        ExrImage exr;
        exr.compression = compression;
        ASSERT_TRUE(addExrLayer(exr, "", image, "RGB", type).ok());
        const auto bytes = encodeExr(exr);
        ASSERT_TRUE(bytes.ok()) << bytes.error().describe();
        EXPECT_LT(bytes->size(), image.pixels.size() * sizeof(float));
        const auto back = parseImageFile(*bytes);
        ASSERT_TRUE(back.ok()) << back.error().describe();
        float worst = 0.0f;
        for (std::size_t i = 0; i < image.pixels.size(); ++i) {
            worst = std::max(worst, std::abs(back->pixels[i] - image.pixels[i]));
        }
        EXPECT_LT(worst, tolerance);
        EXPECT_GT(worst, 0.0f) << "a lossy codec that loses nothing was not used";
    }
}

TEST(Exr, IndependentFileWithLayersAndWindows) {
    const auto image = readExr(fixturePath("layers_windows.exr"));
    ASSERT_TRUE(image.ok()) << image.error().describe();
    EXPECT_EQ(image->dataWindow, (ExrBox{-2, 3, 9, 12}));
    EXPECT_EQ(image->displayWindow, (ExrBox{0, 0, 15, 9}));
    EXPECT_EQ(image->textAttributes.at("document"), "{\"radius\": 0.25}");
    EXPECT_EQ(exrLayers(*image), (std::vector<std::string>{"", "albedo", "depth", "id"}));
    EXPECT_EQ(image->find("id.Y")->type, ExrPixelType::UInt);
    for (int row = 0; row < 10; ++row) {
        for (int column = 0; column < 12; ++column) {
            const std::size_t i = std::size_t(row) * 12 + column;
            EXPECT_EQ(image->find("R")->pixels[i], halfPattern(row, column, 0));
            EXPECT_EQ(image->find("albedo.B")->pixels[i], halfPattern(row, column, 6));
            EXPECT_EQ(image->find("id.Y")->pixels[i], float(pattern(row, column, 0, 65536) * 256));
            EXPECT_EQ(image->find("depth.Z")->pixels[i], float(pattern(row, column, 0, 65536) / 7.0));
        }
    }
}

TEST(Exr, LayersComeInColourOrderCroppedToTheDisplayWindow) {
    const auto exr = readExr(fixturePath("layers_windows.exr"));
    ASSERT_TRUE(exr.ok()) << exr.error().describe();
    const auto beauty = exrLayer(*exr, "");
    ASSERT_TRUE(beauty.ok()) << beauty.error().describe();
    EXPECT_EQ(beauty->width, 16);
    EXPECT_EQ(beauty->height, 10);
    EXPECT_EQ(beauty->channels, 4);
    EXPECT_EQ(beauty->space, ColorSpace::Linear);
    EXPECT_TRUE(beauty->premultiplied);
    EXPECT_EQ(beauty->sourceBits, 16);
    for (int row = 0; row < 10; ++row) {
        for (int column = 0; column < 16; ++column) {
            for (int c = 0; c < 4; ++c) {
                const bool stored = row >= 3 && column <= 9; // the data window begins at (-2, 3)
                EXPECT_EQ(beauty->at(row, column, c), stored ? halfPattern(row - 3, column + 2, c) : 0.0f)
                    << row << ' ' << column << ' ' << c;
            }
        }
    }
    const auto albedo = exrLayer(*exr, "albedo", ExrWindow::Data);
    ASSERT_TRUE(albedo.ok()) << albedo.error().describe();
    EXPECT_EQ(albedo->width, 12);
    EXPECT_EQ(albedo->channels, 3);
    EXPECT_EQ(albedo->at(4, 5, 0), halfPattern(4, 5, 4));
    EXPECT_EQ(albedo->at(4, 5, 2), halfPattern(4, 5, 6));
    const auto depth = exrLayer(*exr, "depth", ExrWindow::Data);
    ASSERT_TRUE(depth.ok()) << depth.error().describe();
    EXPECT_EQ(depth->channels, 1);
    EXPECT_EQ(depth->space, ColorSpace::Data);
    EXPECT_EQ(depth->sourceBits, 32);
}

TEST(Exr, IndependentCodecsAgree) {
    for (const auto& [name, tolerance] :
         std::vector<std::pair<std::string, float>>{{"piz", 0.0f}, {"rle", 0.0f}, {"dwab", 0.02f}}) {
        const auto image = readImageFile(fixturePath("smooth_" + name + ".exr"));
        ASSERT_TRUE(image.ok()) << image.error().describe();
        ASSERT_EQ(image->pixels.size(), 24u * 32u * 3u);
        for (int row = 0; row < 24; ++row) {
            for (int column = 0; column < 32; ++column) {
                for (int c = 0; c < 3; ++c) {
                    EXPECT_NEAR(image->at(row, column, c), smooth(row, column, c), tolerance) << name;
                }
            }
        }
    }
}

TEST(Exr, TiledFileReads) {
    const auto image = readExr(fixturePath("tiled.exr"));
    ASSERT_TRUE(image.ok()) << image.error().describe();
    for (int i = 0; i < 120; ++i) EXPECT_EQ(image->find("Y")->pixels[i], halfPattern(i / 12, i % 12, 0)) << i;
}

TEST(Exr, PartsAreJoinedAndClashingChannelsNamed) {
    const auto image = readExr(fixturePath("multipart.exr"));
    ASSERT_TRUE(image.ok()) << image.error().describe();
    EXPECT_EQ(image->dataWindow, (ExrBox{0, 0, 15, 10}));
    ASSERT_EQ(image->channels.size(), 4u);
    for (const int part : {0, 1}) {
        const ExrChannel* y = image->find(part == 0 ? "left.Y" : "right.Y");
        const ExrChannel* z = image->find(part == 0 ? "only_left.Z" : "only_right.Z");
        ASSERT_TRUE(y && z);
        for (int row = 0; row < 11; ++row) {
            for (int column = 0; column < 16; ++column) {
                const int r = row - part;
                const int c = column - 4 * part;
                const bool stored = r >= 0 && r < 10 && c >= 0 && c < 12;
                EXPECT_EQ(y->pixels[std::size_t(row) * 16 + column], stored ? halfPattern(r, c, part) : 0.0f);
                EXPECT_EQ(z->pixels[std::size_t(row) * 16 + column], stored ? halfPattern(r, c, 2 + part) : 0.0f);
            }
        }
    }
}

TEST(Exr, HeaderAloneTellsLayersChannelsAndSizes) {
    const Bytes bytes = fixture("layers_windows.exr");
    const auto info = parseExrInfo(std::span(bytes).first(bytes.size() / 2));
    ASSERT_TRUE(info.ok()) << info.error().describe();
    ASSERT_EQ(info->parts.size(), 1u);
    EXPECT_EQ(info->layers, (std::vector<std::string>{"", "albedo", "depth", "id"}));
    const ExrPartInfo& part = info->parts.front();
    EXPECT_EQ(part.channels.size(), 9u);
    EXPECT_EQ(part.compression, ExrCompression::Zip);
    EXPECT_EQ(part.dataWindow, (ExrBox{-2, 3, 9, 12}));
    EXPECT_FALSE(part.tiled || part.deep);
    const auto deep = listExr(fixturePath("deep.exr"));
    ASSERT_TRUE(deep.ok()) << deep.error().describe();
    EXPECT_TRUE(deep->parts.front().deep);
    const auto parts = listExr(fixturePath("multipart.exr"));
    ASSERT_TRUE(parts.ok()) << parts.error().describe();
    ASSERT_EQ(parts->parts.size(), 2u);
    EXPECT_EQ(parts->parts[1].name, "right");
}

TEST(Exr, DocumentOfMegabytesSurvivesAndIsListed) {
    ExrImage image = makePicture();
    std::string document;
    for (int i = 0; i < 200000; ++i) document += fmt::format("{} \xc3\xa9, ", i);
    image.textAttributes["document"] = document;
    test::TemporaryFolder folder;
    ASSERT_TRUE(writeExr(folder / "a.exr", image).ok());
    const auto back = readExr(folder / "a.exr");
    ASSERT_TRUE(back.ok()) << back.error().describe();
    EXPECT_EQ(back->textAttributes.at("document"), document);
    const auto info = listExr(folder / "a.exr");
    ASSERT_TRUE(info.ok()) << info.error().describe();
    EXPECT_EQ(info->parts.front().textAttributes.at("document"), document);
}

TEST(Exr, ImagesGoInAndOutAsLayers) {
    Image color;
    color.width = 3;
    color.height = 2;
    color.channels = 4;
    for (int i = 0; i < 24; ++i) color.pixels.push_back(i % 4 == 3 ? 0.5f : float(i) / 8.0f);
    Image normal = color;
    normal.channels = 3;
    normal.space = ColorSpace::Data;
    normal.pixels.resize(18);
    ExrImage exr;
    ASSERT_TRUE(addExrLayer(exr, "", color, "RGBA").ok());
    ASSERT_TRUE(addExrLayer(exr, "normal", normal, "XYZ", ExrPixelType::Float).ok());
    const auto bytes = encodeExr(exr);
    ASSERT_TRUE(bytes.ok()) << bytes.error().describe();
    const auto back = parseExr(*bytes);
    ASSERT_TRUE(back.ok()) << back.error().describe();
    const auto beauty = exrLayer(*back, "");
    ASSERT_TRUE(beauty.ok());
    EXPECT_TRUE(beauty->premultiplied);
    EXPECT_EQ(beauty->at(1, 2, 0), 20.0f / 8.0f * 0.5f);
    EXPECT_EQ(beauty->at(1, 2, 3), 0.5f);
    const auto vectors = exrLayer(*back, "normal");
    ASSERT_TRUE(vectors.ok());
    EXPECT_EQ(vectors->space, ColorSpace::Data);
    EXPECT_TRUE(sameBits(vectors->pixels, normal.pixels));
    const auto missing = exrLayer(*back, "albedo");
    ASSERT_FALSE(missing.ok());
    EXPECT_EQ(missing.error().code, ErrorCode::NotFound);
    EXPECT_NE(missing.error().describe().find("the picture has \"\", \"normal\""), std::string::npos);
    EXPECT_FALSE(addExrLayer(exr, "normal", normal, "XYZ").ok()) << "the name is taken";
    EXPECT_FALSE(addExrLayer(exr, "other", normal, "XY").ok()) << "letters do not match";
    normal.width = 2;
    normal.height = 3;
    EXPECT_FALSE(addExrLayer(exr, "other", normal, "XYZ").ok()) << "another size";
}

TEST(Exr, ImpossiblePicturesAreNotWritten) {
    const struct {
        const char* text;
        std::function<void(ExrImage&)> change;
    } cases[] = {
        {"needs a channel", [](ExrImage& i) { i.channels.clear(); }},
        {"stands twice", [](ExrImage& i) { i.channels[1].name = "R"; }},
        {"1 to 255 bytes", [](ExrImage& i) { i.channels[0].name.clear(); }},
        {"the data window has 1591 pixels", [](ExrImage& i) { i.channels[0].pixels.pop_back(); }},
        {"beyond a half", [](ExrImage& i) { i.channels[0].pixels[3] = 65520.0f; }},
        {"no unsigned integer", [](ExrImage& i) { i.channels[2].pixels[3] = -1.0f; }},
        {"no unsigned integer", [](ExrImage& i) { i.channels[2].pixels[3] = std::nanf(""); }},
        {"has no pixel", [](ExrImage& i) { i.displayWindow.x1 = -1; }},
        {"OpenEXR does not use itself", [](ExrImage& i) { i.textAttributes["type"] = "deepscanline"; }},
        {"OpenEXR does not use itself", [](ExrImage& i) { i.textAttributes["channels"] = "R"; }},
    };
    for (const auto& [text, change] : cases) {
        ExrImage image = makePicture();
        change(image);
        const auto bytes = encodeExr(image);
        ASSERT_FALSE(bytes.ok()) << text;
        EXPECT_EQ(bytes.error().code, ErrorCode::InvalidArgument);
        EXPECT_NE(bytes.error().describe().find(text), std::string::npos) << bytes.error().describe();
    }
}

TEST(Exr, EveryTruncationIsRefused) {
    for (const char* name : {"layers_windows.exr", "smooth_dwab.exr", "tiled.exr", "multipart.exr", "smooth_rle.exr"}) {
        const Bytes bytes = fixture(name);
        ASSERT_TRUE(parseExr(bytes).ok()) << name;
        for (std::size_t size = 0; size < bytes.size(); ++size) {
            const auto image = parseExr(std::span(bytes).first(size));
            ASSERT_FALSE(image.ok()) << name << " cut after " << size << " of " << bytes.size();
            ASSERT_EQ(image.error().code, ErrorCode::BadFile) << image.error().describe();
        }
    }
}

TEST(Exr, BrokenFilesGetOneClearSentence) {
    const Bytes sound = fixture("layers_windows.exr");
    const Bytes parts = fixture("multipart.exr");
    using Box = std::array<std::int32_t, 4>;
    constexpr std::int32_t kHuge = std::numeric_limits<std::int32_t>::max();
    Bytes magic = sound;
    magic[0] = std::byte{0};
    Bytes version = sound;
    version[4] = std::byte{3};
    Bytes missing = sound;
    const std::size_t table = findTable(sound);
    std::memset(missing.data() + table, 0, 8);
    Bytes wild = sound;
    std::memset(wild.data() + table, 0x7f, 8);
    Bytes noisy = sound;
    for (std::size_t i = table + 20; i < noisy.size(); ++i) noisy[i] ^= std::byte{0x5a};
    Bytes twice = sound;
    std::memcpy(twice.data() + findText(twice, "displayWindow"), "dataWindow\0box2i\0\x10\0\0\0", 13);
    Bytes longName = sound;
    std::fill(longName.begin() + 8, longName.begin() + 300, std::byte{'a'});
    const float nan = std::nanf("");
    const struct {
        const char* text;
        ErrorCode code;
        Bytes bytes;
    } cases[] = {
        {"signature", ErrorCode::BadFile, Bytes(64)},
        {"signature 76 2f 31 01", ErrorCode::BadFile, magic},
        {"OpenEXR version 3", ErrorCode::Unsupported, version},
        {"at least one pixel", ErrorCode::BadFile, patchAttribute(sound, "dataWindow", "box2i", Box{0, 0, -1, -1})},
        {"at least one pixel", ErrorCode::BadFile, patchAttribute(sound, "dataWindow", "box2i", Box{5, 0, 4, 9})},
        {"at least one pixel", ErrorCode::BadFile,
         patchAttribute(sound, "dataWindow", "box2i", Box{std::numeric_limits<std::int32_t>::min(), 0, kHuge, 9})},
        {"limit is 32768", ErrorCode::LimitExceeded,
         patchAttribute(sound, "dataWindow", "box2i", Box{0, 0, (1 << 30) - 3, 9})},
        {"limit is 32768", ErrorCode::LimitExceeded,
         patchAttribute(parts, "dataWindow", "box2i", Box{-900000000, 0, -899999990, 9})},
        {"blocks need at least", ErrorCode::BadFile,
         patchAttribute(fixture("smooth_rle.exr"), "dataWindow", "box2i", Box{0, 0, 0, 29999})},
        {"chunkCount is", ErrorCode::BadFile, patchAttribute(parts, "dataWindow", "box2i", Box{0, 0, 11, 99})},
        {"compression 77", ErrorCode::Unsupported,
         patchAttribute(sound, "compression", "compression", std::uint8_t{77})},
        {"subsampled 2x1", ErrorCode::Unsupported,
         patchAttribute(sound, "channels", "chlist", std::int32_t{2}, 2 + 4 + 4)},
        {"sampling 0x1", ErrorCode::BadFile, patchAttribute(sound, "channels", "chlist", std::int32_t{0}, 2 + 4 + 4)},
        {"type 9", ErrorCode::BadFile, patchAttribute(sound, "channels", "chlist", std::int32_t{9}, 2)},
        {"\"A\" stands twice", ErrorCode::BadFile, patchAttribute(sound, "channels", "chlist", 'A', 18)},
        {"tiles", ErrorCode::BadFile, patchAttribute(fixture("tiled.exr"), "tiles", "tiledesc", std::uint32_t{0})},
        {"tiles", ErrorCode::LimitExceeded,
         patchAttribute(fixture("tiled.exr"), "tiles", "tiledesc", std::uint32_t{0x7fffffff})},
        {"broken EXR", ErrorCode::BadFile, patchAttribute(sound, "pixelAspectRatio", "float", nan)},
        {"deep pixels", ErrorCode::Unsupported, fixture("deep.exr")},
        {"block 0 of 1: it is missing", ErrorCode::BadFile, missing},
        {"lies at byte", ErrorCode::BadFile, wild},
        {"broken EXR: Error reading pixel data. Data decompression", ErrorCode::BadFile, noisy},
        {"attribute", ErrorCode::BadFile, twice},
        {"beyond 255 bytes", ErrorCode::BadFile, longName},
    };
    int index = 0;
    for (const auto& [text, code, bytes] : cases) {
        SCOPED_TRACE(fmt::format("case {}", index++));
        expectError(parseExr(bytes), code, text);
    }
}

TEST(Exr, TinyFileThatDeclaresAHugePictureTakesNoMemory) {
    using Box = std::array<std::int32_t, 4>;
    ReadLimits roomy;
    roomy.maxBytes = 1ull << 40;
    ReadLimits small;
    small.maxBytes = 1 << 20;
    const long before = peakKilobytes();
    for (const char* name :
         {"layers_windows.exr", "smooth_dwab.exr", "smooth_piz.exr", "smooth_rle.exr", "tiled.exr"}) {
        const Bytes bytes = patchAttribute(fixture(name), "dataWindow", "box2i", Box{0, 0, 29999, 29999});
        const auto image = parseExr(bytes, roomy);
        ASSERT_FALSE(image.ok()) << name;
        EXPECT_EQ(image.error().code, ErrorCode::BadFile) << image.error().describe();
        expectError(parseExr(bytes, small), ErrorCode::LimitExceeded, "the limit is 1.0 MB");
    }
    // As many blocks as before, so that only their bytes tell.
    const Bytes wide = patchAttribute(fixture("layers_windows.exr"), "dataWindow", "box2i", Box{0, 0, 29999, 9});
    expectError(parseExr(wide, roomy), ErrorCode::BadFile, "cannot hold 30000x10 pixels");
    EXPECT_LT(peakKilobytes() - before, 64 * 1024);
}

// Peaks as the OpenEXR Python package prints them.
TEST(Exr, StudioLightsHaveTheirPeaks) {
    const struct {
        const char* file;
        float red, green, blue;
    } cases[] = {{"city", 33952.0f, 31696.0f, 25792.0f},    {"courtyard", 55.5625f, 53.21875f, 41.65625f},
                 {"forest", 1010.5f, 951.5f, 919.0f},       {"interior", 33952.0f, 32800.0f, 32256.0f},
                 {"night", 7168.0f, 4428.0f, 2908.0f},      {"studio", 111.0f, 110.5f, 118.375f},
                 {"sunrise", 32800.0f, 33664.0f, 30624.0f}, {"sunset", 6520.0f, 984.5f, 2.4765625f}};
    for (const auto& [file, red, green, blue] : cases) {
        ARS_TEST_DATA_FILE(path, std::string("hdri/") + file + ".exr");
        const auto exr = readExr(path);
        ASSERT_TRUE(exr.ok()) << exr.error().describe();
        EXPECT_EQ(exr->compression, ExrCompression::Dwab);
        const auto image = exrLayer(*exr, "");
        ASSERT_TRUE(image.ok()) << image.error().describe();
        ASSERT_EQ(image->width, 1024);
        ASSERT_EQ(image->height, 512);
        const float expected[] = {red, green, blue};
        for (int c = 0; c < 3; ++c) {
            float peak = 0.0f;
            for (std::size_t i = c; i < image->pixels.size(); i += 3) peak = std::max(peak, image->pixels[i]);
            EXPECT_EQ(peak, expected[c]) << file << ' ' << c;
        }
    }
}

// Means as numpy makes them of the OpenEXR Python package's pixels.
TEST(Exr, GroundTruthOfThePathTracedCaptureReads) {
    const struct {
        const char* kind;
        int channels;
        double mean;
    } cases[] = {{"color", 4, (0.014250597947 + 0.012974427100 + 0.014482525902 + 0.067195494970) / 4},
                 {"albedo", 3, (0.014421426963 + 0.014435031645 + 0.013721732830) / 3},
                 {"depth", 1, 0.214853776901},
                 {"normal", 3, (0.015221422495 + 0.008032549466 + 0.046768338010) / 3},
                 {"ao", 1, 0.070769437899},
                 {"roughness", 1, 0.047926141651}};
    for (const auto& [kind, channels, mean] : cases) {
        ARS_TEST_DATA_FILE(path, fmt::format("capture/casual_val/heldout_views/24110013/gt/{}/00000000.exr", kind));
        const auto image = readImageFile(path);
        ASSERT_TRUE(image.ok()) << image.error().describe();
        EXPECT_EQ(image->width, 384);
        EXPECT_EQ(image->height, 512);
        ASSERT_EQ(image->channels, channels) << kind;
        double sum = 0.0;
        for (const float value : image->pixels) sum += value;
        EXPECT_NEAR(sum / double(image->pixels.size()), mean, 1e-8) << kind;
    }
}

} // namespace
} // namespace ars
