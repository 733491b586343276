#include "app/interrupt.h"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <ctime>

namespace ars::app {
namespace {

volatile std::sig_atomic_t requestedSignal = 0;

// SA_RESETHAND has put the default action back by now, so the next signal of this kind ends the program.
void onSignal(int number) { requestedSignal = number; }

constexpr std::array kFaults{SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT};

// Written before any fault, since a handler may do next to nothing.
std::array<char, 1024> faultSentence{};
std::size_t faultSentenceBytes = 0;
enum class Saying { Nothing, Ready, Now, Done };
std::atomic<Saying> saying = Saying::Nothing;
// A stack that could not grow is no place for a handler.
alignas(16) std::array<unsigned char, 64 * 1024> faultStack;

// Once, by whichever thread comes first; two that fault on the same thing come at the same moment, and the second must
// not end the program in the middle of the words. False when they could not be written.
bool sayTheSentence() {
    Saying before = Saying::Ready;
    if (!saying.compare_exchange_strong(before, Saying::Now)) {
        for (int i = 0; saying == Saying::Now && i < 1000; ++i) {
            constexpr timespec kMoment{0, 1'000'000};
            ::nanosleep(&kMoment, nullptr);
        }
        return true;
    }
    const bool written = write(STDERR_FILENO, faultSentence.data(), faultSentenceBytes) >= 0;
    saying = Saying::Done;
    return written;
}

void onFault(int number) {
    // Not SA_RESETHAND: a second thread that faults while this one speaks would end the program.
    if (!sayTheSentence()) ::_exit(128 + number);
    std::signal(number, SIG_DFL);
    std::raise(number);
}

// A library ended the program: nothing of it can be relied on, and its other threads are still at work.
void onExit() {
    if (saying == Saying::Nothing) return;
    sayTheSentence();
    ::_exit(1);
}

} // namespace

FaultSentence::FaultSentence(const std::string& sentence) {
    faultSentenceBytes = std::min(sentence.size(), faultSentence.size());
    std::copy_n(sentence.begin(), faultSentenceBytes, faultSentence.begin());
    saying = Saying::Ready;
    coverLoadedLibraries();
#ifndef __SANITIZE_ADDRESS__ // which tells more of a fault than we could
    stack_t stack{};
    stack.ss_sp = faultStack.data();
    stack.ss_size = faultStack.size();
    ::sigaltstack(&stack, nullptr);
    struct sigaction action{};
    action.sa_handler = onFault;
    action.sa_flags = SA_ONSTACK | SA_NODEFER;
    sigemptyset(&action.sa_mask);
    for (const int number : kFaults) ::sigaction(number, &action, nullptr);
#endif
}

FaultSentence::~FaultSentence() {
    saying = Saying::Nothing;
#ifndef __SANITIZE_ADDRESS__
    for (const int number : kFaults) std::signal(number, SIG_DFL);
#endif
}

// Handlers run in the opposite order of their registration.
void FaultSentence::coverLoadedLibraries() { std::atexit(onExit); }

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
