#include "ui/look/training_starts.h"

#include "engine/core/process.h"
#include "engine/scene/session.h"

#include <map>
#include <optional>
#include <set>
#include <utility>
#include <vector>

namespace ars::ui {

namespace fs = std::filesystem;

struct TrainingStarts::State {
    std::set<fs::path> starting;
    std::map<fs::path, ChildProcess> children;
    std::map<fs::path, std::string> said;
};

TrainingStarts::TrainingStarts() : state_(std::make_shared<State>()) {}

void TrainingStarts::start(StudioContext& context, const TrainingStart& start, std::function<void()> begun) {
    if (works(start.run)) return;
    state_->starting.insert(start.run);
    state_->said.erase(start.run);
    const auto child = std::make_shared<std::optional<ChildProcess>>();
    context.session.start((start.resume ? "Resuming " : "Starting ") + start.run.filename().string(),
                          [start, child](const ProgressFunction&) -> Status {
                              ARS_TRY(ChildProcess made, startTraining(start));
                              child->emplace(std::move(made));
                              return {};
                          },
                          [state = state_, child, run = start.run, begun = std::move(begun)](const Status&) {
                              state->starting.erase(run);
                              if (!*child) return; // told as a notice
                              state->children.insert_or_assign(run, std::move(**child));
                              if (begun) begun();
                          });
}

bool TrainingStarts::update(StudioContext& context) {
    std::vector<std::pair<fs::path, int>> ended;
    for (auto& [run, child] : state_->children) {
        if (!child.running()) ended.emplace_back(run, child.exitCode().value_or(0));
    }
    for (const auto& [run, code] : ended) {
        state_->children.erase(run);
        if (code == 0) continue;
        const auto text = std::make_shared<std::string>();
        context.session.start(
            "Reading the log of " + run.filename().string(),
            [run = run, text](const ProgressFunction&) {
                *text = endOfLog(run);
                return Status();
            },
            [state = state_, run = run, text](const Status&) {
                // One that was started meanwhile has words of its own.
                if (!state->starting.contains(run) && !state->children.contains(run)) state->said[run] = *text;
            },
            true);
    }
    return !ended.empty();
}

bool TrainingStarts::works(const fs::path& run) const {
    return state_->starting.contains(run) || state_->children.contains(run);
}

bool TrainingStarts::starting() const { return !state_->starting.empty(); }

std::string TrainingStarts::said(const fs::path& run) const {
    const auto found = state_->said.find(run);
    return found == state_->said.end() ? std::string() : found->second;
}

void TrainingStarts::forget(const fs::path& run) { state_->said.erase(run); }

} // namespace ars::ui
