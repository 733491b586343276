#pragma once

#include "app/command.h"

#include <string>

namespace ars::app {

struct ImportOptions {
    std::string motion;
    std::string out; ///< .npz or .bvh
    double framesPerSecond = 0.0;
    std::string map = "auto";
    std::string up = "auto";
    std::string body = "open";
    std::string animation;      ///< of a glTF
    std::string floor = "auto"; ///< auto, keep, place
    double metresPerUnit = 0.0;
    std::string frames; ///< a:b, after resampling
    bool keepPosition = false;
    bool keepLeadIn = false;
    OutputOptions output;
};

/// `ars import`: a BVH, AMASS or glTF motion as smpl_params.npz (or as BVH of the body's own skeleton).
int runImport(const ImportOptions& options);

} // namespace ars::app
