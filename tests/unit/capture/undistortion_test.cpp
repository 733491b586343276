// The lens model against OpenCV 5.0.0's initUndistortRectifyMap and remap, run once; its pixel centres lie at whole
// numbers, so half a pixel was taken from principal points going in and added to positions coming out.
#include "engine/capture/undistortion.h"

#include "tests/support/test_data.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace ars::test {
namespace {

struct Looked {
    int row, column;
    double u, v; ///< where OpenCV looks
};

Camera cameraOf(int width, int height, double fx, double fy, double cx, double cy) {
    Camera camera;
    camera.width = width;
    camera.height = height;
    camera.fx = fx;
    camera.fy = fy;
    camera.cx = cx;
    camera.cy = cy;
    return camera;
}

void expectMap(const Camera& camera, const std::vector<double>& coefficients, const std::vector<Looked>& expected,
               float tolerance) {
    const auto lens = lensDistortion({"lens", camera, coefficients});
    ASSERT_TRUE(lens.ok()) << lens.error().describe();
    const Image map = undistortionMap(camera, *lens);
    for (const Looked& looked : expected) {
        EXPECT_NEAR(map.at(looked.row, looked.column, 0), looked.u, tolerance) << looked.row << " " << looked.column;
        EXPECT_NEAR(map.at(looked.row, looked.column, 1), looked.v, tolerance) << looked.row << " " << looked.column;
    }
}

// Four real lenses: the calibration of Pose2Sim's example recording (BSD-3), intrinsics divided by its 64 units a
// pixel. OpenCV hands out floats: at 1,920 pixels their step is 1.2e-4.
TEST(Undistortion, RealLensesLookWhereOpenCvLooks) {
    const float tolerance = 3e-4f;
    expectMap(cameraOf(1088, 1920, 1681.244873046875, 1681.075439453125, 532.97369384375, 948.137390140625),
              {-0.046183, 0.139983, 0.000608, 0.00069, 0.0},
              {{0, 0, -1.1644525527954102, -2.8980300426483154},
               {0, 1087, 1091.06689453125, -4.3139166831970215},
               {1919, 0, -2.5121402740478516, 1926.3575439453125},
               {1919, 1087, 1092.52978515625, 1927.863525390625},
               {960, 544, 544.5003051757812, 960.500244140625},
               {100, 900, 900.3025512695312, 102.07220458984375},
               {1500, 37, 39.5550537109375, 1498.6600341796875}},
              tolerance);
    expectMap(cameraOf(1088, 1920, 1673.729614265625, 1673.79724121875, 534.494567875, 963.225891109375),
              {-0.047847, 0.136786, 0.000972, 0.000291, 0.0},
              {{0, 0, -1.2101597785949707, -2.2592499256134033},
               {1919, 1087, 1091.2589111328125, 1926.341796875},
               {1500, 37, 39.4303092956543, 1498.824951171875}},
              tolerance);
    expectMap(cameraOf(1088, 1920, 1681.598388671875, 1681.509887703125, 513.20837403125, 955.005126953125),
              {-0.046705, 0.137622, -0.000542, -0.000517, 0.0},
              {{0, 0, -2.55902361869812, -4.901362419128418},
               {1919, 1087, 1090.29541015625, 1924.4393310546875},
               {100, 900, 899.884521484375, 100.9771499633789}},
              tolerance);
    expectMap(cameraOf(1088, 1920, 1675.234985359375, 1675.204223640625, 540.106201171875, 964.0302734375),
              {-0.047633, 0.134667, 0.000277, 0.000199, 0.0},
              {{0, 1087, 1090.24853515625, -3.8781046867370605},
               {1919, 0, -1.807760238647461, 1924.0386962890625},
               {1500, 37, 39.63534164428711, 1498.378662109375}},
              tolerance);
}

TEST(Undistortion, StrongLensesLookWhereOpenCvLooks) {
    const Camera camera = cameraOf(640, 480, 410.0, 395.0, 300.25, 260.75);
    expectMap(camera, {-0.31, 0.12, 0.004, -0.003, -0.021},
              {{0, 0, 61.55213165283203, 56.0716667175293},
               {0, 639, 557.972412109375, 63.75455093383789},
               {479, 0, 53.28257369995117, 441.55462646484375},
               {479, 639, 566.9095458984375, 435.0458984375},
               {260, 300, 300.5, 260.5},
               {13, 500, 467.4989318847656, 54.28529357910156},
               {400, 77, 100.2765121459961, 386.5501403808594}},
              1e-4f);
    expectMap(camera, {0.11, -0.04, 0.002, -0.001, 0.013, 0.42, 0.05, -0.007},
              {{0, 0, 76.36304473876953, 67.47607421875},
               {0, 639, 541.4573364257812, 76.2437515258789},
               {479, 0, 66.72055053710938, 431.5867614746094},
               {479, 639, 551.7708740234375, 423.9770812988281},
               {260, 300, 300.5, 260.5},
               {13, 500, 464.2412414550781, 58.447818756103516},
               {400, 77, 103.97766876220703, 384.11224365234375}},
              1e-4f);
}

TEST(Undistortion, APictureComesOutAsOpenCvsDoes) {
    const Camera camera = cameraOf(16, 12, 14.0, 14.5, 7.6, 6.3);
    Image source;
    source.width = 16;
    source.height = 12;
    source.channels = 1;
    source.pixels.resize(16 * 12);
    for (int row = 0; row < 12; ++row) {
        for (int column = 0; column < 16; ++column) {
            source.at(row, column, 0) = static_cast<float>(0.5 + 0.4 * std::sin(0.7 * column) * std::cos(0.5 * row));
        }
    }
    const auto lens = lensDistortion({"lens", camera, {-0.12, 0.03, 0.004, -0.003, 0.0}});
    ASSERT_TRUE(lens.ok());
    Image inside;
    const Image result = resampled(source, undistortionMap(camera, *lens), inside);
    // remap's bilinear weights come in steps of 1/32 pixel: half a step times the steepest slope (0.28 a pixel), twice.
    const float tolerance = 0.009f;
    const std::vector<std::vector<float>> expected = {
        {0.635042f, 0.666686f, 0.425239f, 0.295574f, 0.499644f, 0.691661f, 0.581252f},
        {0.380322f, 0.356586f, 0.559663f, 0.664429f, 0.498533f, 0.334192f, 0.429154f},
        {0.230417f, 0.164531f, 0.63944f, 0.889046f, 0.494969f, 0.114646f, 0.343571f},
        {0.318775f, 0.277743f, 0.592578f, 0.757063f, 0.497346f, 0.243818f, 0.393533f}};
    for (int i = 0; i < 4; ++i) {
        for (int j = 0; j < 7; ++j) {
            const float value = expected[static_cast<std::size_t>(i)][static_cast<std::size_t>(j)];
            EXPECT_NEAR(result.at(2 + 2 * i, 1 + 2 * j, 0), value, tolerance) << i << " " << j;
            EXPECT_EQ(inside.at(2 + 2 * i, 1 + 2 * j, 0), 1.0f);
        }
    }
}

TEST(Undistortion, WithoutCoefficientsNothingMoves) {
    const Camera camera = cameraOf(31, 17, 40.0, 41.0, 12.2, 9.1);
    Image source;
    source.width = 31;
    source.height = 17;
    source.channels = 3;
    source.pixels.resize(31 * 17 * 3);
    for (std::size_t i = 0; i < source.pixels.size(); ++i) source.pixels[i] = static_cast<float>(i % 97) / 97.0f;
    Image inside;
    const Image result = resampled(source, undistortionMap(camera, {}), inside);
    for (std::size_t i = 0; i < source.pixels.size(); ++i) ASSERT_NEAR(result.pixels[i], source.pixels[i], 1e-5f);
}

TEST(Undistortion, WhatTheLensDidNotSeeIsMarked) {
    // A pincushion lens: corners look beyond the picture.
    const Camera camera = cameraOf(20, 20, 20.0, 20.0, 10.0, 10.0);
    Image source;
    source.width = source.height = 20;
    source.channels = 1;
    source.pixels.assign(400, 1.0f);
    Image inside;
    const Image result = resampled(source, undistortionMap(camera, {0.3, 0.0, 0.0, 0.0, 0.0}), inside);
    EXPECT_EQ(inside.at(0, 0, 0), 0.0f);
    EXPECT_EQ(inside.at(19, 19, 0), 0.0f);
    EXPECT_EQ(inside.at(10, 10, 0), 1.0f);
    EXPECT_EQ(result.at(0, 0, 0), 1.0f) << "the nearest pixel";
    // A polynomial that folds back: r (1 - r^2) falls beyond r = 0.577, which lies inside this picture.
    Image wide;
    const Camera open = cameraOf(20, 20, 8.0, 8.0, 10.0, 10.0);
    (void)resampled(source, undistortionMap(open, {-1.0, 0.0, 0.0, 0.0, 0.0}), wide);
    EXPECT_EQ(wide.at(10, 10, 0), 1.0f);
    EXPECT_EQ(wide.at(10, 16, 0), 0.0f) << "r = 0.81";
}

TEST(Undistortion, TheSlopeIsTheDerivative) {
    const LensDistortion<double> lens{0.11, -0.04, 0.0, 0.0, 0.013, 0.42, 0.05, -0.007};
    for (const double r : {0.0, 0.2, 0.9, 1.7}) {
        const double h = 1e-6;
        const double slope = (distorted(lens, r + h, 0.0).x - distorted(lens, r - h, 0.0).x) / (2.0 * h);
        EXPECT_NEAR(radialSlope(lens, r, 0.0), slope, 1e-8);
    }
}

TEST(Undistortion, OtherNumbersOfCoefficientsAreRefused) {
    const auto message = [](std::vector<double> coefficients) {
        const auto lens = lensDistortion({"left", {}, std::move(coefficients)});
        return lens.ok() ? std::string() : lens.error().describe();
    };
    EXPECT_EQ(message({}), "");
    EXPECT_EQ(message({0.1, 0.1, 0.0, 0.0}), "");
    EXPECT_EQ(message({0.1}),
              "camera \"left\": distCoeff has 1 numbers, expected 4, 5, 8, 12 or 14 (k1 k2 p1 p2 k3 ...)");
    EXPECT_EQ(message(std::vector<double>(12, 0.0)), "");
    EXPECT_NE(message(std::vector<double>(12, 0.1)).find("thin prism"), std::string::npos);
}

} // namespace
} // namespace ars::test
