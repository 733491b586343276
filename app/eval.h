#pragma once

#include "app/command.h"

#include <string>

namespace ars::app {

struct EvalOptions {
    std::string avatar;  ///< NAME.avatar/, a run (its newest checkpoint), a checkpoint
    std::string capture; ///< a capture, or a folder of several
    std::string
        split; ///< train, all, held_out_cameras, novel_poses, ag, ... as the capture has them; empty: protocol's
    std::string protocol = "masked";       ///< ag, heldout, masked
    std::string cameras, frames;           ///< override the split's
    std::string light;                     ///< the capture's true light; empty: lights/*.exr in or beside the capture
    std::string lpipsBackbone, lpipsHeads; ///< weight files of LPIPS; both or none
    int pictures = 8;                      ///< views that are written as pictures
    bool project = true;                   ///< poses are projected onto those of training
    std::string out;                       ///< report.json, report.txt, pictures/
    OutputOptions output;
};

/// `ars eval`: how near an avatar comes to a capture.
int runEval(const EvalOptions& options);

} // namespace ars::app
