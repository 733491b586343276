#pragma once

#include "engine/io/exr.h"
#include "engine/io/safetensors.h"
#include "model/avatar/avatar_model.h"
#include "model/training/trainer.h"
#include "tests/unit/capture/synthetic_capture.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <vector>

namespace ars::test {

/// The smallest networks there are, a box as the person: what counts is that everything fits together.
inline TrainingConfig smallConfig() {
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

/// A light that is bright above and dim below.
inline std::filesystem::path writeSky(const std::filesystem::path& path, float above, float below) {
    Image picture;
    picture.width = 32;
    picture.height = 16;
    picture.channels = 3;
    picture.pixels.assign(32 * 16 * 3, below);
    std::fill_n(picture.pixels.begin(), picture.pixels.size() / 2, above);
    ExrImage exr;
    exr.dataWindow = exr.displayWindow = {0, 0, picture.width - 1, picture.height - 1};
    EXPECT_TRUE(addExrLayer(exr, "", picture, "RGB", ExrPixelType::Float).ok());
    const Status written = writeExr(path, exr);
    EXPECT_TRUE(written.ok()) << written.error().describe();
    return path;
}

/// Surfels of an avatar folder in a pose that its maps show.
inline Surfels surfelsOf(const std::filesystem::path& folder) {
    Result<AvatarModel> model = readAvatar(folder);
    EXPECT_TRUE(model.ok()) << model.error().describe();
    Pose pose = restPose(kSmplxJointCount);
    for (const std::size_t joint : {4u, 18u, 19u}) pose.rotations[joint] = glm::angleAxis(0.7f, glm::vec3(0, 1, 0));
    Surfels surfels;
    const Status evaluated = makeTrainedAvatar(std::move(*model), false)->evaluate(pose, nullptr, surfels);
    EXPECT_TRUE(evaluated.ok()) << evaluated.error().describe();
    return surfels;
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

} // namespace ars::test
