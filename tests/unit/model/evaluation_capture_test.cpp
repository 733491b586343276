// Evaluation of an avatar on a capture that was made of its own pictures: every figure is known beforehand.
#include "model/evaluation/evaluation.h"

#include "engine/capture/calibration.h"
#include "engine/core/file.h"
#include "engine/frame/rest_avatar.h"
#include "engine/io/exr.h"
#include "engine/io/png.h"
#include "engine/io/safetensors.h"
#include "engine/light/cube_map.h"
#include "engine/light/environment.h"
#include "engine/light/prefilter.h"
#include "engine/rig/motion.h"
#include "model/evaluation/evaluated_view.h"
#include "tests/support/test_data.h"
#include "tests/unit/model/lpips_fixture.h"

#include <ATen/ATen.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <cmath>
#include <functional>

namespace ars {
namespace {

namespace fs = std::filesystem;

constexpr int kWidth = 52, kHeight = 76;
constexpr double kExposure = 0.7;
constexpr int kBackground = 90; ///< grey of 255
const std::array<float, 3> kGrey{kBackground / 255.0f, kBackground / 255.0f, kBackground / 255.0f};
const std::array<std::string, 2> kCameras{"22010716", "22010708"};

Camera cameraOf(std::size_t index) {
    const double angle = index == 0 ? 0.3 : 2.4;
    Camera camera =
        lookAtCamera({2.6 * std::sin(angle), 0.1, 2.6 * std::cos(angle)}, {0.0, -0.35, 0.0}, 45.0, kWidth, kHeight);
    camera.cx += 1.25;
    return camera;
}

Motion motionOf() {
    Motion motion;
    motion.betas.assign(10, 0.0f);
    for (int frame = 0; frame < 2; ++frame) {
        Pose pose = restPose(kSmplxJointCount);
        pose.rotations[16] = quatFromAxisAngle({0.0f, 0.0f, -0.8f - 0.2f * static_cast<float>(frame)});
        motion.frames.push_back(pose);
    }
    return motion;
}

void writeExrOf(const fs::path& path, const Image& image) {
    ExrImage exr;
    exr.dataWindow = exr.displayWindow = {0, 0, image.width - 1, image.height - 1};
    for (int c = 0; c < image.channels; ++c) {
        ExrChannel channel{image.channels == 1 ? "Y" : std::string(1, "RGB"[c]), ExrPixelType::Float, {}};
        for (std::size_t i = static_cast<std::size_t>(c); i < image.pixels.size();
             i += static_cast<std::size_t>(image.channels)) {
            channel.pixels.push_back(image.pixels[i]);
        }
        exr.channels.push_back(std::move(channel));
    }
    fs::create_directories(path.parent_path());
    const Status written = writeExr(path, exr);
    ASSERT_TRUE(written.ok()) << written.error().describe();
}

/// Eight bits, as a file has them.
Image rounded(Image image) {
    for (float& value : image.pixels) value = std::round(std::clamp(value, 0.0f, 1.0f) * 255.0f) / 255.0f;
    image.sourceBits = 8;
    return image;
}

void writePngOf(const fs::path& path, const Image& image) {
    fs::create_directories(path.parent_path());
    const Status written = writePng(path, image);
    ASSERT_TRUE(written.ok()) << written.error().describe();
}

/// What a view's files say, before the test changes them.
struct Told {
    Image photograph, alpha;
    detail::TrueBuffers truth; ///< normals in world space
};

/// Numbers of the same pixels as the evaluation's: those whose alpha exceeds 128 of 255.
double psnrInMask(const Image& a, const Image& b, const Image& alpha) {
    double sum = 0;
    std::size_t count = 0;
    for (std::size_t p = 0; p < alpha.pixels.size(); ++p) {
        if (!(alpha.pixels[p] > 128.5f / 255.0f)) continue;
        for (std::size_t c = 0; c < 3; ++c) {
            sum += std::pow(double(a.pixels[3 * p + c]) - double(b.pixels[3 * p + c]), 2);
            ++count;
        }
    }
    return -10 * std::log10(sum / static_cast<double>(count));
}

class EvaluationOfItself : public ::testing::Test {
protected:
    using Change = std::function<void(Told&)>;

