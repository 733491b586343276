#include "model/training/training_config.h"

#include "model/training/training_parameters.h"

#include "engine/core/parameter_ranges.h"

#include <fmt/ranges.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <bit>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <functional>
#include <limits>

namespace ars {
namespace {

/// One struct of the configuration under its name: "schedule" of "schedule.radiance_steps".
struct ConfigGroup {
    std::string name;
    std::vector<ParameterInfo> infos;
    std::function<ParameterValue(const TrainingConfig&, std::string_view)> get;
    std::function<Status(TrainingConfig&, std::string_view, std::string_view)> setText;
    std::function<Status(TrainingConfig&, const nlohmann::json&, std::vector<std::string>&)> fromJson;
    std::function<Status(const TrainingConfig&)> checkRanges;
};

/// `find` gives the group's struct of a const or a mutable configuration; `ours` names a row that a training decides by
/// itself: nobody sets it, and a configuration that names it is read all the same.
template <typename Struct, typename Find>
ConfigGroup group(std::string name, const ParameterTable<Struct>& table, Find find, std::string_view ours = "") {
    ConfigGroup result;
    result.name = name;
    result.infos = table.infos();
    std::erase_if(result.infos, [ours](const ParameterInfo& info) { return info.name == ours; });
    result.get = [&table, find](const TrainingConfig& config, std::string_view row) {
        return table.get(find(config), row).value();
    };
    result.setText = [&table, find](TrainingConfig& config, std::string_view row, std::string_view text) {
        return table.setText(find(config), row, text);
    };
    result.fromJson = [&table, find](TrainingConfig& config, const nlohmann::json& json,
                                     std::vector<std::string>& unknown) {
        return table.fromJson(find(config), json, &unknown);
    };
    result.checkRanges = [&table, find, name](const TrainingConfig& config) {
        return checkRanges(table, find(config), name);
    };
    return result;
}

/// In the order in which help lists them.
const std::vector<ConfigGroup>& configGroups() {
    static const std::vector<ConfigGroup> groups{
        group("schedule", scheduleParameters(), [](auto& c) -> auto& { return c.schedule; }),
        group("loss", lossParameters(), [](auto& c) -> auto& { return c.loss; }),
        group("light", lightLearningParameters(), [](auto& c) -> auto& { return c.light; }),
        group("freeze", freezeParameters(), [](auto& c) -> auto& { return c.freeze; }),
        group("data", trainingDataParameters(), [](auto& c) -> auto& { return c; }),
        group("network", avatarNetworkParameters(), [](auto& c) -> auto& { return c.network; }),
        group("decoding", decodingParameters(), [](auto& c) -> auto& { return c.decoding; }),
        group(
            "posing", poseSurfelsParameters(), [](auto& c) -> auto& { return c.posing; }, "training_radii"),
        group("splat", splatParameters(), [](auto& c) -> auto& { return c.splat; }),
        group("occlusion", occlusionParameters(), [](auto& c) -> auto& { return c.occlusion; }),
        group("run", runParameters(), [](auto& c) -> auto& { return c.run; }),
    };
    return groups;
}

/// A row's value as people would type it: 0.1 instead of the 0.10000000149011612 that a float member holds. The long
/// form could not even be read back where the value is a bound of its row.
ParameterValue valueAsTyped(const ConfigGroup& group, const TrainingConfig& config, const std::string& row) {
    const ParameterValue value = group.get(config, row);
    const double* number = std::get_if<double>(&value);
    if (!number || static_cast<double>(static_cast<float>(*number)) != *number) return value;
    const std::string text = fmt::format("{}", static_cast<float>(*number));
    // Whether the member is a float shows in that the short text gives the same number.
    TrainingConfig typed = config;
    if (!group.setText(typed, row, text) || group.get(typed, row) != value) return value;
    double shortest = *number;
    std::from_chars(text.data(), text.data() + text.size(), shortest);
    return shortest;
}

TrainingConfig tinyPreset() {
    TrainingConfig config;
    config.network.inputSize = 64;
    config.network.channelMultiplier = 0.25;
    config.network.maxChannels = 32;
    config.network.viewNormals = true;
    config.decoding.learnBase = true;
    config.schedule.radianceSteps = 60;
    config.schedule.pbrSteps = 60;
    config.schedule.networkRate = 2e-3;
    config.schedule.networkRatePbr = 2e-3;
    config.schedule.viewsPerStep = 2;
    config.schedule.perceptualSize = 0;
    config.light.cubeSize = 64;
    config.occlusion.quality = OcclusionQuality::Interactive;
    config.occlusion.interactiveDirections = 64;
    config.run.checkpointSteps = 20;
    config.run.previewSteps = 60;
    return config;
}

TrainingConfig compactPreset() {
    TrainingConfig config;
    config.network.inputSize = 128;
    config.network.channelMultiplier = 0.5;
    config.network.maxChannels = 64;
    config.network.viewNormals = true;
    config.decoding.learnBase = true;
    config.schedule.radianceSteps = 1000;
    config.schedule.pbrSteps = 3000;
    config.schedule.geometryShare = 0.25;
    config.schedule.lightRate = 3e-2;
    config.schedule.bandPixels = 0;
    config.loss.opacityMask = 0.1;
    config.loss.consistency = config.loss.consistencyEnd = 0.01;
    config.loss.radianceInPbr = 0.5;
    config.splat.depth = DepthMode::Filtered;
    config.decoding.scaleFactor = 0.55;
    config.decoding.insetM = 0.005;
    config.schedule.networkRate = 2e-3;
    config.schedule.networkRatePbr = 1e-3;
    config.schedule.baseRate = 1e-2;
    config.schedule.radiusRate = 5e-3;
    config.schedule.viewsPerStep = 4;
    config.schedule.perceptualSize = 0;
    config.light.cubeSize = 64;
    config.occlusion.quality = OcclusionQuality::Interactive;
    config.occlusion.interactiveDirections = 128;
    config.run.checkpointSteps = 200;
    config.run.previewSteps = 200;
    return config;
}

/// Stages and rates of design section 4: long, networks alone, one view a step.
TrainingConfig studioPreset() {
    TrainingConfig config;
    config.network.inputSize = 256;
    config.network.channelMultiplier = 1.0;
    config.network.maxChannels = 128;
    config.network.viewNormals = true;
    config.network.zeroOutputs = false;
    config.schedule.templateSteps = 1000;
    config.schedule.radianceSteps = 100000;
    config.schedule.pbrSteps = 50000;
    config.schedule.perceptualCropAfter = 50000;
    config.light.cubeSize = 128;
    config.occlusion.quality = OcclusionQuality::Interactive;
    config.occlusion.interactiveDirections = 256;
    config.run.checkpointSteps = 1000;
    config.run.previewSteps = 1000;
    config.run.milestoneSteps = 25000;
    config.run.metricsSteps = 10;
    config.run.cacheMegabytes = 8192;
    return config;
}

TrainingConfig paperPreset() {
    TrainingConfig config = studioPreset();
    config.network.split = NetworkSplit::Four;
    config.network.inputSize = 512;
    config.network.channelMultiplier = 2.0;
    config.network.maxChannels = 512;
    config.network.viewNormals = false;
    config.decoding.initialScale = InitialScale::Neighbours;
    config.decoding.scaleFactor = 1.0;
    config.decoding.initialOpacity = 0.1;
    config.schedule.templateSteps = 5000;
    config.schedule.radianceSteps = 600000;
    config.schedule.pbrSteps = 150000;
    config.schedule.perceptualCropAfter = 300000;
    config.light.cubeSize = 512;
    config.occlusion = bodyOcclusion();
    config.run.checkpointSteps = 2500;
    config.run.previewSteps = 2500;
    config.run.milestoneSteps = 100000;
    config.run.cacheMegabytes = 16384;
    return config;
}

struct NamedPreset {
    std::string_view name;
    TrainingConfig (*make)();
};
constexpr NamedPreset kPresets[]{
    {"paper", paperPreset}, {"studio", studioPreset}, {"compact", compactPreset}, {"tiny", tinyPreset}};

Error invalid(std::string parameter, std::string message) {
    return makeError(ErrorCode::InvalidArgument, std::move(parameter), std::move(message));
}

bool powerOfTwo(int value) { return value > 0 && std::has_single_bit(static_cast<unsigned>(value)); }

Status checkSchedule(const TrainingConfig& config) {
    const ScheduleParams& s = config.schedule;
    if (s.templateSteps + std::int64_t(s.radianceSteps) + s.pbrSteps == 0) {
        return invalid("schedule",
                       "template_steps, radiance_steps and pbr_steps are all 0, expected at least one step");
    }
    if (std::int64_t(s.templateSteps) + s.radianceSteps + s.pbrSteps > std::numeric_limits<int>::max()) {
        return invalid("schedule", fmt::format("the stages have {} steps together, expected at most {}",
                                               std::int64_t(s.templateSteps) + s.radianceSteps + s.pbrSteps,
                                               std::numeric_limits<int>::max()));
    }
    return {};
}

Status checkLosses(const TrainingConfig& config) {
    const LossParams& loss = config.loss;
    if (loss.perceptualBackbone.empty() != loss.perceptualHeads.empty()) {
        const bool backbone = loss.perceptualBackbone.empty();
        return invalid(backbone ? "loss.perceptual_backbone" : "loss.perceptual_heads",
                       "LPIPS needs both weight files, found one (leave both empty for the stand-in)");
    }
    const bool pictures = config.schedule.radianceSteps + config.schedule.pbrSteps > 0;
    if (const int size = config.schedule.perceptualSize; size > 0 && size < 32) {
        return invalid("schedule.perceptual_size", fmt::format("expected 0 or at least 32 pixels, found {}", size));
    }
    if (pictures && loss.l1 == 0 && loss.perceptual == 0) {
        return invalid("loss", "l1 and perceptual are both 0, expected a loss that looks at the pictures");
    }
    return {};
}

Status checkLearning(const TrainingConfig& config) {
    const FreezeParams& freeze = config.freeze;
    const bool light = learnsLight(config.light, freeze);
    const bool networks = !freeze.geometry || !freeze.materials;
    if (config.schedule.pbrSteps > 0 && !networks && !light && freeze.radii != RadiusTraining::Learned) {
        return invalid("freeze", "geometry, materials, light and radii all stay as they are: nothing is left to learn");
    }
    return {};
}

} // namespace

bool learnsLight(const LightLearningParams& light, const FreezeParams& freeze) {
    return light.learn && light.file.empty() && !freeze.light;
}

std::vector<std::string> trainingPresetNames() {
    std::vector<std::string> names;
    for (const NamedPreset& preset : kPresets) names.emplace_back(preset.name);
    return names;
}

Result<TrainingConfig> trainingPreset(std::string_view name) {
    for (const NamedPreset& preset : kPresets) {
        if (preset.name != name) continue;
        TrainingConfig config = preset.make();
        config.preset = name;
        return config;
    }
    return makeError(ErrorCode::NotFound, "preset",
                     fmt::format("expected one of {}, found \"{}\"", fmt::join(trainingPresetNames(), ", "), name));
}

std::vector<ParameterInfo> trainingParameterInfos(const TrainingConfig& config) {
    std::vector<ParameterInfo> infos;
    for (const ConfigGroup& group : configGroups()) {
        for (ParameterInfo info : group.infos) {
            info.defaultValue = valueAsTyped(group, config, info.name);
            info.name = group.name + "." + info.name;
            infos.push_back(std::move(info));
        }
    }
    return infos;
}

Status setTrainingParameter(TrainingConfig& config, std::string_view name, std::string_view text) {
    const std::size_t dot = name.find('.');
    for (const ConfigGroup& group : configGroups()) {
        if (dot == std::string_view::npos || group.name != name.substr(0, dot)) continue;
        const std::string_view row = name.substr(dot + 1);
        const bool known = std::any_of(group.infos.begin(), group.infos.end(),
                                       [&](const ParameterInfo& info) { return info.name == row; });
        if (!known) break;
        Status set = group.setText(config, row, text);
        if (set) return {};
        Error error = std::move(set).error();
        error.place = std::string(name);
        return error;
    }
    if (name == "preset") return invalid("preset", "is chosen before all other parameters, by --preset");
    return detail::unknownParameter(trainingParameterInfos(config), name);
}

nlohmann::json trainingConfigToJson(const TrainingConfig& config) {
    nlohmann::json json{{"preset", config.preset}};
    for (const ConfigGroup& group : configGroups()) {
        nlohmann::json& object = json[group.name];
        for (const ParameterInfo& info : group.infos) {
            std::visit([&](const auto& value) { object[info.name] = value; }, valueAsTyped(group, config, info.name));
        }
    }
    return json;
}

Result<TrainingConfig> trainingConfigFromJson(const nlohmann::json& json) {
    if (!json.is_object()) {
        return makeError(ErrorCode::BadFile, "training",
                         fmt::format("expected a JSON object, found {}", json.type_name()));
    }
    const auto preset = json.find("preset");
    if (preset == json.end() || !preset->is_string()) {
        return makeError(ErrorCode::BadFile, "preset",
                         fmt::format("expected one of {}, found {}", fmt::join(trainingPresetNames(), ", "),
                                     preset == json.end() ? "nothing" : preset->type_name()));
    }
    ARS_TRY(TrainingConfig config, trainingPreset(preset->get<std::string>()));
    for (const auto& item : json.items()) {
        if (item.key() == "preset") continue;
        const auto group = std::find_if(configGroups().begin(), configGroups().end(),
                                        [&](const ConfigGroup& known) { return known.name == item.key(); });
        if (group == configGroups().end()) {
            return makeError(ErrorCode::BadFile, item.key(), "there is no group of parameters of this name");
        }
        std::vector<std::string> unknown;
        if (Status read = group->fromJson(config, item.value(), unknown); !read) {
            return atPlace(std::move(read).error(), item.key());
        }
        // A parameter that this version does not know would be trained without: the run would not be the one asked for.
        if (!unknown.empty()) return atPlace(detail::unknownParameter(group->infos, unknown.front()), item.key());
    }
    return config;
}

void makePathsAbsolute(TrainingConfig& config) {
    for (std::string* path :
         {&config.light.file, &config.loss.perceptualBackbone, &config.loss.perceptualHeads, &config.run.cacheFolder}) {
        std::error_code failure;
        if (path->empty()) continue;
        if (const auto absolute = std::filesystem::absolute(*path, failure); !failure) *path = absolute.string();
    }
}

Status validateTrainingConfig(const TrainingConfig& config) {
    for (const ConfigGroup& group : configGroups()) ARS_TRY_STATUS(group.checkRanges(config));
    if (config.network.inputSize < 64 || !powerOfTwo(config.network.inputSize)) {
        return invalid("network.input_size",
                       fmt::format("expected a power of two of at least 64, found {}", config.network.inputSize));
    }
    if (config.light.cubeSize < 64 || !powerOfTwo(config.light.cubeSize)) {
        return invalid("light.cube_size",
                       fmt::format("expected a power of two of at least 64, found {}", config.light.cubeSize));
    }
    ARS_TRY_STATUS(checkSchedule(config));
    ARS_TRY_STATUS(checkLosses(config));
    ARS_TRY_STATUS(checkLearning(config));
    return validateOcclusionParams(config.occlusion);
}

} // namespace ars
