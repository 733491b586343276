#include "engine/surfel/splat.h"
#include "model/avatar/avatar_model.h"
#include "model/plugin.h"
#include "tests/unit/model/trainer_support.h"

#include <ATen/ATen.h>

#include <algorithm>

extern "C" ars::ModelPlugin* arsModelPlugin();

namespace ars {
namespace {

using test::smallConfig;
using test::TrainerTest;

TEST_F(TrainerTest, PassesThroughItsThreeStagesAndTheAvatarOpens) {
    const auto task = trainer(smallConfig());
    EXPECT_EQ(task->totalSteps(), 8);
    std::string stages;
    for (int i = 0; i < 8; ++i) {
        const Result<StepReport> report = task->step();
        ASSERT_TRUE(report.ok()) << report.error().describe();
        stages += report->stage[0];
        EXPECT_TRUE(std::isfinite(report->values.at("loss.total")));
    }
    EXPECT_EQ(stages, "ttrrrppp");
    const Result<AvatarModel> model = readAvatar(saved(*task, "a"));
    ASSERT_TRUE(model.ok()) << model.error().describe();
    ASSERT_TRUE(model->light.has_value());
    EXPECT_EQ(model->light->size, smallConfig().light.cubeSize);
    Surfels surfels;
    const auto avatar = makeTrainedAvatar(*model, true);
    ASSERT_TRUE(avatar->evaluate(restPose(55), nullptr, surfels).ok());
    EXPECT_EQ(surfels.count(), model->maps.pointCount());
    EXPECT_EQ(surfels.albedos.size(), surfels.count());
    EXPECT_EQ(surfels.colors.size(), surfels.count());
    std::filesystem::create_directories(folder_ / "previews");
    const Status preview = task->preview(folder_ / "previews");
    EXPECT_TRUE(preview.ok()) << preview.error().describe();
    EXPECT_FALSE(std::filesystem::is_empty(folder_ / "previews"));
}

TEST_F(TrainerTest, ResumedAtAnyStepItEndsBitForBitWhereItWouldHaveEnded) {
    const TrainingConfig config = smallConfig();
    const auto whole = trainer(config);
    run(*whole, 8);
    const std::filesystem::path end = saved(*whole, "whole");
    for (const int at : {1, 2, 4, 5, 7}) {
        const auto first = trainer(config);
        run(*first, at);
        const std::filesystem::path checkpoint = saved(*first, fmt::format("at{}", at));
        const auto second = trainer(config);
        const Status restored = second->restore(checkpoint);
        ASSERT_TRUE(restored.ok()) << restored.error().describe();
        EXPECT_EQ(second->stepsDone(), at);
        run(*second, 8 - at);
        const std::filesystem::path resumed = saved(*second, fmt::format("resumed{}", at));
        for (const char* file : {"weights.safetensors", "trainer.safetensors"}) {
            EXPECT_EQ(differences(end / file, resumed / file), std::vector<std::string>{}) << file << " after " << at;
        }
    }
}

TEST_F(TrainerTest, RadianceLossFallsAndFrozenPartsStay) {
    TrainingConfig config = smallConfig();
    config.schedule.templateSteps = 0;
    config.schedule.radianceSteps = 40;
    config.schedule.pbrSteps = 2;
    config.freeze.geometry = true;
    const auto task = trainer(config);
    const std::filesystem::path before = saved(*task, "before");
    const double first = run(*task, 1).at("loss.l1");
    const double last = run(*task, 39).at("loss.l1");
    EXPECT_LT(last, 0.7 * first);
    run(*task, 2);
    const std::filesystem::path after = saved(*task, "after");
    bool appearance = false;
    for (const std::string& name : differences(before / "weights.safetensors", after / "weights.safetensors")) {
        EXPECT_FALSE(name.starts_with("geometry.") || name == "base.geometry") << name;
        appearance = appearance || name.starts_with("appearance.");
    }
    EXPECT_TRUE(appearance);
}

TEST_F(TrainerTest, WhatIsFrozenDecodesToTheSameThoughItSharesThePriorEncoder) {
    for (const NetworkSplit split : {NetworkSplit::Two, NetworkSplit::Four}) {
        for (const bool geometry : {true, false}) {
            TrainingConfig config = smallConfig();
            config.schedule.templateSteps = 0;
            config.schedule.radianceSteps = config.schedule.pbrSteps = 2;
            config.loss.radianceInPbr = 0.5;
            config.network.split = split;
            config.network.zeroOutputs = false; // else the encoder's features reach no output in so few steps
            (geometry ? config.freeze.geometry : config.freeze.materials) = true;
            const std::string name = fmt::format("{}{}", geometry, split == NetworkSplit::Two);
            const auto task = trainer(config);
            const Surfels before = test::surfelsOf(saved(*task, "before" + name));
            run(*task, 4);
            const Surfels after = test::surfelsOf(saved(*task, "after" + name));
            EXPECT_EQ(before.means == after.means, geometry);
            EXPECT_EQ(before.rotations == after.rotations, geometry);
            EXPECT_EQ(before.scales == after.scales, geometry);
            EXPECT_EQ(before.opacities == after.opacities, geometry);
            EXPECT_EQ(before.albedos == after.albedos, !geometry);
            EXPECT_EQ(before.roughnesses == after.roughnesses, !geometry);
            EXPECT_EQ(before.colors == after.colors, !geometry);
        }
    }
}

TEST_F(TrainerTest, AKnownLightStaysTheFilesOwn) {
    TrainingConfig config = smallConfig();
    config.schedule.templateSteps = config.schedule.radianceSteps = 0;
    config.schedule.pbrSteps = 2;
    config.light.file = test::writeSky(folder_ / "sky.exr", 3.0f, 0.25f);
    const auto task = trainer(config);
    const std::filesystem::path before = saved(*task, "before");
    run(*task, 2);
    const std::filesystem::path after = saved(*task, "after");
    const auto differ = differences(before / "trainer.safetensors", after / "trainer.safetensors");
    EXPECT_EQ(std::count(differ.begin(), differ.end(), "light.log"), 0);
    EXPECT_EQ(std::count(differ.begin(), differ.end(), "radius_offsets"), 1) << "nothing was learned at all";
    const Result<AvatarModel> model = readAvatar(after);
    ASSERT_TRUE(model.ok()) << model.error().describe();
    const auto& texels = model->light->texels;
    EXPECT_NEAR(*std::max_element(texels.begin(), texels.end()), 3.0f, 1e-4f);
    EXPECT_NEAR(*std::min_element(texels.begin(), texels.end()), 0.25f, 1e-4f);
}

TEST_F(TrainerTest, RadiiMayStayFixedOrOcclusionBeLeftOut) {
    for (const RadiusTraining radii : {RadiusTraining::Fixed, RadiusTraining::Off}) {
        TrainingConfig config = smallConfig();
        config.schedule.templateSteps = 0;
        config.schedule.radianceSteps = 1;
        config.schedule.pbrSteps = 2;
        config.freeze.radii = radii;
        const std::unique_ptr<TrainingTask> task = trainer(config);
        const auto values = run(*task, 3);
        EXPECT_EQ(task->stepsDone(), 3);
        EXPECT_GT(values.at("loss.l1"), 0.0);
        const Result<AvatarModel> model = readAvatar(saved(*task, radii == RadiusTraining::Fixed ? "fixed" : "off"));
        ASSERT_TRUE(model.ok()) << model.error().describe();
        EXPECT_EQ(model->spec.radiusOffsets, PartRadii{});
    }
}

TEST_F(TrainerTest, NumbersThatAreNoneAreNamedWithTheirStep) {
    TrainingConfig config = smallConfig();
    config.schedule.templateSteps = 0;
    config.schedule.radianceSteps = 30;
    config.schedule.networkRate = 1e30;
    config.schedule.baseRate = 1e30;
    const auto task = trainer(config);
    for (int i = 0; i < 30; ++i) {
        const Result<StepReport> report = task->step();
        if (report) continue;
        EXPECT_NE(report.error().describe().find(fmt::format("step {}", i)), std::string::npos)
            << report.error().describe();
        return;
    }
    FAIL() << "thirty steps at a rate of 1e30 went well";
}

TEST_F(TrainerTest, AStopIsHeardWhileTheCaptureIsOpened) {
    TrainerSources sources;
    sources.capture = folder_ / "capture";
    const auto task = makeAvatarTrainer(sources, smallConfig());
    const Status loaded = task->load([](double, std::string_view what) { return what != "listing pictures"; });
    ASSERT_FALSE(loaded.ok());
    EXPECT_EQ(loaded.error().code, ErrorCode::Cancelled) << loaded.error().describe();

    // Of a new run there is nothing yet.
    TrainRequest request;
    request.capture = sources.capture;
    request.run = folder_ / "run";
    request.preset = "tiny";
    const auto stopped = arsModelPlugin()->train(request, true, {});
    ASSERT_FALSE(stopped.ok());
    EXPECT_EQ(stopped.error().code, ErrorCode::Cancelled) << stopped.error().describe();
    EXPECT_FALSE(std::filesystem::exists(request.run));
}

TEST_F(TrainerTest, BrokenAvatarFilesAreNamed) {
    const auto task = trainer(smallConfig());
    const std::filesystem::path avatar = saved(*task, "a");
    std::filesystem::resize_file(avatar / "weights.safetensors", 5000);
    Result<AvatarModel> model = readAvatar(avatar);
    ASSERT_FALSE(model.ok());
    EXPECT_NE(model.error().describe().find("weights.safetensors"), std::string::npos) << model.error().describe();
    test::writeBytes(avatar / "avatar.json", "{\"format\": \"ars.avatar\", \"version\": 99}");
    model = readAvatar(avatar);
    ASSERT_FALSE(model.ok());
    EXPECT_NE(model.error().describe().find("99"), std::string::npos) << model.error().describe();
}

TEST(ViewMap, HoldsTheCosineAndWhenAskedTheNormalInTheWorld) {
    const auto body = std::make_shared<const BodyModel>(readOpenBody().value());
    const auto avatar = [&](bool normals) {
        AvatarSpec spec;
        spec.network = smallConfig().network;
        spec.network.viewNormals = normals;
        return createAvatar(std::move(spec), templateFromBody(*body), body, 1).value();
    };
    const AvatarModel model = avatar(true);
    Camera camera;
    camera.translation = {0.0, 0.0, 1e6};
    Pose pose;
    pose.rotations.resize(model.mesh.skeleton().jointCount(), glm::quat(1, 0, 0, 0));
    const auto mapOf = [&](const AvatarModel& of) { return viewMap(of, pose, camera).value(); };
    const at::Tensor still = mapOf(model);
    ASSERT_EQ(still.sizes(), at::IntArrayRef({2, 4, 64, 64}));
    EXPECT_TRUE(at::equal(still.slice(1, 0, 1), mapOf(avatar(false))));
    // From far away in -z the cosine is that of the normal to -z.
    EXPECT_LT((still.slice(1, 0, 1) + still.slice(1, 3, 4)).abs().max().item<double>(), 1e-4);
    EXPECT_GT(still.slice(1, 3, 4).abs().max().item<double>(), 0.9);

    // A quarter turn about y takes z to x and x to -z.
    pose.rotations[0] = glm::angleAxis(glm::half_pi<float>(), glm::vec3(0, 1, 0));
    const at::Tensor turned = mapOf(model);
    EXPECT_LT((turned.slice(1, 1, 2) - still.slice(1, 3, 4)).abs().max().item<double>(), 1e-5);
    EXPECT_LT((turned.slice(1, 3, 4) + still.slice(1, 1, 2)).abs().max().item<double>(), 1e-5);
    EXPECT_LT((turned.slice(1, 2, 3) - still.slice(1, 2, 3)).abs().max().item<double>(), 1e-5);
}

TEST(SurfelDecoding, WithoutNetworkOutputsSurfelsLieOnTheTemplateAndFaceOutwards) {
    const BodyModel body = readOpenBody().value();
    CanonicalMapOptions options;
    options.size = 128;
    const CanonicalMaps maps = canonicalMaps(templateFromBody(body), options).value();
    DecodingParams params;
    params.insetM = 0.0;
    const SurfelBase base = surfelBase(maps, params).value();
    const auto n = static_cast<std::int64_t>(maps.pointCount());
    RawAttributes raw;
    raw.offsets = at::zeros({n, 3});
    raw.opacities = at::zeros({n, 1});
    raw.scales = at::zeros({n, 3});
    raw.rotations = at::zeros({n, 4});
    raw.albedos = at::zeros({n, 3});
    raw.roughnesses = at::zeros({n, 1});
    raw.colors = at::zeros({n, 3});
    const Surfels surfels = surfelsFromTensors(decodeSurfels(params, base, raw).surfels);
    const float pixelM = 2.0f / 128.0f;
    for (std::size_t i = 0; i < surfels.count(); ++i) {
        EXPECT_NEAR(glm::distance(surfels.means[i], maps.positions[i]), 0.0f, 1e-6f);
        const float* q = &surfels.rotations[4 * i];
        const glm::mat3 frame = glm::mat3_cast(glm::quat(q[0], q[1], q[2], q[3]));
        EXPECT_GT(glm::dot(frame[2], maps.normals[i]), 0.9999f);
        // The first tangent runs along the fall of the surface: across the map it stretches 1/|n.z|.
        EXPECT_NEAR(surfels.scales[i].y, 0.7f * pixelM, 1e-6f);
        EXPECT_NEAR(surfels.scales[i].x, 0.7f * pixelM * std::min(6.0f, 1.0f / std::abs(maps.normals[i].z)), 1e-5f);
        EXPECT_NEAR(surfels.opacities[i], 0.9f, 1e-5f);
        EXPECT_NEAR(surfels.albedos[i].y, 0.5f, 1e-5f);
        EXPECT_NEAR(surfels.roughnesses[i], 0.6f, 1e-5f);
        if (::testing::Test::HasFailure()) break;
    }
}

} // namespace
} // namespace ars
