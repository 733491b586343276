// Evaluation of an avatar on a capture that was made of its own pictures: every figure is known beforehand.
#include "model/evaluation/evaluation.h"

#include "engine/capture/calibration.h"
#include "engine/core/file.h"
#include "engine/frame/rest_avatar.h"
#include "engine/io/exr.h"
#include "engine/io/jpeg.h"
#include "engine/io/png.h"
#include "engine/io/safetensors.h"
#include "engine/light/cube_map.h"
#include "engine/light/environment.h"
#include "engine/light/prefilter.h"
#include "engine/rig/motion.h"
#include "model/evaluation/evaluated_view.h"
#include "tests/support/test_data.h"
#include "tests/unit/capture/synthetic_capture.h"
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

TEST_F(EvaluationOfItself, AnAvatarWithoutOcclusionIsShadedWithoutIt) {
    avatar_.occlude = false;
    writeItself([](Told&) {});
    EXPECT_NEAR(evaluated().at("mean").at("relit_unscaled_psnr_mask").get<double>(), meanPsnr(), 1e-3);
    avatar_.occlude = true;
    EXPECT_LT(evaluated().at("mean").at("relit_unscaled_psnr_mask").get<double>(), meanPsnr() - 10.0);
}

TEST_F(EvaluationOfItself, ImportanceFallsOffAsInTraining) {
    avatar_.posing.importanceFalloffM = 2.0f;
    writeItself([](Told&) {});
    EXPECT_GT(evaluated().at("mean").at("ao_psnr").get<double>(), 120.0);
    avatar_.posing.importanceFalloffM = 0.02f;
    EXPECT_LT(evaluated().at("mean").at("ao_psnr").get<double>(), 80.0);
}

TEST_F(EvaluationOfItself, AViewWithoutThePersonIsLeftOutAndSaid) {
    int views = 0;
    writeItself([&](Told& told) {
        if (views++ == 1) std::fill(told.alpha.pixels.begin(), told.alpha.pixels.end(), 0.0f); // camera 0, frame 1
    });
    const auto report = evaluated();
    EXPECT_EQ(report.at("views"), 3);
    const auto& set = report.at("sets")[0];
    EXPECT_EQ(set.at("views").size(), 3u);
    ASSERT_EQ(set.at("left_out").size(), 1u);
    EXPECT_EQ(set.at("left_out")[0].at("camera"), kCameras[0]);
    EXPECT_EQ(set.at("left_out")[0].at("frame"), 1);
    EXPECT_EQ(set.at("left_out")[0].at("reason"), "nobody in the mask");
    EXPECT_GT(report.at("mean").at("albedo_psnr").get<double>(), 120.0) << "the others count as ever";
    const std::string table = evaluationTable(report);
    EXPECT_NE(table.find("left out, nobody in the mask: 22010716 1\n"), std::string::npos) << table;
}

TEST_F(EvaluationOfItself, NobodyAnywhereIsAnError) {
    writeItself([&](Told& told) { std::fill(told.alpha.pixels.begin(), told.alpha.pixels.end(), 0.0f); });
    const auto report = evaluateAvatar(avatar_, capture_, {});
    ASSERT_FALSE(report.ok());
    EXPECT_EQ(report.error().code, ErrorCode::BadFile);
    EXPECT_NE(report.error().describe().find("none among 4"), std::string::npos) << report.error().describe();
}

