#pragma once

#include <string>

namespace ars::app {

/// From now on the first SIGINT or SIGTERM only asks the running command to stop; a second one ends the program at
/// once.
void installInterruptHandler();

/// Whether the command was asked to stop.
bool interruptRequested();

/// From now on a fault of the program or of a library writes `sentence` to standard error before the program ends by
/// the fault's signal as it would have. LibTorch, for one, does not look whether it was given memory everywhere.
void sayOnFault(const std::string& sentence);

/// Ends the program by the signal that asked it to stop, as shells expect (they then see 130 or 143). Without such a
/// signal it returns.
void endByInterrupt();

} // namespace ars::app
