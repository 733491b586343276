// Backward of shading: the maths against central differences in double, the picture path against that maths.
#include "engine/shade/shading_gradient.h"
#include "engine/shade/shading_gradient_math.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <random>
#include <vector>

namespace ars {
namespace {

/// A light of random numbers; sides small, so that texels are large and borders are met.
template <typename T>
struct RandomLight {
    static constexpr int kLevels = 4, kLutSize = 12;
    std::array<std::vector<T>, kLevels> specular;
    std::vector<T> diffuse, lut;
    LightView<T> view;

    explicit RandomLight(unsigned seed) {
        std::mt19937 random(seed);
        std::uniform_real_distribution<double> unit(0.1, 1.0);
        const auto fill = [&](std::vector<T>& values, std::size_t count) {
            values.resize(count);
            for (T& v : values) v = static_cast<T>(static_cast<float>(unit(random)));
        };
        for (std::size_t l = 0; l < kLevels; ++l) {
            const int side = 8 >> std::min<std::size_t>(l, 2);
            fill(specular[l], static_cast<std::size_t>(18 * side * side));
            view.specular[l] = {specular[l].data(), side};
        }
        fill(diffuse, 18 * 4 * 4);
        fill(lut, 2 * kLutSize * kLutSize);
        view.levels = kLevels;
        view.diffuse = {diffuse.data(), 4};
        view.lut = lut.data();
        view.lutSize = kLutSize;
        view.worldToEnvironment = worldToEnvironment(T(37));
        view.scale = T(1.5);
    }
};

glm::dvec3 randomDirection(std::mt19937& random) {
    std::normal_distribution<double> normal;
    return glm::normalize(glm::dvec3(normal(random), normal(random), normal(random)));
}

/// A surface point that looks at the camera, with a normal that is not of unit length.
ShadingPoint<double> randomPoint(std::mt19937& random) {
    std::uniform_real_distribution<double> unit(0.0, 1.0);
    ShadingPoint<double> point;
    point.albedo = {unit(random), unit(random), unit(random)};
    point.roughness = 0.1 + 0.85 * unit(random);
    point.toCamera = {0.3 * (unit(random) - 0.5), 0.3 * (unit(random) - 0.5), -1.0};
    do {
        point.normal = (0.6 + unit(random)) * randomDirection(random);
    } while (glm::dot(glm::normalize(point.normal), glm::normalize(point.toCamera)) < 0.1);
    return point;
}

TEST(ShadingGradient, EqualsCentralDifferencesInDouble) {
    const RandomLight<double> light(3);
    std::mt19937 random(11);
    for (int trial = 0; trial < 300; ++trial) {
        const ShadingPoint<double> point = randomPoint(random);
        const glm::dvec3 gDiffuse = randomDirection(random), gSpecular = randomDirection(random);
        const auto loss = [&](const ShadingPoint<double>& p) {
            const ShadedPoint<double> s = shadePoint(p, light.view, light.view.worldToEnvironment, 0.04);
            return glm::dot(gDiffuse, s.diffuse) + glm::dot(gSpecular, s.specular);
        };
        const ShadingPointGradient<double> g = shadePointBackward<double>(
            point, light.view, light.view.worldToEnvironment, 0.04, gDiffuse, gSpecular, nullptr);
        const auto check = [&](const char* name, auto&& change, double expected) {
            constexpr double kStep = 1e-6;
            ShadingPoint<double> up = point, down = point;
            change(up, kStep);
            change(down, -kStep);
            EXPECT_NEAR(expected, (loss(up) - loss(down)) / (2.0 * kStep), 1e-6 * (1.0 + std::abs(expected)))
                << name << ", trial " << trial;
        };
        for (int k = 0; k < 3; ++k) {
            check("albedo", [k](ShadingPoint<double>& p, double h) { p.albedo[k] += h; }, g.albedo[k]);
            check("normal", [k](ShadingPoint<double>& p, double h) { p.normal[k] += h; }, g.normal[k]);
        }
        check("roughness", [](ShadingPoint<double>& p, double h) { p.roughness += h; }, g.roughness);
        EXPECT_NEAR(glm::dot(g.normal, point.normal), 0.0, 1e-9) << "a normal's length changes nothing";
    }
}

TEST(ShadingGradient, PassesToEveryTexelWhatDifferencesSay) {
    RandomLight<double> light(5);
    std::mt19937 random(13);
    for (int trial = 0; trial < 12; ++trial) {
        const ShadingPoint<double> point = randomPoint(random);
        const glm::dvec3 gDiffuse = randomDirection(random), gSpecular = randomDirection(random);
        LightTexelGradient<double> texels;
        shadePointBackward(point, light.view, light.view.worldToEnvironment, 0.04, gDiffuse, gSpecular, &texels);
        const auto loss = [&] {
            const ShadedPoint<double> s = shadePoint(point, light.view, light.view.worldToEnvironment, 0.04);
            return glm::dot(gDiffuse, s.diffuse) + glm::dot(gSpecular, s.specular);
        };
        const auto compare = [&](std::vector<double>& cube, const std::vector<double>& expected) {
            for (std::size_t i = 0; i < cube.size(); ++i) {
                const double kept = cube[i];
                cube[i] = kept + 1e-3; // linear in the light: any step is exact
                const double up = loss();
                cube[i] = kept - 1e-3;
                const double down = loss();
                cube[i] = kept;
                EXPECT_NEAR(expected[i], (up - down) / 2e-3, 1e-9);
            }
        };
        std::vector<double> expected(light.diffuse.size(), 0.0);
        const auto add = [&](const CubeTaps<double>& taps, const glm::dvec3& value) {
            for (int k = 0; k < 4; ++k) {
                for (int c = 0; c < 3; ++c)
                    expected[3 * taps.index[k] + static_cast<std::size_t>(c)] += taps.weight[k] * value[c];
            }
        };
        add(texels.diffuse, texels.diffuseValue);
        compare(light.diffuse, expected);
        for (std::size_t l = 0; l < RandomLight<double>::kLevels; ++l) {
            expected.assign(light.specular[l].size(), 0.0);
            for (int k = 0; k < 2; ++k) {
                if (texels.level[k] == static_cast<int>(l)) add(texels.specular[k], texels.specularValue[k]);
            }
            compare(light.specular[l], expected);
        }
    }
}

/// Pictures of random points, and the loss sum(weights x beauty).
struct Pictures {
    static constexpr int kWidth = 9, kHeight = 7, kPixels = kWidth * kHeight;
    Camera camera;
    std::vector<float> albedo, roughness, normal, opacity, occlusion, weights;

