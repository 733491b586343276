#include "engine/scene/run_monitor.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <exception>
#include <map>
#include <mutex>
#include <thread>

namespace ars {
namespace fs = std::filesystem;
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::milliseconds kInterval{400};
/// Reading may take this share of the time: where metrics have become long, the training needs the processor more.
constexpr int kIntervalPerReading = 15;
constexpr std::string_view kLossPrefix = "loss.";
constexpr const char* kTotal = "loss.total";

/// One name's numbers in the order of steps.
struct Series {
    std::vector<double> steps, values;
};

RunCurve curveOf(const std::string& name, const Series& series, double weight) {
    RunCurve curve;
    curve.name = name;
    const std::size_t count = series.steps.size();
    const std::size_t points = std::min(count, kMostCurvePoints);
    double running = 0.0, share = 0.0; // share: how much of the running mean is numbers yet
    std::size_t read = 0;
    for (std::size_t p = 0; p < points; ++p) {
        const std::size_t end = (p + 1) * count / points;
        double sum = 0.0;
        std::size_t numbers = 0;
        for (; read < end; ++read) {
            const double value = series.values[read];
            if (!std::isfinite(value)) continue;
            sum += value;
            ++numbers;
            running = weight * running + (1.0 - weight) * value;
            share = weight * share + (1.0 - weight);
        }
        const double nothing = std::nan("");
        curve.steps.push_back(series.steps[end - 1]);
        curve.values.push_back(numbers > 0 ? sum / static_cast<double>(numbers) : nothing);
        curve.smoothed.push_back(numbers > 0 ? running / share : nothing);
    }
    return curve;
}

std::string textAt(const nlohmann::json& json, const char* group, const char* key) {
    if (!json.is_object()) return {};
    const auto found = json.find(group);
    if (found == json.end() || !found->is_object()) return {};
    const auto text = found->find(key);
    return text != found->end() && text->is_string() ? text->get<std::string>() : std::string();
}

/// The means of reading one folder; lives on the monitor's thread.
struct Reader {
    explicit Reader(const fs::path& where) : folder(where), metrics(where) {}

    fs::path folder;
    MetricsFollower metrics;
    double weight = -1.0; ///< of the curves that are there
    RunSnapshot snapshot;

    bool read(double smoothing);
};

/// Whether anything differs from before.
bool Reader::read(double smoothing) {
    RunSnapshot next = snapshot;
    next.folder = folder;
    next.error.reset();
    const auto keep = [&next](const Error& error) {
        if (!next.error) next.error = error;
    };
    auto status = readRunStatus(folder);
    if (status) next.status = std::move(*status);
    if (!status) keep(status.error());
    std::error_code unknown;
    next.gone = !status && !fs::exists(folder, unknown) && !unknown;
    next.owned = runOwned(folder);
    const bool first = snapshot.folder.empty();
    const bool told = next.status.updatedUnixS != snapshot.status.updatedUnixS;
    if (first || told || snapshot.error) {
        if (const auto config = readRunConfig(folder)) {
            next.capture = textAt(*config, "sources", "capture");
            next.preset = textAt(*config, "training", "preset");
        }
        if (auto checkpoints = listCheckpoints(folder)) next.checkpoints = std::move(*checkpoints);
        const std::vector<fs::path> previews = listPreviews(folder);
        next.preview = previews.empty() ? fs::path() : previews.back();
    }
    const auto added = metrics.poll();
    if (!added) keep(added.error());
    const bool newCurves = (added && *added) || weight != smoothing;
    if (newCurves) {
        next.curves = runCurves(metrics.rows(), smoothing);
        next.rows = metrics.rows().size();
        weight = smoothing;
    }
    next.brokenLines = metrics.brokenLines();
    const auto words = [](const RunSnapshot& s) { return s.error ? s.error->describe() : std::string(); };
    const bool changed = first || told || newCurves || next.owned != snapshot.owned || next.gone != snapshot.gone ||
                         next.status.state != snapshot.status.state || words(next) != words(snapshot);
    snapshot = std::move(next);
    return changed;
}

} // namespace

std::vector<RunCurve> runCurves(const std::vector<MetricsRow>& rows, double weight) {
    std::map<std::string, Series> all;
    for (const MetricsRow& row : rows) {
        for (const auto& [name, value] : row.values) {
            if (name.compare(0, kLossPrefix.size(), kLossPrefix) != 0) continue;
            Series& series = all[name];
            series.steps.push_back(static_cast<double>(row.step));
            series.values.push_back(value);
        }
    }
    std::vector<RunCurve> curves;
    const auto total = all.find(kTotal);
    if (total != all.end()) curves.push_back(curveOf(kTotal, total->second, weight));
    for (const auto& [name, series] : all) {
        if (name != kTotal) curves.push_back(curveOf(name, series, weight));
    }
    return curves;
}

struct RunMonitor::State {
    std::function<void()> wake;
    mutable std::mutex mutex;
    std::condition_variable asked;
    fs::path folder;
    double smoothing = 0.0;
    std::uint64_t request = 0; ///< counts what was asked for
    bool stop = false;
    std::shared_ptr<const RunSnapshot> latest;
    std::thread thread;

    void run();
};

void RunMonitor::State::run() {
    std::unique_ptr<Reader> reader;
    std::uint64_t seen = 0;
    Clock::duration pause = kInterval;
    for (;;) {
        fs::path wanted;
        double weight = 0.0;
        {
            std::unique_lock lock(mutex);
            const auto due = [&] { return stop || request != seen; };
            if (folder.empty())
                asked.wait(lock, due);
            else
                asked.wait_for(lock, pause, due);
            if (stop) return;
            seen = request;
            wanted = folder;
            weight = smoothing;
        }
        if (wanted.empty()) {
            reader.reset();
            continue;
        }
        const Clock::time_point begin = Clock::now();
        if (!reader || reader->folder != wanted) reader = std::make_unique<Reader>(wanted);
        bool news = true;
        try {
            news = reader->read(weight);
        } catch (const std::exception& error) { // no memory for very long metrics
            reader->snapshot.error = makeError(ErrorCode::Internal, wanted.string(), error.what());
        }
        pause = std::max<Clock::duration>(kInterval, kIntervalPerReading * (Clock::now() - begin));
        {
            const std::lock_guard lock(mutex);
            // Without `latest` even old news are wanted: another folder, and this one again, may have been asked for
            // since the last look.
            if (folder != wanted || (!news && latest)) continue;
            latest = std::make_shared<const RunSnapshot>(reader->snapshot);
        }
        if (wake) wake();
    }
}

RunMonitor::RunMonitor(std::function<void()> wake) : state_(std::make_unique<State>()) {
    state_->wake = std::move(wake);
    state_->thread = std::thread([state = state_.get()] { state->run(); });
}

RunMonitor::~RunMonitor() {
    {
        const std::lock_guard lock(state_->mutex);
        state_->stop = true;
    }
    state_->asked.notify_all();
    state_->thread.join();
}

void RunMonitor::follow(const fs::path& folder) {
    const std::lock_guard lock(state_->mutex);
    if (folder != state_->folder) state_->latest.reset();
    state_->folder = folder;
    ++state_->request;
    state_->asked.notify_all();
}

void RunMonitor::setSmoothing(double weight) {
    const std::lock_guard lock(state_->mutex);
    if (weight == state_->smoothing) return;
    state_->smoothing = weight;
    ++state_->request;
    state_->asked.notify_all();
}

std::shared_ptr<const RunSnapshot> RunMonitor::latest() const {
    const std::lock_guard lock(state_->mutex);
    return state_->latest;
}

} // namespace ars
