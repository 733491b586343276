#include "app/interrupt.h"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <csignal>
#include <cstdio>

namespace ars::app {
namespace {

volatile std::sig_atomic_t requestedSignal = 0;

// SA_RESETHAND has put the default action back by now, so the next signal of this kind ends the program.
void onSignal(int number) { requestedSignal = number; }

// Written before any fault, since a handler may do next to nothing.
std::array<char, 1024> faultSentence{};
std::size_t faultSentenceBytes = 0;
// A stack that could not grow is no place for a handler.
alignas(16) std::array<unsigned char, 64 * 1024> faultStack;

void onFault(int number) {
    // SA_RESETHAND: raised again, the signal does what it would have done.
    if (write(STDERR_FILENO, faultSentence.data(), faultSentenceBytes) < 0) ::_exit(128 + number);
    std::raise(number);
}

} // namespace

void sayOnFault(const std::string& sentence) {
#ifdef __SANITIZE_ADDRESS__
    // Which tells more of a fault than we could.
    static_cast<void>(sentence);
    static_cast<void>(&onFault);
#else
    faultSentenceBytes = std::min(sentence.size(), faultSentence.size());
    std::copy_n(sentence.begin(), faultSentenceBytes, faultSentence.begin());
    stack_t stack{};
    stack.ss_sp = faultStack.data();
    stack.ss_size = faultStack.size();
    ::sigaltstack(&stack, nullptr);
    struct sigaction action{};
    action.sa_handler = onFault;
    action.sa_flags = static_cast<int>(SA_RESETHAND) | SA_ONSTACK | SA_NODEFER;
    sigemptyset(&action.sa_mask);
    for (const int number : {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT}) ::sigaction(number, &action, nullptr);
#endif
}

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
