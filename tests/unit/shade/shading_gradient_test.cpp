// Backward of shading: the maths against central differences in double, the picture path against that maths.
#include "engine/shade/shading_gradient.h"
#include "engine/shade/shading_gradient_kernels.h"
#include "tests/support/devices.h"
#include "tests/unit/light/light_support.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <random>
#include <utility>
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

/// What backward gives, in host memory.
struct Gradients {
    std::vector<float> albedo, roughness, normal, opacity, occlusion;
    std::vector<std::vector<float>> light; ///< specular levels, then the diffuse cube
};

constexpr int kLevels = RandomLight<float>::kLevels;

/// Pictures and light in the memory of a device, for as long as this lives.
class OnDevice {
public:
    OnDevice(const Device& device, const Pictures& pictures, const RandomLight<float>& light)
        : device_(device), inputs_(pictures.inputs(light.view)),
          weights_(upload(pictures.weights, Pictures::kWidth, 4)) {
        for (ImageView<const float>* view :
             {&inputs_.albedo, &inputs_.roughness, &inputs_.normal, &inputs_.opacity, &inputs_.occlusion}) {
            *view = upload({view->data, view->data + view->valueCount()}, view->width, view->channels);
        }
        for (int l = 0; l < kLevels; ++l) {
            const auto level = static_cast<std::size_t>(l);
            inputs_.light.specular[l].texels = cube(light.specular[level]);
        }
        inputs_.light.diffuse.texels = cube(light.diffuse);
        inputs_.light.lut = upload(light.lut, RandomLight<float>::kLutSize, 2).data;
    }

    Result<Gradients> backward(const ShadingParams& params, bool toLight = true) {
        const auto out = [&](int width, int height, int channels) {
            // Numbers that must all be written over.
            const std::size_t count = static_cast<std::size_t>(width * height * channels);
            return test::upload(device_, std::vector<float>(count, 7.0f), width, height, channels);
        };
        constexpr int w = Pictures::kWidth, h = Pictures::kHeight;
        PixelBuffer albedo = out(w, h, 3), roughness = out(w, h, 1), normal = out(w, h, 3), opacity = out(w, h, 1),
                    occlusion = out(w, h, 1);
        ShadingGradientOutputs outputs{albedo.view(),  roughness.view(), normal.view(),
                                       opacity.view(), occlusion.view(), {}};
        std::vector<PixelBuffer> cubes;
        for (int l = 0; toLight && l <= kLevels; ++l) {
            const int side = l < kLevels ? inputs_.light.specular[l].size : inputs_.light.diffuse.size;
            cubes.push_back(out(side, 6 * side, 3));
            (l < kLevels ? outputs.light.specular[static_cast<std::size_t>(l)] : outputs.light.diffuse) =
                cubes.back().view();
            outputs.light.levels = kLevels;
        }
        ARS_TRY_STATUS(shadeBackward(device_, params, inputs_, weights_, outputs, workspace_));
        Gradients result{test::download(albedo),  test::download(roughness), test::download(normal),
                         test::download(opacity), test::download(occlusion), {}};
        for (const PixelBuffer& level : cubes) result.light.push_back(test::download(level));
        return result;
    }

private:
    ImageView<const float> upload(const std::vector<float>& values, int width, int channels) {
        const int height = static_cast<int>(values.size()) / (width * channels);
        kept_.push_back(test::upload(device_, values, width, height, channels));
        return std::as_const(kept_.back()).view();
    }
    const float* cube(const std::vector<float>& texels) { return upload(texels, 1, 3).data; }

    Device device_;
    std::vector<PixelBuffer> kept_;
    ShadingInputs inputs_;
    ImageView<const float> weights_;
    ShadingGradientWorkspace workspace_;
};

/// Float differences of a loss that is linear in `values`: exact but for rounding.
void expectSlopes(Pictures& pictures, const RandomLight<float>& light, const ShadingParams& params,
                  std::vector<float>& values, const std::vector<float>& expected) {
    constexpr float kStep = 0.15f;
    for (std::size_t i = 0; i < values.size(); i += 5) {
        const float kept = values[i];
        if (&values == &pictures.opacity && kept == 0.0f) continue; // no slope where a pixel appears
        values[i] = kept + kStep;
        const double up = pictures.loss(light.view, params);
        values[i] = kept - kStep;
        const double down = pictures.loss(light.view, params);
        values[i] = kept;
        EXPECT_NEAR(expected[i], (up - down) / (2.0 * kStep), 1e-4);
    }
}

