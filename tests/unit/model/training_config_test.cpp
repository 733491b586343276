#include "model/training/training_config.h"

#include "engine/capture/capture.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include <algorithm>
#include <filesystem>
#include <set>

namespace ars {
namespace {

TrainingConfig preset(const char* name) {
    auto config = trainingPreset(name);
    EXPECT_TRUE(config.ok());
    return *config;
}

std::string failureOf(const TrainingConfig& config) {
    const Status sound = validateTrainingConfig(config);
    return sound ? "" : sound.error().describe();
}

TEST(TrainingConfig, PresetsAreSoundAndHaveTheSizesOfTheDesign) {
    struct Size {
        const char* name;
        int input;
        double multiplier;
        int cap;
    };
    // Design sections 4 and 6.
    for (const Size& size :
         {Size{"paper", 512, 2, 512}, {"studio", 256, 1, 128}, {"compact", 128, 0.5, 64}, {"tiny", 64, 0.25, 32}}) {
        const TrainingConfig config = preset(size.name);
        EXPECT_EQ(failureOf(config), "") << size.name;
        EXPECT_EQ(config.preset, size.name);
        EXPECT_EQ(config.network.inputSize, size.input);
        EXPECT_EQ(config.network.channelMultiplier, size.multiplier);
        EXPECT_EQ(config.network.maxChannels, size.cap);
    }
    EXPECT_EQ(trainingPresetNames(), (std::vector<std::string>{"paper", "studio", "compact", "tiny"}));
    EXPECT_EQ(preset("paper").network.split, NetworkSplit::Four);
    EXPECT_EQ(preset("paper").occlusion, bodyOcclusion());
    const auto wrong = trainingPreset("huge");
    ASSERT_FALSE(wrong.ok());
    EXPECT_EQ(wrong.error().describe(), "preset: expected one of paper, studio, compact, tiny, found \"huge\"");
}

TEST(TrainingConfig, LossWeightsAreThePapers) {
    const LossParams loss = preset("paper").loss;
    EXPECT_EQ(loss.l1, 1.0);
    EXPECT_EQ(loss.perceptual, 0.1);
    EXPECT_EQ(loss.offset, 0.005);
    EXPECT_EQ(loss.consistency, 0.025);
    EXPECT_EQ(loss.consistencyEnd, 0.125);
    EXPECT_EQ(loss.curvature, 0.005);
    EXPECT_EQ(loss.normalDeformation, 0.004);
    EXPECT_EQ(loss.brdfVariation, 0.005);
    EXPECT_EQ(loss.lightVariation, 0.005);
    EXPECT_EQ(loss.whiteLight, 0.05);
}

/// Another value of the same kind that the row allows.
std::string anotherValue(const ParameterInfo& info) {
    if (const bool* flag = std::get_if<bool>(&info.defaultValue)) return *flag ? "false" : "true";
    if (!info.choices.empty()) {
        return *std::find_if(info.choices.begin(), info.choices.end(),
                             [&](const std::string& word) { return word != std::get<std::string>(info.defaultValue); });
    }
    if (std::holds_alternative<std::string>(info.defaultValue)) return "something";
    const bool atTop = formatParameter(info.defaultValue) == fmt::format("{}", info.range.maximum);
    return fmt::format("{}", atTop ? info.range.minimum : info.range.maximum);
}

TEST(TrainingConfig, EveryRowIsReadWrittenAndExplained) {
    const TrainingConfig start = preset("compact");
    const std::vector<ParameterInfo> rows = trainingParameterInfos(start);
    std::set<std::string> names;
    for (const ParameterInfo& row : rows) {
        EXPECT_TRUE(names.insert(row.name).second) << row.name << " stands twice";
        EXPECT_NE(row.name.find('.'), std::string::npos) << row.name;
        EXPECT_TRUE(row.help.ends_with('.')) << row.name << ": help is a sentence";
        TrainingConfig changed = start;
        const Status set = setTrainingParameter(changed, row.name, anotherValue(row));
        ASSERT_TRUE(set.ok()) << set.error().describe();
        EXPECT_FALSE(changed == start) << row.name << " reaches nothing";
        const auto back = trainingConfigFromJson(nlohmann::json::parse(trainingConfigToJson(changed).dump()));
        ASSERT_TRUE(back.ok()) << back.error().describe();
        EXPECT_TRUE(*back == changed) << row.name << " is lost in JSON";
    }
    for (const char* known : {"schedule.radiance_steps", "loss.l1", "network.input_size", "freeze.radii",
                              "occlusion.delta", "decoding.learn_base", "data.cameras", "run.checkpoint_steps"}) {
        EXPECT_TRUE(names.contains(known)) << known;
    }
}

TEST(TrainingConfig, HelpShowsNumbersAsPeopleTypeThem) {
    for (const ParameterInfo& row : trainingParameterInfos(preset("compact"))) {
        if (!std::holds_alternative<double>(row.defaultValue)) continue;
        EXPECT_LT(formatParameter(row.defaultValue).size(), 12u) << row.name << formatParameter(row.defaultValue);
    }
}

TEST(TrainingConfig, NumbersReadBackExactly) {
    TrainingConfig config = preset("tiny");
    config.loss.l1 = static_cast<double>(0.1f); // 0.1 would be another double
    config.occlusion.delta = 0.1f;
    config.schedule.networkRate = 1.0 / 3;
    const auto back = trainingConfigFromJson(nlohmann::json::parse(trainingConfigToJson(config).dump()));
    ASSERT_TRUE(back.ok()) << back.error().describe();
    EXPECT_TRUE(*back == config);
}

TEST(TrainingConfig, SettingsNameTheirMistake) {
    TrainingConfig config = preset("tiny");
    const auto failure = [&](const char* name, const char* text) {
        const Status set = setTrainingParameter(config, name, text);
        return set ? std::string() : set.error().describe();
    };
    EXPECT_EQ(failure("schedule.radiance_stps", "3"),
              "schedule.radiance_stps: there is no parameter of this name; did you mean schedule.radiance_steps?");
    EXPECT_EQ(failure("loss.l1", "-1"), "loss.l1: expected float in [0 .. 1e+06], found -1");
    EXPECT_EQ(failure("freeze.radii", "some"), "freeze.radii: expected one of learned, fixed, off, found \"some\"");
    EXPECT_NE(failure("preset", "paper"), "");
    EXPECT_NE(failure("l1", "1"), "");
    EXPECT_TRUE(config == preset("tiny")) << "nothing changes by mistake";
}

TEST(TrainingConfig, PicturesAreMadeAsSmallAsTheReaderMakesThem) {
    TrainingConfig config = preset("tiny");
    for (const int scale : {1, 8, 9, 16}) {
        ViewOptions view;
        view.scale = scale;
        EXPECT_EQ(setTrainingParameter(config, "schedule.image_scale", fmt::format("{}", scale)).ok(),
                  validateViewOptions(view).ok())
            << scale;
    }
}

TEST(TrainingConfig, WhatATrainingDecidesByItselfIsNoParameter) {
    TrainingConfig config = preset("tiny");
    EXPECT_FALSE(setTrainingParameter(config, "posing.training_radii", "true").ok());
    EXPECT_FALSE(trainingConfigToJson(config)["posing"].contains("training_radii"));
    // Configurations that were written when it was one are read.
    EXPECT_TRUE(trainingConfigFromJson({{"preset", "tiny"}, {"posing", {{"training_radii", true}}}}).ok());
}

TEST(TrainingConfig, AKnownLightIsNotLearned) {
    TrainingConfig config = preset("tiny");
    EXPECT_TRUE(learnsLight(config.light, config.freeze));
    config.light.file = "sky.exr";
    EXPECT_FALSE(learnsLight(config.light, config.freeze));
    config.freeze = {true, true, false, RadiusTraining::Fixed};
    EXPECT_NE(failureOf(config).find("nothing is left to learn"), std::string::npos);
    config.light.file.clear();
    EXPECT_EQ(failureOf(config), "");
}

TEST(TrainingConfig, PathsBecomeThoseOfTheWorkingFolder) {
    TrainingConfig config = preset("tiny");
    makePathsAbsolute(config);
    EXPECT_TRUE(config == preset("tiny")) << "what is empty stays empty";
    for (const char* name : {"light.file", "loss.perceptual_backbone", "loss.perceptual_heads", "run.cache_folder"}) {
        ASSERT_TRUE(setTrainingParameter(config, name, std::string("lights/") + name).ok());
    }
    makePathsAbsolute(config);
    const std::string here = std::filesystem::current_path().string() + "/lights/";
    EXPECT_EQ(config.light.file, here + "light.file");
    EXPECT_EQ(config.loss.perceptualBackbone, here + "loss.perceptual_backbone");
    EXPECT_EQ(config.loss.perceptualHeads, here + "loss.perceptual_heads");
    EXPECT_EQ(config.run.cacheFolder, here + "run.cache_folder");
    const TrainingConfig before = config;
    makePathsAbsolute(config);
    EXPECT_TRUE(config == before);
}

TEST(TrainingConfig, JsonMayLeaveOutButNotInvent) {
    const auto sparse = trainingConfigFromJson({{"preset", "tiny"}, {"loss", {{"l1", 2}}}});
    ASSERT_TRUE(sparse.ok()) << sparse.error().describe();
    TrainingConfig expected = preset("tiny");
    expected.loss.l1 = 2;
    EXPECT_TRUE(*sparse == expected);

    const auto failure = [](nlohmann::json json) {
        const auto config = trainingConfigFromJson(json);
        return config ? std::string() : config.error().describe();
    };
    EXPECT_EQ(failure({{"loss", {{"l1", 2}}}}), "preset: expected one of paper, studio, compact, tiny, found nothing");
    EXPECT_EQ(failure({{"preset", "tiny"}, {"loss", {{"l2", 2}}}}),
              "loss: l2: there is no parameter of this name; did you mean l1?");
    EXPECT_EQ(failure({{"preset", "tiny"}, {"looks", {{"l1", 2}}}}),
              "looks: there is no group of parameters of this name");
    EXPECT_NE(failure({{"preset", "tiny"}, {"loss", {{"l1", "much"}}}}), "");
    EXPECT_NE(failure(nlohmann::json::array()), "");
}

TEST(TrainingConfig, WhatDoesNotGoTogetherIsNamed) {
    TrainingConfig config = preset("tiny");
    config.network.inputSize = 96;
    EXPECT_EQ(failureOf(config), "network.input_size: expected a power of two of at least 64, found 96");
    config = preset("tiny");
    config.light.cubeSize = 100;
    EXPECT_EQ(failureOf(config), "light.cube_size: expected a power of two of at least 64, found 100");
    config = preset("tiny");
    config.schedule.radianceSteps = config.schedule.pbrSteps = 0;
    EXPECT_NE(failureOf(config).find("expected at least one step"), std::string::npos);
    config = preset("tiny");
    config.loss.perceptualBackbone = "vgg.safetensors";
    EXPECT_NE(failureOf(config).find("loss.perceptual_heads"), std::string::npos);
    config = preset("tiny");
    config.loss.l1 = config.loss.perceptual = 0;
    EXPECT_NE(failureOf(config), "");
    config = preset("tiny");
    config.freeze = {true, true, true, RadiusTraining::Fixed};
    EXPECT_NE(failureOf(config).find("nothing is left to learn"), std::string::npos);
    config = preset("tiny");
    config.occlusion.firstStep = 9;
    config.occlusion.lastStep = 8;
    EXPECT_NE(failureOf(config), "");
    config = preset("tiny");
    config.schedule.networkRate = -1;
    EXPECT_NE(failureOf(config).find("network_rate"), std::string::npos);
}

} // namespace
} // namespace ars
