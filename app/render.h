#pragma once

#include "app/command.h"
#include "app/frame_options.h"
#include "engine/core/progress.h"

#include <array>
#include <filesystem>
#include <string>
#include <vector>

namespace ars::app {

struct RenderOptions {
    std::string project;   ///< NAME.ars, or a picture of this program; then only size, buffers, formats, out, film,
                           ///< range, framesPerSecond, display.transparent and frame.device are looked at
    bool film = false;     ///< of a project: its timeline's range
    std::string filmTimes; ///< START:END in seconds, of a film

    std::string avatar;
    int surfels = 0; ///< of a rest: avatar; 0: the default

    std::string pose; ///< rest, canonical, relaxed, or a motion file
    std::size_t poseFrame = 0;
    std::string motion;
    std::string frames; ///< a:b
    double framesPerSecond = 0.0;
    std::string map;
    std::string up = "auto";

    std::string camera;      ///< CAMERA.json or CALIBRATION.json:NAME
    int orbit = 0;           ///< frames of one turn of the camera; 0: it stands still
    double azimuthDeg = 0.0; ///< of the orbit camera's first frame
    double elevationDeg = 8.0;
    double fieldDeg = 30.0;
    std::string size; ///< WxH

    std::string environment = "studio";
    double environmentScale = 1.0;
    double environmentRotationDeg = 0.0;
    int environmentOrbit = 0; ///< frames of one turn of the light; 0: it stands still
    int lightSize = 512;      ///< side of the cube that is filtered

    std::string buffers; ///< --aov
    std::string formats; ///< --write; empty: png, exr with --aov, mp4 where there are several frames
    std::string out;

    FrameOptions frame;
    DisplayOptions display;
    OutputOptions output;
};

/// What a rendering did.
struct RenderSummary {
    std::string avatar; ///< in words
    Device device;
    std::size_t frames = 0;
    double seconds = 0;
    std::array<double, kFrameStageCount> stageMs{}; ///< of all frames together
    std::vector<std::filesystem::path> files;
    std::vector<MemoryUse> memory; ///< of the buffers, at the end
    std::vector<std::string> notes;
};

/// `ars render`: pictures of an avatar without a display.
int runRender(const RenderOptions& options);

/// `ars render --project`: a document as the window would show it (render_project.cpp).
Result<RenderSummary> renderProject(const RenderOptions& options, const ProgressFunction& progress);

/// What `ars` does where no window can be opened: a turntable of the open body in the folder ars-turntable.
int runTurntable(const OutputOptions& output);

} // namespace ars::app
