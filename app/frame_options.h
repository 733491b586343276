#pragma once

#include "app/command.h"
#include "engine/core/error.h"
#include "engine/frame/display.h"
#include "engine/frame/frame_pipeline.h"

#include <string>
#include <vector>

namespace ars::app {

/// What render, stage and bench have in common: how a frame is made, as the command line says it.
struct FrameOptions {
    std::string device = "auto";
    std::string occlusion;             ///< body, reference, mesh_rays, rasterised, baked, off; empty: the avatar's own
    std::vector<std::string> settings; ///< --set GROUP.NAME=VALUE
    std::string radius;                ///< metres, one for all parts; or PART=METRES with commas
};

/// How pictures are shown, as the command line says it.
struct DisplayOptions {
    double exposureEv = 0.0;
    std::string curve = "none";
    std::string background = "0.5"; ///< sRGB grey or R,G,B in [0,1]
    bool transparent = false;
    bool backdrop = false;
};

/// "auto" (a CUDA device where there is one, else the processor), "cpu", "cuda", "cuda:1".
Result<Device> chooseDevice(const std::string& text);

/// Fills radii and all settings of `inputs`. InvalidArgument whose place is the option.
Status applyFrameOptions(const FrameOptions& options, FrameInputs& inputs);
Result<DisplaySettings> displaySettings(const DisplayOptions& options);

/// Every row of every table that --set reaches, for help: "occlusion.thickness  float ...".
std::string describeSettings();

/// "512x768". InvalidArgument (place: the option) for anything else or sides outside [1, 16384].
struct PictureSize {
    int width = 0;
    int height = 0;
};
Result<PictureSize> parseSize(const std::string& text, const std::string& option);

} // namespace ars::app
