#pragma once

#include "app/command.h"

#include <string>
#include <vector>

namespace ars::app {

struct InfoOptions {
    std::vector<std::string> files;
    bool fast = false;
    OutputOptions output;
};

/// `ars info`: what each file is and whether it is sound. Goes on after a bad file; kSuccess only when all are sound
/// (or, with --fast, none is known to be broken).
int runInfo(const InfoOptions& options);

} // namespace ars::app
