#pragma once

#include "engine/core/error.h"
#include "engine/core/parameters.h"
#include "engine/occlusion/ambient_occlusion.h"
#include "engine/surfel/pose_surfels.h"
#include "engine/surfel/splat.h"
#include "model/avatar/surfel_decoding.h"
#include "model/network/avatar_network.h"

#include <nlohmann/json_fwd.hpp>

#include <string>
#include <string_view>
#include <vector>

namespace ars {

/// Lengths, rates and pictures of the three stages.
struct ScheduleParams {
    int templateSteps = 0;     ///< stage 0: the networks learn to give the template
    int radianceSteps = 0;     ///< stage 1
    int pbrSteps = 0;          ///< stage 2
    double networkRate = 5e-4; ///< Adam rate of the networks in stages 0 and 1
    double networkRatePbr = 1e-4;
    double geometryShare = 1.0;     ///< of the networks' rate, for those of geometry
    double baseRate = 5e-3;         ///< of the per-surfel base attributes (`learn_base`)
    double baseGeometryShare = 0.2; ///< of baseRate for position, scale, rotation and opacity
    double lightRate = 1e-2;
    double radiusRate = 1e-3;     ///< of the nine offsets
    double finalRateShare = 0.05; ///< cosine from 1 to this share over each stage
    int warmUpSteps = 0;          ///< linear from 0 at the start of each stage
    double beta1 = 0.9, beta2 = 0.999;
    int viewsPerStep = 1;             ///< cameras of one pose that share one evaluation of the networks
    int imageScale = 1;               ///< pictures are made this much smaller
    int bandPixels = 2;               ///< half-width of the band along the outline in which nothing is compared
    int cropMargin = 16;              ///< pixels around the person; negative: whole pictures
    int perceptualCropAfter = 300000; ///< steps after stage 0 from which on the perceptual loss looks at windows
    int perceptualSize = 512;         ///< side of the square in which it sees the person; 0: the picture as it is
    double viewNoise = 0.1;           ///< added to the direction of the view map
    int seed = 1;

    bool operator==(const ScheduleParams&) const = default;
};

/// Weights of the losses (the paper's table).
struct LossParams {
    double l1 = 1.0;
    double perceptual = 0.1;
    std::string perceptualBackbone; ///< LPIPS backbone file; empty: the stand-in ms_ssim_gradient
    std::string perceptualHeads;    ///< LPIPS linear weights
    double offset = 0.005;
    bool offsetSquared = true;
    double consistency = 0.025;    ///< at the start
    double consistencyEnd = 0.125; ///< from half of the training on
    double curvature = 0.005;
    double normalDeformation = 0.004; ///< radiance stage only
    int normalPairs = 20000;          ///< random pairs a step
    double brdfVariation = 0.005;     ///< PBR, albedo and roughness
    double lightVariation = 0.005;    ///< PBR
    double whiteLight = 0.05;         ///< PBR
    double radianceInPbr = 0.0;       ///< keeps the radiance loss in the PBR stage at this weight
    double opacityMask = 0.0;         ///< mean |opacity - mask| (not in the paper)

    bool operator==(const LossParams&) const = default;
};

/// The learned light.
struct LightLearningParams {
    int cubeSize = 512;   ///< side of a face, a power of two >= 64
    double initial = 0.5; ///< grey radiance at the start
    std::string file;     ///< a known light instead, which nothing changes; "" = learned
    bool learn = true;

    bool operator==(const LightLearningParams&) const = default;
};

/// How occlusion takes part in the PBR stage (the paper's ablation).
enum class RadiusTraining { Learned, Fixed, Off };
template <>
struct EnumWords<RadiusTraining> {
    static constexpr std::array words{"learned", "fixed", "off"};
};

/// What stays as it is.
struct FreezeParams {
    bool geometry = false;  ///< networks and base of geometry, and the prior encoder that all networks share
    bool materials = false; ///< those of materials and colours, and the prior encoder
    bool light = false;
    RadiusTraining radii = RadiusTraining::Learned;

    bool operator==(const FreezeParams&) const = default;
};

/// Where steps are computed.
enum class RunDevice { Auto, Cpu, Cuda };
template <>
struct EnumWords<RunDevice> {
    static constexpr std::array words{"auto", "cpu", "cuda"};
};

struct RunParams {
    RunDevice device = RunDevice::Auto;
    int checkpointSteps = 500;
    int previewSteps = 500;
    int checkpointsKept = 3;
    int milestoneSteps = 0;
    int metricsSteps = 1;
    int cacheMegabytes = 1024;
    std::string cacheFolder;

    bool operator==(const RunParams&) const = default;
};

/// Every number of a training. One table, names with a dot ("schedule.radiance_steps", "loss.l1",
/// "network.input_size"):
/// `--set`, config.json, the panel and help read it.
struct TrainingConfig {
    std::string preset = "compact";
    AvatarNetworkConfig network;
    DecodingParams decoding;
    ScheduleParams schedule;
    LossParams loss;
    LightLearningParams light;
    FreezeParams freeze;
    SplatParams splat;
    PoseSurfelsParams posing;
    OcclusionParams occlusion;
    RunParams run;
    std::string cameras; ///< of the capture, for training; empty: the subject's published ones, else all
    std::string frames;

    bool operator==(const TrainingConfig&) const = default;
};

/// Whether the PBR stage changes the light: one from a file is known, and stays what it is.
bool learnsLight(const LightLearningParams& light, const FreezeParams& freeze);

/// "paper", "studio", "compact", "tiny".
Result<TrainingConfig> trainingPreset(std::string_view name);
std::vector<std::string> trainingPresetNames();

/// All rows with their full names, defaults those of `config`.
std::vector<ParameterInfo> trainingParameterInfos(const TrainingConfig& config);
/// `--set name=text`. NotFound with the nearest name.
Status setTrainingParameter(TrainingConfig& config, std::string_view name, std::string_view text);
nlohmann::json trainingConfigToJson(const TrainingConfig& config);
Result<TrainingConfig> trainingConfigFromJson(const nlohmann::json& json);
/// Paths as the folder that the program works in makes them: a run goes on from any other, too.
void makePathsAbsolute(TrainingConfig& config);
/// InvalidArgument naming what does not go together (a size that is no power of two, no steps at all).
Status validateTrainingConfig(const TrainingConfig& config);

} // namespace ars
