#pragma once

#include "engine/core/error.h"
#include "engine/core/progress.h"
#include "engine/scene/run_folder.h"
#include "engine/scene/trained_avatar.h"
#include "model/runtime.h"

#include <nlohmann/json_fwd.hpp>

#include <atomic>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace ars {

/// What an avatar's networks compute in. Quick: bfloat16 where the CPU multiplies it natively, else as Exact. For
/// people who wait for a picture; files and figures are Exact.
enum class AvatarPrecision { Exact, Quick };

/// One call of `ars train`.
struct TrainRequest {
    std::filesystem::path capture;
    std::filesystem::path body;         ///< body file; empty: the capture's own or the open body
    std::filesystem::path templateFile; ///< empty: template.glb|npz|ply in the capture, else the body
    std::filesystem::path run;
    std::string preset = "compact";
    std::vector<std::pair<std::string, std::string>> settings; ///< --set name=value, in order
    bool resume = false;
};

/// One call of `ars eval`.
struct EvalRequest {
    std::filesystem::path avatar; ///< NAME.avatar/, a run (its newest checkpoint), a checkpoint
    std::filesystem::path capture;
    std::filesystem::path out;
    std::string split; ///< empty: the protocol's
    std::string protocol = "masked";
    std::string cameras, frames;
    std::filesystem::path light;
    std::filesystem::path lpipsBackbone, lpipsHeads; ///< weight files; both or none
    int pictures = 8;
    bool project = true; ///< PCA projection of poses
};

/// What the program asks of model/. The program loads libars_model.so when a command first needs LibTorch and speaks to
/// it through this interface alone.
class ModelPlugin {
public:
    virtual ~ModelPlugin() = default;
    virtual TorchInfo initialize() = 0;
    virtual TorchSpeed measureSpeed(int repetitions) = 0;

    /// NAME.avatar/ or a checkpoint, as TrainedAvatarOpener has it.
    virtual Result<OpenedTrainedAvatar> openAvatar(const std::filesystem::path& folder, bool project,
                                                   AvatarPrecision precision) = 0;
    /// Trains until the end, a request or `stop`; the last status.
    virtual Result<RunStatus> train(const TrainRequest& request, const std::atomic<bool>& stop,
                                    const std::function<void(const RunStatus&)>& listener) = 0;
    virtual Result<nlohmann::ordered_json> evaluate(const EvalRequest& request, const ProgressFunction& progress) = 0;
    /// Rows of `ars train --help-parameters`.
    virtual Result<std::vector<ParameterInfo>> trainingParameters(const std::string& preset) = 0;
    /// NAME.avatar/ of an avatar, a run (its newest checkpoint) or a checkpoint, with a picture of it: what a training
    /// needs to go on is left behind. Errors of writeAvatar.
    virtual Status exportAvatar(const std::filesystem::path& source, const std::filesystem::path& folder) = 0;
};

/// Name of the function that the library exports: `ars::ModelPlugin* arsModelPlugin()`; the object lives for ever.
inline constexpr const char* kModelPluginSymbol = "arsModelPlugin";

} // namespace ars
