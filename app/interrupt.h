#pragma once

namespace ars::app {

/// From now on the first SIGINT or SIGTERM only asks the running command to stop; a second one ends the program at
/// once.
void installInterruptHandler();

/// Whether the command was asked to stop.
bool interruptRequested();

/// Ends the program by the signal that asked it to stop, as shells expect (they then see 130 or 143). Without such a
/// signal it returns.
void endByInterrupt();

} // namespace ars::app