    void SetUp() override {
        auto rest = restAvatarFromFile("open", {.maxSurfels = 6000});
        ASSERT_TRUE(rest.ok()) << rest.error().describe();
        avatar_.evaluator = std::move(*rest);
        avatar_.name = "itself";
        Environment sky = uniformEnvironment(0.5f);
        for (int row = 0; row < sky.picture.height; ++row) {
            for (int column = 0; column < sky.picture.width; ++column) {
                const double bright = 1.0 - double(row) / sky.picture.height + 0.2 * std::sin(0.1 * column);
                for (int c = 0; c < 3; ++c) {
                    sky.picture.at(row, column, c) = static_cast<float>((0.25 + 0.1 * c) * (1.0 + bright));
                }
            }
        }
        writeExrOf(capture_ / "lights" / "sky.exr", sky.picture);
        auto environment = readEnvironment(capture_ / "lights" / "sky.exr");
        ASSERT_TRUE(environment.ok()) << environment.error().describe();
        auto cube = cubeFromLatLong(environment->picture, kDefaultLightBase);
        ASSERT_TRUE(cube.ok());
        avatar_.light = *cube;
        auto filtered = detail::filteredCube(*cube);
        ASSERT_TRUE(filtered.ok());
        light_ = std::move(*filtered);
    }

    /// The avatar's own pictures under the light, and its own buffers as the truth; `change` spoils them. What a
    /// perfect evaluation finds of the photographs is kept.
    void writeItself(const Change& change) {
        nlohmann::ordered_json calibration;
        const Motion motion = motionOf();
        auto renderer = detail::ViewRenderer::create(avatar_);
        ASSERT_TRUE(renderer.ok());
        for (std::size_t i = 0; i < kCameras.size(); ++i) {
            const Camera camera = cameraOf(i);
            nlohmann::ordered_json json = cameraToJson(camera);
            json["T"] = json["t"];
            json["imgSize"] = {kWidth, kHeight};
            calibration[kCameras[i]] = json;
            for (std::size_t frame = 0; frame < motion.frames.size(); ++frame) {
                const auto view = renderer->render(motion.frames[frame], camera);
                ASSERT_TRUE(view.ok()) << view.error().describe();
                const auto shaded = renderer->shade(*view, camera, *light_, static_cast<float>(kExposure));
                ASSERT_TRUE(shaded.ok());
                const Image picture = detail::composedShading(*shaded, kGrey);
                Told told{rounded(picture),
                          rounded(view->opacity),
                          {view->albedo, view->roughness, view->occlusion, inWorld(view->normal, camera), view->depth}};
                change(told);
                writeView(i, frame, told);
                psnr_.push_back(psnrInMask(picture, told.photograph, told.alpha));
                overWhite_.push_back(detail::composedShading(*shaded, {1.0f, 1.0f, 1.0f}));
                photographs_.push_back(told.photograph);
                alphas_.push_back(told.alpha);
            }
        }
        ASSERT_TRUE(writeFileAtomic(capture_ / "calibration_full.json", calibration.dump()).ok());
        ASSERT_TRUE(writeFileAtomic(capture_ / "metadata.json", "{\"light\": \"sky\", \"exposure\": 0.7}").ok());
        const Status written = writeSmplParams(capture_ / "smpl_params.npz", motion);
        ASSERT_TRUE(written.ok()) << written.error().describe();
    }

    static Image inWorld(Image normal, const Camera& camera) {
        const glm::mat3 rotation(camera.rotation);
        for (std::size_t i = 0; i < normal.pixels.size(); i += 3) {
            float* n = &normal.pixels[i];
            const glm::vec3 world = glm::transpose(rotation) * glm::vec3(n[0], n[1], n[2]);
            for (int c = 0; c < 3; ++c) n[c] = world[c];
        }
        return normal;
    }

    void writeView(std::size_t camera, std::size_t frame, const Told& told) const {
        const fs::path folder = capture_ / kCameras[camera];
        const std::string name = fmt::format("{:08}", frame);
        writePngOf(folder / (name + ".png"), told.photograph);
        writePngOf(folder / "mask" / "pha" / (name + ".png"), told.alpha);
        writeExrOf(folder / "gt" / "albedo" / (name + ".exr"), *told.truth.albedo);
        writeExrOf(folder / "gt" / "roughness" / (name + ".exr"), *told.truth.roughness);
        writeExrOf(folder / "gt" / "ao" / (name + ".exr"), *told.truth.occlusion);
        writeExrOf(folder / "gt" / "normal" / (name + ".exr"), *told.truth.normal);
        writeExrOf(folder / "gt" / "depth" / (name + ".exr"), *told.truth.depth);
    }

    nlohmann::ordered_json evaluated(const EvaluationOptions& options = {}) const {
        const auto report = evaluateAvatar(avatar_, capture_, options);
        EXPECT_TRUE(report.ok()) << report.error().describe();
        return report.ok() ? *report : nlohmann::ordered_json();
    }
    double meanPsnr() const {
        double sum = 0;
        for (const double value : psnr_) sum += value;
        return sum / static_cast<double>(psnr_.size());
    }

