#include "engine/core/file.h"
#include "engine/surfel/splat.h"
#include "model/avatar/avatar_model.h"
#include "model/plugin.h"
#include "model/training/placement.h"
#include "tests/unit/model/trainer_support.h"

#include <ATen/ATen.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <cstdio>

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

TEST_F(TrainerTest, WithoutCudaATrainingThereIsRefusedBeforeAnythingIsRead) {
    if (trainingDevice(RunDevice::Cuda)) {
        std::printf("NOT RUN: TrainerTest: the refusal of CUDA: there is a device\n");
        return;
    }
    TrainingConfig config = smallConfig();
    ASSERT_TRUE(setTrainingParameter(config, "run.device", "cuda").ok());
    TrainerSources nowhere;
    nowhere.capture = folder_ / "no_such_capture";
    const Status status = makeAvatarTrainer(nowhere, config)->load({});
    ASSERT_FALSE(status.ok());
    EXPECT_TRUE(status.error().describe().starts_with("run.device: is cuda, but ")) << status.error().describe();
}

// The first steps of both are one function of the same numbers; later ones drift apart as roundings do.
TEST_F(TrainerTest, OnCudaItLearnsWhatItLearnsOnTheProcessor) {
    if (const auto device = trainingDevice(RunDevice::Cuda); !device) {
        std::printf("NOT RUN: TrainerTest: a training on CUDA: %s\n", device.error().describe().c_str());
        return;
    }
    for (const auto& [radiance, pbr] : {std::pair{8, 0}, std::pair{0, 8}}) {
        TrainingConfig config = smallConfig();
        config.schedule.templateSteps = 0;
        config.schedule.radianceSteps = radiance;
        config.schedule.pbrSteps = pbr;
        config.run.device = RunDevice::Cpu;
        const auto expected = run(*trainer(config), 1);
        config.run.device = RunDevice::Cuda;
        const auto task = trainer(config);
        const auto found = run(*task, 1);
        for (const auto& [name, value] : expected) {
            if (!name.starts_with("loss.")) continue;
            EXPECT_NEAR(found.at(name), value, 0.01 * std::abs(value) + 1e-5) << name;
        }
        run(*task, 3);
        const std::filesystem::path checkpoint = saved(*task, fmt::format("cuda{}", pbr));
        ASSERT_TRUE(trainer(config)->restore(checkpoint).ok());
        config.run.device = RunDevice::Cpu;
        const auto onHost = trainer(config);
        ASSERT_TRUE(onHost->restore(checkpoint).ok()) << "a checkpoint belongs to no device";
        EXPECT_TRUE(std::isfinite(run(*onHost, 1).at("loss.total")));
        std::filesystem::create_directories(folder_ / "previews");
        const Status preview = task->preview(folder_ / "previews");
        EXPECT_TRUE(preview.ok()) << preview.error().describe();
    }
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
        EXPECT_EQ(model->spec.occluded, radii == RadiusTraining::Fixed);
    }
}

/// Trained without occlusion, and with a falloff and a thickness of its own.
TrainingConfig unusualConfig() {
    TrainingConfig config = smallConfig();
    config.freeze.radii = RadiusTraining::Off;
    config.posing.importanceFalloffM = 0.31f;
    config.occlusion.thicknessM = 0.22f;
    return config;
}

TEST_F(TrainerTest, AnAvatarIsShownWithTheOcclusionThatItWasTrainedWith) {
    const std::filesystem::path checkpoint = saved(*trainer(unusualConfig()), "a");
    const Result<OpenedTrainedAvatar> opened = arsModelPlugin()->openAvatar(checkpoint, true, AvatarPrecision::Exact);
    ASSERT_TRUE(opened.ok()) << opened.error().describe();
    EXPECT_FALSE(opened->occluded);
    EXPECT_EQ(opened->posing.importanceFalloffM, 0.31f);
    EXPECT_EQ(opened->occlusion.thicknessM, 0.22f);
    EXPECT_EQ(opened->occlusion.quality, OcclusionQuality::Full) << "the directions of a step are no picture's";
    EXPECT_EQ(opened->occlusion.interactiveDirections, OcclusionParams().interactiveDirections);
}

