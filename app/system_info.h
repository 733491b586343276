#pragma once

#include "app/command.h"

namespace ars::app {

/// `ars info` without a file: this build and what it finds on this machine. With `measure`, also the speed of
/// LibTorch's convolution and matrix product. Always kSuccess: what is missing is said, not an error.
int runSystemInfo(bool measure, const OutputOptions& output);

} // namespace ars::app
