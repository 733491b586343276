#pragma once

#include "app/command.h"

#include <string>
#include <vector>

namespace ars::app {

struct TrainOptions {
    std::string capture; ///< folder; may be left out with --resume
    std::string run;     ///< run folder
    std::string preset;  ///< empty: compact, or the run's own with --resume
    std::string body;    ///< body file; empty: the capture's own, else the open body
    std::string templateFile;
    std::vector<std::string> settings; ///< --set NAME=VALUE, in order
    bool resume = false;
    std::string request;         ///< pause, resume, save, stop, discard: of the process that works on --run
    bool status = false;         ///< only says what --run is doing
    bool helpParameters = false; ///< only lists the parameters of the preset
    OutputOptions output;
};

/// `ars train`: trains an avatar from a capture, or speaks to a run that another process works on. Ctrl-C and SIGTERM
/// stop with a checkpoint. With --json every new row of metrics and at last the status (or the error) are lines of
/// JSON.
int runTrain(const TrainOptions& options);

} // namespace ars::app
