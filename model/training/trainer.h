#pragma once

#include "engine/core/error.h"
#include "model/run/training_run.h"
#include "model/training/training_config.h"

#include <nlohmann/json_fwd.hpp>

#include <filesystem>
#include <memory>

namespace ars {

struct Capture;

/// What a training is made of.
struct TrainerSources {
    std::filesystem::path capture;
    std::filesystem::path body; ///< empty: the open body that ships with the program
    std::filesystem::path
        templateFile; ///< empty: template.npz, .glb or .ply in the capture's folder, else the body itself
    std::shared_ptr<const Capture> opened{}; ///< the capture, where it was looked at already; else it is opened
};
nlohmann::json trainerSourcesToJson(const TrainerSources& sources);
Result<TrainerSources> trainerSourcesFromJson(const nlohmann::json& json);

/// The two-stage training of the paper as a task of runTraining (docs/math/training.md): template, radiance, PBR.
std::unique_ptr<TrainingTask> makeAvatarTrainer(TrainerSources sources, TrainingConfig config);

} // namespace ars
