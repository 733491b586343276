#include "app/train_progress.h"

#include "app/text.h"

#include <fmt/format.h>

#include <unistd.h>

#include <cmath>
#include <cstdio>

namespace ars::app {
namespace {

constexpr auto kRedraw = std::chrono::milliseconds(200);
constexpr auto kLineEvery = std::chrono::seconds(10); ///< plain lines, so that logs stay short
constexpr auto kRowsEvery = std::chrono::milliseconds(200);

/// What compares pictures, and the sum; all the terms would make the line too long.
std::string lossText(const RunStatus& status) {
    std::string text;
    for (const char* name : {"l1", "ms_ssim_gradient", "lpips_vgg", "lpips_alex"}) {
        const auto loss = status.losses.find(name);
        if (loss != status.losses.end()) text += fmt::format("  {} {:.4f}", name, loss->second);
    }
    const auto total = status.losses.find("total");
    if (total != status.losses.end()) text += fmt::format("  total {:.4f}", total->second);
    return text;
}

} // namespace

std::string durationText(double seconds) {
    if (!std::isfinite(seconds) || seconds < 0) return "unknown";
    const auto whole = static_cast<std::int64_t>(std::llround(seconds));
    if (whole < 60) return fmt::format("{} s", whole);
    if (whole < 3600) return fmt::format("{} min", (whole + 30) / 60);
    return fmt::format("{} h {:02} min", whole / 3600, whole % 3600 / 60);
}

std::string progressText(const RunStatus& status) {
    std::string text;
    if (status.state != RunState::Running) text = std::string(runStateName(status.state)) + "  ";
    if (status.totalSteps > 0) {
        text += fmt::format("step {} of {}", grouped(static_cast<std::uint64_t>(status.step)),
                            grouped(static_cast<std::uint64_t>(status.totalSteps)));
        if (!status.stage.empty()) text += fmt::format(" ({})", status.stage);
    }
    text += lossText(status);
    if (status.stepMs > 0) text += fmt::format("  {:.2f} s a step", status.stepMs * 1e-3);
    if (status.etaS > 0) text += fmt::format("  {} left", durationText(status.etaS));
    if (status.memoryBytes > 0) text += fmt::format("  {:.2f} GB", static_cast<double>(status.memoryBytes) * 1e-9);
    if (!status.note.empty()) text += "  " + status.note;
    return printable(text);
}

TrainProgress::TrainProgress(std::filesystem::path run, const OutputOptions& output)
    : output_(output), terminal_(::isatty(STDERR_FILENO) == 1), metrics_(std::move(run)) {}

TrainProgress::~TrainProgress() { finish(); }

void TrainProgress::show(const RunStatus& status) {
    // What stood in the file before, and was not cut by the resume, has been told by an earlier call of the program.
    if (printedStep_ < 0 && status.state == RunState::Running) printedStep_ = status.step;
    const Clock::time_point now = Clock::now();
    const auto wait = output_.json ? Clock::duration(kRowsEvery) : terminal_ ? Clock::duration(kRedraw) : kLineEvery;
    const bool newState = status.state != lastState_ && status.state != RunState::Saving &&
                          !(lastState_ == RunState::Saving && status.state == RunState::Running);
    if (now - lastShown_ < wait && !newState) return;
    lastShown_ = now;
    lastState_ = status.state;
    if (output_.json) printRows();
    if (!output_.json && !output_.quiet) draw(status);
}

void TrainProgress::draw(const RunStatus& status) {
    const std::string text = progressText(status);
    if (!terminal_) {
        fmt::print(stderr, "{}\n", text);
        return;
    }
    fmt::print(stderr, "\r\033[K{}", text);
    std::fflush(stderr);
    drawn_ = true;
}

void TrainProgress::printRows() {
    if (printedStep_ < 0 || !metrics_.poll()) return;
    const std::vector<MetricsRow>& rows = metrics_.rows();
    auto next = rows.end();
    while (next != rows.begin() && std::prev(next)->step > printedStep_) --next;
    for (; next != rows.end(); ++next) {
        fmt::print("{}\n", metricsRowToJson(*next).dump());
        printedStep_ = next->step;
    }
    std::fflush(stdout);
}

void TrainProgress::finish() {
    if (output_.json) printRows();
    if (!drawn_) return;
    fmt::print(stderr, "\r\033[K");
    std::fflush(stderr);
    drawn_ = false;
}

} // namespace ars::app
