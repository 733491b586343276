#include "model/training/trainer.h"

#include "engine/io/safetensors.h"
#include "engine/surfel/splat.h"
#include "model/avatar/avatar_model.h"
#include "model/training/placement.h"
#include "tests/unit/capture/synthetic_capture.h"

#include <ATen/ATen.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <cstring>

namespace ars {
namespace {

/// The smallest networks there are, a box as the person: what counts is that everything fits together.
TrainingConfig smallConfig() {
    TrainingConfig config = trainingPreset("tiny").value();
    config.schedule.templateSteps = 2;
    config.schedule.radianceSteps = 3;
    config.schedule.pbrSteps = 3;
    config.schedule.perceptualSize = 32;
    config.schedule.perceptualCropAfter = 2; // within stage 1
    config.network.maxChannels = 8;
    config.network.styleSize = 16;
    config.occlusion.interactiveDirections = 16;
    return config;
}

class TrainerTest : public ::testing::Test {
protected:
    void SetUp() override {
        folder_ =
            std::filesystem::temp_directory_path() /
            fmt::format("ars-trainer-{}-{}", getpid(), ::testing::UnitTest::GetInstance()->current_test_info()->name());
        std::filesystem::remove_all(folder_);
        test::SyntheticCapture capture;
        capture.cameras = 2;
        capture.frames = 2;
        test::writeCapture(capture, folder_ / "capture");
    }
    void TearDown() override { std::filesystem::remove_all(folder_); }

    std::unique_ptr<TrainingTask> trainer(const TrainingConfig& config) {
        TrainerSources sources;
        sources.capture = folder_ / "capture";
        std::unique_ptr<TrainingTask> task = makeAvatarTrainer(sources, config);
        const Status loaded = task->load({});
        EXPECT_TRUE(loaded.ok()) << loaded.error().describe();
        return task;
    }
    std::filesystem::path saved(TrainingTask& task, const std::string& name) {
        std::filesystem::create_directories(folder_ / name);
        const Status status = task.save(folder_ / name);
        EXPECT_TRUE(status.ok()) << status.error().describe();
        return folder_ / name;
    }
    static std::map<std::string, double> run(TrainingTask& task, int steps) {
        std::map<std::string, double> last;
        for (int i = 0; i < steps; ++i) {
            const Result<StepReport> report = task.step();
            EXPECT_TRUE(report.ok()) << report.error().describe();
            if (!report) break;
            last = report->values;
        }
        return last;
    }
    /// Names of tensors whose bytes differ.
    static std::vector<std::string> differences(const std::filesystem::path& a, const std::filesystem::path& b) {
        const SafetensorsFile first = readSafetensors(a).value(), second = readSafetensors(b).value();
        std::vector<std::string> names;
        EXPECT_EQ(first.tensors.size(), second.tensors.size());
        for (const auto& [name, array] : first.tensors) {
            if (array.bytes != second.tensors.at(name).bytes) names.push_back(name);
        }
        return names;
    }

    std::filesystem::path folder_;
};

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

TEST_F(TrainerTest, ACheckpointOfOtherNetworksIsRefused) {
    const auto task = trainer(smallConfig());
    const std::filesystem::path checkpoint = saved(*task, "a");
    TrainingConfig other = smallConfig();
    other.network.maxChannels = 4;
    const Status status = trainer(other)->restore(checkpoint);
    ASSERT_FALSE(status.ok());
    EXPECT_NE(status.error().describe().find("other networks"), std::string::npos) << status.error().describe();
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
