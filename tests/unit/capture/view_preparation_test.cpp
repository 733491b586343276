// Boundary band, scale and crop of photographs, and what a view keeps when it is packed.
#include "engine/capture/view_preparation.h"

#include "engine/capture/undistortion.h"
#include "engine/capture/view_cache.h"
#include "tests/support/test_data.h"
#include "tests/unit/capture/synthetic_capture.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace ars::test {
namespace {

Image maskOf(int width, int height, const std::vector<int>& ones) {
    Image mask = filledImage(width, height, 1, 0.0f, ColorSpace::Data);
    for (std::size_t i = 0; i < ones.size(); ++i) mask.pixels[i] = static_cast<float>(ones[i]);
    return mask;
}

std::vector<int> bandOf(const Image& mask, int halfWidth) {
    const Image band = boundaryBand(mask, {0, 0, mask.width, mask.height}, 128, halfWidth);
    std::vector<int> values;
    for (const float value : band.pixels) values.push_back(static_cast<int>(value));
    return values;
}

// OpenCV's dilate(m, 5x5) ^ erode(m, 5x5), run once.
TEST(BoundaryBand, IsOpenCvsDilationMinusErosion) {
    const Image hole = maskOf(11, 9, {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, //
                                      0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, //
                                      0, 0, 0, 1, 1, 1, 1, 1, 0, 0, 0, //
                                      0, 0, 0, 1, 1, 1, 1, 1, 0, 0, 0, //
                                      0, 0, 0, 1, 1, 0, 1, 1, 0, 0, 0, //
                                      0, 0, 0, 1, 1, 1, 1, 1, 0, 0, 0, //
                                      0, 0, 0, 1, 1, 1, 1, 1, 0, 0, 0, //
                                      0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, //
                                      0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0});
    EXPECT_EQ(bandOf(hole, 2), (std::vector<int>{0, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, //
                                                 0, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, //
                                                 0, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, //
                                                 0, 1, 1, 1, 1, 1, 1, 1, 1, 1, 0, //
                                                 0, 1, 1, 1, 1, 1, 1, 1, 1, 1, 0, //
                                                 0, 1, 1, 1, 1, 1, 1, 1, 1, 1, 0, //
                                                 0, 1, 1, 1, 1, 1, 1, 1, 1, 1, 0, //
                                                 0, 1, 1, 1, 1, 1, 1, 1, 1, 1, 0, //
                                                 0, 1, 1, 1, 1, 1, 1, 1, 1, 1, 0}));
    Image half = maskOf(11, 9, {});
    for (int row = 0; row < 9; ++row) {
        for (int column = 0; column < 7; ++column) half.at(row, column, 0) = 1.0f;
    }
    std::vector<int> expected;
    for (int row = 0; row < 9; ++row) {
        for (const int value : {0, 0, 0, 0, 0, 1, 1, 1, 1, 0, 0}) expected.push_back(value);
    }
    EXPECT_EQ(bandOf(half, 2), expected) << "the picture's edge is no boundary";
    EXPECT_EQ(bandOf(half, 0), std::vector<int>(99, 0));
}

TEST(BoundaryBand, HoldsEverySoftPixelAndIsTheSameInAPart) {
    Image mask = filledImage(40, 30, 1, 0.0f, ColorSpace::Data);
    std::mt19937 random(3);
    for (float& value : mask.pixels) value = static_cast<float>(random() % 256) / 255.0f;
    const Image band = boundaryBand(mask, {0, 0, 40, 30}, 128, 0);
    for (std::size_t i = 0; i < mask.pixels.size(); ++i) {
        const int level = static_cast<int>(std::lround(mask.pixels[i] * 255.0f));
        ASSERT_EQ(band.pixels[i], level > 5 && level < 250 ? 1.0f : 0.0f) << level;
    }
    const PixelBox part{7, 9, 20, 15};
    const Image whole = boundaryBand(mask, {0, 0, 40, 30}, 200, 3);
    EXPECT_EQ(boundaryBand(mask, part, 200, 3).pixels, cropped(whole, part).pixels);
}

TEST(Crop, NeverLosesAPixelOfThePersonAndShiftsThePrincipalPoint) {
    std::mt19937 random(11);
    const CalibratedCamera camera{"c", SyntheticCapture{.width = 53, .height = 37}.camera(1), {}};
    for (int round = 0; round < 200; ++round) {
        Image color = filledImage(53, 37, 3, 0.25f, ColorSpace::Srgb);
        Image mask = filledImage(53, 37, 1, 0.0f, ColorSpace::Data);
        std::vector<glm::ivec2> person;
        for (unsigned i = 0; i < 1 + random() % 4; ++i) {
            person.emplace_back(random() % 53, random() % 37);
            mask.at(person.back().y, person.back().x, 0) = static_cast<float>(129 + random() % 127) / 255.0f;
        }
        ViewOptions options;
        options.scale = 1 + static_cast<int>(random() % 8);
        options.cropMargin = static_cast<int>(random() % 4);
        const auto view = prepareView({0, 0}, camera, color, mask, options);
        ASSERT_TRUE(view.ok());
        // The whole picture at the same scale says where the crop lies.
        options.cropMargin = -1;
        const auto whole = prepareView({0, 0}, camera, color, mask, options);
        ASSERT_TRUE(whole.ok());
        EXPECT_EQ(whole->camera.width, (53 + options.scale - 1) / options.scale);
        const double left = whole->camera.cx - view->camera.cx, top = whole->camera.cy - view->camera.cy;
        EXPECT_NEAR(left, std::round(left), 1e-9);
        EXPECT_EQ(view->camera.width, view->color.width);
        EXPECT_EQ(view->camera.height, view->band.height);
        EXPECT_NEAR(whole->camera.cx, camera.camera.cx / options.scale, 1e-12);
        EXPECT_NEAR(whole->camera.fy, camera.camera.fy / options.scale, 1e-12);
        for (const glm::ivec2 pixel : person) {
            const int x = pixel.x / options.scale - static_cast<int>(std::lround(left));
            const int y = pixel.y / options.scale - static_cast<int>(std::lround(top));
            ASSERT_TRUE(x >= 0 && x < view->mask.width && y >= 0 && y < view->mask.height);
            ASSERT_TRUE(view->mask.at(y, x, 0) > 0.0f || view->band.at(y, x, 0) > 0.0f || options.scale > 1);
        }
    }
}

TEST(Crop, AnEmptyMaskGivesTheWholePicture) {
    const CalibratedCamera camera{"c", SyntheticCapture{}.camera(0), {}};
    const auto view = prepareView({0, 0}, camera, filledImage(40, 56, 3, 0.5f, ColorSpace::Srgb),
                                  filledImage(40, 56, 1, 0.0f, ColorSpace::Data), {});
    ASSERT_TRUE(view.ok());
    EXPECT_EQ(view->mask.width, 40);
    EXPECT_EQ(view->mask.height, 56);
}

TEST(Scale, AveragesLightOverAreas) {
    Image color = filledImage(12, 8, 3, 0.0f, ColorSpace::Srgb);
    for (int row = 0; row < 8; ++row) {
        for (int column = 0; column < 12; ++column) {
            for (int c = 0; c < 3; ++c)
                color.at(row, column, c) = static_cast<float>((row * 7 + column * 3) % 11) / 10.0f;
        }
    }
    // Means of 4 x 3 blocks by numpy.
    const Image mean = areaAveraged(cropped(color, {0, 0, 12, 8}), 4);
    EXPECT_EQ(mean.width, 3);
    EXPECT_EQ(mean.height, 2);
    double sum = 0.0;
    for (int row = 0; row < 4; ++row) {
        for (int column = 4; column < 8; ++column) sum += ((row * 7 + column * 3) % 11) / 10.0;
    }
    EXPECT_NEAR(mean.at(0, 1, 2), sum / 16.0, 1e-6);
    // Black and white in equal parts are half the light, sRGB 0.7354, not 0.5.
    Image board = filledImage(4, 4, 3, 0.0f, ColorSpace::Srgb);
    for (int row = 0; row < 4; ++row) {
        for (int column = row % 2; column < 4; column += 2) {
            for (int c = 0; c < 3; ++c) board.at(row, column, c) = 1.0f;
        }
    }
    const CalibratedCamera camera{"c", SyntheticCapture{.width = 4, .height = 4}.camera(0), {}};
    const auto view = prepareView({0, 0}, camera, board, filledImage(4, 4, 1, 1.0f, ColorSpace::Data), {.scale = 2});
    ASSERT_TRUE(view.ok());
    EXPECT_NEAR(view->color.at(0, 0, 0), 0.735357f, 2e-5f);
    EXPECT_EQ(view->color.space, ColorSpace::Srgb);
}

TEST(Scale, IncompleteAreasAreNotCompared) {
    const CalibratedCamera camera{"c", SyntheticCapture{.width = 7, .height = 6}.camera(0), {}};
    const auto view = prepareView({0, 0}, camera, filledImage(7, 6, 3, 0.5f, ColorSpace::Srgb),
                                  filledImage(7, 6, 1, 1.0f, ColorSpace::Data), {.scale = 2, .cropMargin = -1});
    ASSERT_TRUE(view.ok());
    EXPECT_EQ(view->band.width, 4);
    for (int row = 0; row < 3; ++row) {
        for (int column = 0; column < 4; ++column) EXPECT_EQ(view->band.at(row, column, 0), column == 3 ? 1.0f : 0.0f);
    }
}

TEST(View, OutsideTheBandTheMaskIsZeroOrOne) {
    ARS_TEST_DATA_FILE(folder, "capture/casual");
    const auto capture = openCapture(folder);
    ASSERT_TRUE(capture.ok()) << capture.error().describe();
    for (const ViewOptions options : {ViewOptions{}, ViewOptions{.scale = 3}, ViewOptions{.cropMargin = -1}}) {
        const auto view = readView(*capture, {5, 11}, options);
        ASSERT_TRUE(view.ok()) << view.error().describe();
        std::size_t compared = 0;
        for (std::size_t i = 0; i < view->mask.pixels.size(); ++i) {
            if (view->band.pixels[i] > 0.0f) continue;
            ++compared;
            ASSERT_TRUE(view->mask.pixels[i] == 0.0f || view->mask.pixels[i] == 1.0f);
        }
        EXPECT_GT(compared, view->mask.pixels.size() / 2);
    }
}

// A known scene seen through a lens: undistorting puts a straight line back where the pinhole camera sees it.
TEST(View, ALensIsUndone) {
    CalibratedCamera camera{"c", {}, {-0.25, 0.08, 0.002, -0.001, 0.0}};
    camera.camera.width = 80;
    camera.camera.height = 60;
    camera.camera.fx = camera.camera.fy = 70.0;
    camera.camera.cx = 41.3;
    camera.camera.cy = 28.9;
    const auto lens = lensDistortion(camera);
    ASSERT_TRUE(lens.ok());
    // What the lens photographs: for each distorted pixel, find the straight ray by Newton's method.
    Image color = filledImage(80, 60, 3, 0.0f, ColorSpace::Srgb);
    color.sourceBits = 32;
    Image mask = filledImage(80, 60, 1, 1.0f, ColorSpace::Data);
    const auto light = [](double x, double y) { return 0.5 + 0.4 * std::sin(7.0 * x + 3.0 * y); };
    for (int row = 0; row < 60; ++row) {
        for (int column = 0; column < 80; ++column) {
            const glm::dvec2 target((column + 0.5 - camera.camera.cx) / 70.0, (row + 0.5 - camera.camera.cy) / 70.0);
            glm::dvec2 ray = target;
            for (int i = 0; i < 50; ++i) ray += target - distorted(*lens, ray.x, ray.y);
            for (int c = 0; c < 3; ++c) {
                color.at(row, column, c) = linearToSrgb(static_cast<float>(light(ray.x, ray.y)));
            }
        }
    }
    const auto view = prepareView({0, 0}, camera, color, mask, {.cropMargin = -1});
    ASSERT_TRUE(view.ok());
    double worst = 0.0;
    for (int row = 4; row < 56; ++row) {
        for (int column = 4; column < 76; ++column) {
            const double expected =
                light((column + 0.5 - camera.camera.cx) / 70.0, (row + 0.5 - camera.camera.cy) / 70.0);
            worst = std::max(worst, std::abs(srgbToLinear(view->color.at(row, column, 0)) - expected));
        }
    }
    // Bilinear lookup of a sine: at most h^2 / 8 times the second derivative in each axis, 0.4 (0.1^2 + 0.043^2) / 8.
    EXPECT_LT(worst, 1e-3);
}

void expectSame(const CapturedView& a, const CapturedView& b) {
    EXPECT_EQ(a.id, b.id);
    EXPECT_EQ(a.camera, b.camera);
    EXPECT_EQ(a.color.pixels, b.color.pixels);
    EXPECT_EQ(a.mask.pixels, b.mask.pixels);
    EXPECT_EQ(a.band.pixels, b.band.pixels);
    EXPECT_EQ(a.color.space, b.color.space);
    EXPECT_EQ(a.color.sourceBits, b.color.sourceBits);
    EXPECT_EQ(a.band.space, b.band.space);
    EXPECT_EQ(a.band.sourceBits, b.band.sourceBits);
    EXPECT_EQ(a.mask.width, b.mask.width);
    EXPECT_EQ(a.band.channels, b.band.channels);
    EXPECT_EQ(a.unknown.pixels, b.unknown.pixels);
    EXPECT_EQ(a.unknown.width, b.unknown.width);
    EXPECT_EQ(a.unknown.sourceBits, b.unknown.sourceBits);
}

/// A person who is cut by the picture's edge on all sides, seen through a lens that sees less than the picture holds.
CapturedView cutByTheLens(std::vector<double> distortion, int scale) {
    CalibratedCamera camera{"c", SyntheticCapture{}.camera(0), std::move(distortion)};
    const auto view = prepareView({0, 0}, camera, filledImage(40, 56, 3, 0.5f, ColorSpace::Srgb),
                                  filledImage(40, 56, 1, 1.0f, ColorSpace::Data), {.scale = scale});
    EXPECT_TRUE(view.ok());
    return view ? *view : CapturedView();
}

TEST(View, WhatALensNeverSawIsUnknown) {
    for (const int scale : {1, 3}) {
        const CapturedView view = cutByTheLens({1.0, 0.0, 0.0, 0.0}, scale);
        ASSERT_EQ(view.unknown.pixels.size(), view.mask.pixels.size());
        std::size_t unknown = 0;
        for (std::size_t i = 0; i < view.mask.pixels.size(); ++i) {
            if (view.unknown.pixels[i] == 1.0f) {
                ++unknown;
                EXPECT_EQ(view.band.pixels[i], 1.0f) << "its colour is compared with nothing";
                continue;
            }
            EXPECT_EQ(view.unknown.pixels[i], 0.0f);
            EXPECT_EQ(view.mask.pixels[i], 1.0f) << "all that was seen is the person, scale " << scale;
        }
        EXPECT_GT(unknown, view.mask.pixels.size() / 20);
        EXPECT_EQ(view.unknown.at(view.unknown.height / 2, view.unknown.width / 2, 0), 0.0f);
        EXPECT_EQ(view.unknown.at(0, 0, 0), 1.0f);
        const auto again = unpackView(packView(view));
        ASSERT_TRUE(again.ok()) << again.error().describe();
        expectSame(view, *again);
    }
    // 40 x 56 is no multiple of 3: the last column and row are made of fewer pixels, but these were seen.
    EXPECT_TRUE(cutByTheLens({}, 1).unknown.pixels.empty());
    EXPECT_TRUE(cutByTheLens({}, 3).unknown.pixels.empty());
}

TEST(PackedView, KeepsEveryNumber) {
    ARS_TEST_DATA_FILE(folder, "capture/casual");
    const auto capture = openCapture(folder);
    ASSERT_TRUE(capture.ok());
    for (const int scale : {1, 2, 3}) {
        const auto view = readView(*capture, {3, 7}, {.scale = scale});
        ASSERT_TRUE(view.ok());
        const auto bytes = packView(*view);
        const auto again = unpackView(bytes);
        ASSERT_TRUE(again.ok()) << again.error().describe();
        expectSame(*view, *again);
        const std::size_t pixels = view->mask.pixels.size();
        EXPECT_LT(bytes.size(), pixels * (scale == 1 ? 4 : 8) + pixels / 8 + 400) << "8 bits where they do";
    }
}

TEST(PackedView, DamagedBytesAreRefused) {
    const CalibratedCamera camera{"c", SyntheticCapture{}.camera(0), {}};
    const auto view = prepareView({1, 2}, camera, filledImage(40, 56, 3, 0.5f, ColorSpace::Srgb),
                                  filledImage(40, 56, 1, 1.0f, ColorSpace::Data), {});
    ASSERT_TRUE(view.ok());
    const auto bytes = packView(*view);
    ASSERT_TRUE(unpackView(bytes).ok());
    for (std::size_t i = 0; i < bytes.size(); i += 1 + i / 50) {
        auto wrong = bytes;
        wrong[i] ^= std::byte{4};
        EXPECT_FALSE(unpackView(wrong).ok()) << i;
    }
    for (const std::size_t length : {std::size_t(0), std::size_t(10), std::size_t(200), bytes.size() - 1}) {
        EXPECT_FALSE(unpackView(std::span(bytes).first(length)).ok());
    }
    auto longer = bytes;
    longer.push_back(std::byte{0});
    EXPECT_FALSE(unpackView(longer).ok());
}

} // namespace
} // namespace ars::test
