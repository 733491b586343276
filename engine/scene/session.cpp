#include "engine/scene/session_state.h"

#include <fmt/format.h>

#include <algorithm>
#include <system_error>
#include <thread>

namespace ars {
namespace {

constexpr auto kGestureRest = std::chrono::milliseconds(150); ///< after the last step of a drag it counts as still

/// Assets for a picture that is written: what is on the screen may be a forerunner.
Result<SceneAssets> wholeAssets(SceneAssets assets, const Document& document, const LightTarget& target,
                                const ProgressFunction& progress) {
    if (!assets.avatar || assets.avatar->coarse) {
        ARS_TRY(assets.avatar, loadAvatarAsset(document.avatar, progress));
    }
    if (!assets.light || assets.light->quality == LightQuality::Draft ||
        assets.light->key != lightKey(document.light)) {
        auto light = loadLightAsset(document.light, target, LightQuality::Exact, progress);
        // A light that is not to be had is stood in for on the screen, and so in the picture of it.
        if (light) assets.light = *light;
        if (!assets.light) return std::move(light).error();
    }
    return assets;
}

} // namespace

std::filesystem::path absolutePath(const std::filesystem::path& path) {
    std::error_code failure;
    const std::filesystem::path absolute = std::filesystem::absolute(path, failure);
    std::filesystem::path normal = (failure ? path : absolute).lexically_normal();
    if (!normal.has_filename() && normal.has_relative_path()) normal = normal.parent_path(); // "folder/"
    return normal;
}

Session::State::State(SessionOptions given)
    : options(std::move(given)), recoveries(findRecoveries(options.stateFolder)), recentFiles(options.stateFolder),
      editor(std::move(options.document)), jobs(std::make_unique<JobRunner>(options.wake)),
      store({options.device, options.lightBase}, *jobs, [this](Notice notice) { notify(std::move(notice)); }),
      worker(options.device, options.wake) {
    if (options.autosave) autosave.emplace(options.stateFolder);
    store.follow(editor.document(), {}); // the first picture cannot come too soon
}

Session::State::~State() { jobs.reset(); }

Session::Session(SessionOptions options) : state_(std::make_unique<State>(std::move(options))) {}
Session::~Session() = default;

// ---- document

const Document& Session::document() const { return state_->editor.document(); }
const Editor& Session::editor() const { return state_->editor; }
const SceneAssets& Session::assets() const { return state_->store.assets(); }

Status Session::State::run(std::string_view id, const Arguments& arguments, std::string_view gesture) {
    if (opensBeside(id, arguments)) {
        const std::string source = arguments.at("source");
        openAvatar(source, source);
        return {};
    }
    CommandContext commandContext = context(timeS());
    const std::uint64_t before = editor.version();
    Status status = editor.run(id, arguments, commandContext, gesture);
    if (!gesture.empty() && editor.version() != before) lastGesture = Clock::now();
    return status;
}

Status Session::run(std::string_view id, const Arguments& arguments, std::string_view gesture) {
    return state_->run(id, arguments, gesture);
}

Status Session::commandEnabled(const Command& command) const {
    if (!command.enabled) return {};
    return command.enabled(state_->editor.document(), state_->context(timeS()));
}

void Session::endGesture() {
    state_->editor.endGesture();
    state_->lastGesture.reset();
}

bool Session::cancelGesture() {
    state_->lastGesture.reset();
    return state_->editor.cancelGesture();
}

bool Session::undo() { return state_->editor.undo(); }
bool Session::redo() { return state_->editor.redo(); }
void Session::travel(std::size_t entries) { state_->editor.travel(entries); }

// ---- projects

void Session::State::stop() {
    asked = false;
    transport.playing = false;
    transport.timeS = editor.document().timeline.timeS;
}

void Session::State::replace(Document document, const std::filesystem::path& project, bool saved) {
    editor.replace(std::move(document), saved);
    projectPath = project;
    lastGesture.reset();
    store.replaceDocument();
    stop();
}

void Session::newProject() { state_->replace(newDocument(), {}, true); }

void Session::replaceDocument(Document document, const std::filesystem::path& project, bool saved) {
    state_->replace(std::move(document), project, saved);
}

void Session::save(const std::filesystem::path& given) {
    const std::filesystem::path path = absolutePath(given);
    Document document = state_->editor.document();
    document.timeline.timeS = timeS();
    auto copy = std::make_shared<const Document>(std::move(document));
    JobRequest job;
    job.title = "Saving " + path.filename().string();
    job.lane = "save";
    job.cancellable = false;
    job.work = [path, copy](const ProgressFunction&) { return saveProject(path, *copy); };
    job.done = [state = state_.get(), path, copy, version = state_->editor.version()](const Status& status) {
        if (!status) {
            const std::string hint = "The project is still open and unsaved; save it under another name or folder.";
            return state->notify(failureNotice("Could not save " + path.filename().string(), status.error(), hint));
        }
        state->editor.markSaved(*copy, version);
        state->projectPath = path;
        state->remember(path);
        state->notify({Notice::Kind::Done, "Saved " + path.filename().string(), path.string(), ""});
    };
    state_->jobs->start(std::move(job));
}

const std::filesystem::path& Session::projectPath() const { return state_->projectPath; }
RecentFiles& Session::recentFiles() { return state_->recentFiles; }
const std::filesystem::path& Session::trainingRun() const { return state_->trainingRun; }
std::uint64_t Session::trainingRunsOpened() const { return state_->trainingRunsOpened; }
std::vector<Recovery> Session::recoveries() const { return state_->recoveries; }

// ---- jobs

std::vector<JobStatus> Session::jobs() const { return state_->jobs->list(); }
void Session::cancel(std::uint64_t job) { state_->jobs->cancel(job); }

std::uint64_t Session::start(std::string title, std::function<Status(const ProgressFunction&)> work,
                             std::function<void(const Status&)> done, bool quiet) {
    JobRequest job;
    job.title = title;
    job.work = std::move(work);
    job.listed = !quiet;
    job.done = [state = state_.get(), title = std::move(title), done = std::move(done), quiet](const Status& status) {
        if (!status && !quiet && status.error().code == ErrorCode::Cancelled) {
            state->notify({Notice::Kind::Note, "Stopped: " + title, "", ""});
        } else if (!status && !quiet) {
            state->notify(failureNotice("Failed: " + title, status.error()));
        }
        if (done) done(status);
    };
    return state_->jobs->start(std::move(job));
}

namespace {

LightTarget lightTarget(const SessionOptions& options) { return {options.device, options.lightBase}; }

/// Writing a picture or film of the document as it is now.
template <typename Write>
auto writingJob(const Document& document, const SceneAssets& assets, const LightTarget& target, Write write) {
    return [document, assets, target, write](const ProgressFunction& progress) -> Status {
        ARS_TRY(const SceneAssets whole, wholeAssets(assets, document, target, progress));
        return write(document, whole, target.device, progress);
    };
}

} // namespace

std::uint64_t Session::screenshot(const ScreenshotOptions& options) {
    Document document = state_->editor.document();
    document.timeline.timeS = timeS();
    const std::string name = options.file.filename().string();
    const auto write = [options](const Document& d, const SceneAssets& assets, const Device& device,
                                 const ProgressFunction& p) { return writeScreenshot(d, assets, device, options, p); };
    return start("Writing " + name, writingJob(document, assets(), lightTarget(state_->options), write),
                 [state = state_.get(), name, path = options.file.string()](const Status& status) {
                     if (status) state->notify({Notice::Kind::Done, "Wrote " + name, path, ""});
                 });
}

std::uint64_t Session::video(const VideoOptions& options) {
    const std::string name = options.file.filename().string();
    const auto write = [options](const Document& d, const SceneAssets& assets, const Device& device,
                                 const ProgressFunction& p) { return writeVideo(d, assets, device, options, p); };
    return start("Writing " + name, writingJob(document(), assets(), lightTarget(state_->options), write),
                 [state = state_.get(), name, path = options.file.string()](const Status& status) {
                     if (status) state->notify({Notice::Kind::Done, "Wrote " + name, path, ""});
                 });
}

std::vector<Notice> Session::takeNotices() { return std::exchange(state_->notices, {}); }
std::function<void()> Session::waker() const { return state_->options.wake; }
void Session::notify(Notice notice) { state_->notify(std::move(notice)); }

// ---- time

double Session::timeS() const { return state_->timeS(); }
Transport& Session::transport() { return state_->transport; }

void Session::play() {
    const TimelineSection& timeline = state_->editor.document().timeline;
    if (!(timeline.endS > timeline.startS)) return;
    const bool inside = timeline.timeS >= timeline.startS && timeline.timeS < timeline.endS - 1e-6;
    state_->transport = {true, inside ? timeline.timeS : timeline.startS};
}

void Session::pause() {
    if (!state_->transport.playing) return;
    state_->transport.playing = false;
    state_->asked = false;
    const Status status = state_->run("timeline.seek", {{"time", state_->transport.timeS}});
    if (!status) state_->notify(failureNotice("Could not stay at this time", status.error()));
}

bool Session::State::dragging() const {
    return interacting || (lastGesture && Clock::now() - *lastGesture < kGestureRest);
}

bool Session::settled() const { return state_->settled(); }

bool Session::settle(std::chrono::milliseconds timeout) {
    const auto begin = State::Clock::now();
    auto last = begin;
    while (true) {
        const auto now = State::Clock::now();
        update(std::chrono::duration<double>(now - last).count());
        last = now;
        if (settled()) return true;
        if (now - begin > timeout) return false;
        std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
}

} // namespace ars
