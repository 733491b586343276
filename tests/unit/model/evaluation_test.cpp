#include "model/evaluation/evaluation.h"

#include "engine/core/file.h"
#include "engine/frame/rest_avatar.h"
#include "model/evaluation/evaluated_view.h"
#include "tests/support/test_data.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <cmath>
#include <random>

namespace ars {
namespace {

Image noise(int width, int height, int channels, unsigned seed) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<float> uniform(0.05f, 0.9f);
    Image image;
    image.width = width;
    image.height = height;
    image.channels = channels;
    image.pixels.resize(static_cast<std::size_t>(width * height * channels));
    for (float& value : image.pixels) value = uniform(random);
    return image;
}

TEST(AlbedoScale, FindsTheFactorOfEveryChannelInTheMask) {
    const Image truth = noise(9, 7, 3, 1);
    Image picture = truth, mask = noise(9, 7, 1, 2);
    const glm::dvec3 factor(0.5, 2.0, 1.25);
    for (float& value : mask.pixels) value = value > 0.4f ? 1.0f : 0.0f;
    for (std::size_t i = 0; i < picture.pixels.size(); ++i) {
        picture.pixels[i] /= static_cast<float>(factor[static_cast<int>(i % 3)]);
        if (mask.pixels[i / 3] == 0.0f) picture.pixels[i] = 100.0f;
    }
    detail::AlbedoScale scale;
    scale.add(picture, truth, mask);
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(scale.value()[c], factor[c], 1e-6);
    detail::Figures figures;
    ASSERT_TRUE(detail::judgeAlbedo("albedo", picture, scale.value(), truth, mask, figures).ok());
    EXPECT_GT(figures[0].second, 100.0) << "dB";
    EXPECT_EQ(detail::AlbedoScale().value(), glm::dvec3(1.0));
}

TEST(UniformSsim, IsOneForEqualPicturesAndTheClosedFormForConstants) {
    const Image a = noise(12, 10, 3, 3);
    EXPECT_NEAR(*detail::uniformSsim(a, a), 1.0, 1e-12);
    Image x = a, y = a;
    std::fill(x.pixels.begin(), x.pixels.end(), 0.2f);
    std::fill(y.pixels.begin(), y.pixels.end(), 0.6f);
    EXPECT_NEAR(*detail::uniformSsim(x, y), (2 * 0.2 * 0.6 + 1e-4) / (0.04 + 0.36 + 1e-4), 1e-6);
    EXPECT_FALSE(detail::uniformSsim(noise(6, 10, 3, 1), noise(6, 10, 3, 1)).ok());
}

CubeMap brightTowards(int side, int axis, float scale) {
    CubeMap cube(side);
    for (int face = 0; face < 6; ++face) {
        for (int row = 0; row < side; ++row) {
            for (int column = 0; column < side; ++column) {
                const glm::vec3 d = glm::normalize(cubeDirection<float>(face, texelCoordinate<float>(column, side),
                                                                        texelCoordinate<float>(row, side)));
                for (int c = 0; c < 3; ++c) cube.texel(face, row, column)[c] = scale * (1.5f + d[axis]);
            }
        }
    }
    return cube;
}

TEST(IrradianceCorrelation, SeesThePatternAndNotTheScale) {
    const CubeMap up = brightTowards(64, 1, 1.0f);
    EXPECT_NEAR(irradianceCorrelation(up, brightTowards(32, 1, 7.0f)), 1.0, 1e-4);
    EXPECT_NEAR(irradianceCorrelation(up, brightTowards(64, 0, 1.0f)), 0.0, 1e-4);
    CubeMap down = up;
    for (float& value : down.texels) value = 3.0f - value;
    EXPECT_NEAR(irradianceCorrelation(up, down), -1.0, 1e-4);
    CubeMap grey(16);
    std::fill(grey.texels.begin(), grey.texels.end(), 1.0f);
    EXPECT_TRUE(std::isnan(irradianceCorrelation(up, grey)));
}

TEST(ComposedPictures, LayTheAvatarOverTheBackground) {
    Image shaded = noise(2, 1, 4, 4);
    shaded.pixels = {0.1f, 0.2f, 0.3f, 0.5f, 2.0f, 0.0f, 0.0f, 1.0f};
    const Image result = detail::composedShading(shaded, {0.5f, 1.0f, 0.0f});
    EXPECT_NEAR(result.pixels[0], linearToSrgb(0.1f + 0.5f * srgbToLinear(0.5f)), 1e-6f);
    EXPECT_NEAR(result.pixels[1], linearToSrgb(0.7f), 1e-6f);
    EXPECT_NEAR(result.pixels[2], linearToSrgb(0.3f), 1e-6f);
    EXPECT_FLOAT_EQ(result.pixels[3], 1.0f);
}

TEST(Evaluation, ARestAvatarUnderTheTrueLightMeetsThePathTracer) {
    ARS_TEST_DATA_FILE(templatePath, "capture/casual/template.glb");
    ARS_TEST_DATA_FILE(root, "capture/casual_val");
    auto rest = restAvatarFromFile(templatePath.string(), {.maxSurfels = 20000});
    ASSERT_TRUE(rest.ok()) << rest.error().describe();
    EvaluatedAvatar avatar;
    avatar.evaluator = std::move(*rest);
    avatar.radii.fill(0.25f);
    avatar.splat.depth = DepthMode::Filtered;
    avatar.name = "rest";
    const test::TemporaryFolder out;
    EvaluationOptions options;
    options.frames = "0";
    options.outFolder = out.path();
    options.pictures = 1;
    const auto report = evaluateAvatar(avatar, root, options);
    ASSERT_TRUE(report.ok()) << report.error().describe();
    ASSERT_EQ(report->at("sets").size(), 2u);
    EXPECT_EQ(report->at("views"), 4);
    const auto& mean = report->at("mean");
    EXPECT_GT(mean.at("relit_psnr_mask").get<double>(), 25.0);
    EXPECT_GT(mean.at("albedo_psnr").get<double>(), 26.0);
    EXPECT_LT(mean.at("photograph_as_albedo_psnr").get<double>(), 22.0);
    EXPECT_LT(mean.at("normal_deg").get<double>(), 10.0);
    EXPECT_LT(mean.at("depth_mm").get<double>(), 8.0);
    EXPECT_GT(mean.at("mask_iou").get<double>(), 0.95);
    EXPECT_FALSE(mean.contains("pbr_psnr_mask")) << "it has no light of its own";
    EXPECT_TRUE(report->at("lpips").is_null());
    EXPECT_TRUE(std::filesystem::exists(out / "report.json"));
    EXPECT_EQ(*readTextFile(out / "report.txt"), evaluationTable(*report));
    EXPECT_TRUE(std::filesystem::exists(out.path() / "pictures"));
}

TEST(Evaluation, SaysWhatIsMissing) {
    const test::TemporaryFolder empty;
    EvaluatedAvatar avatar;
    EXPECT_FALSE(evaluateAvatar(avatar, empty.path(), {}).ok());
}

} // namespace
} // namespace ars
