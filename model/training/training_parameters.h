#pragma once

#include "engine/core/parameters.h"
#include "model/training/training_config.h"

namespace ars {

/// Rows of the groups that training_config.h declares itself; the other groups' tables stand beside their structs.
const ParameterTable<ScheduleParams>& scheduleParameters();
const ParameterTable<LossParams>& lossParameters();
const ParameterTable<LightLearningParams>& lightLearningParameters();
const ParameterTable<FreezeParams>& freezeParameters();
const ParameterTable<RunParams>& runParameters();
/// `cameras` and `frames` of the configuration itself.
const ParameterTable<TrainingConfig>& trainingDataParameters();

} // namespace ars
