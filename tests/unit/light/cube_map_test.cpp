#include "engine/light/environment.h"
#include "tests/support/test_data.h"
#include "tests/unit/light/light_support.h"

#include "engine/io/image_file.h"

#include <numbers>

namespace ars {
namespace {

using test::Direction;
constexpr double kPi = std::numbers::pi;

double relative(const glm::dvec3& a, const glm::dvec3& b) { return glm::length(a - b) / glm::length(b); }

TEST(TexelAreas, ExactOnesFillTheSphereAndMatchQuadrature) {
    for (const int size : {1, 2, 7, 16, 64}) {
        const std::vector<float> areas = texelSolidAngles(size);
        double sum = 0.0;
        for (const float a : areas) sum += double(a);
        EXPECT_NEAR(6.0 * sum, 4.0 * kPi, 2e-6 * 4.0 * kPi) << size;
    }
    // One texel by 200 x 200 midpoints of dA / (1 + u^2 + v^2)^(3/2).
    const int size = 16, row = 2, column = 13, fine = 200;
    double sum = 0.0;
    for (int i = 0; i < fine; ++i) {
        for (int j = 0; j < fine; ++j) {
            const double u = 2.0 * (column + (j + 0.5) / fine) / size - 1.0;
            const double v = 2.0 * (row + (i + 0.5) / fine) / size - 1.0;
            sum += std::pow(1.0 + u * u + v * v, -1.5);
        }
    }
    sum *= std::pow(2.0 / (size * fine), 2.0);
    EXPECT_NEAR(double(texelSolidAngles(size)[row * size + column]), sum, 1e-6 * sum);
}

TEST(TexelAreas, TheParityOnesHaveTheMeasuredExcess) {
    // The excess that was measured on nvdiffrec's kernels at this side.
    double sum = 0.0;
    for (const float a : texelSolidAngles(16, TexelArea::Nvdiffrec)) sum += double(a);
    EXPECT_NEAR(6.0 * sum / (4.0 * kPi), 1.0818, 1e-3);
}

TEST(LatLong, FollowsTheConvention) {
    // +z in the centre, +x a quarter to the left, +y on top.
    EXPECT_NEAR(glm::length(latLongDirection(0.5, 0.5) - Direction(0, 0, 1)), 0.0, 1e-12);
    EXPECT_NEAR(glm::length(latLongDirection(0.25, 0.5) - Direction(1, 0, 0)), 0.0, 1e-12);
    EXPECT_NEAR(latLongDirection(0.3, 0.0).y, 1.0, 1e-12);
    const Direction d = glm::normalize(Direction(0.3, -0.5, -0.7));
    const glm::dvec2 place = latLongPlace(d);
    EXPECT_NEAR(glm::length(latLongDirection(place.x, place.y) - d), 0.0, 1e-12);
}

TEST(CubeConversion, PutsEveryDirectionWhereItBelongs) {
    const auto radiance = [](const Direction& d) { return glm::dvec3(1.5 + d.x, 1.5 + d.y, 1.5 + d.z); };
    const auto cube = cubeFromLatLong(test::latLongOf(256, 128, radiance), 32);
    ASSERT_TRUE(cube.ok());
    double worst = 0.0;
    const CubeMap expected = test::cubeOf(32, radiance);
    for (std::size_t i = 0; i < expected.texels.size(); ++i) {
        worst = std::max(worst, double(std::fabs(cube->texels[i] - expected.texels[i])));
    }
    // Most: at the poles, where a mean by solid angle lies a sixth of a pixel (of the halved picture) off the centre.
    EXPECT_LT(worst, 4e-3);
}

// L6.
TEST(CubeConversion, RoundTripOfASmoothMapIsWithinOnePercent) {
    const auto radiance = [](const Direction& d) {
        return glm::dvec3(2.0 + d.x * d.y, 2.0 + std::sin(3.0 * d.z), 1.5 + d.y);
    };
    const Image before = test::latLongOf(256, 128, radiance);
    const auto cube = cubeFromLatLong(before, 64);
    ASSERT_TRUE(cube.ok());
    const auto after = latLongFromCube(*cube, 256, 128);
    ASSERT_TRUE(after.ok());
    double worst = 0.0;
    for (std::size_t i = 0; i < before.pixels.size(); ++i) {
        worst = std::max(worst, double(std::fabs(after->pixels[i] - before.pixels[i]) / before.pixels[i]));
    }
    EXPECT_LT(worst, 1e-2);
}

TEST(CubeConversion, ATinySunKeepsItsEnergyAndItsPlace) {
    for (const int width : {16, 128, 512}) {
        for (const int size : {16, 64, 100}) {
            for (const double height : {0.03, 0.4, 0.5}) {
                Image picture = test::latLongOf(width, width / 2, [](const Direction&) { return glm::dvec3(0.1); });
                const int row = static_cast<int>(height * picture.height), column = width / 5;
                picture.at(row, column, 0) = 50000.0f;
                picture.at(row, column, 1) = 40000.0f;
                const auto cube = cubeFromLatLong(picture, size);
                ASSERT_TRUE(cube.ok());
                EXPECT_LT(relative(totalFlux(*cube), totalFlux(picture)), 1e-3)
                    << width << " " << size << " " << height;
                // The first moment: where the light comes from.
                const std::vector<float> areas = texelSolidAngles(size);
                Direction moment(0.0);
                for (int face = 0; face < 6; ++face) {
                    for (int i = 0; i < size * size; ++i) {
                        moment += test::texelDirection(face, i / size, i % size, size) *
                                  double(cube->texel(face, i / size, i % size)[0] * areas[static_cast<std::size_t>(i)]);
                    }
                }
                const Direction sun = latLongDirection((column + 0.5) / width, (row + 0.5) / picture.height);
                // Half of the coarser of the two texels.
                EXPECT_LT(std::acos(std::min(1.0, glm::dot(glm::normalize(moment), sun))),
                          std::max(kPi / width, 0.5 * kPi / size) * 0.7);
            }
        }
    }
}

TEST(CubeConversion, ConstantLightStaysConstantWhateverTheSizes) {
    for (const int width : {1, 2, 64, 500, 512}) {
        Image picture =
            test::latLongOf(width, std::max(width / 2, 1), [](const Direction&) { return glm::dvec3(0.7); });
        for (const int size : {1, 5, 64}) {
            const auto cube = cubeFromLatLong(picture, size);
            ASSERT_TRUE(cube.ok());
            for (const float v : cube->texels) EXPECT_NEAR(v, 0.7f, 1e-5f) << width << " " << size;
        }
    }
}

TEST(CubeConversion, BlackStaysBlack) {
    const auto cube = cubeFromLatLong(uniformEnvironment(0.0f).picture, 16);
    ASSERT_TRUE(cube.ok());
    for (const float v : cube->texels) EXPECT_EQ(v, 0.0f);
    const auto back = latLongFromCube(*cube, 32, 16);
    ASSERT_TRUE(back.ok());
    for (const float v : back->pixels) EXPECT_EQ(v, 0.0f);
}

TEST(CubeConversion, RealEnvironmentsKeepTheirLight) {
    for (const char* name : {"courtyard", "sunset", "night", "studio"}) {
        ARS_TEST_DATA_FILE(path, std::string("hdri/") + name + ".exr");
        const auto environment = readEnvironment(path);
        ASSERT_TRUE(environment.ok()) << environment.error().describe();
        const auto cube = cubeFromLatLong(environment->picture, 64);
        ASSERT_TRUE(cube.ok());
        EXPECT_LT(relative(totalFlux(*cube), totalFlux(environment->picture)), 1e-3) << name;
        for (const float v : cube->texels) ASSERT_GE(v, 0.0f);
    }
}

TEST(CubeConversion, RefusesWhatItCannotConvert) {
    const Image good = uniformEnvironment(1.0f).picture;
    EXPECT_EQ(cubeFromLatLong(good, 0).error().code, ErrorCode::InvalidArgument);
    EXPECT_EQ(cubeFromLatLong(good, 1 << 20).error().code, ErrorCode::InvalidArgument);
    Image encoded = good;
    encoded.space = ColorSpace::Srgb;
    EXPECT_EQ(cubeFromLatLong(encoded, 16).error().code, ErrorCode::InvalidArgument);
    Image shortOne = good;
    shortOne.pixels.pop_back();
    EXPECT_EQ(cubeFromLatLong(shortOne, 16).error().code, ErrorCode::InvalidArgument);
    EXPECT_FALSE(latLongFromCube(CubeMap(4), 0, 4).ok());
}

} // namespace
} // namespace ars
