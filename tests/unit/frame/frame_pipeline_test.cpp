#include "engine/frame/display.h"
#include "engine/frame/frame_pipeline.h"
#include "engine/frame/framing.h"
#include "engine/frame/light_source.h"
#include "engine/frame/rest_avatar.h"

#include "tests/support/devices.h"
#include "tests/support/slow_evaluator.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace ars {
namespace {

using Ran = std::vector<std::string_view>;

/// The open body with few surfels, a small camera and a coarse light: frames take milliseconds.
class FramePipelineTest : public ::testing::Test {
protected:
    void SetUp() override {
        RestAvatarOptions options;
        options.maxSurfels = 6000;
        auto rest = restAvatarFromFile("open", options);
        ASSERT_TRUE(rest.ok()) << rest.error().describe();
        avatar_ = std::move(*rest);
        auto light = filterLight("uniform", uniformEnvironment(1.0f), {}, LightQuality::Draft, 64);
        ASSERT_TRUE(light.ok()) << light.error().describe();
        light_ = light->filtered;
        inputs_.pose = restPose(kSmplxJointCount);
        inputs_.camera = orbitCamera(boundsOf(avatar_->mesh().mesh.positions), 20, 5, 30, 96, 96);
        inputs_.occlusion.screenSpace.adaptive = OcclusionAdaptive::Off;
        auto pipeline = FramePipeline::create(avatar_);
        ASSERT_TRUE(pipeline.ok());
        pipeline_ = std::move(*pipeline);
        pipeline_->setLight(light_);
    }

    Ran ran(const std::vector<BufferId>& wanted) {
        const Status status = pipeline_->render(inputs_, wanted);
        EXPECT_TRUE(status.ok()) << status.error().describe();
        Ran names;
        for (const StageReport& report : pipeline_->stages()) {
            if (report.ran) names.push_back(frameStageName(report.stage));
        }
        return names;
    }
    Image picture(BufferId id) {
        auto image = pipeline_->picture(id);
        EXPECT_TRUE(image.ok()) << image.error().describe();
        return image.ok() ? *image : Image{};
    }