TEST(ShadingGradient, PicturePathFollowsDifferencesOfPictures) {
    for (const Device& device : test::devicesUnderTest()) {
        for (const bool occludeSpecular : {true, false}) {
            Pictures pictures;
            RandomLight<float> light(7);
            const ShadingParams params{.occludeSpecular = occludeSpecular};
            const auto g = OnDevice(device, pictures, light).backward(params);
            ASSERT_TRUE(g.ok()) << g.error().describe();
            expectSlopes(pictures, light, params, pictures.albedo, g->albedo);
            expectSlopes(pictures, light, params, pictures.occlusion, g->occlusion);
            expectSlopes(pictures, light, params, pictures.opacity, g->opacity);
            for (std::size_t l = 0; l < kLevels; ++l) {
                expectSlopes(pictures, light, params, light.specular[l], g->light[l]);
            }
            expectSlopes(pictures, light, params, light.diffuse, g->light[kLevels]);
            for (std::size_t p = 0; p < Pictures::kPixels; ++p) {
                if (pictures.opacity[p] > 0.0f) continue;
                EXPECT_EQ(g->albedo[3 * p], 0.0f) << "an empty pixel passes nothing";
                EXPECT_EQ(g->occlusion[p], 0.0f);
                EXPECT_EQ(g->normal[3 * p], 0.0f);
                EXPECT_EQ(g->roughness[p], 0.0f);
                EXPECT_EQ(g->opacity[p], 0.0f);
            }
        }
    }
}

/// Normals and roughness, of which the picture is no linear function: against the maths in double.
TEST(ShadingGradient, PicturePathIsTheMaths) {
    const Pictures pictures;
    const RandomLight<float> light(7);
    const RandomLight<double> exact(7);
    const glm::dmat3 toEnvironment = exact.view.worldToEnvironment * glm::transpose(pictures.camera.rotation);
    for (const Device& device : test::devicesUnderTest()) {
        const auto g = OnDevice(device, pictures, light).backward({});
        ASSERT_TRUE(g.ok());
        for (std::size_t p = 0; p < Pictures::kPixels; ++p) {
            if (pictures.opacity[p] == 0.0f) continue;
            const auto three = [p](const std::vector<float>& v, std::size_t stride) {
                return glm::dvec3(v[stride * p], v[stride * p + 1], v[stride * p + 2]);
            };
            const double column = static_cast<double>(p % Pictures::kWidth) + 0.5;
            const double row = static_cast<double>(p / Pictures::kWidth) + 0.5;
            const ShadingPoint<double> point{three(pictures.albedo, 3), pictures.roughness[p],
                                             three(pictures.normal, 3), -pictures.camera.ray(column, row)};
            const glm::dvec3 upper = static_cast<double>(pictures.opacity[p]) *
                                     static_cast<double>(pictures.occlusion[p]) * three(pictures.weights, 4);
            const ShadingPointGradient<double> expected =
                shadePointBackward<double>(point, exact.view, toEnvironment, 0.04, upper, upper, nullptr);
            EXPECT_NEAR(g->roughness[p], expected.roughness, 1e-3 * (0.1 + std::abs(expected.roughness)));
            for (int c = 0; c < 3; ++c) {
                EXPECT_NEAR(three(g->normal, 3)[c], expected.normal[c], 1e-3 * (0.1 + glm::length(expected.normal)));
                EXPECT_NEAR(three(g->albedo, 3)[c], expected.albedo[c], 1e-3 * (0.1 + std::abs(expected.albedo[c])));
            }
        }
    }
}

/// The pictures' own gradients do not depend on whether the light's are wanted.
TEST(ShadingGradient, TheLightCanBeLeftOut) {
    const Pictures pictures;
    const RandomLight<float> light(7);
    for (const Device& device : test::devicesUnderTest()) {
        OnDevice scene(device, pictures, light);
        const auto all = scene.backward({}), some = scene.backward({}, false);
        ASSERT_TRUE(all.ok() && some.ok());
        EXPECT_EQ(all->normal, some->normal);
        EXPECT_EQ(all->roughness, some->roughness);
        EXPECT_EQ(all->opacity, some->opacity);
        const auto again = scene.backward({});
        ASSERT_TRUE(again.ok());
        EXPECT_EQ(all->light, again->light) << "the same numbers each time";
    }
}

/// What the threads of the CUDA form do, one after the other in an order of its own: the same bodies, whole numbers in
/// place of the pieces' sums. Only the atomic addition is not run here.
struct ThreadsInALoop {
    std::vector<float> light;
    std::vector<float> albedo;

    ThreadsInALoop(const ShadingInputs& inputs, const std::vector<float>& weights, std::uint32_t seed) {
        const auto shading = shadingArguments({}, inputs);
        EXPECT_TRUE(shading.ok());
        albedo.resize(3 * Pictures::kPixels);
        ShadingGradientArguments a;
        a.shading = *shading;
        a.gradBeauty = weights.data();
        a.albedo = albedo.data();
        const LightLayout layout = lightLayout(inputs.light);
        const int bits = fixedPointBits(Pictures::kPixels);
        std::vector<int> order(Pictures::kPixels);
        for (int p = 0; p < Pictures::kPixels; ++p) order[static_cast<std::size_t>(p)] = p;
        std::shuffle(order.begin(), order.end(), std::mt19937(seed));
        std::uint32_t largest = 0;
        for (const int p : order) {
            const float own = lightGradientBound(a, p / Pictures::kWidth, p % Pictures::kWidth);
            largest = std::max(largest, std::bit_cast<std::uint32_t>(std::fabs(own)));
        }
        const float bound = std::bit_cast<float>(largest);
        const double steps = isFiniteNumber(bound) ? fixedPointSteps(bound, bits) : 0.0;
        std::vector<long long> sums(layout.count, 0);
        for (const int p : order) {
            shadePixelBackward(a, p / Pictures::kWidth, p % Pictures::kWidth, &layout,
                               [&](std::size_t place, float value) {
                                   EXPECT_LE(std::fabs(value), bound) << "what a pixel gives is within its bound";
                                   sums[place] += toFixedPoint(value, steps);
                               });
        }
        for (const long long sum : sums) light.push_back(fromFixedPoint(sum, bound, bits));
    }
};

