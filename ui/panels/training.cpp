#include "engine/core/buffer.h"
#include "engine/io/image_file.h"
#include "engine/scene/run_monitor.h"
#include "ui/look/controls.h"
#include "ui/look/loss_plot.h"
#include "ui/look/output_jobs.h"
#include "ui/look/picture_cache.h"
#include "ui/look/training_starts.h"
#include "ui/panel.h"
#include "ui/studio.h"

#include <imgui_stdlib.h>

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>

namespace ars::ui {

namespace fs = std::filesystem;

namespace {

/// Under these names the settings remember the run that was followed last, and where captures and runs were.
constexpr const char* kLastRun = "training run";
constexpr const char* kCaptures = "captures";
constexpr const char* kRuns = "training runs";
/// For so long after its end was asked for, a run that cannot be read is taken for one that is being deleted.
constexpr std::chrono::minutes kDeleting{1};

struct PresetWords {
    const char* name;
    const char* help;
};
constexpr std::array<PresetWords, 4> kPresets{{
    {"compact", "Maps of 256, about 19,000 surfels: an hour on two processor cores, and interactive there."},
    {"tiny", "Maps of 128, about 5,000 surfels: minutes, to see whether everything works."},
    {"studio", "Maps of 512, about 75,000 surfels: a graphics card with 8 GB."},
    {"paper", "Maps of 1024, about 300,000 surfels: a graphics card with 24 GB."},
}};

/// "1 h 12 min", "3 min 20 s", "15 s".
std::string durationText(double seconds) {
    if (!std::isfinite(seconds) || seconds < 0.0) return "unknown";
    const auto whole = static_cast<long long>(std::llround(seconds));
    if (whole >= 3600) return fmt::format("{} h {} min", whole / 3600, whole % 3600 / 60);
    if (whole >= 60) return fmt::format("{} min {} s", whole / 60, whole % 60);
    return fmt::format("{} s", whole);
}

ImVec4 colorOf(RunState state) {
    switch (state) {
    case RunState::Failed:
        return badColor();
    case RunState::Finished:
        return goodColor();
    case RunState::Idle:
    case RunState::Paused:
        return mutedColor();
    default:
        return accentColor();
    }
}

/// What went wrong, in red; nothing for no words.
void badText(const std::string& words) {
    if (words.empty()) return;
    ImGui::PushStyleColor(ImGuiCol_Text, badColor());
    ImGui::PushTextWrapPos(0.0f);
    ImGui::TextUnformatted(words.c_str());
    ImGui::PopTextWrapPos();
    ImGui::PopStyleColor();
}

/// What the dialogs fill in: one may answer after the panel.
struct TrainingForm {
    std::string capture, run;
    std::string suggestedRun; ///< what `run` was set to by itself
    std::string settings;     ///< lines "name=value"
    int preset = 0;
};

class TrainingPanel : public Panel {
public:
    const char* id() const override { return "training"; }
    const char* title() const override { return "Training"; }
    const char* help() const override { return "Learns an avatar from a capture: start, watch, pause, resume."; }
    void draw(StudioContext& context) override;

private:
    void begin(StudioContext& context);
    void follow(StudioContext& context, const fs::path& run);
    void drawRun(StudioContext& context, const RunSnapshot* run);
    void drawState(StudioContext& context, const RunSnapshot& run);
    void drawNumbers(StudioContext& context, const RunSnapshot& run);
    void drawButtons(StudioContext& context, const RunSnapshot& run);
    void drawDiscard(StudioContext& context);
    void drawPreview(StudioContext& context, const RunSnapshot& run, float height);
    void drawForm(StudioContext& context);
    void drawFolder(StudioContext& context, const char* label, const char* tooltip, std::string TrainingForm::* field,
                    const char* key);
    void drawSettings(StudioContext& context, const char* tooltip);
    void suggestRun(const StudioContext& context);
    void askForRun(StudioContext& context);
    void request(StudioContext& context, RunRequest what, const std::string& title);
    void start(StudioContext& context, const TrainingStart& start);

