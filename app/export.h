#pragma once

#include "app/command.h"

#include <optional>
#include <string>

namespace ars::app {

struct ExportOptions {
    std::string avatar; ///< a trained avatar, a run or a checkpoint: NAME.avatar is written instead of a mesh
    std::string body;   ///< "open" or a file; empty: "open"
    std::string templateFile;
    std::string betas;      ///< numbers with commas, or "motion"
    std::string expression; ///< numbers with commas
    std::string pose;       ///< "rest", "canonical" or a motion file
    std::size_t frame = 0;  ///< of the pose file
    std::string motion;
    std::string frames; ///< a:b
    double framesPerSecond = 0.0;
    std::string map;
    std::string up = "auto";
    std::string out;
    OutputOptions output;
};

/// `ars export`: a posed body or template as OBJ, PLY, npz or glb, a motion as numbered files or as a glb's animation;
/// with --avatar what a training learned as a folder NAME.avatar.
int runExport(const ExportOptions& options);

} // namespace ars::app
