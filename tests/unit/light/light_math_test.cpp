#include "tests/unit/light/light_support.h"

namespace ars {
namespace {

using test::Direction;

template <typename T>
class LightMath : public ::testing::Test {};
using Scalars = ::testing::Types<float, double>;
TYPED_TEST_SUITE(LightMath, Scalars);

Direction randomDirection(std::mt19937& random) {
    std::normal_distribution<double> normal;
    return glm::normalize(Direction(normal(random), normal(random), normal(random)));
}

TYPED_TEST(LightMath, FacesPointAsTheReferenceTableSays) {
    using T = TypeParam;
    for (int face = 0; face < 6; ++face) {
        for (int row = 0; row < 5; ++row) {
            for (int column = 0; column < 5; ++column) {
                const Direction expected = test::texelDirection(face, row, column, 5);
                const glm::vec<3, T> found =
                    glm::normalize(cubeDirection<T>(face, texelCoordinate<T>(column, 5), texelCoordinate<T>(row, 5)));
                EXPECT_NEAR(glm::length(glm::dvec3(found) - expected), 0.0, 1e-6);
                const CubePoint<T> back = cubePoint(glm::vec<3, T>(expected));
                EXPECT_EQ(back.face, face);
                EXPECT_NEAR(double(back.u), 2.0 * (column + 0.5) / 5 - 1.0, 1e-6);
                EXPECT_NEAR(double(back.v), 2.0 * (row + 0.5) / 5 - 1.0, 1e-6);
            }
        }
    }
}

TYPED_TEST(LightMath, TapsAreAPartitionOfUnityInsideTheMap) {
    using T = TypeParam;
    std::mt19937 random(1);
    for (int i = 0; i < 20000; ++i) {
        const int size = 1 + i % 7;
        const CubeTaps<T> taps = cubeTaps(glm::vec<3, T>(randomDirection(random)), size);
        double sum = 0.0;
        for (int k = 0; k < 4; ++k) {
            EXPECT_LT(taps.index[k], static_cast<std::size_t>(6 * size * size));
            EXPECT_GE(taps.weight[k], T(-1e-6));
            sum += double(taps.weight[k]);
        }
        EXPECT_NEAR(sum, 1.0, 1e-6);
    }
}

// L6: the same value from both sides of every edge and all three sides of every corner.
TYPED_TEST(LightMath, LookupIsContinuousAcrossEdgesAndCorners) {
    using T = TypeParam;
    constexpr int kSize = 8;
    const CubeMap cube = test::randomCube(kSize, 3);
    const std::vector<T> texels(cube.texels.begin(), cube.texels.end());
    const CubeView<T> view{texels.data(), kSize};
    const double h = sizeof(T) == 4 ? 1e-5 : 1e-9;
    double worst = 0.0;
    for (int a = 0; a < 3; ++a) {
        for (int s = 0; s < 4; ++s) {
            for (int step = 0; step <= 200; ++step) {
                Direction edge(0.0);
                edge[(a + 1) % 3] = s & 1 ? 1.0 : -1.0;
                edge[(a + 2) % 3] = s & 2 ? 1.0 : -1.0;
                edge[a] = -1.0 + step / 100.0;
                Direction one = edge, other = edge;
                one[(a + 1) % 3] *= 1.0 + h;
                other[(a + 2) % 3] *= 1.0 + h;
                const glm::dvec3 x = lookupCube(view, glm::vec<3, T>(one)), y = lookupCube(view, glm::vec<3, T>(other));
                worst = std::max(worst, glm::length(x - y) / glm::length(x));
            }
        }
    }
    // Slope of a random map (about 10 a texel of 1/4) times the step.
    EXPECT_LT(worst, sizeof(T) == 4 ? 1e-3 : 1e-7);
}

TYPED_TEST(LightMath, ALinearFunctionOnAFaceIsReproducedBetweenTexels) {
    using T = TypeParam;
    constexpr int kSize = 16;
    std::vector<T> texels(18 * kSize * kSize, T(0));
    for (int row = 0; row < kSize; ++row) {
        for (int column = 0; column < kSize; ++column) {
            T* texel = texels.data() + 3 * cubeTexelIndex(4, row, column, kSize);
            texel[0] = texelCoordinate<T>(column, kSize);
            texel[1] = texelCoordinate<T>(row, kSize);
            texel[2] = T(1);
        }
    }
    for (const double u : {-0.9, -0.3, 0.0, 0.41, 0.93}) {
        for (const double v : {-0.93, 0.1, 0.8}) {
            const glm::dvec3 found = lookupCube(CubeView<T>{texels.data(), kSize}, cubeDirection<T>(4, T(u), T(v)));
            EXPECT_NEAR(glm::length(found - glm::dvec3(u, v, 1.0)), 0.0, 2e-6);
        }
    }
}

// L5.
TYPED_TEST(LightMath, LevelsOfTheSixLevelLight) {
    using T = TypeParam;
    EXPECT_NEAR(double(roughnessLevel(T(0.08), 6)), 0.0, 1e-6);
    EXPECT_NEAR(double(roughnessLevel(T(0.5), 6)), 4.0, 1e-6);
    EXPECT_NEAR(double(roughnessLevel(T(1), 6)), 5.0, 1e-6);
    EXPECT_EQ(roughnessLevel(T(0), 6), T(0));
    EXPECT_EQ(roughnessLevel(T(3), 6), T(5));
    EXPECT_EQ(roughnessLevel(std::numeric_limits<T>::quiet_NaN(), 6), T(0));
    const double expected[6] = {0.08, 0.185, 0.29, 0.395, 0.5, 1.0};
    for (int l = 0; l < 6; ++l) {
        EXPECT_NEAR(double(levelRoughness<T>(l, 6)), expected[l], 1e-6);
        EXPECT_NEAR(double(roughnessLevel(levelRoughness<T>(l, 6), 6)), l, 1e-5);
    }
    EXPECT_EQ(lightLevelCount(512), 6);
    EXPECT_EQ(lightLevelCount(64), 3);
}

TYPED_TEST(LightMath, DirectionsWithoutDirectionStayInsideTheMap) {
    using T = TypeParam;
    const T nan = std::numeric_limits<T>::quiet_NaN(), inf = std::numeric_limits<T>::infinity();
    for (const glm::vec<3, T>& d : {glm::vec<3, T>(T(0)), glm::vec<3, T>(nan), glm::vec<3, T>(inf),
                                    glm::vec<3, T>(inf, nan, 0), glm::vec<3, T>(-inf, inf, 1)}) {
        for (const std::size_t index : cubeTaps(d, 4).index) EXPECT_LT(index, 96u);
    }
}

TYPED_TEST(LightMath, ALightInFrontTurnedByNinetyDegreesShinesFromTheBodysLeft) {
    using T = TypeParam;
    const glm::mat<3, 3, T> toEnvironment = worldToEnvironment(T(90));
    const glm::dvec3 found = toEnvironment * glm::vec<3, T>(1, 0, 0);
    EXPECT_NEAR(glm::length(found - glm::dvec3(0, 0, 1)), 0.0, 1e-6);
    EXPECT_NEAR(double(glm::determinant(worldToEnvironment(T(33)))), 1.0, 1e-6);
}

} // namespace
} // namespace ars
