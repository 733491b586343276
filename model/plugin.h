#pragma once

#include "model/runtime.h"

namespace ars {

/// What the program asks of model/. The program loads libars_model.so when a command first needs LibTorch and speaks to
/// it through this interface alone.
class ModelPlugin {
public:
    virtual ~ModelPlugin() = default;
    virtual TorchInfo initialize() = 0;
    virtual TorchSpeed measureSpeed(int repetitions) = 0;
};

/// Name of the function that the library exports: `ars::ModelPlugin* arsModelPlugin()`; the object lives for ever.
inline constexpr const char* kModelPluginSymbol = "arsModelPlugin";

} // namespace ars
