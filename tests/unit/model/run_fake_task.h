#pragma once

#include "engine/core/file.h"
#include "engine/core/log.h"
#include "model/run/training_run.h"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <chrono>
#include <functional>
#include <random>
#include <sstream>
#include <thread>
#include <vector>

namespace ars::test {

/// A training in small: a chaotic recurrence pushed by random numbers, so that one lost bit or one random number drawn
/// twice changes everything after it.
class ChaoticTask : public TrainingTask {
public:
    std::int64_t total = 100;
    std::chrono::microseconds stepTime{0};
    std::size_t ballastBytes = 0;                          ///< makes checkpoints large
    std::function<Status(const ProgressFunction&)> onLoad; ///< instead of loading nothing
    std::function<Status(std::int64_t)> onStep;            ///< before a step; may fail or throw
    std::function<Status()> onRestore;                     ///< before a checkpoint is restored
    std::vector<std::int64_t> previews;                    ///< steps of which one was made
    std::function<double(std::int64_t, double)> loss = [](std::int64_t, double x) { return x; };

    Status load(const ProgressFunction& progress) override { return onLoad ? onLoad(progress) : Status(); }
    std::int64_t totalSteps() const override { return total; }
    std::int64_t stepsDone() const override { return done_; }

    Result<StepReport> step() override {
        if (onStep) ARS_TRY_STATUS(onStep(done_ + 1));
        if (stepTime.count() > 0) std::this_thread::sleep_for(stepTime);
        const double push = std::uniform_real_distribution<double>(-1e-3, 1e-3)(random_);
        x_ = std::clamp(3.97 * x_ * (1 - x_) + push, 1e-6, 1 - 1e-6);
        ++done_;
        StepReport report;
        report.stage = done_ <= total / 2 ? "radiance" : "pbr";
        report.values = {{"loss.total", loss(done_, x_)}, {"loss.l1", loss(done_, x_)}, {"rate.network", 1e-3}};
        report.milliseconds = 1;
        return report;
    }

    Status save(const std::filesystem::path& folder) override {
        ARS_TRY_STATUS(writeFileAtomic(folder / "state.txt", stateText()));
        return writeFileAtomic(folder / "ballast.bin", std::string(ballastBytes, 'b'));
    }

    Status restore(const std::filesystem::path& folder) override {
        if (onRestore) ARS_TRY_STATUS(onRestore());
        ARS_TRY(const std::string text, readTextFile(folder / "state.txt"));
        std::istringstream stream(text);
        std::string number;
        std::string end;
        if (!(stream >> done_ >> number >> random_ >> end) || end != "end") {
            return makeError(ErrorCode::BadFile, (folder / "state.txt").string(),
                             "expected a whole state, found a part");
        }
        x_ = std::strtod(number.c_str(), nullptr);
        return {};
    }

    Status preview(const std::filesystem::path& folder) override {
        previews.push_back(done_);
        return writeFileAtomic(folder / fmt::format("{:08}_view.png", done_), "picture");
    }

    /// Every bit of the state.
    std::string stateText() const {
        std::ostringstream stream;
        stream << done_ << '\n' << fmt::format("{:a}", x_) << '\n' << random_ << "\nend\n";
        return stream.str();
    }

private:
    std::int64_t done_ = 0;
    double x_ = 0.4;
    std::mt19937_64 random_{7};
};

inline RunOptions quickOptions() {
    RunOptions options;
    options.checkpointSteps = 10;
    options.previewSteps = 0;
    options.policy = {2, 0};
    return options;
}

/// Runs a task in a folder, made or continued.
inline Result<RunStatus> runIn(const std::filesystem::path& folder, TrainingTask& task, const RunOptions& options,
                               const RunListener& listener = {}) {
    const bool resume = looksLikeRunFolder(folder);
    ARS_TRY(const auto writer,
            resume ? RunWriter::open(folder) : RunWriter::create(folder, nlohmann::json{{"preset", "fake"}}));
    const RunSignals signals;
    return runTraining(*writer, task, options, resume, signals, listener);
}

/// metrics.jsonl without what depends on the clock and the machine.
inline std::string metricsText(const std::filesystem::path& folder) {
    MetricsFollower follower(folder);
    if (!follower.poll()) return "unreadable";
    std::string text = fmt::format("{} broken lines\n", follower.brokenLines());
    for (MetricsRow row : follower.rows()) {
        std::erase_if(row.values,
                      [](const auto& v) { return v.first.starts_with("time.") || v.first.starts_with("memory."); });
        text += metricsRowToJson(row).dump() + "\n";
    }
    return text;
}

/// Lines of metrics.jsonl as they stand, rows that are superseded or written twice included.
inline std::size_t metricsLines(const std::filesystem::path& folder) {
    const auto text = readTextFile(folder / kRunMetricsFile);
    return text ? static_cast<std::size_t>(std::count(text->begin(), text->end(), '\n')) : 0;
}

} // namespace ars::test
