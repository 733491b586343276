#include "engine/light/environment.h"

#include "engine/core/file.h"
#include "engine/io/exr.h"
#include "engine/io/hdr.h"
#include "engine/io/png.h"
#include "tests/support/test_data.h"
#include "tests/unit/light/light_support.h"

#include <limits>

namespace ars {
namespace {

using test::Direction;
using test::TemporaryFolder;

Image picture(int width, int height, float value = 0.5f) {
    Image image;
    image.width = width;
    image.height = height;
    image.channels = 3;
    image.pixels.assign(3 * static_cast<std::size_t>(width) * static_cast<std::size_t>(height), value);
    return image;
}

/// What the environment shows along a direction.
glm::dvec3 seen(const Image& latLong, const Direction& d) {
    const glm::dvec2 place = latLongPlace(d);
    const int column = std::min(static_cast<int>(place.x * latLong.width), latLong.width - 1);
    const int row = std::min(static_cast<int>(place.y * latLong.height), latLong.height - 1);
    return {latLong.at(row, column, 0), latLong.at(row, column, 1), latLong.at(row, column, 2)};
}

/// A colour of its own for every direction.
glm::dvec3 paint(const Direction& d) { return glm::dvec3(2.0) + d; }

/// A cube of side 16 of paint() in a picture of all faces.
Image faceSheet(int columns, int rows, const int (&places)[6][2], bool turnLast) {
    Image sheet = picture(16 * columns, 16 * rows, 0.0f);
    for (int face = 0; face < 6; ++face) {
        for (int i = 0; i < 256; ++i) {
            int row = i / 16, column = i % 16;
            const glm::dvec3 color = paint(test::texelDirection(face, row, column, 16));
            if (face == 5 && turnLast) row = 15 - row, column = 15 - column;
            for (int c = 0; c < 3; ++c) {
                sheet.at(16 * places[face][1] + row, 16 * places[face][0] + column, c) = static_cast<float>(color[c]);
            }
        }
    }
    return sheet;
}

void expectPainted(const Result<Environment>& environment) {
    ASSERT_TRUE(environment.ok()) << environment.error().describe();
    EXPECT_EQ(environment->picture.width, 64);
    EXPECT_EQ(environment->picture.height, 32);
    std::mt19937 random(3);
    std::normal_distribution<double> normal;
    for (int i = 0; i < 200; ++i) {
        const Direction d = glm::normalize(Direction(normal(random), normal(random), normal(random)));
        // A texel of the cube and one of the picture are 0.1 wide each.
        EXPECT_LT(glm::length(seen(environment->picture, d) - paint(d)), 0.1);
    }
}

TEST(Environment, CubeSheetsOfAllFourShapesShowTheSame) {
    expectPainted(environmentFromImage(faceSheet(4, 3, {{2, 1}, {0, 1}, {1, 0}, {1, 2}, {1, 1}, {3, 1}}, false)));
    expectPainted(environmentFromImage(faceSheet(3, 4, {{2, 1}, {0, 1}, {1, 0}, {1, 2}, {1, 1}, {1, 3}}, true)));
    expectPainted(environmentFromImage(faceSheet(6, 1, {{0, 0}, {1, 0}, {2, 0}, {3, 0}, {4, 0}, {5, 0}}, false)));
    expectPainted(environmentFromImage(faceSheet(1, 6, {{0, 0}, {0, 1}, {0, 2}, {0, 3}, {0, 4}, {0, 5}}, false)));
}

void writeFaces(const TemporaryFolder& folder) {
    const char* names[6] = {"px.exr", "nx.exr", "posy.exr", "ny.exr", "pz.exr", "nz.exr"};
    for (int face = 0; face < 6; ++face) {
        Image image = picture(16, 16);
        for (int i = 0; i < 256; ++i) {
            const glm::dvec3 color = paint(test::texelDirection(face, i / 16, i % 16, 16));
            for (int c = 0; c < 3; ++c) image.at(i / 16, i % 16, c) = static_cast<float>(color[c]);
        }
        ExrImage exr;
        ASSERT_TRUE(addExrLayer(exr, "", image, "RGB").ok());
        ASSERT_TRUE(writeExr(folder / names[face], exr).ok());
    }
}

TEST(Environment, AFolderOfSixFacesShowsTheSame) {
    const TemporaryFolder folder;
    writeFaces(folder);
    expectPainted(readEnvironment(folder.path()));
}

TEST(Environment, AMissingOrUnequalFaceIsNamed) {
    const TemporaryFolder folder;
    writeFaces(folder);
    std::filesystem::remove(folder / "ny.exr");
    const auto missing = readEnvironment(folder.path());
    ASSERT_FALSE(missing.ok());
    EXPECT_EQ(missing.error().code, ErrorCode::NotFound);
    EXPECT_NE(missing.error().describe().find("ny"), std::string::npos) << missing.error().describe();
    ASSERT_TRUE(writeHdr(folder / "ny.hdr", picture(8, 8)).ok());
    const auto unequal = readEnvironment(folder.path());
    ASSERT_FALSE(unequal.ok());
    EXPECT_EQ(unequal.error().code, ErrorCode::BadFile);
    EXPECT_NE(unequal.error().describe().find("ny: 8x8 pixels, expected a square of 16"), std::string::npos)
        << unequal.error().describe();
}

TEST(Environment, BrokenNumbersAreMendedAndCounted) {
    Image image = picture(4, 2, 3.0f);
    image.pixels[0] = std::numeric_limits<float>::quiet_NaN();
    image.pixels[1] = image.pixels[2] = -1.0f;
    image.pixels[3] = std::numeric_limits<float>::infinity();
    image.pixels[4] = -std::numeric_limits<float>::infinity();
    image.pixels[5] = 7.0f;
    const auto environment = environmentFromImage(image);
    ASSERT_TRUE(environment.ok());
    const std::vector<float> expected = {0, 0, 0, 7, 0, 7};
    for (std::size_t i = 0; i < 6; ++i) EXPECT_EQ(environment->picture.pixels[i], expected[i]);
    ASSERT_EQ(environment->notes.size(), 3u);
    EXPECT_NE(environment->notes[0].find("1 of 24"), std::string::npos) << environment->notes[0];
    EXPECT_NE(environment->notes[1].find("3 of 24 numbers are negative"), std::string::npos) << environment->notes[1];
    EXPECT_NE(environment->notes[2].find("set to 7"), std::string::npos) << environment->notes[2];
}

TEST(Environment, InfinityWithoutAnyOtherLightBecomesTheBrightestHalf) {
    const auto environment = environmentFromImage(picture(2, 1, std::numeric_limits<float>::infinity()));
    ASSERT_TRUE(environment.ok());
    for (const float v : environment->picture.pixels) EXPECT_EQ(v, 65504.0f);
}

TEST(Environment, OnePixelAndBlackAreEnvironments) {
    for (const float value : {0.0f, 2.0f}) {
        const auto environment = environmentFromImage(picture(1, 1, value));
        ASSERT_TRUE(environment.ok());
        EXPECT_TRUE(environment->notes.empty());
        const auto cube = cubeFromLatLong(environment->picture, 64);
        ASSERT_TRUE(cube.ok());
        const PrefilteredLight light = test::filtered({}, *cube);
        for (const float v : test::download(light.diffuse)) EXPECT_NEAR(v, value, 1e-3f);
    }
}

TEST(Environment, GreyAlphaAndEncodedPicturesBecomeLinearColour) {
    Image grey = picture(2, 1);
    grey.channels = 2;
    grey.pixels = {0.25f, 1.0f, 4.0f, 0.5f};
    const auto color = environmentFromImage(grey);
    ASSERT_TRUE(color.ok());
    EXPECT_EQ(color->picture.pixels, (std::vector<float>{0.25f, 0.25f, 0.25f, 4.0f, 4.0f, 4.0f}));
    Image encoded = picture(2, 1, 0.5f);
    encoded.space = ColorSpace::Srgb;
    encoded.sourceBits = 8;
    const auto decoded = environmentFromImage(encoded);
    ASSERT_TRUE(decoded.ok());
    EXPECT_NEAR(decoded->picture.pixels[0], 0.2140411f, 1e-6f);
    ASSERT_EQ(decoded->notes.size(), 1u);
    EXPECT_NE(decoded->notes[0].find("sRGB"), std::string::npos);
}

TEST(Environment, OtherShapesAreStretchedWithANoteOrRefused) {
    const auto nearly = environmentFromImage(picture(1920 / 10, 1080 / 10));
    ASSERT_TRUE(nearly.ok());
    EXPECT_EQ(nearly->notes.size(), 1u);
    for (const auto& size : {std::pair{100, 100}, {300, 100}, {100, 300}, {7, 1}}) {
        const auto refused = environmentFromImage(picture(size.first, size.second));
        ASSERT_FALSE(refused.ok()) << size.first;
        EXPECT_EQ(refused.error().code, ErrorCode::BadFile);
        EXPECT_NE(refused.error().describe().find("expected 2:1"), std::string::npos);
    }
}

TEST(Environment, FilesThatAreNoneAreRefusedByName) {
    const TemporaryFolder folder;
    ASSERT_TRUE(writeHdr(folder / "sky.hdr", picture(64, 32)).ok());
    EXPECT_TRUE(readEnvironment(folder / "sky.hdr").ok());
    auto bytes = readFile(folder / "sky.hdr");
    ASSERT_TRUE(bytes.ok());
    bytes->resize(bytes->size() / 2);
    ASSERT_TRUE(writeFileAtomic(folder / "half.hdr", *bytes).ok());
    const auto truncated = readEnvironment(folder / "half.hdr");
    ASSERT_FALSE(truncated.ok());
    EXPECT_EQ(truncated.error().code, ErrorCode::BadFile);
    EXPECT_NE(truncated.error().describe().find("half.hdr"), std::string::npos) << truncated.error().describe();
    EXPECT_EQ(readEnvironment(folder / "none.exr").error().code, ErrorCode::NotFound);
    ASSERT_TRUE(writeHdr(folder / "square.hdr", picture(32, 32)).ok());
    const auto square = readEnvironment(folder / "square.hdr");
    ASSERT_FALSE(square.ok());
    EXPECT_NE(square.error().describe().find("square.hdr"), std::string::npos) << square.error().describe();
}

TEST(Environment, PicturesWithTooFewNumbersAreRefused) {
    Image image = picture(4, 2);
    image.pixels.pop_back();
    EXPECT_EQ(environmentFromImage(image).error().code, ErrorCode::InvalidArgument);
    EXPECT_EQ(environmentFromImage(Image{}).error().code, ErrorCode::InvalidArgument);
    EXPECT_EQ(environmentFromFaces({image}).error().code, ErrorCode::InvalidArgument);
}

TEST(Environment, RealPicturesAreReadWithoutNotes) {
    ARS_TEST_DATA_FILE(courtyard, "capture/casual_val/lights/courtyard.exr");
    const auto environment = readEnvironment(courtyard);
    ASSERT_TRUE(environment.ok()) << environment.error().describe();
    EXPECT_EQ(environment->picture.width, 2 * environment->picture.height);
    for (const float v : environment->picture.pixels) ASSERT_TRUE(v >= 0.0f && v < 1e6f);
    ARS_TEST_DATA_FILE(sunset, "hdri/sunset.exr");
    // The sky is above the ground.
    const auto evening = readEnvironment(sunset);
    ASSERT_TRUE(evening.ok());
    EXPECT_GT(seen(evening->picture, {0, 1, 0}).z, seen(evening->picture, {0, -1, 0}).z);
}

} // namespace
} // namespace ars