    std::unique_ptr<RunMonitor> monitor_;
    fs::path run_;             ///< that is followed
    std::uint64_t opened_ = 0; ///< of Session::trainingRunsOpened that were seen
    std::shared_ptr<TrainingForm> form_ = std::make_shared<TrainingForm>();
    LossPlot plot_;
    bool discarding_ = false; ///< the question is on the screen
    fs::path discarded_;      ///< the run that is to be deleted at the wish of this panel
    std::chrono::steady_clock::time_point discardedAt_;
    TrainingStarts starts_;
    /// A run to be followed, from a dialog or a start that answers later.
    std::shared_ptr<std::optional<fs::path>> arrived_ = std::make_shared<std::optional<fs::path>>();

    struct Preview {
        fs::path file;
        std::unique_ptr<PictureCache> picture;
    };
    Preview shown_, coming_;
};

void TrainingPanel::begin(StudioContext& context) {
    if (!monitor_) {
        monitor_ = std::make_unique<RunMonitor>(context.session.waker());
        const auto last = context.settings.folders.find(kLastRun);
        if (last != context.settings.folders.end()) follow(context, last->second);
    }
    if (context.session.trainingRunsOpened() != opened_) {
        opened_ = context.session.trainingRunsOpened();
        follow(context, context.session.trainingRun());
    }
    if (*arrived_) {
        follow(context, **arrived_);
        arrived_->reset();
    }
    monitor_->setSmoothing(plot_.smoothing());
    if (starts_.update(context)) monitor_->follow(run_); // look at once
}

void TrainingPanel::follow(StudioContext& context, const fs::path& run) {
    if (run != run_) starts_.forget(run_);
    run_ = run;
    discarding_ = false;
    shown_ = {};
    coming_ = {};
    if (run.empty())
        context.settings.folders.erase(kLastRun);
    else
        context.settings.folders[kLastRun] = run.string();
    monitor_->follow(run);
}

void TrainingPanel::draw(StudioContext& context) {
    begin(context);
    std::shared_ptr<const RunSnapshot> run = monitor_->latest();
    if (run && run->gone && discarded_ == run_) { // what was asked for is done: there is nothing to follow
        context.studio.toast(run_.filename().string() + " is deleted.");
        discarded_.clear();
        follow(context, {});
        run.reset();
    }
    if (run_.empty()) {
        drawForm(context);
        const char* words =
            "Choose a capture and start, or open a run folder to look at it, also one of another machine.";
        sameLineIfFits(ImGui::CalcTextSize(words).x);
        ImGui::AlignTextToFramePadding();
        ui::hint(words);
        return;
    }
    drawRun(context, run.get());
    if (ImGui::CollapsingHeader("New run")) drawForm(context);
}

void TrainingPanel::drawRun(StudioContext& context, const RunSnapshot* run) {
    if (!run) {
        ui::hint("Reading the run ...");
        return;
    }
    const float size = ImGui::GetFontSize();
    const float wide = ImGui::GetContentRegionAvail().x;
    // All of the panel but the line of "New run" below; a low panel scrolls rather than to squeeze the curves.
    const float below = ImGui::GetFrameHeight() + 2.0f * ImGui::GetStyle().ItemSpacing.y;
    const float height = std::max(8.0f * size, ImGui::GetContentRegionAvail().y - below);
    const bool beside = wide > 44.0f * size;
    // Below the viewport there is more width than height: words, curves and picture stand beside each other.
    const float words = beside ? 20.0f * size : 0.0f;
    if (beside) ImGui::BeginChild("Words", {words, height});
    drawState(context, *run);
    if (beside) ImGui::EndChild();
    if (run->curves.empty() && run->preview.empty()) return;
    const bool picture = !run->preview.empty();
    if (beside) ImGui::SameLine();
    const float rest = ImGui::GetContentRegionAvail().x;
    const float plot = beside && picture ? 0.62f * rest : rest;
    ImGui::BeginChild("Curves", {plot, beside ? height : 15.0f * size});
    plot_.draw(context, *run, ImGui::GetContentRegionAvail().y);
    ImGui::EndChild();
    if (!picture) return;
    if (beside) ImGui::SameLine();
    drawPreview(context, *run, beside ? height : 12.0f * size);
}

void TrainingPanel::drawState(StudioContext& context, const RunSnapshot& run) {
    const std::string name = run_.filename().string();
    const float button = 2.0f * (ImGui::GetFrameHeight() + ImGui::GetStyle().ItemSpacing.x);
    ImGui::AlignTextToFramePadding();
    ImGui::TextUnformatted(fitted(name, ImGui::GetContentRegionAvail().x - button, true).c_str());
    const std::string where =
        fmt::format("{}\n{}{}", run_.string(), run.capture.empty() ? "" : "learns from " + run.capture,
                    run.preset.empty() ? "" : ", preset " + run.preset);
    ui::help(context, where.c_str());
    ImGui::SameLine(ImGui::GetCursorPosX() + ImGui::GetContentRegionAvail().x - button +
                    ImGui::GetStyle().ItemSpacing.x);
    if (toolButton(icon::kFolder, "Open run. Follows a run folder, also one that another program works on"))
        askForRun(context);
    ImGui::SameLine();
    if (toolButton(icon::kClose, "Leave run. It goes on; the panel no longer follows it")) {
        follow(context, {});
        return;
    }
    // First, so that a low panel still has them.
    drawButtons(context, run);
    if (!run.error)
        drawNumbers(context, run);
    else if (starts_.works(run_))
        ui::hint("Starting ...");
    else if (discarded_ == run_ && std::chrono::steady_clock::now() - discardedAt_ < kDeleting)
        ui::hint("Deleting ...");
    else
        badText(run.error->describe());
    // Where the status says what was wrong, the log says it again.
    if (run.status.error.empty()) badText(starts_.said(run_));
}

void TrainingPanel::drawNumbers(StudioContext& context, const RunSnapshot& run) {
    const RunStatus& status = run.status;
    ImGui::TextColored(colorOf(status.state), "%s", wordsOf(runStateName(status.state)).c_str());
    ui::help(context, run.owned ? fmt::format("Process {} on {} works on it.", status.process, status.host).c_str()
                                : "No process works on it now.");
    if (!status.stage.empty()) {
        ImGui::SameLine();
        ImGui::TextColored(mutedColor(), "stage %s", status.stage.c_str());
    }
    const double done =
        status.totalSteps > 0 ? static_cast<double>(status.step) / static_cast<double>(status.totalSteps) : 0.0;
    const std::string steps = fmt::format("step {} of {}", status.step, status.totalSteps);
    ImGui::ProgressBar(static_cast<float>(std::clamp(done, 0.0, 1.0)), {-1.0f, 0.0f}, steps.c_str());
    if (run.owned && status.state == RunState::Running && status.stepMs > 0.0) {
        numberText(context,
                   fmt::format("{:.2f} s a step, {} left", status.stepMs / 1000.0, durationText(status.etaS)).c_str());
    }
    if (run.owned && status.memoryBytes > 0) {
        numberText(context, fmt::format("memory {}, at most {}", formatBytes(status.memoryBytes),
                                        formatBytes(status.peakMemoryBytes))
                                .c_str());
    }
    if (const auto total = status.losses.find("total"); total != status.losses.end()) {
        numberText(context, fmt::format("loss {:.5g}", total->second).c_str());
    }
    if (!run.checkpoints.empty()) {
        numberText(context, fmt::format("newest checkpoint: step {}", run.checkpoints.back().step).c_str());
    }
    badText(status.error);
    if (!status.note.empty()) ui::hint(status.note.c_str());
    if (run.brokenLines > 0) ui::hint(fmt::format("{} broken lines in the metrics", run.brokenLines).c_str());
}

void TrainingPanel::drawButtons(StudioContext& context, const RunSnapshot& run) {
    const RunState state = run.status.state;
    const bool starting = starts_.works(run_) && !run.owned;
    const bool waits = run.owned && state == RunState::Paused;
    const bool works = run.owned && (state == RunState::Running || state == RunState::Loading);
    const bool ended = !run.owned && !starting && !run.error;
    bool first = true;
    const auto button = [&](const char* symbol, const char* label, bool enabled, const char* tooltip) {
        if (!std::exchange(first, false)) sameLineIfFits(buttonWidth(fmt::format("{}  {}", symbol, label).c_str()));
        ImGui::BeginDisabled(!enabled);
        const bool clicked = iconButton(symbol, label);
        ImGui::EndDisabled();
        ui::help(context, tooltip);
        return clicked;
    };
    if (waits || ended) {
        if (button(icon::kPlay, "Resume", true,
                   waits ? "Goes on with the next step"
                         : "Goes on from the newest checkpoint, in a process of its own")) {
            if (waits)
                request(context, RunRequest::Resume, "Resuming the run");
            else
                start(context, {run_, {}, {}, {}, true});
        }
    } else if (button(icon::kPause, "Pause", works, "Saves a checkpoint and waits; memory stays taken")) {
        request(context, RunRequest::Pause, "Pausing the run");
    }
    if (button(icon::kSave, "Save", works, "Writes a checkpoint now and goes on"))
        request(context, RunRequest::Save, "Saving a checkpoint");
    if (button(icon::kStop, "Stop", works || waits, "Writes a checkpoint and ends the process; Resume goes on from it"))
        request(context, RunRequest::Stop, "Stopping the run");
    if (button(icon::kDelete, "Discard", works || waits, "Ends the process and deletes the run folder; asks first"))
        discarding_ = !discarding_;
    if (button(icon::kPerson, "Open avatar", !run.checkpoints.empty(),
               "Shows the newest checkpoint as the avatar, with its learned radii")) {
        context.session.openAs(run_, FileRole::Avatar);
    }
    discarding_ = discarding_ && (works || waits);
    if (discarding_) drawDiscard(context);
}

/// Asked within the panel: the window stays usable, and the run goes on meanwhile.
void TrainingPanel::drawDiscard(StudioContext& context) {
    badText("Deletes " + run_.filename().string() + " with its checkpoints, previews and numbers.");
    if (ImGui::Button("Delete run")) {
        request(context, RunRequest::Discard, "Discarding the run");
        discarding_ = false;
        discarded_ = run_;
        discardedAt_ = std::chrono::steady_clock::now();
    }
    ImGui::SameLine();
    if (ImGui::Button("Keep it")) discarding_ = false;
}

void TrainingPanel::drawPreview(StudioContext& context, const RunSnapshot& run, float height) {
    const auto get = [&context](Preview& preview) {
        if (!preview.picture) return PictureCache::Shown();
        return preview.picture->get(context.session, preview.file.string(),
                                    [file = preview.file](const ProgressFunction&) { return readImageFile(file); });
    };
    if (run.preview != shown_.file && run.preview != coming_.file) {
        coming_ = {run.preview, std::make_unique<PictureCache>()};
    }
    // The last one stays until the next is there.
    if (coming_.picture && get(coming_).texture) shown_ = std::exchange(coming_, {});
    const PictureCache::Shown shown = get(shown_);
    if (!shown.texture) return;
    const float wide = ImGui::GetContentRegionAvail().x;
    const auto width = static_cast<float>(shown.texture->width()), tall = static_cast<float>(shown.texture->height());
    const float scale = std::min(wide / width, height / tall);
    ImGui::Image(textureOf(*shown.texture), {scale * width, scale * tall});
    if (!ImGui::BeginItemTooltip()) return;
    const ImVec2 room = ImGui::GetMainViewport()->WorkSize;
    const float larger = std::min({0.9f * room.x / width, 0.8f * room.y / tall, 2.0f * context.scale});
    ImGui::TextUnformatted(shown_.file.filename().string().c_str());
    ImGui::Image(textureOf(*shown.texture), {larger * width, larger * tall});
    ImGui::EndTooltip();
}

// ---- starting

void TrainingPanel::suggestRun(const StudioContext& context) {
    TrainingForm& form = *form_;
    if (form.capture.empty() || (!form.run.empty() && form.run != form.suggestedRun)) return;
    fs::path capture = form.capture;
    if (!capture.has_filename()) capture = capture.parent_path();
    if (capture.extension() == ".json") capture = capture.parent_path();
    const auto known = context.settings.folders.find(kRuns);
    const char* home = std::getenv("HOME");
    const fs::path runs = known != context.settings.folders.end() ? fs::path(known->second)
                          : home && *home                         ? fs::path(home) / "ars-runs"
                                                                  : fs::temp_directory_path() / "ars-runs";
    const std::string preset = kPresets[static_cast<std::size_t>(form.preset)].name;
    form.run = form.suggestedRun = freeName(runs / (capture.filename().string() + "-" + preset)).string();
}

void TrainingPanel::drawFolder(StudioContext& context, const char* label, const char* tooltip,
                               std::string TrainingForm::* field, const char* key) {
    rowLabel(label, tooltip);
    const float button = ImGui::GetFrameHeight() + ImGui::GetStyle().ItemInnerSpacing.x;
    ImGui::SetNextItemWidth(-button);
    if (ImGui::InputText(fmt::format("###{}", label).c_str(), &((*form_).*field))) suggestRun(context);
    ui::help(context, tooltip);
    ImGui::SameLine(0.0f, ImGui::GetStyle().ItemInnerSpacing.x);
    ImGui::PushID(label);
    if (toolButton(icon::kFolder, "Choose folder. Opens a dialog")) {
        FileQuestion question;
        question.title = label;
        question.folder = true;
        question.folderKey = key;
        question.chosen = [form = form_, field](const fs::path& path) {
            (*form).*field = path.string();
            if (field == &TrainingForm::capture && form->run == form->suggestedRun) form->run.clear();
        };
        context.studio.ask(std::move(question));
    }
    ImGui::PopID();
}

void TrainingPanel::drawForm(StudioContext& context) {
    TrainingForm& form = *form_;
    if (form.run.empty()) suggestRun(context);
    drawFolder(context, "Capture",
               "The capture to learn from: an AvatarReX, THuman4 or ActorsHQ subject as it was downloaded.",
               &TrainingForm::capture, kCaptures);
    drawFolder(context, "Run", "The new folder that everything of this training goes into.", &TrainingForm::run, kRuns);
    std::array<Choice, kPresets.size()> presets;
    for (std::size_t i = 0; i < kPresets.size(); ++i) presets[i] = {kPresets[i].name, kPresets[i].help};
    if (const auto clicked = choiceButtons(context, "Preset", presets, form.preset)) {
        form.preset = *clicked;
        suggestRun(context);
    }
    drawSettings(context, "Other values than the preset's, one \"name=value\" a line: schedule.radiance_steps=2000. "
                          "`ars train --help-parameters` lists all names.");
    const fs::path folder = form.run.empty() ? fs::path() : fs::absolute(form.run).lexically_normal();
    ImGui::BeginDisabled(starts_.starting() || starts_.works(folder) || form.capture.empty() || form.run.empty());
    if (iconButton(icon::kPlay, "Start")) {
        if (auto settings = parseSettingLines(form.settings)) {
            TrainingStart start;
            start.capture = fs::absolute(form.capture).lexically_normal();
            start.run = folder;
            start.preset = kPresets[static_cast<std::size_t>(form.preset)].name;
            start.settings = std::move(*settings);
            this->start(context, start);
        } else {
            context.studio.showError("This cannot be trained", settings.error().describe());
        }
    }
    ImGui::EndDisabled();
    ui::help(context, "Begins in a process of its own, which goes on when the window is closed");
    ImGui::SameLine();
    if (iconButton(icon::kFolder, "Open run")) askForRun(context);
    ui::help(context, "Follows a run folder, also one that another program works on");
}

void TrainingPanel::drawSettings(StudioContext& context, const char* tooltip) {
    rowLabel("Settings", tooltip);
    ImGui::InputTextMultiline("###Settings", &form_->settings, {-1.0f, 2.6f * ImGui::GetTextLineHeight()});
    ui::help(context, tooltip);
}

void TrainingPanel::askForRun(StudioContext& context) {
    FileQuestion question;
    question.title = "Open training run";
    question.folder = true;
    question.folderKey = kRuns;
    question.chosen = [arrived = arrived_](const fs::path& path) { *arrived = path; };
    context.studio.ask(std::move(question));
}

void TrainingPanel::request(StudioContext& context, RunRequest what, const std::string& title) {
    context.session.start(title, [run = run_, what](const ProgressFunction&) { return requestOfRun(run, what); });
}

void TrainingPanel::start(StudioContext& context, const TrainingStart& start) {
    if (start.run == discarded_) discarded_.clear();            // another one under the same name
    if (start.resume) return starts_.start(context, start, {}); // is followed, or was left meanwhile
    starts_.start(context, start, [arrived = arrived_, form = form_, run = start.run] {
        *arrived = run;
        // A name that stood there by itself is taken now: the next run gets another.
        if (form->run == form->suggestedRun && run == fs::path(form->suggestedRun)) form->run.clear();
    });
}

} // namespace

std::unique_ptr<Panel> makeTrainingPanel() { return std::make_unique<TrainingPanel>(); }

} // namespace ars::ui
