#pragma once

#include "model/avatar/avatar_model.h"
#include "model/training/adam.h"
#include "model/training/training_config.h"

#include <array>
#include <cstdint>
#include <string_view>

namespace ars {

struct SafetensorsFile;

enum class TrainingStage { Template, Radiance, Pbr };
constexpr std::array<std::string_view, 3> kTrainingStageNames{"template", "radiance", "pbr"};

/// The stage that a checkpoint's trainer.safetensors was written in. BadFile where it names none.
Result<TrainingStage> stageOfState(const SafetensorsFile& state);
TrainingStage stageOfStep(const ScheduleParams& schedule, std::int64_t step);
/// What a step's rates are multiplied by: warm-up, then a cosine from 1 to the final share over the stage (stage 0 has
/// no cosine).
double rateShare(const ScheduleParams& schedule, TrainingStage stage, std::int64_t step);

/// Everything that a training changes.
struct LearnedState {
    AvatarModel model;        ///< its networks and base
    at::Tensor lightLog;      ///< (6, side, side, 3) logarithms of the light's texels
    bool lightKnown = false;  ///< it is a file's: no checkpoint's takes its place
    at::Tensor radiusOffsets; ///< (9) delta_g

    /// Offsets stay where radii have their limits, texels where float has room.
    void keepInRange();
    /// The model's description with the offsets of now.
    AvatarSpec specNow() const;
    /// What the model says of itself follows what was learned.
    void syncModel(std::string origin, bool withLight);

    /// Light and offsets as a checkpoint keeps them beside the avatar's files.
    void store(SafetensorsFile& file) const;
    /// Networks and base from `saved`, light and offsets from `file`, as a run goes on under these or other parameters.
    /// InvalidArgument where the parameters of now would lose what was learned; BadFile for a damaged file.
    Status load(AvatarModel& saved, const SafetensorsFile& file);
};

/// Light and offsets before any step.
Status createLearnedLight(const LightLearningParams& light, const FreezeParams& freeze, LearnedState& state);

/// The optimiser at the start of a stage: moments start anew with each (avatar reference 4).
Adam optimiserOf(const ScheduleParams& schedule, const LearnedState& state);
/// Rates of a step; returns that of the networks.
double setRates(const TrainingConfig& config, TrainingStage stage, std::int64_t step, Adam& adam);

} // namespace ars
