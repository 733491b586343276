#include "engine/scene/evaluate.h"
#include "engine/scene/session_state.h"

#include <algorithm>
#include <cmath>

namespace ars {

bool showsTwoSides(ViewLayout layout) {
    return layout == ViewLayout::SideBySide || layout == ViewLayout::Split || layout == ViewLayout::Blink ||
           layout == ViewLayout::Difference;
}

namespace {

/// The buffers that the document itself shows, and those that panels asked for; each once.
std::vector<BufferId> buffersOf(const ViewSection& view, const std::vector<BufferId>& wanted) {
    std::vector<BufferId> buffers{view.buffer};
    if (view.layout == ViewLayout::Strip || view.layout == ViewLayout::Grid) {
        buffers.insert(buffers.end(), view.strip.begin(), view.strip.end());
    }
    if (showsTwoSides(view.layout) && view.compare.kind == CompareKind::Buffer) buffers.push_back(view.compare.buffer);
    buffers.insert(buffers.end(), wanted.begin(), wanted.end());
    std::sort(buffers.begin(), buffers.end());
    buffers.erase(std::unique(buffers.begin(), buffers.end()), buffers.end());
    return buffers;
}

FrameRequest requestFor(const Document& document, const SceneAssets& assets, double timeS, int width, int height) {
    FrameRequest request;
    request.avatar = assets.avatar;
    request.light = assets.light;
    request.inputs = frameInputs(document, assets, timeS, width, height);
    return request;
}

} // namespace

bool Session::State::otherSideSeen() const {
    const ViewSection& view = editor.document().view;
    return showsTwoSides(view.layout) && otherDocument(editor.document()).has_value();
}

void Session::setViewport(int width, int height) {
    if (width == state_->width && height == state_->height) return;
    state_->width = width;
    state_->height = height;
    state_->asked = false;
}

void Session::setWantedBuffers(std::vector<BufferId> buffers) {
    if (buffers == state_->wantedBuffers) return;
    state_->wantedBuffers = std::move(buffers);
    state_->asked = false;
}

void Session::setInteracting(bool interacting) {
    if (interacting == state_->interacting) return;
    state_->interacting = interacting;
    state_->asked = false;
}

std::shared_ptr<const Frame> Session::frame() const { return state_->worker.latest(); }

std::shared_ptr<const Frame> Session::otherFrame() const {
    return state_->otherWorker ? state_->otherWorker->latest() : nullptr;
}

FrameWorker& Session::worker() { return state_->worker; }

void Session::State::advanceTransport(double seconds) {
    const TimelineSection& timeline = editor.document().timeline;
    if (!transport.playing) {
        transport.timeS = timeline.timeS;
        return;
    }
    asked = false;
    const double length = timeline.endS - timeline.startS;
    double time = transport.timeS + std::max(0.0, seconds) * timeline.speed;
    const bool ended = !(length > 0.0) || time >= timeline.endS;
    if (ended && timeline.loop && length > 0.0) {
        time = timeline.startS + std::fmod(time - timeline.startS, length);
    } else if (ended) {
        time = std::max(timeline.startS, timeline.endS);
    }
    transport.timeS = std::max(time, timeline.startS);
    if (!ended || (timeline.loop && length > 0.0)) return;
    transport.playing = false; // at the end, where it stays
    const Status status = run("timeline.seek", {{"time", transport.timeS}});
    if (!status) notify(failureNotice("Could not stay at the end", status.error()));
}

void Session::State::dropOtherWorker() {
    if (!otherWorker) return;
    JobRequest job; // its end waits for a frame
    job.title = "Ending a comparison";
    job.listed = false;
    job.work = [worker = std::shared_ptr<FrameWorker>(std::move(otherWorker))](const ProgressFunction&) mutable {
        worker.reset();
        return Status();
    };
    jobs->start(std::move(job));
}

void Session::State::askForFrames() {
    const SceneAssets& assets = store.assets();
    if (!assets.avatar || width < 1 || height < 1) return;
    asked = true;
    const Document& document = editor.document();
    FrameRequest request = requestFor(document, assets, timeS(), width, height);
    request.buffers = buffersOf(document.view, wantedBuffers);
    // What is shown of forerunners soon makes place for the real thing, which gets the processor meanwhile.
    const bool forerunners = assets.avatar->coarse || (assets.light && assets.light->quality == LightQuality::Draft);
    request.moving = moving() || forerunners;
    request.parts = document.view.parts || document.view.selectedPart >= 0;
    request.surfels = document.view.surfelDiscs;

    const std::optional<Document> other = otherSideSeen() ? otherDocument(document) : std::nullopt;
    if (!other) {
        dropOtherWorker();
    } else if (assets.otherAvatar) {
        if (!otherWorker) otherWorker = std::make_unique<FrameWorker>(options.device, options.wake);
        SceneAssets otherAssets = assets;
        otherAssets.avatar = assets.otherAvatar;
        otherAssets.light = assets.otherLight;
        FrameRequest otherRequest = requestFor(*other, otherAssets, timeS(), width, height);
        otherRequest.buffers = {document.view.buffer};
        otherRequest.moving = request.moving;
        otherWorker->submit(std::move(otherRequest));
    }
    worker.submit(std::move(request));
}

void Session::State::reportFailures() {
    std::optional<Error> error = worker.takeError();
    if (!error && otherWorker) error = otherWorker->takeError();
    // A drag must not say the same sixty times a second.
    if (error && (error->describe() != frameError || worker.latest() != errorFrame)) {
        frameError = error->describe();
        errorFrame = worker.latest();
        notify(failureNotice("Could not draw the picture", *error));
    }
    if (!autosave) return;
    if (const std::optional<Error> unsaved = autosave->takeError()) {
        notify(failureNotice("Could not autosave", *unsaved, "Save the project yourself, in another folder."));
    }
}

void Session::update(double secondsSinceLast) {
    State& state = *state_;
    state.jobs->pump();
    state.advanceTransport(secondsSinceLast);
    const State::Seen now{state.editor.version(), state.store.version(), state.dragging(), state.otherSideSeen()};
    if (!state.seen || !(*state.seen == now)) {
        state.store.follow(state.editor.document(), {now.dragging, now.other});
        state.seen = now;
        state.seen->assets = state.store.version();
        state.asked = false;
    }
    if (!state.asked) state.askForFrames();
    if (now.dragging && !state.interacting) state.jobs->wakeAfter(std::chrono::milliseconds(160)); // to see its end
    if (state.autosave) state.autosave->update(state.editor.document(), state.editor.version(), state.projectPath);
    state.reportFailures();
}

bool Session::State::settled() const {
    const bool current = seen && seen->document == editor.version() && seen->assets == store.version() &&
                         seen->dragging == dragging() && seen->other == otherSideSeen();
    const bool nothingToAsk = width < 1 || height < 1 || !store.assets().avatar;
    if (!current || !(asked || nothingToAsk) || moving() || !store.complete() || jobs->busy()) return false;
    return worker.idle() && (!otherWorker || otherWorker->idle());
}

} // namespace ars
