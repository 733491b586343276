#pragma once

#include "app/command.h"
#include "app/frame_options.h"

#include <string>

namespace ars::app {

struct StageOptions {
    std::string input;  ///< template (maps), PLY (splat) or EXR
    std::string camera; ///< CAMERA.json or CALIBRATION.json:NAME
    std::string environment = "studio";
    double environmentScale = 1.0;
    double environmentRotationDeg = 0.0;
    int lightSize = 512;
    std::string buffers; ///< splat: which channels; empty: all that the surfels have
    std::string pose;    ///< maps: canonical, rest or a motion file
    std::size_t poseFrame = 0;
    int mapSize = 512;
    std::string out;
    FrameOptions frame;
    OutputOptions output;
};

/// `ars stage maps|splat|occlude|shade`: one stage of a frame alone, from file to file.
int runStageMaps(const StageOptions& options);
int runStageSplat(const StageOptions& options);
int runStageOcclude(const StageOptions& options);
int runStageShade(const StageOptions& options);

} // namespace ars::app
