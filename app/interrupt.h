#pragma once

#include <string>

namespace ars::app {

/// From now on the first SIGINT or SIGTERM only asks the running command to stop; a second one ends the program at
/// once.
void installInterruptHandler();

/// Whether the command was asked to stop.
bool interruptRequested();

/// While one lives, a program that breaks off says so: a fault writes `sentence` to standard error before the program
/// ends by the fault's signal as it would have, and an exit() that a library calls on its own writes it before the
/// program ends with exit code 1. LibTorch does not look everywhere whether it was given memory, and the runtime of
/// OpenMP ends the program when it is refused a thread. One at a time.
class FaultSentence {
public:
    explicit FaultSentence(const std::string& sentence);
    ~FaultSentence();
    FaultSentence(const FaultSentence&) = delete;
    FaultSentence& operator=(const FaultSentence&) = delete;

    /// To be called when libraries were loaded meanwhile: what they do at an exit() would come before the sentence,
    /// with other threads still at work on it.
    static void coverLoadedLibraries();
};

/// Ends the program by the signal that asked it to stop, as shells expect (they then see 130 or 143). Without such a
/// signal it returns.
void endByInterrupt();

} // namespace ars::app