    test::TemporaryFolder folder_;
    fs::path capture_ = folder_ / "capture";
    EvaluatedAvatar avatar_;
    std::unique_ptr<PrefilteredLight> light_;
    std::vector<double> psnr_; ///< of each view, in the mask
    std::vector<Image> overWhite_, photographs_, alphas_;
};

TEST_F(EvaluationOfItself, FindsTheRoundingOfTheFilesAndNothingElse) {
    writeItself([](Told&) {});
    EvaluationOptions options;
    options.outFolder = folder_ / "out";
    options.pictures = 1;
    const auto report = evaluated(options);
    ASSERT_EQ(report.at("views"), 4);
    const auto& mean = report.at("mean");
    // Errors that are even over one step of 255 have the variance step^2 / 12: 58.92 dB.
    EXPECT_NEAR(mean.at("relit_unscaled_psnr_mask").get<double>(), 58.92, 1.0);
    EXPECT_NEAR(mean.at("relit_unscaled_psnr_mask").get<double>(), meanPsnr(), 1e-3);
    EXPECT_NEAR(mean.at("relit_psnr_mask").get<double>(), meanPsnr(), 1e-3) << "its albedo needs no scale";
    EXPECT_GT(mean.at("relit_ssim_mask").get<double>(), 0.999);
    EXPECT_GT(mean.at("albedo_unscaled_psnr").get<double>(), 120.0) << "floats: nothing is lost";
    EXPECT_GT(mean.at("albedo_psnr").get<double>(), 120.0);
    EXPECT_GT(mean.at("roughness_psnr").get<double>(), 120.0);
    EXPECT_GT(mean.at("ao_psnr").get<double>(), 120.0);
    EXPECT_LT(mean.at("normal_deg").get<double>(), 0.1);
    EXPECT_LT(mean.at("depth_mm").get<double>(), 1e-3);
    EXPECT_GT(mean.at("mask_iou").get<double>(), 0.98);
    EXPECT_NEAR(report.at("light_irradiance_correlation").get<double>(), 1.0, 1e-9);
    for (std::size_t c = 0; c < 3; ++c) EXPECT_NEAR(report.at("albedo_scale")[c].get<double>(), 1.0, 1e-6);
    EXPECT_TRUE(report.at("lpips").is_null());
    EXPECT_FALSE(mean.contains("relit_lpips"));
    const auto table = readTextFile(options.outFolder / "report.txt");
    ASSERT_TRUE(table.ok()) << table.error().describe();
    EXPECT_EQ(*table, evaluationTable(report));
    EXPECT_NE(table->find("LPIPS, FID                             not computed\n"), std::string::npos) << *table;
    EXPECT_FALSE(fs::is_empty(options.outFolder / "pictures"));
}

TEST_F(EvaluationOfItself, FindsErrorsOfKnownSizes) {
    constexpr float kTiltDeg = 10.0f;
    writeItself([](Told& told) {
        for (std::size_t p = 0; p < told.alpha.pixels.size(); ++p) {
            for (std::size_t c = 0; c < 3; ++c) {
                // Sixteen levels up or down, wherever there is room.
                float& value = told.photograph.pixels[3 * p + c];
                if (told.alpha.pixels[p] > 0.0f) value += (value < 0.5f ? 16.0f : -16.0f) / 255.0f;
                told.truth.albedo->pixels[3 * p + c] *= 0.5f + 0.25f * static_cast<float>(c);
            }
            told.truth.roughness->pixels[p] += 0.1f;
            told.truth.occlusion->pixels[p] += 0.05f;
            if (told.truth.depth->pixels[p] > 0.0f) told.truth.depth->pixels[p] += 0.01f;
            float* n = &told.truth.normal->pixels[3 * p];
            const glm::vec3 normal(n[0], n[1], n[2]);
            if (glm::length(normal) < 0.5f) continue;
            const glm::vec3 side = glm::normalize(glm::cross(normal, glm::vec3(0.3f, 0.9f, -0.2f)));
            const glm::vec3 tilted =
                std::cos(glm::radians(kTiltDeg)) * glm::normalize(normal) + std::sin(glm::radians(kTiltDeg)) * side;
            for (int c = 0; c < 3; ++c) n[c] = tilted[c];
        }
    });
    const auto report = evaluated();
    ASSERT_EQ(report.at("views"), 4);
    const auto& mean = report.at("mean");
    EXPECT_NEAR(mean.at("relit_unscaled_psnr_mask").get<double>(), 20 * std::log10(255.0 / 16.0), 0.05);
    EXPECT_NEAR(mean.at("relit_unscaled_psnr_mask").get<double>(), meanPsnr(), 1e-3);
    for (std::size_t view = 0; view < 4; ++view) {
        // Frames outside, cameras inside: as the sets' rows come.
        const auto& row = report.at("sets")[0].at("views")[view];
        const std::size_t camera = row.at("camera") == kCameras[0] ? 0 : 1;
        const auto frame = row.at("frame").get<std::size_t>();
        EXPECT_NEAR(row.at("relit_unscaled_psnr_mask").get<double>(), psnr_[2 * camera + frame], 1e-3);
    }
    for (std::size_t c = 0; c < 3; ++c) {
        EXPECT_NEAR(report.at("albedo_scale")[c].get<double>(), 0.5 + 0.25 * static_cast<double>(c), 1e-5);
    }
    EXPECT_GT(mean.at("albedo_psnr_linear").get<double>(), 100.0) << "after the scale";
    EXPECT_LT(mean.at("albedo_unscaled_psnr_linear").get<double>(), 25.0) << "without it";
    EXPECT_NEAR(mean.at("roughness_mae").get<double>(), 0.1, 1e-5);
    EXPECT_NEAR(mean.at("roughness_psnr").get<double>(), 20.0, 1e-3);
    EXPECT_NEAR(mean.at("ao_mae").get<double>(), 0.05, 1e-5);
    EXPECT_NEAR(mean.at("ao_psnr").get<double>(), 20 * std::log10(20.0), 1e-3);
    EXPECT_NEAR(mean.at("depth_mm").get<double>(), 10.0, 1e-2);
    EXPECT_NEAR(mean.at("normal_deg").get<double>(), kTiltDeg, 0.05);
}

TEST_F(EvaluationOfItself, LpipsIsToldWithItsNetworkWhereThereAreWeights) {
    writeItself([](Told& told) {
        for (std::size_t i = 0; i < told.photograph.pixels.size(); i += 5) {
            float& value = told.photograph.pixels[i];
            if (told.alpha.pixels[i / 3] > 0.0f) value += (value < 0.5f ? 24.0f : -24.0f) / 255.0f;
        }
    });
    EvaluationOptions options;
    options.lpipsBackbone = folder_ / "alex.safetensors";
    options.lpipsHeads = folder_ / "heads.safetensors";
    ASSERT_TRUE(writeSafetensors(options.lpipsBackbone, test::lpipsBackbone(test::kAlex)).ok());
    ASSERT_TRUE(writeSafetensors(options.lpipsHeads, test::lpipsHeads({64, 192, 384, 256, 256})).ok());
    const auto report = evaluated(options);
    EXPECT_EQ(report.at("lpips").at("network"), "alex");
    EXPECT_EQ(report.at("lpips").at("backbone"), options.lpipsBackbone.string());
    // Ours over white beside the photograph that is white outside the mask.
    const auto loss = readLpips(options.lpipsBackbone, options.lpipsHeads);
    ASSERT_TRUE(loss.ok()) << loss.error().describe();
    double sum = 0;
    for (std::size_t view = 0; view < 4; ++view) {
        Image target = photographs_[view];
        for (std::size_t p = 0; p < alphas_[view].pixels.size(); ++p) {
            if (alphas_[view].pixels[p] > 128.5f / 255.0f) continue;
            for (std::size_t c = 0; c < 3; ++c) target.pixels[3 * p + c] = 1.0f;
        }
        const auto tensor = [](const Image& image) {
            return at::tensor(image.pixels).view({image.height, image.width, 3});
        };
        sum += (*loss)->evaluate(tensor(overWhite_[view]), tensor(target)).item<double>();
    }
    EXPECT_GT(sum, 1e-4);
    EXPECT_NEAR(report.at("mean").at("relit_unscaled_lpips").get<double>(), sum / 4, 1e-5 * sum);
    for (const char* name : {"radiance_lpips", "pbr_lpips", "relit_lpips"}) {
        EXPECT_TRUE(report.at("mean").contains(name)) << name;
    }
    const std::string table = evaluationTable(report);
    EXPECT_NE(table.find("PBR, LPIPS (alex)"), std::string::npos) << table;
    EXPECT_NE(table.find("\nFID "), std::string::npos) << table;
}

TEST_F(EvaluationOfItself, LpipsFilesThatDoNotFitAreNamedBeforeAnythingIsRendered) {
    EvaluationOptions options;
    options.lpipsBackbone = folder_ / "alex.safetensors";
    const auto alone = evaluateAvatar(avatar_, capture_, options);
    ASSERT_FALSE(alone.ok());
    EXPECT_EQ(alone.error().place, "--lpips-heads");
    ASSERT_TRUE(writeSafetensors(options.lpipsBackbone, test::lpipsBackbone(test::kAlex)).ok());
    options.lpipsHeads = folder_ / "heads.safetensors";
    ASSERT_TRUE(writeSafetensors(options.lpipsHeads, test::lpipsHeads({64, 128, 256, 512, 512})).ok());
    const auto other = evaluateAvatar(avatar_, capture_, options);
    ASSERT_FALSE(other.ok());
    EXPECT_NE(other.error().describe().find("heads.safetensors"), std::string::npos) << other.error().describe();
    EXPECT_NE(other.error().describe().find("lin1.model.1.weight"), std::string::npos) << other.error().describe();
}

} // namespace
} // namespace ars
