#pragma once

#include <string>
#include <vector>

namespace ars::app {

/// Reads the arguments (without the program's name), runs the command that they name, and returns the exit code.
int runCommandLine(const std::vector<std::string>& arguments);

} // namespace ars::app
