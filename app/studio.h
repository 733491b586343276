#pragma once

#include "app/command.h"

#include <string>
#include <vector>

namespace ars::app {

struct StudioOptions {
    std::vector<std::string> files; ///< opened at the start, in this order
    std::string stateFolder;        ///< empty: stateFolder() of engine/scene/project.h
    std::string size;               ///< WxH of the window; empty: as it was left
    double scale = 0.0;             ///< of text and widgets; 0: the display's
    std::string device = "auto";
    std::string timings; ///< file for the window's frame times
    std::string probe;   ///< folder of ui/script_probe.h
    OutputOptions output;
};

/// `ars studio`: the window. Returns when the person has left it.
int runStudio(const StudioOptions& options);

/// Whether a window can be expected to open here: the build has one and there is a display.
bool displayIsThere();

} // namespace ars::app