TEST(ShadingGradient, ThreadsThatAddInAnyOrderGiveTheProcessorsNumbers) {
    Pictures pictures;
    const RandomLight<float> light(7);
    for (const float size : {1.0f, 1e-12f, 3e20f}) {
        for (float& w : pictures.weights) w *= size;
        const auto expected = OnDevice({}, pictures, light).backward({});
        ASSERT_TRUE(expected.ok());
        const ThreadsInALoop first(pictures.inputs(light.view), pictures.weights, 1);
        const ThreadsInALoop second(pictures.inputs(light.view), pictures.weights, 2);
        EXPECT_EQ(first.light, second.light) << "the order changes nothing, not the last bit";
        EXPECT_EQ(first.albedo, expected->albedo);
        std::size_t at = 0;
        float strongest = 0.0f;
        for (const std::vector<float>& cube : expected->light) {
            for (const float v : cube) strongest = std::max(strongest, std::fabs(v));
        }
        ASSERT_GT(strongest, 0.0f);
        for (const std::vector<float>& cube : expected->light) {
            for (const float v : cube) EXPECT_NEAR(first.light[at++], v, 2e-6f * strongest);
        }
        EXPECT_EQ(at, first.light.size());
        for (float& w : pictures.weights) w /= size;
    }
}

TEST(ShadingGradient, ANumberThatIsNotFiniteIsSeenInTheLight) {
    Pictures pictures;
    const RandomLight<float> light(7);
    const auto sumOf = [](const std::vector<std::vector<float>>& cubes) {
        double sum = 0.0;
        for (const auto& cube : cubes) {
            for (const float v : cube) sum += static_cast<double>(v);
        }
        return sum;
    };
    pictures.weights[4 * 30] = std::numeric_limits<float>::quiet_NaN();
    ASSERT_GT(pictures.opacity[30], 0.0f);
    for (const Device& device : test::devicesUnderTest()) {
        const auto g = OnDevice(device, pictures, light).backward({});
        ASSERT_TRUE(g.ok());
        EXPECT_TRUE(std::isnan(sumOf(g->light)));
    }
    // Beside a pixel that shows nothing it changes nothing.
    pictures.opacity[30] = 0.0f;
    for (const Device& device : test::devicesUnderTest()) {
        const auto g = OnDevice(device, pictures, light).backward({});
        ASSERT_TRUE(g.ok());
        EXPECT_TRUE(std::isfinite(sumOf(g->light)));
    }
    EXPECT_TRUE(std::isnan(fromFixedPoint(3, std::numeric_limits<float>::infinity(), 40)));
    EXPECT_TRUE(std::isnan(fromFixedPoint(3, std::numeric_limits<float>::quiet_NaN(), 40)));
    EXPECT_EQ(fromFixedPoint(-(1ll << 40), 0.75f, 40), -1.0f) << "the bound's power of two is 2^bits steps";
}

TEST(ShadingGradient, WrongSizesAreNamed) {
    const Pictures pictures;
    const RandomLight<float> light(7);
    const ImageView<const float> beauty{pictures.weights.data(), Pictures::kWidth, Pictures::kHeight, 4};
    ShadingGradientWorkspace workspace;
    const auto message = [&](ImageView<const float> gradBeauty, const ShadingGradientOutputs& outputs) {
        const Status status = shadeBackward({}, {}, pictures.inputs(light.view), gradBeauty, outputs, workspace);
        return status.ok() ? std::string("no error") : status.error().describe();
    };
    EXPECT_EQ(message({pictures.weights.data(), 3, 3, 4}, {}),
              "shading gradient: dL/dbeauty is 3x3 with 4 channels, expected 9x7 with 4");
    LightLevelGradients levels;
    levels.reset(light.view);
    ShadingGradientOutputs outputs;
    outputs.light = levels.view();
    EXPECT_EQ(message(beauty, outputs), "no error");
    levels.specular[1].resize(18 * 2 * 2);
    outputs.light = levels.view();
    EXPECT_EQ(message(beauty, outputs),
              "shading gradient: dL/dlight, level 1, is 2x12 with 3 channels, expected 4x24 with 3");
    outputs.light.levels = 2;
    EXPECT_EQ(message(beauty, outputs), "shading gradient: dL/dlight has 2 levels, expected the light's 4");
    const Status refused =
        shadeBackward({DeviceKind::Cuda, 99}, {}, pictures.inputs(light.view), beauty, {}, workspace);
    ASSERT_FALSE(refused.ok());
    EXPECT_EQ(refused.error().code, ErrorCode::Unavailable) << refused.error().describe();
}

} // namespace
} // namespace ars