TEST_F(TrainerTest, QuickNetworksGiveNearlyTheSameSurfels) {
    const auto task = trainer(smallConfig());
    run(*task, 8);
    const std::filesystem::path checkpoint = saved(*task, "a");
    Surfels exact, quick;
    for (const auto precision : {AvatarPrecision::Exact, AvatarPrecision::Quick}) {
        const auto opened = arsModelPlugin()->openAvatar(checkpoint, true, precision);
        ASSERT_TRUE(opened.ok()) << opened.error().describe();
        Surfels& surfels = precision == AvatarPrecision::Exact ? exact : quick;
        ASSERT_TRUE(opened->evaluator->evaluate(restPose(55), nullptr, surfels).ok());
        const bool said = opened->evaluator->description().find("bfloat16") != std::string::npos;
        EXPECT_EQ(said, precision == AvatarPrecision::Quick && hasNativeBFloat16());
    }
    double geometry = 0, materials = 0;
    for (std::size_t i = 0; i < exact.count(); ++i) {
        geometry = std::max(geometry, double(glm::distance(exact.means[i], quick.means[i])));
        materials = std::max(materials, double(glm::distance(exact.albedos[i], quick.albedos[i])));
    }
    EXPECT_LT(geometry, 1e-3) << "metres";
    EXPECT_LT(materials, 1e-2);
    if (!hasNativeBFloat16()) {
        EXPECT_EQ(geometry + materials, 0.0);
        std::puts("NOT RUN: bfloat16 networks, this CPU does not multiply it natively");
        return;
    }
    EXPECT_GT(geometry + materials, 0.0) << "sixteen bits were used";
}

TEST_F(TrainerTest, EvaluationShadesAsTheAvatarWasTrained) {
    for (const bool occluded : {false, true}) {
        TrainingConfig config = unusualConfig();
        if (occluded) config.freeze.radii = RadiusTraining::Fixed;
        EvalRequest request;
        request.avatar = saved(*trainer(config), occluded ? "with" : "without");
        request.capture = folder_ / "capture";
        const auto report = arsModelPlugin()->evaluate(request, {});
        ASSERT_TRUE(report.ok()) << report.error().describe();
        EXPECT_EQ(report->at("occluded"), occluded);
    }
}

