#pragma once

#include "app/command.h"

#include <string>
#include <vector>

namespace ars::app {

struct LightOptions {
    std::string source;                ///< a file, a folder of six faces, sky[:E,A], studio[:PRESET], uniform
    std::vector<std::string> settings; ///< --set NAME=VALUE of the sky or the studio
    std::string out;                   ///< .exr, .hdr (linear) or .png, .jpg (a preview)
    std::string size;                  ///< WxH of the lat-long picture; empty: as it comes
    int cube = 0;                      ///< side of a face: write the cube as a strip of six instead
    double rotationDeg = 0.0;
    double scale = 1.0;
    std::string prefilter; ///< folder for the split-sum levels, irradiance and table
    int lightSize = 512;
    std::string device = "auto";
    OutputOptions output;
};

/// `ars light`: looks at, converts, generates and prefilters environments.
int runLight(const LightOptions& options);

/// Rows that --set reaches for the generators, for help.
std::string describeLightSettings();

} // namespace ars::app
