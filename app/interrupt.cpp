#include "app/interrupt.h"

#include <csignal>
#include <cstdio>

namespace ars::app {
namespace {

volatile std::sig_atomic_t requestedSignal = 0;

// SA_RESETHAND has put the default action back by now, so the next signal of this kind ends the program.
void onSignal(int number) { requestedSignal = number; }

} // namespace

void installInterruptHandler() {
    struct sigaction action{};
    action.sa_handler = onSignal;
    action.sa_flags = static_cast<int>(SA_RESETHAND) | SA_RESTART;
    sigemptyset(&action.sa_mask);
    ::sigaction(SIGINT, &action, nullptr);
    ::sigaction(SIGTERM, &action, nullptr);
}

bool interruptRequested() { return requestedSignal != 0; }

void endByInterrupt() {
    if (requestedSignal == 0) return;
    std::fflush(nullptr);
    std::signal(requestedSignal, SIG_DFL);
    std::raise(requestedSignal);
}

} // namespace ars::app