    std::shared_ptr<AvatarEvaluator> avatar_;
    std::shared_ptr<PrefilteredLight> light_;
    std::unique_ptr<FramePipeline> pipeline_;
    FrameInputs inputs_;
};

TEST_F(FramePipelineTest, WhatDidNotChangeIsNotComputedAgain) {
    const std::vector<BufferId> wanted{BufferId::Beauty};
    EXPECT_EQ(ran(wanted), (Ran{"evaluate", "pose", "splat", "occlude", "shade"}));
    EXPECT_EQ(ran(wanted), Ran{});
    inputs_.placement.rotationDeg = 30;
    EXPECT_EQ(ran(wanted), Ran{"shade"}) << "a turned light shades again";
    auto other = filterLight("uniform", uniformEnvironment(2.0f), {}, LightQuality::Draft, 64);
    pipeline_->setLight(other->filtered);
    EXPECT_EQ(ran(wanted), Ran{"shade"}) << "so does another light";
    inputs_.radii[0] *= 0.5f;
    EXPECT_EQ(ran(wanted), (Ran{"pose", "splat", "occlude", "shade"})) << "a radius never evaluates the avatar";
    inputs_.camera = orbitCamera(boundsOf(avatar_->mesh().mesh.positions), 60, 5, 30, 96, 96);
    EXPECT_EQ(ran(wanted), (Ran{"splat", "occlude", "shade"}));
    inputs_.occlusion.screenSpace.thicknessM = 0.2f;
    EXPECT_EQ(ran(wanted), (Ran{"occlude", "shade"}));
    inputs_.shading.f0 = 0.08f;
    EXPECT_EQ(ran(wanted), Ran{"shade"});
    inputs_.pose.rotations[16] = quatFromAxisAngle({0, 0, -1.0f});
    EXPECT_EQ(ran(wanted), (Ran{"pose", "splat", "occlude", "shade"})) << "a rest avatar has nothing to evaluate";
    EXPECT_EQ(ran({BufferId::Albedo}), Ran{}) << "the albedo was splatted for the shading";
    EXPECT_EQ(ran({BufferId::Radiance}), Ran{"splat"}) << "a buffer that was not asked for before";
    EXPECT_EQ(ran({BufferId::Specular}), (Ran{"occlude", "shade"}));
}

TEST_F(FramePipelineTest, AFrameIsTheSameHoweverTheInputsCameAbout) {
    const std::vector<BufferId> wanted{BufferId::Beauty, BufferId::AmbientOcclusion, BufferId::Normal};
    ran(wanted);
    inputs_.pose.rotations[17] = quatFromAxisAngle({0, 0, 0.8f});
    ran({BufferId::Depth});
    inputs_.radii = uniformPartRadii(0.1f);
    inputs_.placement.rotationDeg = 10;
    ran(wanted);
    const Image walked = picture(BufferId::Beauty), occluded = picture(BufferId::AmbientOcclusion);
    auto fresh = FramePipeline::create(avatar_);
    (*fresh)->setLight(light_);
    ASSERT_TRUE((*fresh)->render(inputs_, wanted).ok());
    EXPECT_EQ((*fresh)->picture(BufferId::Beauty)->pixels, walked.pixels);
    EXPECT_EQ((*fresh)->picture(BufferId::AmbientOcclusion)->pixels, occluded.pixels);
}

TEST_F(FramePipelineTest, BuffersHoldWhatTheCatalogueSays) {
    auto all = parseBuffers("all");
    ran(*all);
    const Image opacity = picture(BufferId::Opacity);
    std::size_t covered = 0;
    for (const float value : opacity.pixels) covered += value > 0.5f;
    EXPECT_GT(covered, opacity.pixels.size() / 30);
    for (const BufferId id : *all) {
        const Image image = picture(id);
        ASSERT_EQ(image.channels, bufferInfo(id).channels()) << bufferInfo(id).name;
        float largest = 0;
        for (std::size_t p = 0; p < opacity.pixels.size(); ++p) {
            for (int c = 0; c < image.channels; ++c) {
                const float value =
                    image.pixels[p * static_cast<std::size_t>(image.channels) + static_cast<std::size_t>(c)];
                ASSERT_TRUE(std::isfinite(value)) << bufferInfo(id).name;
                largest = std::max(largest, std::abs(value));
                ASSERT_TRUE(opacity.pixels[p] != 0.0f || value == 0.0f) << bufferInfo(id).name << " where nothing is";
            }
        }
        EXPECT_GT(largest, 0.0f) << bufferInfo(id).name;
    }
    const Image diffuse = picture(BufferId::Diffuse), specular = picture(BufferId::Specular),
                beauty = picture(BufferId::Beauty);
    for (std::size_t p = 0; p < opacity.pixels.size(); ++p) {
        for (std::size_t c = 0; c < 3; ++c) {
            EXPECT_NEAR(beauty.pixels[4 * p + c],
                        opacity.pixels[p] * (diffuse.pixels[3 * p + c] + specular.pixels[3 * p + c]), 2e-5);
        }
    }
}

TEST_F(FramePipelineTest, EveryMethodOfOcclusionGivesAPicture) {
    const std::vector<BufferId> wanted{BufferId::AmbientOcclusion};
    inputs_.occlusion.meshRays.rays = 64;
    inputs_.occlusion.rasterised.rows = 6;
    inputs_.occlusion.baked.resolution = 48;
    inputs_.occlusion.baked.samples = 32;
    std::map<OcclusionMethod, double> means;
    for (const auto method : {OcclusionMethod::ScreenSpace, OcclusionMethod::MeshRays, OcclusionMethod::Rasterised,
                              OcclusionMethod::Baked, OcclusionMethod::Off}) {
        inputs_.occlusion.method = method;
        ran(wanted);
        const Image opacity = picture(BufferId::Opacity), occlusion = picture(BufferId::AmbientOcclusion);
        double sum = 0, weight = 0;
        for (std::size_t p = 0; p < opacity.pixels.size(); ++p) {
            if (!(opacity.pixels[p] > 0.9f)) continue;
            sum += occlusion.pixels[p];
            weight += 1;
        }
        means[method] = sum / weight;
        std::printf("%s: mean %.3f\n",
                    std::string(EnumWords<OcclusionMethod>::words[static_cast<std::size_t>(method)]).c_str(),
                    means[method]);
    }
    EXPECT_EQ(means[OcclusionMethod::Off], 1.0);
    // A standing body is mostly open, and every method finds its armpits and legs.
    for (const auto& [method, mean] : means) {
        if (method == OcclusionMethod::Off) continue;
        EXPECT_GT(mean, 0.6);
        EXPECT_LT(mean, 0.99);
    }
    EXPECT_NEAR(means[OcclusionMethod::ScreenSpace], means[OcclusionMethod::MeshRays], 0.08)
        << "the method and the rays that it approximates look as far as each other";
}

TEST_F(FramePipelineTest, SettingsOfEveryMethodTakeEffect) {
    const std::vector<BufferId> wanted{BufferId::AmbientOcclusion};
    inputs_.occlusion.meshRays.rays = 64;
    inputs_.occlusion.rasterised.rows = 6;
    inputs_.occlusion.baked.resolution = 48;
    inputs_.occlusion.baked.samples = 32;
    const auto changes = [&](OcclusionMethod method, auto change) {
        inputs_.occlusion.method = method;
        ran(wanted);
        const Image before = picture(BufferId::AmbientOcclusion);
        change(inputs_.occlusion);
        EXPECT_EQ(ran(wanted), Ran{"occlude"});
        EXPECT_NE(picture(BufferId::AmbientOcclusion).pixels, before.pixels)
            << EnumWords<OcclusionMethod>::words[static_cast<std::size_t>(method)];
    };
    changes(OcclusionMethod::ScreenSpace,
            [](OcclusionSettings& s) { s.screenSpace.steps = s.screenSpace.lastStep = 8; });
    changes(OcclusionMethod::MeshRays, [](OcclusionSettings& s) { s.meshRays.rays = 16; });
    changes(OcclusionMethod::Rasterised, [](OcclusionSettings& s) { s.rasterised.rows = 4; });
    changes(OcclusionMethod::Baked, [](OcclusionSettings& s) { s.baked.thresholdM = 0.1f; });
}

TEST_F(FramePipelineTest, InteractiveOcclusionRefinesWhileNothingMoves) {
    inputs_.occlusion.screenSpace.quality = OcclusionQuality::Interactive;
    const std::vector<BufferId> wanted{BufferId::Beauty};
    ran(wanted);
    EXPECT_FALSE(pipeline_->occlusionComplete());
    EXPECT_LT(pipeline_->occlusionShare(), 1.0f);
    for (int i = 0; i < 64 && !pipeline_->occlusionComplete(); ++i) EXPECT_EQ(ran(wanted), (Ran{"occlude", "shade"}));
    EXPECT_TRUE(pipeline_->occlusionComplete());
    EXPECT_EQ(ran(wanted), Ran{});
    const Image refined = picture(BufferId::AmbientOcclusion);
    inputs_.occlusion.screenSpace.quality = OcclusionQuality::Full;
    ran({BufferId::AmbientOcclusion});
    const Image full = picture(BufferId::AmbientOcclusion);
    for (std::size_t p = 0; p < full.pixels.size(); ++p) ASSERT_NEAR(refined.pixels[p], full.pixels[p], 1e-4);
}

TEST_F(FramePipelineTest, ADraftPosesTheLastCanonicalSurfels) {
    const auto slow = std::make_shared<test::SlowEvaluator>(avatar_, std::chrono::milliseconds(0));
    pipeline_ = std::move(FramePipeline::create(slow).value());
    const std::vector<BufferId> wanted{BufferId::Normal};
    EXPECT_EQ(ran(wanted), (Ran{"evaluate", "pose", "splat"}));
    EXPECT_TRUE(pipeline_->canonicalFresh());
    const std::vector<glm::vec3> before = pipeline_->surfelMeans().value();
    inputs_.pose.rotations[0] = quatFromAxisAngle({0, 0.5f, 0});
    inputs_.keepCanonical = true;
    EXPECT_EQ(ran(wanted), (Ran{"pose", "splat"}));
    EXPECT_FALSE(pipeline_->canonicalFresh());
    EXPECT_NEAR(pipeline_->surfelMeans().value()[50].y, before[50].y, 1e-5f) << "turned, not lifted";
    inputs_.keepCanonical = false;
    EXPECT_EQ(ran(wanted), (Ran{"evaluate", "pose", "splat"}));
    EXPECT_TRUE(pipeline_->canonicalFresh());
    EXPECT_NEAR(pipeline_->surfelMeans().value()[50].y, before[50].y + 0.005f, 1e-5f);
    EXPECT_EQ(slow->evaluations, 2);
    inputs_.posing.importanceFalloffM = 0.2f;
    EXPECT_EQ(ran(wanted), (Ran{"pose", "splat"})) << "how surfels are posed is nothing to the networks";
}

TEST_F(FramePipelineTest, BothTargetsKeepTheirPictures) {
    const std::vector<BufferId> wanted{BufferId::Beauty, BufferId::AmbientOcclusion};
    ran(wanted);
    const Image main = picture(BufferId::Beauty);
    const std::uint64_t version = pipeline_->pictureVersion(BufferId::Beauty);
    FrameInputs half = inputs_;
    half.camera = resizedCamera(inputs_.camera, 48, 48);
    half.radii = inputs_.radii;
    ASSERT_TRUE(pipeline_->render(half, wanted, FrameTarget::Draft).ok());
    EXPECT_EQ(picture(BufferId::Beauty).width, 48);
    EXPECT_NE(pipeline_->pictureVersion(BufferId::Beauty), version);
    for (const bool due : pipeline_->pending(inputs_, wanted)) EXPECT_FALSE(due);
    EXPECT_EQ(ran(wanted), Ran{}) << "the main picture still stands";
    EXPECT_EQ(pipeline_->pictureVersion(BufferId::Beauty), version);
    EXPECT_EQ(picture(BufferId::Beauty).pixels, main.pixels);
    // A pose that was drawn in the draft is new to the main picture, too.
    half.pose.rotations[16] = quatFromAxisAngle({0, 0, -0.7f});
    ASSERT_TRUE(pipeline_->render(half, wanted, FrameTarget::Draft).ok());
    inputs_.pose = half.pose;
    EXPECT_EQ(pipeline_->pending(inputs_, wanted), (StageFlags{false, false, true, true, true}));
    EXPECT_EQ(ran(wanted), (Ran{"splat", "occlude", "shade"})) << "the surfels are posed already";
    auto fresh = FramePipeline::create(avatar_);
    (*fresh)->setLight(light_);
    ASSERT_TRUE((*fresh)->render(inputs_, wanted).ok());
    EXPECT_EQ((*fresh)->picture(BufferId::Beauty)->pixels, picture(BufferId::Beauty).pixels);
}

TEST_F(FramePipelineTest, WhatIsPendingIsWhatRuns) {
    const std::vector<BufferId> wanted{BufferId::Beauty};
    const auto check = [&](const char* what) {
        const StageFlags pending = pipeline_->pending(inputs_, wanted);
        ASSERT_TRUE(pipeline_->render(inputs_, wanted).ok());
        for (std::size_t i = 0; i < pending.size(); ++i) {
            EXPECT_EQ(pipeline_->stages()[i].ran, pending[i]) << what << ": " << frameStageName(FrameStage(i));
        }
    };
    check("first");
    check("again");
    inputs_.placement.rotationDeg = 5;
    check("light");
    inputs_.radii[1] *= 1.2f;
    check("radius");
    inputs_.occlusion.screenSpace.quality = OcclusionQuality::Interactive;
    check("interactive");
    check("refined");
    inputs_.refineOcclusion = false;
    check("not refined");
    EXPECT_FALSE(pipeline_->stages()[static_cast<std::size_t>(FrameStage::Occlude)].ran)
        << "it stands as it is, although it is not complete";
    EXPECT_FALSE(pipeline_->occlusionComplete());
}

TEST_F(FramePipelineTest, RasterisedVisibilityIsKeptForDrafts) {
    inputs_.occlusion.method = OcclusionMethod::Rasterised;
    inputs_.occlusion.rasterised.rows = 4;
    EXPECT_FALSE(pipeline_->occlusionPrepared(inputs_.occlusion));
    const std::vector<BufferId> wanted{BufferId::AmbientOcclusion};
    ran(wanted);
    EXPECT_TRUE(pipeline_->occlusionPrepared(inputs_.occlusion));
    inputs_.pose.rotations[16] = quatFromAxisAngle({0, 0, -0.9f});
    inputs_.keepVisibility = true;
    ran(wanted);
    EXPECT_EQ(pipeline_->occlusionPreparationMs(), 0.0);
    EXPECT_FALSE(pipeline_->occlusionComplete());
    const Image kept = picture(BufferId::AmbientOcclusion);
    inputs_.keepVisibility = false;
    EXPECT_EQ(ran(wanted), Ran{"occlude"});
    EXPECT_TRUE(pipeline_->occlusionComplete());
    EXPECT_NE(picture(BufferId::AmbientOcclusion).pixels, kept.pixels);
}

TEST_F(FramePipelineTest, SurfelsComeBackPosed) {
    EXPECT_EQ(pipeline_->surfelMeans().error().code, ErrorCode::NotFound);
    inputs_.pose.translation = {1, 2, 3};
    ran({BufferId::Depth});
    const Surfels surfels = pipeline_->surfels().value();
    EXPECT_TRUE(checkSurfels(surfels).ok());
    EXPECT_EQ(surfels.means, pipeline_->surfelMeans().value());
    const Bounds bounds = boundsOf(surfels.means);
    EXPECT_NEAR(bounds.center().z, 3.0f, 0.2f);
    const std::vector<glm::mat4> joints = pipeline_->jointWorld();
    ASSERT_EQ(joints.size(), static_cast<std::size_t>(kSmplxJointCount));
    EXPECT_NEAR(joints[0][3].x, 1.0f, 0.05f);
}

TEST_F(FramePipelineTest, WhatCannotBeRenderedIsSaid) {
    pipeline_->setLight(nullptr);
    EXPECT_EQ(pipeline_->render(inputs_, {BufferId::Beauty}).error().code, ErrorCode::InvalidArgument);
    EXPECT_TRUE(pipeline_->render(inputs_, {BufferId::Depth}).ok());
    EXPECT_EQ(pipeline_->picture(BufferId::Beauty).error().code, ErrorCode::NotFound);
    FrameInputs bad = inputs_;
    bad.camera.fx = 0;
    EXPECT_FALSE(pipeline_->render(bad, {BufferId::Depth}).ok());
    bad = inputs_;
    bad.pose.rotations.pop_back();
    EXPECT_NE(pipeline_->render(bad, {BufferId::Depth}).error().message.find("54"), std::string::npos);
    bad = inputs_;
    bad.pose.rotations[5].y = std::numeric_limits<float>::quiet_NaN();
    EXPECT_NE(pipeline_->render(bad, {BufferId::Depth}).error().message.find("right_knee"), std::string::npos);
    bad = inputs_;
    bad.radii[2] = -1.0f;
    EXPECT_FALSE(pipeline_->render(bad, {BufferId::Depth}).ok());
    EXPECT_TRUE(pipeline_->render(inputs_, {BufferId::Depth}).ok()) << "a refused frame spoils nothing";
}

TEST(FramePipelineDevices, CpuAndCudaShowTheSame) {
    const auto devices = test::devicesUnderTest();
    RestAvatarOptions options;
    options.maxSurfels = 6000;
    auto rest = restAvatarFromFile("open", options);
    ASSERT_TRUE(rest.ok());
    const std::shared_ptr<AvatarEvaluator> avatar = std::move(*rest);
    FrameInputs inputs;
    inputs.pose = restPose(kSmplxJointCount);
    inputs.camera = orbitCamera(boundsOf(avatar->mesh().mesh.positions), 20, 5, 30, 96, 96);
    const auto buffers = parseBuffers("all");
    std::map<BufferId, Image> first;
    std::vector<glm::vec3> hostMeans;
    for (const Device& device : devices) {
        auto pipeline = FramePipeline::create(avatar, device);
        ASSERT_TRUE(pipeline.ok());
        auto light = filterLight("sky", readLight("sky").value(), device, LightQuality::Exact, 64);
        ASSERT_TRUE(light.ok()) << light.error().describe();
        (*pipeline)->setLight(light->filtered);
        ASSERT_TRUE((*pipeline)->render(inputs, *buffers).ok());
        const std::vector<glm::vec3> means = (*pipeline)->surfelMeans().value();
        if (device.kind == DeviceKind::Host) hostMeans = means;
        ASSERT_EQ(means.size(), hostMeans.size());
        for (std::size_t i = 0; i < means.size(); ++i) ASSERT_LT(glm::distance(means[i], hostMeans[i]), 1e-4f);
        EXPECT_EQ((*pipeline)->surfels().value().means, means);
        for (const BufferId id : *buffers) {
            Image image = (*pipeline)->picture(id).value();
            if (device.kind == DeviceKind::Host) {
                first[id] = std::move(image);
                continue;
            }
            // Pixels at a threshold (a surfel just above 1/255 on one device) may differ; there must be few.
            std::size_t different = 0;
            for (std::size_t i = 0; i < image.pixels.size(); ++i) {
                different += std::abs(image.pixels[i] - first[id].pixels[i]) > 1e-3f;
            }
            EXPECT_LE(different, image.pixels.size() / 200) << bufferInfo(id).name;
        }
    }
}

TEST(LightSource, WordsStandForGeneratedLights) {
    for (const char* word : {"sky", "sky:8,-30", "studio", "studio:rim", "studio:overcast", "uniform"}) {
        const auto light = readLight(word);
        EXPECT_TRUE(light.ok()) << word << ": " << (light.ok() ? "" : light.error().describe());
    }
    for (const char* word : {"sky:", "sky:high", "sky:10", "sky:10,20,30", "sky:200,0", "studio:bright"}) {
        if (std::string(word) == "sky:") continue; // an empty variant is none
        const auto light = readLight(word);
        ASSERT_FALSE(light.ok()) << word;
        EXPECT_EQ(light.error().code, ErrorCode::InvalidArgument) << word;
    }
    EXPECT_EQ(readLight("nowhere.exr").error().code, ErrorCode::NotFound);
}

} // namespace
} // namespace ars