TEST_F(EvaluationOfItself, EverySetIsComparedWithItsOwnLight) {
    writeItself([](Told&) {});
    const fs::path both = folder_ / "both";
    fs::create_directories(both);
    for (const char* name : {"one", "two"}) fs::copy(capture_, both / name, fs::copy_options::recursive);
    auto sky = readEnvironment(both / "two" / "lights" / "sky.exr");
    ASSERT_TRUE(sky.ok()) << sky.error().describe();
    Image turned = sky->picture;
    for (int row = 0; row < turned.height; ++row) {
        for (int column = 0; column < turned.width; ++column) {
            for (int c = 0; c < 3; ++c) turned.at(row, column, c) = sky->picture.at(turned.height - 1 - row, column, c);
        }
    }
    writeExrOf(both / "two" / "lights" / "sky.exr", turned);
    const auto report = evaluateAvatar(avatar_, both, {});
    ASSERT_TRUE(report.ok()) << report.error().describe();
    constexpr const char* kKey = "light_irradiance_correlation";
    EXPECT_TRUE(report->at(kKey).is_null()) << "there is no one light of both";
    ASSERT_EQ(report->at("sets").size(), 2u);
    EXPECT_NEAR(report->at("sets")[0].at(kKey).get<double>(), 1.0, 1e-9);
    EXPECT_LT(report->at("sets")[1].at(kKey).get<double>(), 0.9) << "upside down";
    const std::string table = evaluationTable(*report);
    EXPECT_NE(table.find("light of one: correlation of the irradiance   1.0000\n"), std::string::npos) << table;
    EXPECT_NE(table.find("light of two: "), std::string::npos) << table;
}

TEST_F(EvaluationOfItself, AFolderThatIsNoUtf8IsReported) {
    writeItself([](Told&) {});
    const fs::path odd = folder_ / "capt\xffure";
    fs::rename(capture_, odd);
    EvaluationOptions options;
    options.frames = "0";
    options.outFolder = folder_ / "out";
    const auto report = evaluateAvatar(avatar_, odd, options);
    ASSERT_TRUE(report.ok()) << report.error().describe();
    const auto written = readTextFile(options.outFolder / "report.json");
    ASSERT_TRUE(written.ok());
    EXPECT_NE(written->find("capt\xef\xbf\xbdure"), std::string::npos);
}

TEST(EvaluatedCaptures, TheSplitThatIsNamedIsTaken) {
    test::SyntheticCapture what;
    what.cameras = 16;
    what.frames = 1;
    const test::TemporaryFolder folder;
    test::writeCapture(what, folder / "avatarrex_zzr");
    const auto splitOf = [&](const std::string& split, EvaluationProtocol protocol) {
        EvaluationOptions options;
        options.split = split;
        options.protocol = protocol;
        const auto sets = detail::openEvaluatedCaptures(folder / "avatarrex_zzr", options);
        EXPECT_TRUE(sets.ok()) << sets.error().describe();
        return sets ? sets->front().split : CaptureSplit();
    };
    EXPECT_EQ(splitOf("", EvaluationProtocol::Ag).name, "ag");
    EXPECT_EQ(splitOf("", EvaluationProtocol::HeldOut).cameras, (std::vector<int>{7, 13}));
    EXPECT_EQ(splitOf("", EvaluationProtocol::Masked).cameras.size(), 16u);
    for (const auto protocol : {EvaluationProtocol::Ag, EvaluationProtocol::HeldOut, EvaluationProtocol::Masked}) {
        const CaptureSplit all = splitOf("all", protocol);
        EXPECT_EQ(all.name, "all");
        EXPECT_EQ(all.cameras.size(), 16u);
    }
}

