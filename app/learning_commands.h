#pragma once

#include "app/eval.h"
#include "app/train.h"

namespace CLI {
class App;
}

namespace ars::app {

/// Arguments of `ars train`; the command is returned, for what all commands share.
CLI::App& addTrain(CLI::App& app, TrainOptions& options);
/// Arguments of `ars eval`.
CLI::App& addEval(CLI::App& app, EvalOptions& options);

} // namespace ars::app
