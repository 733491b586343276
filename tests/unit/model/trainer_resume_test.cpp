#include "tests/unit/model/trainer_support.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace ars {
namespace {

using test::smallConfig;

/// A run that goes on under parameters that it was not begun with.
class TrainerResume : public test::TrainerTest {
protected:
    static TrainingConfig config(int radianceSteps, int pbrSteps) {
        TrainingConfig config = smallConfig();
        config.schedule.templateSteps = 0;
        config.schedule.radianceSteps = radianceSteps;
        config.schedule.pbrSteps = pbrSteps;
        return config;
    }
    std::filesystem::path savedAfter(const TrainingConfig& config, int steps, const std::string& name) {
        const auto task = trainer(config);
        run(*task, steps);
        return saved(*task, name);
    }
    std::unique_ptr<TrainingTask> resumed(const TrainingConfig& config, const std::filesystem::path& checkpoint) {
        std::unique_ptr<TrainingTask> task = trainer(config);
        const Status restored = task->restore(checkpoint);
        EXPECT_TRUE(restored.ok()) << restored.error().describe();
        return task;
    }
    static SafetensorsFile state(const std::filesystem::path& checkpoint) {
        return readSafetensors(checkpoint / "trainer.safetensors").value();
    }
    static std::vector<float> values(const std::filesystem::path& checkpoint, const char* name) {
        return state(checkpoint).tensors.at(name).toFloat().value();
    }
};

TEST_F(TrainerResume, PartsThatWereFrozenAreLearnedFromThenOn) {
    TrainingConfig frozen = config(1, 4);
    frozen.freeze.light = true;
    frozen.freeze.radii = RadiusTraining::Fixed;
    frozen.decoding.learnBase = false;
    const std::filesystem::path before = savedAfter(frozen, 2, "before");
    const auto task = resumed(config(1, 4), before);
    run(*task, 2);
    const std::filesystem::path after = saved(*task, "after");
    EXPECT_NE(values(before, "light.log"), values(after, "light.log"));
    EXPECT_NE(values(before, "radius_offsets"), values(after, "radius_offsets"));
    const SafetensorsFile weights = readSafetensors(after / "weights.safetensors").value();
    const std::vector<float> base = weights.tensors.at("base.materials").toFloat().value();
    EXPECT_GT(*std::max_element(base.begin(), base.end()), 0.0f);
    // Their moments begin where they begin; those of the others go on.
    EXPECT_EQ(state(after).metadata.at("adam.light.steps"), "2");
    EXPECT_EQ(state(after).metadata.at("adam.appearance.steps"), "3");
}

TEST_F(TrainerResume, AnotherLightTakesThePlaceOfTheLearnedOneAndBack) {
    const TrainingConfig learned = config(1, 5);
    const std::filesystem::path first = savedAfter(learned, 2, "first");
    TrainingConfig known = learned;
    known.light.file = test::writeSky(folder_ / "sky.exr", 3.0f, 0.25f);
    const auto task = resumed(known, first);
    run(*task, 1);
    const std::filesystem::path second = saved(*task, "second");
    for (const float texel : values(second, "light.log")) {
        const float value = std::exp(texel);
        ASSERT_TRUE(value > 0.249f && value < 3.001f) << value;
    }
    const std::vector<float> sky = values(second, "light.log");
    EXPECT_NEAR(*std::max_element(sky.begin(), sky.end()), std::log(3.0f), 1e-4f);
    // Learned again, it starts from what it was.
    const std::filesystem::path third = saved(*resumed(learned, second), "third");
    EXPECT_EQ(values(third, "light.log"), sky);
}

TEST_F(TrainerResume, AScheduleThatChangesTheStageBeginsItAsAnyStageBegins) {
    const std::filesystem::path before = savedAfter(config(6, 2), 4, "before");
    TrainingConfig shorter = config(2, 6);
    const auto task = resumed(shorter, before);
    const Result<StepReport> report = task->step();
    ASSERT_TRUE(report.ok()) << report.error().describe();
    EXPECT_EQ(report->stage, "pbr");
    const std::filesystem::path after = saved(*task, "after");
    for (const char* group : {"geometry", "appearance", "light", "radii"}) {
        EXPECT_EQ(state(after).metadata.at(fmt::format("adam.{}.steps", group)), "1") << group;
    }
    // The first step of Adam is as long as its rate (here that of two steps into six, a third along the cosine).
    const double share = 0.05 + 0.95 * 0.5 * (1.0 + std::cos(std::numbers::pi / 3.0));
    double longest = 0;
    for (const float offset : values(after, "radius_offsets")) longest = std::max<double>(longest, std::abs(offset));
    EXPECT_NEAR(longest, share * shorter.schedule.radiusRate, 1e-3 * shorter.schedule.radiusRate);

    // Back to the stage before, too; and where only lengths change, moments go on.
    const auto back = resumed(config(9, 1), after);
    run(*back, 1);
    EXPECT_EQ(state(saved(*back, "back")).metadata.at("adam.geometry.steps"), "1");
    const auto longer = resumed(config(9, 2), before);
    run(*longer, 1);
    EXPECT_EQ(state(saved(*longer, "longer")).metadata.at("adam.geometry.steps"), "5");
}

TEST_F(TrainerResume, WhatWouldLoseLearnedValuesIsRefused) {
    const std::filesystem::path checkpoint = savedAfter(config(2, 2), 1, "a");
    const auto refusal = [&](const TrainingConfig& other) {
        const Status status = trainer(other)->restore(checkpoint);
        EXPECT_FALSE(status.ok());
        EXPECT_EQ(status ? ErrorCode::Internal : status.error().code, ErrorCode::InvalidArgument);
        return status ? std::string() : status.error().describe();
    };
    TrainingConfig other = config(2, 2);
    other.decoding.learnBase = false;
    EXPECT_NE(refusal(other).find("decoding.learn_base: is off now"), std::string::npos) << refusal(other);
    other = config(2, 2);
    other.light.cubeSize = 128;
    EXPECT_NE(refusal(other).find("light.cube_size: is 128 now, expected 64"), std::string::npos) << refusal(other);
    other = config(2, 2);
    other.network.maxChannels = 4;
    EXPECT_NE(refusal(other).find("other networks"), std::string::npos) << refusal(other);
}

TEST_F(TrainerResume, AStageThatIsNoneIsNamed) {
    const auto task = trainer(config(2, 2));
    for (const char* stage : {"", "dinner"}) {
        const std::filesystem::path checkpoint = saved(*task, fmt::format("a{}", stage));
        SafetensorsFile broken = state(checkpoint);
        broken.metadata.erase("stage");
        if (*stage) broken.metadata["stage"] = stage;
        ASSERT_TRUE(writeSafetensors(checkpoint / "trainer.safetensors", broken).ok());
        const Status status = task->restore(checkpoint);
        ASSERT_FALSE(status.ok());
        EXPECT_EQ(status.error().code, ErrorCode::BadFile);
        EXPECT_NE(status.error().describe().find("stage"), std::string::npos) << status.error().describe();
    }
}

} // namespace
} // namespace ars