TEST(EvaluatedCaptures, OfASequenceWithSeveralScalesTheSmallestIsTaken) {
    test::SyntheticCapture what;
    what.kind = CaptureKind::ActorsHq;
    const test::TemporaryFolder folder;
    test::writeCapture(what, folder / "sequence");
    fs::copy(folder / "sequence" / "4x", folder / "sequence" / "2x", fs::copy_options::recursive);
    const auto sets = detail::openEvaluatedCaptures(folder / "sequence", {});
    ASSERT_TRUE(sets.ok()) << sets.error().describe();
    ASSERT_EQ(sets->size(), 1u) << "one recording, however often it was scaled";
    EXPECT_EQ(sets->front().name, "sequence");
    EXPECT_NE(sets->front().capture.imagePath({0, 0}).string().find("/4x/"), std::string::npos);
    // A folder of sequences is a folder of captures.
    fs::copy(folder / "sequence", folder / "other", fs::copy_options::recursive);
    const auto two = detail::openEvaluatedCaptures(folder.path(), {});
    ASSERT_TRUE(two.ok()) << two.error().describe();
    EXPECT_EQ(two->size(), 2u);
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

/// Pixels around the person in `mask`'s box, 50 a side, in the middle of white.
TEST(PublishedCrop, IsTheMasksBoxAndFiftyPixelsInAWhiteSquare) {
    Image picture, mask;
    picture.width = mask.width = 300;
    picture.height = mask.height = 200;
    picture.channels = 3;
    picture.pixels.resize(300 * 200 * 3);
    for (std::size_t i = 0; i < picture.pixels.size(); ++i) picture.pixels[i] = static_cast<float>(i % 251) / 500.0f;
    mask.channels = 1;
    mask.pixels.assign(300 * 200, 0.0f);
    for (int row = 20; row < 40; ++row) {
        for (int column = 120; column < 180; ++column) mask.at(row, column, 0) = 1.0f;
    }
    // Columns 70 to 229, rows 0 to 89: 160 x 90, so 35 white rows above and below.
    const Image crop = detail::publishedCrop(picture, mask);
    ASSERT_EQ(crop.width, 160);
    ASSERT_EQ(crop.height, 160);
    for (const auto& [row, column] : {std::pair{0, 0}, {34, 80}, {125, 159}}) EXPECT_EQ(crop.at(row, column, 1), 1.0f);
    for (const auto& [row, column] : {std::pair{35, 0}, {80, 77}, {124, 159}}) {
        EXPECT_EQ(crop.at(row, column, 2), picture.at(row - 35, column + 70, 2));
    }
}

TEST_F(EvaluationOfItself, PublishedProtocolsTakeLpipsOfTheCrop) {
    writeItself([](Told&) {});
    EvaluationOptions options;
    options.protocol = EvaluationProtocol::Ag;
    options.frames = "0";
    options.cameras = kCameras[0];
    options.lpipsBackbone = folder_ / "alex.safetensors";
    options.lpipsHeads = folder_ / "heads.safetensors";
    ASSERT_TRUE(writeSafetensors(options.lpipsBackbone, test::lpipsBackbone(test::kAlex)).ok());
    ASSERT_TRUE(writeSafetensors(options.lpipsHeads, test::lpipsHeads({64, 192, 384, 256, 256})).ok());
    const auto report = evaluated(options);
    const auto loss = readLpips(options.lpipsBackbone, options.lpipsHeads);
    ASSERT_TRUE(loss.ok()) << loss.error().describe();
    // Fifty pixels around the person are all of a picture of 52 x 76: twelve white columns on either side.
    const auto square = [](const Image& image) {
        const at::Tensor whole = at::tensor(image.pixels).view({kHeight, kWidth, 3});
        const at::Tensor white = at::ones({kHeight, (kHeight - kWidth) / 2, 3});
        const at::Tensor padded = at::cat({white, whole, white}, 1).permute({2, 0, 1}).unsqueeze(0);
        return at::upsample_bilinear2d(padded, {512, 512}, false).squeeze(0).permute({1, 2, 0}).contiguous();
    };
    Image target = photographs_[0];
    for (std::size_t p = 0; p < alphas_[0].pixels.size(); ++p) {
        if (alphas_[0].pixels[p] > 128.5f / 255.0f) continue;
        for (std::size_t c = 0; c < 3; ++c) target.pixels[3 * p + c] = 1.0f;
    }
    const auto bytes = encodeJpeg(overWhite_[0], 95);
    ASSERT_TRUE(bytes.ok());
    const auto jpeg = parseJpeg(*bytes);
    ASSERT_TRUE(jpeg.ok());
    const double expected = (*loss)->evaluate(square(jpeg->image), square(target)).item<double>();
    EXPECT_GT(expected, 1e-5);
    EXPECT_NEAR(report.at("mean").at("relit_unscaled_lpips").get<double>(), expected, 1e-4 * expected);
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