TEST_F(TrainerTest, AnAvatarFromBeforeOcclusionWasWrittenOpensWithTheUsualOne) {
    const std::filesystem::path avatar = saved(*trainer(unusualConfig()), "a");
    auto json = nlohmann::ordered_json::parse(readTextFile(avatar / "avatar.json").value());
    for (const char* key : {"occluded", "occlusion", "posing"}) json.erase(key);
    test::writeBytes(avatar / "avatar.json", json.dump());
    const Result<AvatarModel> model = readAvatar(avatar);
    ASSERT_TRUE(model.ok()) << model.error().describe();
    EXPECT_TRUE(model->spec.occluded);
    EXPECT_EQ(model->spec.occlusion, OcclusionParams());
    EXPECT_EQ(model->spec.posing, PoseSurfelsParams());
    json["occlusion"] = {{"last_step", 9000}};
    test::writeBytes(avatar / "avatar.json", json.dump());
    const Result<AvatarModel> broken = readAvatar(avatar);
    ASSERT_FALSE(broken.ok());
    EXPECT_NE(broken.error().describe().find("avatar.json"), std::string::npos) << broken.error().describe();
    EXPECT_NE(broken.error().describe().find("last_step"), std::string::npos) << broken.error().describe();
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

TEST_F(TrainerTest, NamesThatAreNoUtf8AreSaidAtTheStartAndCostNoAvatar) {
    const std::filesystem::path odd = folder_ / "capt\xffure";
    std::filesystem::copy(folder_ / "capture", odd, std::filesystem::copy_options::recursive);
    for (const auto& [capture, run] : {std::pair{odd, folder_ / "run"}, {folder_ / "capture", folder_ / "ru\xfen"}}) {
        TrainRequest request;
        request.capture = capture;
        request.run = run;
        request.preset = "tiny";
        const auto trained = arsModelPlugin()->train(request, std::atomic<bool>(true), {});
        ASSERT_FALSE(trained.ok());
        EXPECT_EQ(trained.error().code, ErrorCode::InvalidArgument);
        EXPECT_NE(trained.error().message.find("UTF-8"), std::string::npos) << trained.error().describe();
        EXPECT_FALSE(std::filesystem::exists(run));
    }
    Result<AvatarModel> model = readAvatar(saved(*trainer(smallConfig()), "a"));
    ASSERT_TRUE(model.ok()) << model.error().describe();
    model->spec.origin = "step 3 of a training on capt\xffure";
    std::filesystem::create_directories(folder_ / "b");
    const Status written = writeAvatarFiles(folder_ / "b", *model, {});
    ASSERT_TRUE(written.ok()) << written.error().describe();
    const Result<AvatarModel> again = readAvatar(folder_ / "b");
    ASSERT_TRUE(again.ok()) << again.error().describe();
    EXPECT_EQ(again->spec.origin, "step 3 of a training on capt\xef\xbf\xbdure");
}

TEST_F(TrainerTest, AnExportedAvatarIsTheCheckpointWithoutTheTrainer) {
    const std::filesystem::path checkpoint = saved(*trainer(smallConfig()), "checkpoint");
    const std::filesystem::path avatar = folder_ / "out" / "anna.avatar";
    const auto exported = [&](const std::filesystem::path& to) {
        return arsModelPlugin()->exportAvatar(checkpoint, to);
    };
    Status status = exported(avatar / ""); // with a slash at the end
    ASSERT_TRUE(status.ok()) << status.error().describe();
    std::vector<std::string> names;
    for (const auto& entry : std::filesystem::directory_iterator(avatar)) names.push_back(entry.path().filename());
    std::sort(names.begin(), names.end());
    const std::vector<std::string> wanted{"avatar.json", "light.exr",    "pca.safetensors",
                                          "preview.png", "template.glb", "weights.safetensors"};
    EXPECT_EQ(names, wanted);
    EXPECT_EQ(differences(checkpoint / "weights.safetensors", avatar / "weights.safetensors"),
              std::vector<std::string>{});
    EXPECT_TRUE(readAvatar(avatar).ok());
    // Replaced where it is an avatar; what else stands there is never touched.
    std::filesystem::resize_file(avatar / "light.exr", 10);
    status = exported(avatar);
    ASSERT_TRUE(status.ok()) << status.error().describe();
    EXPECT_GT(std::filesystem::file_size(avatar / "light.exr"), 10u);
    test::writeBytes(avatar / "notes.txt", "mine");
    test::writeBytes(folder_ / "file.avatar", "mine");
    for (const auto& [place, word] : {std::pair{avatar, "notes.txt"},
                                      {checkpoint, "trainer.safetensors"},
                                      {folder_ / "file.avatar", "found a file"},
                                      {folder_ / "capture", "found "}}) {
        status = exported(place);
        ASSERT_FALSE(status.ok()) << place;
        EXPECT_EQ(status.error().code, ErrorCode::InvalidArgument);
        EXPECT_NE(status.error().describe().find(word), std::string::npos) << status.error().describe();
        EXPECT_TRUE(std::filesystem::exists(place));
    }
    EXPECT_TRUE(readAvatar(avatar).ok());
    EXPECT_TRUE(std::filesystem::exists(avatar / "notes.txt"));
    EXPECT_TRUE(std::filesystem::exists(checkpoint / "trainer.safetensors"));
    for (const auto& entry : std::filesystem::directory_iterator(avatar.parent_path())) {
        EXPECT_EQ(entry.path(), avatar) << "nothing of the way there is left";
    }
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
