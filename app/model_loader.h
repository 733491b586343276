#pragma once

#include "engine/core/error.h"
#include "model/plugin.h"

namespace ars::app {

/// Loads model/ (libars_model.so and with it LibTorch, some 0.3 s and 450 MB of address space) at the first call.
/// Unavailable with the loader's own words when it is not there or LibTorch is missing.
Result<ModelPlugin*> loadModel();

} // namespace ars::app