    Pictures() : camera(lookAtCamera({0.2, 0.1, 3.0}, {0.0, 0.0, 0.0}, 40.0, kWidth, kHeight)) {
        std::mt19937 random(17);
        std::uniform_real_distribution<float> unit(0.0f, 1.0f);
        for (int p = 0; p < kPixels; ++p) {
            const ShadingPoint<double> point = randomPoint(random);
            for (int c = 0; c < 3; ++c) {
                albedo.push_back(static_cast<float>(point.albedo[c]));
                normal.push_back(static_cast<float>(point.normal[c]));
            }
            roughness.push_back(static_cast<float>(point.roughness));
            opacity.push_back(p % 11 == 0 ? 0.0f : 0.2f + 0.8f * unit(random));
            occlusion.push_back(unit(random));
            for (int c = 0; c < 4; ++c) weights.push_back(unit(random) - 0.5f);
        }
    }
    ShadingInputs inputs(const LightView<float>& light) const {
        const auto view = [](const std::vector<float>& values, int channels) {
            return ImageView<const float>{values.data(), kWidth, kHeight, channels};
        };
        return {view(albedo, 3),
                view(roughness, 1),
                view(normal, 3),
                view(opacity, 1),
                view(occlusion, 1),
                {},
                camera,
                light};
    }
    double loss(const LightView<float>& light, const ShadingParams& params) const {
        std::vector<float> beauty(4 * kPixels);
        const Status status = shade({}, params, inputs(light), {{beauty.data(), kWidth, kHeight, 4}, {}, {}, {}});
        EXPECT_TRUE(status.ok());
        double sum = 0.0;
        for (std::size_t i = 0; i < beauty.size(); ++i) sum += static_cast<double>(weights[i]) * beauty[i];
        return sum;
    }
};

TEST(ShadingGradient, PicturePathFollowsDifferencesOfPictures) {
    for (const bool occludeSpecular : {true, false}) {
        Pictures pictures;
        RandomLight<float> light(7);
        const ShadingParams params{.occludeSpecular = occludeSpecular};
        constexpr int kWidth = Pictures::kWidth, kHeight = Pictures::kHeight;
        std::vector<float> albedo(3 * Pictures::kPixels), roughness(Pictures::kPixels), normal(3 * Pictures::kPixels),
            opacity(Pictures::kPixels), occlusion(Pictures::kPixels);
        LightLevelGradients levels;
        const ShadingGradientOutputs outputs{{albedo.data(), kWidth, kHeight, 3},
                                             {roughness.data(), kWidth, kHeight, 1},
                                             {normal.data(), kWidth, kHeight, 3},
                                             {opacity.data(), kWidth, kHeight, 1},
                                             {occlusion.data(), kWidth, kHeight, 1}};
        ASSERT_TRUE(shadeBackward(params, pictures.inputs(light.view), {pictures.weights.data(), kWidth, kHeight, 4},
                                  outputs, &levels)
                        .ok());
        // Float differences of a loss that is linear in these: exact but for rounding.
        const auto compare = [&](std::vector<float>& values, const std::vector<float>& expected, float step,
                                 double bound) {
            for (std::size_t i = 0; i < values.size(); i += 5) {
                const float kept = values[i];
                values[i] = kept + step;
                const double up = pictures.loss(light.view, params);
                values[i] = kept - step;
                const double down = pictures.loss(light.view, params);
                values[i] = kept;
                EXPECT_NEAR(expected[i], (up - down) / (2.0 * step), bound);
            }
        };
        compare(pictures.albedo, albedo, 0.25f, 1e-4);
        compare(pictures.occlusion, occlusion, 0.25f, 1e-4);
        compare(light.diffuse, levels.diffuse, 0.25f, 1e-4);
        for (std::size_t l = 0; l < RandomLight<float>::kLevels; ++l)
            compare(light.specular[l], levels.specular[l], 0.25f, 1e-4);
        for (std::size_t p = 0; p < Pictures::kPixels; ++p) {
            if (pictures.opacity[p] > 0.0f) continue;
            EXPECT_EQ(albedo[3 * p], 0.0f) << "an empty pixel passes nothing";
            EXPECT_EQ(occlusion[p], 0.0f);
        }
    }
}

TEST(ShadingGradient, WrongSizesAreNamed) {
    const Pictures pictures;
    const RandomLight<float> light(7);
    const Status status =
        shadeBackward({}, pictures.inputs(light.view), {pictures.weights.data(), 3, 3, 4}, {}, nullptr);
    ASSERT_FALSE(status.ok());
    EXPECT_NE(status.error().describe().find("dL/dbeauty is 3x3 with 4 channels, expected 9x7 with 4"),
              std::string::npos)
        << status.error().describe();
}

} // namespace
} // namespace ars
